# Copyright 2026 The sparse_coord_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Forgeries beyond the messages of each time step: displays, repeats, counts, times."""

import random

import numpy as np
import pytest
from diagnostic_msgs.msg import DiagnosticStatus
from nav_msgs.srv import GetPlan
from rclpy.serialization import deserialize_message, serialize_message
from recordings import each, with_tables
from std_msgs.msg import String

from sparse_coord_ros.base.errors import BagError
from sparse_coord_ros.base.version import FORMAT
from sparse_coord_ros.log.bags import BagWriter, QoS
from sparse_coord_ros.log.bags.reader import open_bag
from sparse_coord_ros.log.bags.recover import recover
from sparse_coord_ros.log.runlog import read_run, verify
from sparse_coord_ros.log.runlog.difference import NOTHING_TO_LEARN, TWICE
from sparse_coord_ros.log.runlog.explain import coordinations, explained
from sparse_coord_ros.log.runlog.verify import UNLEARNED
from sparse_coord_ros.protocol.wire.messages import ACTION_FORM
from sparse_coord_ros.ros.nodes.messages import Converter

EVENT = "/robot_2/active_perception/_service_event"
SHOWN = {
    "/map": "map",
    "/markers": "markers",
    "/robot_1/coordination_map": "coordination_map",
}


def quantities(found):
    return {one.quantity.split()[0] for one in found.differences}


def places(messages, topic):
    return [place for place, one in enumerate(messages) if one.topic == topic]


# What is shown.


