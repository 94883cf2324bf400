# Copyright 2026 The sparse_coord_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Losses of honest recordings, and forgeries of stamps, formats, encodings, labels and answers."""

import json

import numpy as np
import pytest
from diagnostic_msgs.msg import DiagnosticStatus
from geometry_msgs.msg import PoseStamped
from nav_msgs.srv import GetPlan
from recordings import each
from rosgraph_msgs.msg import Clock
from sensor_msgs.msg import JointState

from sparse_coord_ros.base.errors import BagError
from sparse_coord_ros.base.version import FORMAT
from sparse_coord_ros.cli.main import main
from sparse_coord_ros.log.bags.reader import open_bag
from sparse_coord_ros.log.runlog import verify
from sparse_coord_ros.log.runlog.verify import LOST_COPIES
from sparse_coord_ros.protocol.wire import TABLES_DEPTH

EVENT = "/robot_2/active_perception/_service_event"
EPISODES = (
    "/map",
    "/markers",
    "/robot_1/coordination_map",
    "/robot_2/coordination_map",
)


def logged(found, words):
    """Return whether a difference, or a foreign message of a run that differs, has some words."""
    if not found.differences:
        return False
    return any(
        words in str(one) for one in (*found.differences, *found.log.messages.foreign)
    )


# Stamps before the run.


def before_the_run(message):
    stamp = message.clock if hasattr(message, "clock") else message.header.stamp
    stamp.sec = -(2**31)


@pytest.mark.parametrize(
    ("topic", "kind"),
    [
        ("/clock", Clock),
        ("/robot_1/local_state", PoseStamped),
        ("/robot_2/reward", JointState),
    ],
)
def test_a_stamp_before_the_run(alter, topic, kind):
    found = alter(each(topic, kind, before_the_run, slice(20, 21)))
    assert logged(found, "stamp: logged -2147483647")
    assert all(one.step is None or one.step >= 0 for one in found.differences)


# The bag's format.


@pytest.mark.parametrize("number", ["0", str(FORMAT + 1), "x", ""])
def test_another_format_is_refused_in_one_line(
    good, rewritten, tmp_path, number, capsys
):
    bag = rewritten(good.bag, tmp_path / "bag", record={"format": number})
    with pytest.raises(BagError, match="format .*this version reads format") as caught:
        verify(bag)
    assert "\n" not in str(caught.value)
    assert main(["verify", str(bag)]) == 2
    assert capsys.readouterr().err.count("\n") == 1


def test_what_a_later_version_adds_to_the_record_is_no_difference(alter):
    assert alter(record={"version_moon": "1"}).same


# Losses of honest recordings.


def logged_again(messages):
    """Return messages with markers, which have no stamp, logged at the newest stamp before."""
    newest = 0
    found = []
    for one in messages:
        if one.topic == "/markers":
            at = min(one.log_time_ns, newest)
            one = one._replace(log_time_ns=at, publish_time_ns=at)
        newest = max(newest, one.log_time_ns)
        found.append(one)
    return found


@pytest.mark.parametrize("topic", EPISODES[:3])
def test_lost_copies_are_a_note(good, rewritten, tmp_path, capsys, topic):
    def change(messages):
        mine = [p for p, one in enumerate(messages) if one.topic == topic]
        rest = [one for place, one in enumerate(messages) if place not in mine[1:]]
        return logged_again(rest)

    bag = rewritten(good.bag, tmp_path / "bag", change)
    found = verify(bag)
    whole = verify(good.bag)
    [(note, count)] = found.notes.items()
    assert found.same and note == f"{LOST_COPIES}{topic}" and count > 1
    assert topic != "/map" or count == open_bag(good.bag).counts[topic] - 1
    for one in ("choices", "updates", "tables"):
        assert getattr(found, one) == getattr(whole, one)
    assert main(["verify", str(bag)]) == 0
    assert f"{note}: {count}\n" in capsys.readouterr().out
    assert main(["verify", str(bag), "--json"]) == 0
    assert json.loads(capsys.readouterr().out)["notes"] == {note: count}


@pytest.mark.parametrize("topic", EPISODES[1:3])
def test_a_topic_without_any_message_differs(alter, topic):
    found = alter(lambda messages: [one for one in messages if one.topic != topic])
    assert logged(found, "missing, computed one as the episode begins")
    assert not found.notes


@pytest.mark.parametrize("later", [TABLES_DEPTH, TABLES_DEPTH - 1])
def test_tables_that_a_recorder_in_arrears_missed(record, rewritten, tmp_path, later):
    """ROS keeps the last ten tables of a robot until they are received: others may be lost."""
    run = record(settings={"steps": 200}, values={"checkpoint": 10})

    def some(found):
        mine = [one for one in found if one.name.startswith("tables/robot_1")]
        return [one for one in found if one not in mine[-later - 3 : -later]]

    found = verify(rewritten(run.bag, tmp_path / "bag", attach=some))
    lost = later == TABLES_DEPTH
    assert found.notes == ({f"{LOST_COPIES}/robot_1/tables": 3} if lost else {})
    assert found.same == lost


