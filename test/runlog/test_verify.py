# Copyright 2026 The sparse_coord_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Changed numbers differ, missing messages leave a log undecided; honest faults do neither."""

import math
import random

import numpy as np
import pytest
from geometry_msgs.msg import PoseStamped
from nav_msgs.msg import Path
from rclpy.serialization import deserialize_message, serialize_message
from recordings import chunks_in, rolled_back, with_tables
from sensor_msgs.msg import JointState
from std_msgs.msg import UInt8MultiArray
from teams import tables_equal

from sparse_coord_ros.core.game.actions import ACTIONS
from sparse_coord_ros.core.game.world import Action, Reward
from sparse_coord_ros.log.bags import open_bag
from sparse_coord_ros.log.bags.playlist import Playlist
from sparse_coord_ros.log.runlog import read_run, verify
from sparse_coord_ros.log.runlog.explain import coordinations, explained, in_words
from sparse_coord_ros.protocol.wire import ACTION, PerceptEnd
from sparse_coord_ros.protocol.wire.messages import ACTION_FORM, POSE_FORM, REWARD_FORM
from sparse_coord_ros.protocol.wire.published_tables import read_tables
from sparse_coord_ros.ros.nodes.ros_messages import cell_path, messages_of

TYPES = {
    "local_state": PoseStamped,
    "reward": JointState,
    "action": JointState,
    "percept": Path,
}
TOPICS = tuple(TYPES)
HALF = {"perception": "probability:0.5"}


@pytest.fixture(scope="module")
def convert(good):
    return messages_of(good.run)


@pytest.fixture(scope="module")
def log(good):
    return read_run(good.bag)


@pytest.fixture(scope="module")
def asked(log):
    """Return the first steps after 50 at which robot_1's percept succeeds, and fails."""
    mine = log.asked[:, 0] & (log.step > 50)
    succeeded = log.step[mine & log.perceived[:, 0]]
    failed = log.step[mine & ~log.perceived[:, 0]]
    return int(succeeded[0]), int(failed[0])


@pytest.fixture(scope="module")
def moved(log):
    """Return a step after 120 at which robot_2 moves, in mid-episode, both being under way."""
    for t in range(len(log.step) - 1):
        under_way = (log.action[t] >= 0).all() and (log.action[t + 1] >= 0).all()
        if log.step[t] > 120 and under_way and not log.asked[t].any():
            if (
                log.cells[t, 1] != log.cells[t + 1, 1]
                and log.step[t + 1] == log.step[t] + 1
            ):
                return int(log.step[t])
    raise AssertionError