@pytest.mark.parametrize(
    ("topic", "how"),
    [
        *((topic, "changed") for topic in SHOWN),
        ("/map", "swapped in place"),
        ("/markers", "swapped"),
    ],
)
def test_what_is_shown_as_an_episode_begins(alter, topic, how):
    def change(messages):
        of = places(messages, topic)
        mine = of[len(of) // 2]
        other = next(
            p for p in of[len(of) // 2 + 1 :] if messages[p].data != messages[mine].data
        )
        one = messages[mine]
        two = messages[other]
        if how == "changed":
            data = bytearray(one.data)
            at = len(data) // 2 if topic == "/markers" else len(data) - 12
            data[at : at + 4] = bytes(byte ^ 0x64 for byte in data[at : at + 4])
            messages[mine] = one._replace(data=bytes(data))
        elif how == "swapped":
            messages[mine] = two
            messages[other] = one
        else:
            messages[mine] = one._replace(data=two.data)
            messages[other] = two._replace(data=one.data)
        return messages

    found = alter(change)
    names = (topic, SHOWN[topic])
    odd = [
        one for one in found.differences if any(name in one.quantity for name in names)
    ]
    assert odd, found.differences


def test_a_coordination_map_that_shows_another_table(alter):
    """A further cell with COORDINATE, in mid-run."""

    def change(messages):
        mine = places(messages, "/robot_1/coordination_map")[-3]
        data = bytearray(messages[mine].data)
        free = [at for at in range(len(data) - 40, len(data)) if data[at] == 0]
        data[free[-1]] = 100
        messages[mine] = messages[mine]._replace(data=bytes(data))
        return messages

    found = alter(change)
    assert found.first.quantity == "coordination_map" and found.first.robot == "robot_1"
    assert "COORDINATE in cells" in found.first.logged


# Said twice.


@pytest.mark.parametrize("name", ["run.yaml", "scenario.yaml", "map.txt"])
def test_an_attachment_twice(alter, name):
    found = alter(attach=lambda all: [*all, next(a for a in all if a.name == name)])
    [difference] = found.differences
    assert difference[2:4] == (f"attachment {name}", TWICE)


def test_a_second_run(alter):
    def change(messages):
        data = next(m for m in messages if m.topic == "/run").data.replace(
            b"seed: 7", b"seed: 8"
        )
        return [*messages, messages[-1]._replace(topic="/run", data=data)]

    found = [one[2:4] for one in alter(change).differences]
    assert ("topic run", TWICE) in found


def test_a_second_metadata_record(good, tmp_path):
    source = open_bag(good.bag)
    with BagWriter(tmp_path / "bag") as bag:
        bag.add_metadata(
            "sparse_coord_ros", {"scenario": "other", "format": str(FORMAT)}
        )
        bag.add_metadata("sparse_coord_ros", dict(source.metadata["sparse_coord_ros"]))
        bag.attach("run.yaml", source.attachments[0].data, "application/yaml")
    found = [one[2:4] for one in verify(tmp_path / "bag").differences]
    assert ("metadata sparse_coord_ros", TWICE) in found
    assert ("metadata scenario", "'other'") in found


def test_a_table_twice(alter):
    found = alter(attach=lambda all: [*all, all[-1]])
    assert [one.quantity for one in found.differences] == ["tables"]
    assert found.first.logged == TWICE


@pytest.mark.parametrize("key", ["seed", "version_numpy"])
def test_the_metadata_record(alter, key):
    found = alter(record={key: "other"})
    assert [one.quantity for one in found.differences] == [f"metadata {key}"]


def test_bags_of_something_else(tmp_path):
    text = String(data="a: 1\nseed: 2\n")
    cases = {
        "two": [("/a/run", "std_msgs/msg/String"), ("/b/run", "std_msgs/msg/String")],
        "one": [("/a/run", "std_msgs/msg/String")],
        "type": [("/foo/run", "std_msgs/msg/UInt8MultiArray")],
    }
    for name, topics in cases.items():
        with BagWriter(tmp_path / name) as bag:
            for topic, kind in topics:
                bag.write(
                    bag.add_topic(topic, kind, QoS()), serialize_message(text), 0, 0
                )
        with pytest.raises(BagError, match="is not a bag of this package") as caught:
            read_run(tmp_path / name)
        assert "\n" not in str(caught.value)


# Counted and timed.


@pytest.mark.parametrize(
    ("name", "change"),
    [
        ("answered", {"answered": 1}),
        ("refused", {"refused": -1, "late": 1}),
        ("late", {"late": 1}),
        ("dropped", {"dropped": 77}),
        ("repeated", {"repeated": 5}),
        ("learned", {"learned": -1}),
        ("learned", {"learned": 1}),
    ],
)
def test_each_count_beside_the_tables(alter, name, change):
    def more(tables, counts):
        for key, number in change.items():
            counts[key] += number

    def attach(found):
        places = [
            p for p, one in enumerate(found) if one.name.startswith("tables/robot_1_")
        ]
        place = places[1] if name == "learned" else places[-1]
        found[place] = with_tables(found[place], 1, more)
        return found

    found = alter(attach=attach)
    assert found.first.quantity == f"tables count {name}", found.differences


@pytest.mark.parametrize(
    ("key", "value", "said"),
    [
        ("left_out", "3", "3 robots' steps left out"),
        ("transitions", "7", "'learning'"),
        ("began", "reset", "episode began: reset"),
    ],
)
def test_what_the_world_says_of_itself(alter, key, value, said):
    first = alter(last_status(key, value)).first
    assert (first.quantity, first.logged) == ("status", said)


def last_status(key, value):
    """Return a change of a value in the last status."""

    def change(status):
        (pair,) = [pair for pair in status.values if pair.key == key]
        assert pair.value != value
        pair.value = value

    return each("/status", DiagnosticStatus, change, slice(-1, None))


def test_a_world_that_takes_back_how_often_it_went_on_without_a_robot(
    record, rewritten, tmp_path
):
    """Between the two statuses no robot was left out, so the difference names none."""
    run = record(late=[(0, step) for step in range(30, 160)])
    assert run.recording.world.left_out > 1
    first = verify(
        rewritten(run.bag, tmp_path / "bag", last_status("left_out", "1"))
    ).first
    assert (first.quantity, first.logged) == ("status", "1 robots' steps left out")


def test_a_status_of_another_type(good, tmp_path):
    with BagWriter(tmp_path / "bag") as bag:
        source = open_bag(good.bag)
        channels = {
            topic.name: bag.add_known_topic(topic)
            for topic in source.topics.values()
            if topic.name != "/status"
        }
        channels["/status"] = bag.add_topic("/status", "std_msgs/msg/String", QoS())
        for name, texts in source.metadata.items():
            if name != "rosbag2":
                bag.add_metadata(name, texts)
        for one in source.messages():
            data = (
                serialize_message(String(data="a"))
                if one.topic == "/status"
                else one.data
            )
            bag.write(channels[one.topic], data, one.log_time_ns, one.publish_time_ns)
    found = verify(tmp_path / "bag")
    assert "topic /status" in {one.quantity for one in found.differences}


def test_a_robot_that_learns_before_it_has_acted(alter):
    def change(messages):
        place = places(messages, "/robot_1/action")[0]
        numbers = list(ACTION_FORM.layout.unpack(messages[place].data))
        assert numbers[-1] == 0.0
        data = ACTION_FORM.layout.pack(*numbers[:-1], 1.0)
        messages[place] = messages[place]._replace(data=data)
        return messages

    first = alter(change).first
    assert (first.step, first.robot, first.quantity) == (1, "robot_1", "action")
    assert (first.logged, first.computed) == ("learned=1", NOTHING_TO_LEARN)


def test_a_reward_of_a_robot_that_has_arrived(good, alter):
    log = read_run(good.bag)
    goals = [robot.goal for robot in log.run.scenario.robots]
    alone = (log.cells[:, 0] == goals[0]) & (log.action[:, 1] >= 0)
    row = int(np.flatnonzero(alone)[0])
    step = int(log.step[row])

    def change(messages):
        period = Converter(log.run).period
        (place,) = [
            place
            for place in places(messages, "/robot_2/reward")
            if messages[place].log_time_ns // period == step
        ]
        messages.insert(place, messages[place]._replace(topic="/robot_1/reward"))
        return messages

    first = alter(change).first
    assert (first.step, first.robot, first.quantity) == (step, "robot_1", "reward")
    assert "arrived" in first.computed


@pytest.mark.parametrize(
    ("topic", "which"),
    [
        ("/robot_1/reward", "log_time_ns"),
        ("/status", "log_time_ns"),
        (EVENT, "log_time_ns"),
        ("/markers", "publish_time_ns"),
    ],
)
def test_times_of_the_log(alter, topic, which):
    def change(messages):
        of = places(messages, topic)
        mine = of[len(of) // 2]
        changed = {which: getattr(messages[mine], which) + 5}
        messages[mine] = messages[mine]._replace(**changed)
        return messages

    found = alter(change)
    assert {one.quantity for one in found.differences} == {f"log_time of {topic}"}


def test_swapped_service_events(alter):
    """Of one writer, of one kind: their clocks tell."""

    def change(messages):
        of = [
            place
            for place in places(messages, EVENT)
            if deserialize_message(messages[place].data, GetPlan.Event).info.event_type
            == 0
        ]
        one = of[3]
        two = of[4]
        data = messages[one].data, messages[two].data
        messages[one] = messages[one]._replace(data=data[1])
        messages[two] = messages[two]._replace(data=data[0])
        return messages

    found = alter(change)
    assert "dialogue" in quantities(found)
    assert any("younger" in one.logged for one in found.differences)


@pytest.mark.parametrize(
    ("frame", "sec", "ahead"), [("odom", 5, 0), ("map", 0, 0), ("map", 0, 99)]
)
def test_what_a_person_asks_may_be_anything(alter, good, frame, sec, ahead):
    """The log keeps neither it nor its answer, with any frame, stamp or clock."""

    def change(messages):
        _, received, answered, *_ = places(messages, EVENT)
        asked, answer = (
            deserialize_message(messages[place].data, GetPlan.Event)
            for place in (received, answered)
        )
        asked.info.stamp = answer.info.stamp
        asked.info.stamp.sec += ahead
        header = asked.request[0].start.header
        header.frame_id = frame
        header.stamp.sec = sec
        header.stamp.nanosec = 0
        for event in (answer, asked):
            event.info.client_gid[0] = 77
            person = messages[answered]._replace(data=serialize_message(event))
            messages.insert(answered + 1, person)
        return messages

    found = alter(change)
    assert found.same, found.first
    assert len(found.log.requests) == len(read_run(good.bag).requests)


# Attachments.


@pytest.mark.parametrize("step", ["9" * 5000, "²", "-1", "", "00"])
def test_a_table_of_no_step(alter, step):
    found = alter(
        attach=lambda all: [*all, all[-1]._replace(name=f"tables/robot_1_{step}.npz")]
    )
    (one,) = found.differences
    assert one.logged == "of no robot of the run" and len(str(one)) < 200


# Recovered.


def test_what_was_recovered_is_judged_up_to_where_it_broke_off(good, tmp_path):
    data = open_bag(good.bag).path.read_bytes()
    draw = random.Random(5)
    parts = set()
    for number in range(3):
        cut = tmp_path / str(number) / "cut_0.mcap.partial"
        cut.parent.mkdir()
        cut.write_bytes(data[: draw.randrange(len(data) // 20, len(data))])
        found = verify(recover(cut).path)
        assert found.undecided, found.differences
        assert found.unknown[-1].last is None
        parts.add(found.steps)
    assert len(parts) > 1


# Explained.


def test_explain_knows_what_a_left_out_robot_has_not_learned(record):
    deaf = [(0, 50), (0, 51), (1, 100), (2, 220)]
    run = record("env2-4r", {"perception": "probability:0.5"}, deaf=deaf)
    log = read_run(run.bag)
    found = [one for k in range(4) for one in explained(log, k, coordinations(log, k))]
    assert verify(run.bag).notes[UNLEARNED] > 0
    assert all(one is not None and one.agrees and one.doubt is None for one in found)
    [last] = explained(log, 0, coordinations(log, 0)[-1:])
    own = run.recording.robots[0].agent.tables
    entry, _, after = last.update.star
    assert own.q_star[entry] == after or last.step < log.step[-20]


def test_explain_says_what_it_cannot_know(good, rewritten, tmp_path):
    def better(tables, counts):
        tables["q_star"][3, 2] += 1.0

    def attach(found):
        place = next(
            p for p, one in enumerate(found) if one.name == "tables/robot_1_0.npz"
        )
        found[place] = with_tables(found[place], 1, better)
        return found

    log = read_run(rewritten(good.bag, tmp_path / "bag", attach=attach))
    right = read_run(good.bag)
    step = coordinations(log, 0)[5]
    [told] = explained(log, 0, [step])
    [known] = explained(right, 0, [step])
    assert "tables q_star[3, 2]" in told.doubt and known.doubt is None
    assert told.q_values == known.q_values