def without_last_tables(robot):
    def attach(found):
        mine = [
            p for p, one in enumerate(found) if one.name.startswith(f"tables/{robot}_")
        ]
        return [one for place, one in enumerate(found) if place != mine[-1]]

    return attach


def test_a_killed_robot_is_an_open_question(record, rewritten, tmp_path, capsys):
    stopped = record(settings={"perception": "probability:0.5"}, stop=230)
    assert verify(stopped.bag).same
    bag = rewritten(
        stopped.bag, tmp_path / "bag", attach=without_last_tables("robot_2")
    )
    [unknown] = verify(bag).unknown
    assert unknown.why.startswith("robot_2 saved no tables at its end")
    assert main(["verify", str(bag)]) == 3
    assert f"undecided at time step {unknown.first}: robot_2" in capsys.readouterr().out


def test_a_robot_may_be_killed_after_its_last_action(alter):
    found = alter(attach=without_last_tables("robot_2"))
    [unknown] = found.unknown
    assert found.undecided and unknown.why.startswith("robot_2 saved no tables")


@pytest.mark.parametrize("lost", [False, True])
def test_a_killed_world_is_an_open_question(record, rewritten, tmp_path, lost):
    stopped = record(settings={"perception": "probability:0.5"}, stop=230)
    last = verify(stopped.bag).log.step[-1]

    def change(messages):
        ends = [p for p, one in enumerate(messages) if one.topic == "/status"]
        del messages[ends[-1]]
        if lost:  # the last state of one robot, and what it did there
            return [
                one
                for one in messages
                if one.log_time_ns < last * 100_000_000
                or not one.topic.startswith("/robot_2/")
                or one.topic.endswith("_event")
            ]
        return messages

    attach = without_last_tables("robot_2") if lost else list
    found = verify(rewritten(stopped.bag, tmp_path / "bag", change, attach))
    assert found.undecided, found.differences
    [loss] = found.log.losses
    assert loss.endswith("the world does not show how the run ended")
    assert len(found.unknown) == 1 and found.steps > 200


# Other forms, answers, status.


def plain_no_more(messages):
    return [
        one._replace(data=b"\x09\x01" + one.data[2:])
        if one.topic == "/robot_1/action"
        else one
        for one in messages
    ]


def extra(message):
    message.name = [*message.name, "more"]
    message.position = [*message.position, 3.0]


@pytest.mark.parametrize(
    "change", [plain_no_more, each("/robot_1/action", JointState, extra)]
)
def test_messages_of_another_form(alter, change):
    assert logged(
        alter(change), "/robot_1/action: logged a message that has another form"
    )


def second(event):
    for response in event.response:
        response.plan.poses = [*response.plan.poses, *response.plan.poses]


def turned(event):
    for response in event.response:
        for pose in response.plan.poses:
            pose.pose.orientation.w = 0.0


def asked_elsewhere(event):
    for request in event.request:
        request.start.header.frame_id = "odom"


@pytest.mark.parametrize(
    ("how", "words"),
    [(second, "another form"), (turned, "another form"), (asked_elsewhere, "dialogue")],
)
def test_a_dialogue_of_other_places(alter, how, words):
    """A request from another place is a person's: the robot's request is then missing."""
    assert logged(alter(each(EVENT, GetPlan.Event, how)), words)


@pytest.mark.parametrize(
    ("message", "without", "words"),
    [
        ("strange", {}, "'strange'"),
        ("learning", {"began"}, "no value 'began'"),
    ],
)
def test_a_status_that_cannot_be(alter, message, without, words):
    def change(status):
        status.message = message
        status.values = [one for one in status.values if one.key not in without]

    assert logged(alter(each("/status", DiagnosticStatus, change, slice(1, 2))), words)


def test_a_robot_that_stops_while_it_repeats_a_request(good, record):
    """Its last tables count an answer "not there yet" that no action follows."""
    log = verify(good.bag).log
    made = ~np.isnan(log.reward[..., 0]).all(axis=1)
    row = int(
        np.flatnonzero(log.asked[:, 1] & (log.cells[:, 0] != log.cells[0, 0]))[40]
    )
    step = int(log.step[row])
    stopped = record(
        settings={"perception": "probability:0.5"},
        late=[(0, step)],
        stop=int(made[:row].sum()),
        patient=True,
    )
    found = verify(stopped.bag)
    assert stopped.recording.robots[1].counts["repeated"] > 0
    assert step not in found.log.messages.actions[1].step
    assert found.same, found.first