def place_of(messages, topic, step, convert):
    """Return the place of the only message of a topic and time step."""
    said = ((m.topic, m.log_time_ns // convert.period) for m in messages)
    (place,) = [place for place, one in enumerate(said) if one == (topic, step)]
    return place


def on(topic, step, convert, data):
    """Return a change of the message of a topic and time step; data: bytes from bytes."""

    def change(messages):
        place = place_of(messages, topic, step, convert)
        messages[place] = messages[place]._replace(data=data(messages[place].data))
        return messages

    return change


def is_first(found, step, robot, quantity):
    assert not found.same
    first = found.first
    assert (first.step, first.robot) == (step, robot), str(first)
    assert first.quantity.startswith(quantity), str(first)
    assert str(first).count("\n") == 0


# Good logs.


@pytest.mark.parametrize(
    ("name", "settings", "values"),
    [
        ("env1", HALF, {}),
        ("env1", {"perception": "range:2"}, {}),
        ("env2-4r", HALF, {}),
        ("crowd-3r", {**HALF, "peers": "all", "steps": 200}, {}),
        ("env1", {}, {"learner": "noncoop"}),
        ("env1", {**HALF, "starts": "random", "max_steps": 7}, {"checkpoint": 0}),
    ],
)
def test_a_good_log_is_identical(record, name, settings, values):
    run = record(name, settings, values=values)
    found = verify(run.bag)
    assert found.same, found.first
    assert found.steps == run.run.scenario.steps
    assert found.choices == found.updates > found.steps
    checkpoints = 0 if values.get("checkpoint") == 0 else found.log.step[-1] // 150
    assert found.tables == len(run.names) * (2 + checkpoints)
    assert not found.notes
    if run.run.learner == "coop":
        ends = set(found.log.column("percept")[found.log.asked].tolist())
        assert ends == {PerceptEnd.ANSWERED, PerceptEnd.REFUSED}


@pytest.mark.parametrize("learner", ["coop", "noncoop", "voi", "cq"])
def test_a_robot_without_peers(record, tmp_path, learner):
    (tmp_path / "one.yaml").write_text("map: env1\nrobots: {x: {start: 1, goal: 2}}\n")
    run = record(str(tmp_path / "one.yaml"), values={"learner": learner})
    found = verify(run.bag)
    assert found.same, found.first
    assert found.tables >= 2


def test_a_learner_that_marks_cells(record, tmp_path):
    (tmp_path / "door.yaml").write_text(
        'map: {name: door, text: "title: door\\n---\\n1.D.2\\n"}\n'
        "robots: {a: {start: 1, goal: 2}, b: {start: 2, goal: 1}}\n"
    )
    settings = {"steps": 1500, "penalty": -50, "epsilon": "constant:0.3", **HALF}
    run = record(str(tmp_path / "door.yaml"), settings, values={"learner": "cq"})
    assert all(
        len(robot.agent.memory()["q_coord_keys"]) for robot in run.recording.robots
    )
    assert verify(run.bag).same
    tables = [robot.agent.tables for robot in run.recording.robots]
    values = {"learner": "cq", "tables": "before", "seed": 8}
    on = record(
        str(tmp_path / "door.yaml"),
        {**settings, "steps": 300},
        values=values,
        tables=tables,
    )
    assert verify(on.bag).same


def test_a_greedy_run_from_tables(record, good):
    tables = [robot.agent.tables for robot in good.recording.robots]
    run = record(
        settings=HALF, values={"greedy": True, "tables": "before"}, tables=tables
    )
    found = verify(run.bag)
    assert found.same, found.first
    assert found.updates == 0 < found.choices


def test_a_run_that_goes_on_from_tables(record, good):
    tables = [robot.agent.tables for robot in good.recording.robots]
    run = record(settings=HALF, values={"tables": "before", "seed": 8}, tables=tables)
    assert verify(run.bag).same
    assert not tables_equal(
        tables, [robot.agent.tables for robot in run.recording.robots]
    )


# Honest faults of runs.


def test_of_an_unfinished_log_the_rest_is_checked(record):
    run = record(settings=HALF, finish=False)
    found = verify(run.bag)
    assert found.difference is None and "it has no end" in found.undecided.why
    assert 0 <= found.log.step[-1] - found.undecided.step < 10
    assert found.steps > 390 and found.tables >= 2 * 3


# Altered logs.


def test_a_rewritten_log_is_still_identical(alter):
    """Although DDS pads serialised messages, such as the map."""

    def change(messages):
        padded = ("/world_simulator/map", "/robot_1/reward")
        return [
            m._replace(data=m.data + b"\0\0" * (m.topic in padded)) for m in messages
        ]

    assert alter(change).same


def test_a_log_whose_topics_come_one_after_the_other_is_identical(alter):
    """As `pymcap-cli rechunk` writes it."""
    assert alter(lambda messages: sorted(messages, key=lambda one: one.topic)).same


@pytest.mark.parametrize(
    ("label", "value", "said"),
    [
        ("individual", math.nextafter(0.0, 1.0), "5e-324"),
        ("total", math.nextafter(0.0, 1.0), "5e-324"),
        ("individual", math.nan, "nan"),
        ("individual", -0.0, "-0.0"),
    ],
)
def test_a_changed_reward(alter, convert, log, moved, label, value, said):
    """NaN differs from itself, -0.0 equals 0.0: bits are compared, not numbers."""
    assert log.rewards[log.step == moved, 1].tolist()[0][0] == 0.0

    def data(old):
        reward = Reward(*REWARD_FORM.layout.unpack(old)[2:])
        return convert.pack_reward(moved, reward._replace(**{label: value}))

    found = alter(on("/robot_2/reward", moved, convert, data))
    is_first(found, moved, "robot_2", "reward")
    assert f"{label}={said}" in found.first.logged


def test_a_changed_state(alter, convert, log, moved):
    row = int(np.flatnonzero(log.step == moved)[0])
    other = int(log.cells[row, 1] + 1) % len(convert.grid.cells)
    change = on(
        "/robot_2/local_state",
        moved,
        convert,
        lambda old: convert.pack_state(moved, other),
    )
    found = alter(change)
    is_first(found, moved, "robot_2", "local_state")
    assert f"cell {other} " in found.first.logged
    assert f"cell {log.cells[row, 1]} " in found.first.computed


def test_a_state_beside_the_middle_of_its_cell(alter, convert, moved):
    def data(old):
        sec, nanosec, x, y = POSE_FORM.layout.unpack(old)
        return POSE_FORM.layout.pack(sec, nanosec, x + 0.01, y)

    is_first(
        alter(on("/robot_2/local_state", moved, convert, data)),
        moved,
        "robot_2",
        "local_state",
    )


def test_a_changed_move(alter, convert, log, moved):
    row = int(np.flatnonzero(log.step == moved)[0])
    action = Action((int(log.move[row, 1]) + 1) % 4, False, -1, False)
    change = on(
        "/robot_2/action",
        moved,
        convert,
        lambda old: convert.pack_action(moved, action, (0, 1)),
    )
    is_first(alter(change), moved, "robot_2", "action")


@pytest.mark.parametrize("place", [3, 5, 6, 7, 8])
def test_a_changed_number_of_an_action(alter, convert, asked, place):
    def data(old):
        numbers = list(ACTION_FORM.layout.unpack(old))
        numbers[place] += 2.0
        return ACTION_FORM.layout.pack(*numbers)

    found = alter(on("/robot_1/action", asked[0], convert, data))
    is_first(found, asked[0], "robot_1", "")
    assert found.first.quantity in ("action", "percept")


def test_a_changed_percept(alter, convert, log, asked):
    row = int(np.flatnonzero(log.step == asked[0])[0])
    own = int(log.cells[row, 0])
    seen = int(log.percept[row, 0, 1])
    assert seen == log.cells[row, 1]

    def says(*cells):
        message = serialize_message(cell_path(convert, asked[0], cells))
        return on("/robot_1/percept", asked[0], convert, lambda old: message)

    for cells in ((own, (seen + 1) % 21), ((own + 1) % 21, seen), (own,)):
        found = alter(says(*cells))
        is_first(found, asked[0], "robot_1", "percept")


def test_a_percept_that_ought_to_have_failed(alter, convert, log, asked):
    row = int(np.flatnonzero(log.step == asked[1])[0])
    cells = log.cells[row].tolist()
    message = serialize_message(cell_path(convert, asked[1], cells))
    found = alter(on("/robot_1/percept", asked[1], convert, lambda old: message))
    is_first(found, asked[1], "robot_1", "percept")
    assert found.first.computed == "refused"


def test_an_answered_percept_that_is_said_to_be_refused(alter, convert, log, asked):
    """The draw of that step says that the percept succeeds."""
    row = int(np.flatnonzero(log.step == asked[0])[0])
    own = serialize_message(cell_path(convert, asked[0], log.cells[row, :1].tolist()))

    def action(old):
        numbers = list(ACTION_FORM.layout.unpack(old))
        numbers[2 + ACTION.column("perceived")] = 0.0
        numbers[2 + ACTION.column("percept")] = float(PerceptEnd.REFUSED)
        return ACTION_FORM.layout.pack(*numbers)

    def change(messages):
        messages = on("/robot_1/percept", asked[0], convert, lambda old: own)(messages)
        return on("/robot_1/action", asked[0], convert, action)(messages)

    found = alter(change)
    is_first(found, asked[0], "robot_1", "percept")
    assert found.first[3:] == ("refused", "answered")


@pytest.mark.parametrize("end", [PerceptEnd.ANSWERED, PerceptEnd.NOBODY_TO_ASK])
def test_a_percept_that_ended_without_having_begun(alter, convert, moved, end):
    """A robot that does not choose COORDINATE has no percept to end."""

    def data(old):
        numbers = list(ACTION_FORM.layout.unpack(old))
        assert numbers[2 + ACTION.column("percept")] == PerceptEnd.DID_NOT_ASK
        numbers[2 + ACTION.column("percept")] = float(end)
        return ACTION_FORM.layout.pack(*numbers)

    found = alter(on("/robot_2/action", moved, convert, data))
    is_first(found, moved, "robot_2", "percept")
    assert (found.first.logged, found.first.computed) == (end.words, "did not ask")


@pytest.mark.parametrize("topic", TOPICS)
@pytest.mark.parametrize(
    ("how", "same"), [("doubled", True), ("doubled by another", False)]
)
def test_a_message_of_a_step_that_comes_twice(alter, convert, asked, topic, how, same):
    """A node may repeat what got no answer; it never says something else."""

    def change(messages):
        place = place_of(messages, f"/robot_1/{topic}", asked[0], convert)
        one = messages[place]
        if how != "doubled":
            data = {
                "local_state": convert.pack_state(asked[0], 3),
                "reward": convert.pack_reward(asked[0], Reward(1.0, 2.0, 3.0, 6.0)),
                "action": convert.pack_action(
                    asked[0], Action(0, False, -1, False), (0, 1)
                ),
                "percept": serialize_message(cell_path(convert, asked[0], [3])),
            }[topic]
            one = one._replace(data=data)
        messages.insert(place + 1, one)
        return messages

    found = alter(change)
    assert found.same == same
    if not same:
        assert found.undecided.step == asked[0]
        assert "different messages" in found.undecided.why


def changed_anywhere(log, draw):
    """Return a change of one number of one message of the topics that are compared."""
    topic = f"/{draw.choice(log.names)}/{draw.choice(TOPICS)}"

    def change(messages):
        place = draw.choice([p for p, m in enumerate(messages) if m.topic == topic])
        kind = TYPES[topic.rpartition("/")[2]]
        message = deserialize_message(messages[place].data, kind)
        if kind is JointState:
            number = draw.randrange(len(message.position))
            message.position[number] += draw.choice([1.0, -0.25, 1e-9])
        else:
            poses = message.poses if kind is Path else [message]
            setattr(
                draw.choice(poses).pose.position,
                *draw.choice([("x", draw.random()), ("y", draw.random())]),
            )
        messages[place] = messages[place]._replace(data=serialize_message(message))
        return messages

    return change


SEEDS = [*range(3), *(pytest.param(n, marks=pytest.mark.long) for n in range(3, 50))]


@pytest.mark.parametrize("seed", SEEDS)
def test_a_changed_number_differs(alter, log, seed):
    draw = random.Random(seed)
    for _ in range(10):
        found = alter(changed_anywhere(log, draw))
        assert found.difference is not None, found.first


@pytest.mark.parametrize("seed", SEEDS)
def test_a_missing_message_leaves_the_rest_undecided(alter, log, seed):
    """Of the topics that are compared; never a difference, never identical."""
    draw = random.Random(seed)

    def change(messages):
        count = draw.choice([1, 1, 2, 10])
        compared = [p for p, m in enumerate(messages) if m.topic.endswith(TOPICS)]
        begin = draw.randrange(len(compared) - count)
        for place in reversed(compared[begin : begin + count]):
            del messages[place]
        return messages

    for _ in range(10):
        found = alter(change)
        assert found.undecided is not None, found.first
        assert found.difference is None


def test_without_what_is_not_compared(alter):
    """Status, map, markers, clock and coordination maps may be missing or of another node."""
    left_out = ("/status", "/map", "/coordination_map")
    found = alter(lambda found: [m for m in found if not m.topic.endswith(left_out)])
    assert found.same


def test_a_stopped_run_whose_world_does_not_say_so(record, rewritten, tmp_path):
    """The recorder may have been stopped before the world."""
    run = record(settings=HALF, stop=200)
    assert verify(run.bag).same

    def change(messages):
        last = max(p for p, m in enumerate(messages) if m.topic == "/status")
        del messages[last]
        return messages

    found = verify(rewritten(run.bag, tmp_path / "bag", change))
    assert "does not show how the run ended" in found.undecided.why


def test_a_robot_that_shows_nothing_of_what_it_learns(alter):
    """A user's own robot; its actions are shown, without an invented reason."""
    found = alter(lambda all: [one for one in all if one.topic != "/robot_1/tables"])
    why = found.undecided.why
    assert why.startswith("robot_1 publishes no tables") and found.steps == 250
    steps = coordinations(found.log, 0)
    for one in explained(found.log, 0, steps):
        assert (one.reason, one.update) == (None, None)
        last = list(in_words(found.log, one))[-1].strip()
        assert last == f"goes {ACTIONS[one.move]}; {why}"
    assert len(steps) > 10


@pytest.mark.parametrize("which", [0, 1, -1])
@pytest.mark.parametrize("how", ["off by a bit", "missing", "garbage", "a count"])
def test_tables_that_are_changed_or_not_there(alter, which, how):
    steps = []

    def nearly(memory, counts):
        memory["q_star"][3, 1] = math.nextafter(memory["q_star"][3, 1], -math.inf)

    def one_more(memory, counts):
        counts["refused"] += 1

    def change(found):
        mine = [p for p, one in enumerate(found) if one.topic == "/robot_2/tables"]
        place = mine[which]
        message = deserialize_message(found[place].data, UInt8MultiArray)
        steps.append(read_tables(message).step)
        if how == "missing":
            del found[place]
        elif how == "garbage":
            message.data = message.data[:-30]
            found[place] = found[place]._replace(data=serialize_message(message))
        else:
            changed = one_more if how == "a count" else nearly
            found[place] = with_tables(found[place], 2, changed)
        return found

    found = alter(change)
    if how == "missing":
        assert found.undecided.step <= steps[0] and "robot_2" in found.undecided.why
        return
    quantity = "tables q_star[3, 1]" if how == "off by a bit" else "tables"
    is_first(found, steps[0], "robot_2", quantity)


def test_a_wrong_seed(alter):
    def change(messages):
        return [
            m._replace(data=m.data.replace(b"seed: 7", b"seed: 8"))
            if m.topic == "/run"
            else m
            for m in messages
        ]

    found = alter(change)
    assert found.difference.step < 20
    assert found.first.quantity in ("local_state", "action", "percept")


# Damage.


@pytest.mark.parametrize("share", [0.3, 0.6, 0.99])
@pytest.mark.parametrize("how", ["cut", "a bit"])
def test_a_damaged_bag_is_verified_up_to_there(record, tmp_path, share, how):
    bag = open_bag(record(settings=HALF, chunk=5000).bag)
    chunks = chunks_in(bag.path)
    place = chunks[int(share * len(chunks))][0] + 100
    data = bytearray(bag.path.read_bytes())
    if how == "cut":
        del data[place:]
    else:
        data[place] ^= 1
    path = tmp_path / "bag_0.mcap"
    path.write_bytes(data)
    found = verify(path)
    assert found.difference is None
    last = int(found.log.step[-1])
    assert last - 20 < found.undecided.step <= last + 1
    assert f"read to step {found.log.made_before(last)}" in found.log.damage
    assert ("pymcap-cli recover" in found.log.damage) == (how == "a bit")
    assert found.steps > 20


# Segments.


@pytest.mark.parametrize("killed", [False, True])
@pytest.mark.parametrize(("step", "after"), [(150, 1), (150, 25), (0, 25)])
def test_a_run_that_went_back_is_one_chain(good, tmp_path, killed, step, after):
    directory = rolled_back(good, tmp_path / "bag", step, after=after, killed=killed)
    found = verify(directory)
    assert found.same, found.first
    assert found.log.segments == (0, step)
    due = read_run(good.bag)
    for name in ("step", "cells", "action", "percept"):
        assert np.array_equal(getattr(found.log, name), getattr(due, name)), name
    played = [
        Playlist(open_bag(bag), ["/robot_1/action"]) for bag in (directory, good.bag)
    ]
    assert len(played[0]) == len(played[1])


def test_a_recorder_that_came_back_too_late_leaves_a_hole(good, tmp_path):
    found = verify(rolled_back(good, tmp_path / "bag", 150, after=25, missed=3))
    assert found.undecided.step == 150


@pytest.mark.parametrize("late", ["/action", "/reward", "/local_state", "/percept"])
def test_a_killed_recorder_may_lack_the_last_steps_before_a_checkpoint(
    good, tmp_path, late
):
    found = verify(
        rolled_back(good, tmp_path / "bag", 150, after=0, killed=True, late=(late,))
    )
    assert found.difference is None
    assert late == "/percept" or 147 <= found.undecided.step <= 150
