# Copyright 2026 The sparse_coord_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Foreign messages among those of a run: reported; a difference only if a node used them."""

import numpy as np
import pytest
from geometry_msgs.msg import PoseStamped
from hypothesis import given, strategies
from nav_msgs.srv import GetPlan
from rclpy.serialization import deserialize_message, serialize_message
from rosgraph_msgs.msg import Clock

from sparse_coord_ros.cli.main import main
from sparse_coord_ros.core.game.world import Action, Reward
from sparse_coord_ros.log.runlog import verify
from sparse_coord_ros.log.runlog.run_messages import in_order
from sparse_coord_ros.log.runlog.verify import FOREIGN
from sparse_coord_ros.protocol import wire
from sparse_coord_ros.protocol.wire import PerceptEnd, SelfReport
from sparse_coord_ros.protocol.wire.events import EventKind
from sparse_coord_ros.protocol.wire.status import RunStatus
from sparse_coord_ros.ros.nodes.messages import Converter, status

STAMPED = [topic.name.lstrip("/") for topic in wire.TOPICS if topic.stamped]
AT = 121
FAR = 1_000_000


@pytest.fixture(scope="module")
def convert(good):
    return Converter(good.run)


def relogged(messages):
    """Return messages that have no stamp logged at the newest stamp before, as recorders do."""
    newest = 0
    found = []
    for one in messages:
        if one.topic.endswith(tuple(STAMPED)):
            newest = max(newest, one.log_time_ns)
        else:
            one = one._replace(log_time_ns=newest, publish_time_ns=newest)
        found.append(one)
    return found


def beside(topic, step, convert, data, *, said=None, before=False):
    """Return a change that puts a message beside that of a topic and time step.

    It is logged at the stamp of the time step `said`, or with that message.
    """

    def change(messages):
        [place] = [
            place
            for place, one in enumerate(messages)
            if (one.topic, one.log_time_ns) == (topic, step * convert.period)
        ]
        one = messages[place]
        at = one.log_time_ns if said is None else said * convert.period
        new = one._replace(data=data, log_time_ns=at, publish_time_ns=at)
        return relogged(
            [*messages[: place + 1 - before], new, *messages[place + 1 - before :]]
        )

    return change


def status_of(step, transitions, state="learning", began="start", run=""):
    said = RunStatus(run, state, step, transitions, 0, began)
    return serialize_message(status("env1", state, said.values()))


def is_foreign(found, count=1):
    assert found.same, found.first
    assert found.notes == {FOREIGN: count}


STATE = "/robot_1/local_state"
REWARD = "/robot_1/reward"
ACTION = "/robot_1/action"
PERCEPT = "/robot_1/percept"
EVENTS = "/robot_2/active_perception/_service_event"


@pytest.mark.parametrize(
    ("ahead", "before"), [(0, False), (0, True), (1, False), (3, True)]
)
def test_a_forged_state(alter, good, convert, ahead, before):
    """Of this step, or early: then all messages up to that step seem to be late."""
    cell = 7 if verify(good.bag).log.cells[AT - 1, 0] != 7 else 8
    data = convert.pack_state(AT + ahead, cell)
    said = None if ahead == 0 else AT + ahead
    is_foreign(alter(beside(STATE, AT, convert, data, said=said, before=before)))


@pytest.mark.parametrize("topic", [STATE, "/clock"])
def test_a_state_of_a_step_that_never_comes(alter, convert, topic, capsys, tmp_path):
    """A recorder logs it at the run's time."""
    pack = (
        convert.pack_clock
        if topic == "/clock"
        else lambda step: convert.pack_state(step, 3)
    )
    found = alter(beside(topic, AT, convert, pack(FAR)))
    is_foreign(found)
    assert found.log.step[-1] < FAR
    assert main(["verify", str(tmp_path / "bag")]) == 0
    out = capsys.readouterr().out
    assert "foreign messages: 1\nidentical: " in out


@pytest.mark.parametrize(
    ("topic", "how"),
    [
        (STATE, "before the run"),
        ("/clock", "before the run"),
        (STATE, "between two steps"),
        ("/clock", "of another form"),
    ],
)
def test_what_cannot_be_of_the_run(alter, convert, topic, how):
    """A recorder logs it on arrival: with a wrong stamp at the run's time."""
    kind = Clock if topic == "/clock" else PoseStamped
    pack = (
        convert.pack_clock
        if topic == "/clock"
        else lambda step: convert.pack_state(step, 3)
    )
    message = deserialize_message(pack(AT), kind)
    stamp = message.clock if topic == "/clock" else message.header.stamp
    if how == "before the run":
        stamp.sec = -7
    elif how == "between two steps":
        stamp.nanosec += 1
    data = serialize_message(message)
    is_foreign(
        alter(
            beside(topic, AT, convert, data[:-2] if how == "of another form" else data)
        )
    )


@pytest.mark.parametrize("before", [False, True])
def test_a_forged_reward(alter, convert, before):
    data = convert.pack_reward(AT, Reward(1.0, 0.0, 0.0, 1.0))
    is_foreign(alter(beside(REWARD, AT, convert, data, before=before)))


