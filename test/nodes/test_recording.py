# Copyright 2026 The sparse_coord_ros authors
# SPDX-License-Identifier: Apache-2.0
"""A recorder in its run: its messages, its waiting, its obedience to orders."""

from contextlib import ExitStack
from dataclasses import replace

import pytest
from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus
from std_msgs.msg import String

from sparse_coord_ros.core.game.scenario import load_scenario
from sparse_coord_ros.core.runs.run_config import make_run
from sparse_coord_ros.protocol.wire import RunState
from sparse_coord_ros.protocol.wire.status import (
    NO_ROLLBACK,
    Order,
    RunStatus,
    read_progress,
)
from sparse_coord_ros.ros.nodes import ros_topics
from sparse_coord_ros.ros.nodes.messages import status
from sparse_coord_ros.ros.nodes.recorder import (
    LAST_MESSAGES_SECONDS,
    TALK_SECONDS,
    Recorder,
)
from sparse_coord_ros.ros.nodes.spin import ros_context

from .puppet import puppet


@pytest.fixture
def recording(own_domain, tmp_path):
    """Return a function that starts a recorder, which records a run at once."""
    with ros_context() as context, ExitStack() as stack:

        def begin(namespace="", kind=Recorder):
            node = puppet(kind)(
                context=context,
                namespace=namespace,
                values={"out": str(tmp_path / "bag")},
            )
            stack.callback(node.destroy_node)
            stack.callback(node.finish, interrupted=True)
            run = replace(make_run(load_scenario("env1"), {}), id="this run")
            node.hear("run", String(data=run.to_yaml()))
            node.tick()
            assert node.recording is not None
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


def test_a_recorder_has_obeyed_when_it_finds_the_robots(recording):
    """Else a log that begins there lacks a robot's first message."""
    told = []

    class Telling(Recorder):
        """Keeps its messages to the world."""

        def announce(self, topic, owner=""):
            publisher = super().announce(topic, owner)
            if topic.name == ros_topics.PROGRESS.name:
                publisher.publish = told.append
            return publisher

    node = recording(kind=Telling)
    found = set()
    node.count_publishers = lambda name: name in found
    say(node, RunState.LEARNING, 1, 0, order=Order("order", NO_ROLLBACK, 1))
    for robot in ("robot_1", "robot_2"):
        node.tick()
        assert not told
        found.add(ros_topics.ACTION.of(robot))
    node.tick()
    [message] = told
    assert read_progress(message).obeyed == "order"
