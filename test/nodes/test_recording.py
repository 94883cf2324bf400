# Copyright 2026 The sparse_coord_ros authors
# SPDX-License-Identifier: Apache-2.0
"""A recorder in its run: its messages, its waiting, its obedience to orders."""

from contextlib import ExitStack
from dataclasses import replace

import pytest
from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus
from rclpy.serialization import deserialize_message
from std_msgs.msg import String

from sparse_coord_ros.core.game.scenario import load_scenario
from sparse_coord_ros.core.runs.run_config import make_run
from sparse_coord_ros.log.bags.reader import open_bag
from sparse_coord_ros.protocol.wire import Occasion, RunState
from sparse_coord_ros.protocol.wire.status import (
    LEFT,
    NO_ATTEMPT,
    Order,
    Progress,
    RunStatus,
    read_progress,
)
from sparse_coord_ros.ros.nodes import recorder, ros_topics
from sparse_coord_ros.ros.nodes.recorder import (
    LAST_MESSAGES_SECONDS,
    TALK_SECONDS,
    Recorder,
)
from sparse_coord_ros.ros.nodes.ros_messages import messages_of, status, tables_message
from sparse_coord_ros.ros.nodes.spin import ros_context

from .puppet import puppet

FIRST = Order("first", 0)
SECOND = Order("second", 0)


@pytest.fixture
def recording(own_domain, tmp_path):
    """Return a function that starts a recorder, which records a run at once."""
    with ros_context() as context, ExitStack() as stack:

        def begin(namespace="", kind=Recorder, robots=True):
            node = puppet(kind)(
                context=context,
                namespace=namespace,
                values={"out": str(tmp_path / "bag")},
            )
            stack.callback(node.destroy_node)
            stack.callback(node.finish, interrupted=True)
            run = make_run(load_scenario("env1"), {"recorded": True})
            run = replace(run, id="this run")
            node.hear("run", String(data=run.to_yaml()))
            say(node, RunState.WAITING, 1, 0)
            node.tick()
            say(node, RunState.WAITING, 1, 0, order=FIRST)
            assert node.recording is not None
            node.count_publishers = lambda name: 1
            if robots:
                begun(node, FIRST)
            return node

        yield begin


def say(node, *said, order=None):
    """Send the world's status."""
    one = RunStatus("this run", *said, order=order or Order())
    node.hear("status", status("env1", one.state, one.values()))


@pytest.mark.parametrize(
    ("namespace", "name", "kept"),
    [
        ("", "robot_1: agent", True),
        ("", "team_a/robot_1: agent", False),
        ("team_a", "team_a/robot_1: agent", True),
        ("team_a", "/team_b/robot_1: agent", False),
        ("team_a", "camera: frames", False),
    ],
)
def test_diagnostics_of_other_namespaces_are_not_recorded(
    recording, namespace, name, kept
):
    node = recording(namespace)
    before = node.recording.bag.message_count
    message = DiagnosticArray(status=[DiagnosticStatus(name=name)])
    node.hear(ros_topics.DIAGNOSTICS.name, message)
    assert node.recording.bag.message_count - before == kept


def test_diagnostics_that_nobody_can_read_are_counted(recording):
    node = recording()
    [(_, callback)] = [
        pair for pair in node.ears if pair[0].topic == ros_topics.DIAGNOSTICS.name
    ]
    callback(b"\x00\x01\x00\x00\xff\xff\xff\xff")
    assert node.failure is None
    assert node.subscriber.dropped[ros_topics.DIAGNOSTICS.name] == 1


def test_who_talks_on_keeps_no_recorder(recording):
    """Another node on a topic of the team; late messages in a busy moment still count."""
    node = recording()
    node.count_publishers = lambda name: 1  # the last words are still to come
    say(node, RunState.STOPPED, 7, 7)
    ended = node.presence.ended
    part = node.recording
    for later, done in ((LAST_MESSAGES_SECONDS + 1, False), (TALK_SECONDS + 0.1, True)):
        part.heard = ended + later
        assert part.all_done(ended + later) is done
    part.heard = ended
    assert part.all_done(ended + LAST_MESSAGES_SECONDS + 1)


def begun(node, order):
    """Let the robots say that they have begun an attempt."""
    for robot in ("robot_1", "robot_2"):
        said = Progress((0,), order.attempt)
        topic = ros_topics.PROGRESS.of(robot)
        node.hear(topic, status(robot, "progress", said.values()))
    node.tick()


class Telling(Recorder):
    """Keeps its messages to the world."""

    def announce(self, topic, owner=""):
        publisher = super().announce(topic, owner)
        if topic.name == ros_topics.PROGRESS.name:
            self.told = []
            publisher.publish = lambda said: self.told.append(read_progress(said))
        return publisher


def test_a_recorder_begins_a_segment_when_all_robots_have_begun_the_attempt(
    recording, monkeypatch
):
    """Else messages of the attempt before would come into it."""
    node = recording(kind=Telling, robots=False)
    assert node.told == [Progress((), NO_ATTEMPT)]
    begun(node, FIRST)
    assert node.told.pop() == Progress((0,), "first")
    say(node, RunState.RESUMING, 1, 0, order=SECOND)
    node.tick()
    begun(node, FIRST)
    assert node.recording.attempt == "first"
    monkeypatch.setattr(recorder, "QUIET_SECONDS", 0.0)
    begun(node, SECOND)
    assert node.told.pop() == Progress((0,), "second")
    assert sorted(path.name for path in node.directory.iterdir()) == [
        "bag_0.mcap",
        "bag_1.mcap.partial",
    ]


def test_a_recorder_begins_without_robots_with_which_the_world_does_not_wait(recording):
    node = recording(robots=False)
    say(node, RunState.LEARNING, 1, 0, order=FIRST)
    node.tick()
    assert node.recording.attempt == "first"


def tables(node, robot, step, occasion, attempt="first"):
    """Let the recorder hear a robot's tables."""
    message = tables_message(b"npz", step, occasion, attempt)
    node.hear(ros_topics.TABLES.of(robot), message)
    node.tick()


def test_tables_are_written_when_the_bag_holds_everything_before_them(recording):
    """With those of all robots it is a checkpoint of the recorder; not of another attempt."""
    node = recording(kind=Telling)
    robots = "robot_1", "robot_2"
    for robot in robots:
        tables(node, robot, 0, Occasion.BEGIN)
        tables(node, robot, 7, Occasion.CHECKPOINT, attempt="another")
        tables(node, robot, 7, Occasion.CHECKPOINT)
    assert node.told[-1] == Progress((0,), "first")
    messages = messages_of(node.run)
    for robot in robots:
        data = messages.pack_state(7, node.run.scenario.robots[0].start)
        message = deserialize_message(data, ros_topics.LOCAL_STATE.type)
        node.hear(ros_topics.LOCAL_STATE.of(robot), message)
    node.tick()
    assert node.told[-1] == Progress((0, 7), "first", written=7)
    tables(node, "robot_1", 9, Occasion.FINAL)
    node.finish(interrupted=False)
    assert node.told[-1] == Progress((0, 7), "first", LEFT)
    bag = open_bag(node.directory)
    written = [
        (one.topic, one.log_time_ns // messages.period)
        for one in bag.messages()
        if one.topic.endswith("/tables")
    ]
    assert written == [
        *((f"/{robot}/tables", step) for step in (0, 7) for robot in robots),
        ("/robot_1/tables", 9),
    ]