@pytest.mark.parametrize(
    "data",
    [status_of(3, 2), status_of(AT, 7, state="finished"), status_of(FAR, 7)],
    ids=["of an earlier step", "an early end", "of no step"],
)
def test_a_forged_status(alter, convert, data):
    is_foreign(alter(said_at_once(convert, data)))


def said_at_once(convert, data, topic="/status"):
    """Return a change that puts a message of another topic beside a state."""

    def change(messages):
        found = beside(STATE, AT, convert, b"")(messages)
        return [
            one._replace(topic=topic, data=data) if not one.data else one
            for one in found
        ]

    return change


def test_a_status_of_another_run(record, rewritten, tmp_path, convert):
    run = record(
        settings={"perception": "probability:0.5", "steps": 250}, identity="this run"
    )
    for said in ("another", "this run"):
        change = said_at_once(convert, status_of(AT, 7, run=said))
        found = verify(rewritten(run.bag, tmp_path / "bag", change))
        if said == "another":
            is_foreign(found)
        else:
            [difference] = found.differences
            assert difference.quantity == "status" and not found.notes


NOW_AND_THEN = ["/map", "/markers", "/robot_1/coordination_map", "/status"]


SHORT = b"\x07" * 9
LONG = b"\x00\x01\x00\x00" + b"\xf9" * 400


@pytest.mark.parametrize(
    ("topic", "data"),
    [
        *((topic, LONG) for topic in (*NOW_AND_THEN, ACTION, "/clock", EVENTS)),
        ("/status", SHORT),
        ("/clock", SHORT),
    ],
)
def test_what_no_node_of_a_run_says(alter, convert, topic, data):
    """Also on topics with rare messages, and with any stamp."""
    is_foreign(alter(said_at_once(convert, data, topic)))


def test_a_status_that_names_no_run(alter, convert):
    is_foreign(
        alter(said_at_once(convert, serialize_message(status("env1", "paused", {}))))
    )


@pytest.mark.parametrize(("step", "said"), [(0, 0), (FAR, None)])
def test_a_clock_and_a_state_of_a_step_that_is_none(alter, convert, step, said):
    def change(messages):
        both = (
            ("/clock", convert.pack_clock(step)),
            (STATE, convert.pack_state(step, 3)),
        )
        for topic, data in both:
            messages = beside(topic, AT, convert, data, said=said)(messages)
        return messages

    is_foreign(alter(change), 2)


@pytest.mark.parametrize(
    ("topic", "after"),
    [(ACTION, None), (REWARD, None), (PERCEPT, 1), (ACTION, 1000), (REWARD, 1)],
)
def test_what_robots_say_of_a_step_that_never_comes(alter, good, convert, topic, after):
    """In mid-run, or after the end."""
    step = FAR if after is None else int(verify(good.bag).log.step[-1]) + after
    data = {
        ACTION: convert.pack_action(
            step, Action(0, False, -1, False), SelfReport(0, True)
        ),
        REWARD: convert.pack_reward(step, Reward(1.0, 0.0, 0.0, 1.0)),
        PERCEPT: serialize_message(convert.path(step, (3,))),
    }[topic]

    def change(messages):
        places = [place for place, one in enumerate(messages) if one.topic == topic]
        place = places[-1 if after else len(places) // 2]
        new = messages[place]._replace(data=data)
        if after:
            at = step * convert.period
            return [*messages, new._replace(log_time_ns=at, publish_time_ns=at)]
        return [*messages[:place], new, *messages[place:]]

    is_foreign(alter(change))


@pytest.mark.parametrize("topic", ["/clock", STATE])
def test_what_was_said_already(alter, convert, topic):
    """A repeated earlier step has no new content."""
    at = AT - 9, (AT - 9) * convert.period

    def change(messages):
        [data] = [
            one.data
            for one in messages
            if (one.topic, one.log_time_ns) == (topic, at[1])
        ]
        return beside(topic, AT, convert, data, said=at[0])(messages)

    is_foreign(alter(change))


def test_an_answer_of_a_step_that_never_comes(alter, convert):
    def change(messages):
        said = next(
            event
            for one in messages
            if one.topic == EVENTS
            and (event := deserialize_message(one.data, GetPlan.Event)).response
        )
        said.info.client_gid[3] += 1
        said.response[0].plan.header.stamp.sec = FAR
        return said_at_once(convert, serialize_message(said), EVENTS)(messages)

    is_foreign(alter(change))


def test_a_status_beside_a_true_one_of_its_step(alter, convert):
    """That the world took none back tells the other one."""

    def change(messages):
        places = [place for place, one in enumerate(messages) if one.topic == "/status"]
        one = messages[places[2]]
        new = one._replace(data=status_of(round(one.log_time_ns / convert.period), 7))
        return [*messages[: places[2]], new, *messages[places[2] :]]

    is_foreign(alter(change))


@pytest.mark.parametrize("topic", [STATE, REWARD])
def test_what_replaces_the_true_one_differs(alter, convert, topic):
    data = convert.pack_state(AT, 7)
    if topic == REWARD:
        data = convert.pack_reward(AT, Reward(1.0, 0.0, 0.0, 1.0))

    def change(messages):
        [place] = [
            place
            for place, one in enumerate(messages)
            if (one.topic, one.log_time_ns) == (topic, AT * convert.period)
        ]
        messages[place] = messages[place]._replace(data=data)
        return messages

    found = alter(change)
    assert found.differences and not found.notes


def test_what_the_world_went_by_differs(alter, good, convert):
    """An action that came first, and is not the agent's; the true one is a note."""
    log = verify(good.bag).log
    row = int(np.searchsorted(log.step, AT))
    assert log.step[row] == AT and log.move[row, 0] >= 0
    action = Action((int(log.move[row, 0]) + 1) % 4, False, -1, False)
    data = convert.pack_action(AT, action, SelfReport(PerceptEnd.DID_NOT_ASK, True))
    found = alter(beside(ACTION, AT, convert, data, before=True))
    assert found.first[:3] == (AT, "robot_1", "action")
    assert found.notes == {FOREIGN: 1}


def test_an_action_that_came_too_late(alter, good, convert):
    data = convert.pack_action(
        AT, Action(0, True, 1, False), SelfReport(PerceptEnd.DID_NOT_ASK, True)
    )
    is_foreign(alter(beside(ACTION, AT, convert, data)))


def test_a_foreign_message_explains_no_difference(alter, convert):
    late = beside(
        REWARD, AT, convert, convert.pack_reward(AT, Reward(1.0, 0.0, 0.0, 1.0))
    )
    false = convert.pack_reward(AT + 3, Reward(1.0, 0.0, 0.0, 1.0))

    def change(messages):
        found = late(messages)
        place = next(
            place
            for place, one in enumerate(found)
            if (one.topic, one.log_time_ns) == (REWARD, (AT + 3) * convert.period)
        )
        found[place] = found[place]._replace(data=false)
        return found

    found = alter(change)
    assert found.first[:3] == (AT + 3, "robot_1", "reward")
    assert found.notes == {FOREIGN: 1}


@pytest.mark.parametrize("before", [False, True])
@pytest.mark.parametrize("kept", [True, False])
def test_another_server_of_a_robots_service(alter, kept, before):
    """Its response comes first or second; alone, in place of the robot's own, it differs."""

    def change(messages):
        topic = "/robot_2/active_perception/_service_event"
        for place, one in enumerate(messages):
            event = (
                deserialize_message(one.data, GetPlan.Event)
                if one.topic == topic
                else None
            )
            if (
                event
                and event.info.event_type == EventKind.RETURNED
                and event.response[0].plan.poses
            ):
                event.response[0].plan.poses[0].pose.position.x += 1.0
                other = one._replace(data=serialize_message(event))
                both = [other, one] if before else [one, other]
                return [
                    *messages[:place],
                    *(both if kept else [other]),
                    *messages[place + 1 :],
                ]
        raise AssertionError("nobody was answered")

    found = alter(change)
    if kept:
        is_foreign(found)
    else:
        assert "dialogue with robot_2" in found.first.quantity and not found.notes


STEPS = strategies.lists(strategies.integers(0, 9), max_size=12)


def best(steps, *, each_once):
    """Return the length of a longest non-decreasing sequence of some steps."""
    lengths = []
    for place, step in enumerate(steps):
        before = [
            lengths[i]
            for i in range(place)
            if steps[i] < step or (steps[i] == step and not each_once)
        ]
        lengths.append(1 + max(before, default=0))
    return max(lengths, default=0)


@given(STEPS)
def test_a_longest_sequence_that_never_falls(steps):
    right = in_order(np.array(steps, dtype=np.int64))
    chosen = np.array(steps, dtype=np.int64)[right]
    assert (np.diff(chosen) >= 0).all() and len(chosen) == best(steps, each_once=False)


@given(STEPS)
def test_a_step_that_comes_again_makes_no_sequence_longer(steps):
    right = in_order(np.array(steps, dtype=np.int64), each_once=True)
    chosen = np.array(steps, dtype=np.int64)[right]
    falls = (np.diff(steps) < 0).any()
    assert (np.diff(chosen) >= falls).all()
    assert len(chosen) == (best(steps, each_once=True) if falls else len(steps))


@pytest.mark.parametrize("topic", ["/map", "/robot_1/coordination_map"])
def test_what_replaces_a_copy_is_no_lost_copy(alter, topic):
    """A possibly foreign message is in the place of one of the run's."""

    def change(messages):
        places = [place for place, one in enumerate(messages) if one.topic == topic]
        place = places[len(places) // 2]
        messages[place] = messages[place]._replace(data=SHORT)
        return relogged(messages)

    found = alter(change)
    assert found.first.quantity == topic.rpartition("/")[2], found.differences
    assert found.first.logged == "missing"
