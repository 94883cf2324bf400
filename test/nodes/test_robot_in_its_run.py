# Copyright 2026 The sparse_coord_ros authors
# SPDX-License-Identifier: Apache-2.0
"""A robot in its run: its new subscriptions when the team goes back, and its end."""

from dataclasses import replace

import pytest
from rclpy.serialization import serialize_message
from recordings import cell_pose
from std_msgs.msg import String

from sparse_coord_ros.core.game.actions import COORDINATE
from sparse_coord_ros.core.game.scenario import load_scenario
from sparse_coord_ros.core.game.world import Reward
from sparse_coord_ros.core.runs.run_config import make_run
from sparse_coord_ros.protocol.wire import RunState
from sparse_coord_ros.protocol.wire.status import Order, RunStatus
from sparse_coord_ros.ros.nodes import robot, ros_topics
from sparse_coord_ros.ros.nodes.robot import LAST_REWARD_SECONDS, RobotNode
from sparse_coord_ros.ros.nodes.ros_messages import messages_of, status
from sparse_coord_ros.ros.nodes.spin import ros_context

from .puppet import puppet

END = 3
"""The time step at which the run ends."""

STATES = ros_topics.LOCAL_STATE.of("robot_1")
PEERS_STATES = ros_topics.LOCAL_STATE.of("robot_2")


@pytest.fixture
def begun(own_domain, tmp_path, monkeypatch):
    """Return a function that starts robot_1, which joins a run at once; and its run."""
    monkeypatch.setattr(robot, "PEER_PATIENCE_SECONDS", 0.0)
    with ros_context() as context:
        nodes = []

        def begin(peers_seen="when_asked", **run):
            values = {"out": str(tmp_path)}
            node = puppet(RobotNode)(name="robot_1", context=context, values=values)
            nodes.append(node)
            node.heard_by = lambda publisher, role: True
            scenario = load_scenario("env1").with_settings(
                {"steps": END, "epsilon": "constant:0", "peers_seen": peers_seen}
            )
            config = replace(make_run(scenario, run), id="this run")
            node.hear("run", String(data=config.to_yaml()))
            say(node, RunState.WAITING, 1, 0)
            node.tick()
            say(node, RunState.WAITING, 1, 0, Order("the first", 0))
            node.tick()
            assert node.joined
            return node

        yield begin
        for node in nodes:
            node.destroy_node()


def say(node, state, step, transitions, order=None):
    """Send the world's status."""
    said = RunStatus("this run", state, step, transitions, order=order or Order())
    node.hear("status", status("env1", said.state, said.values()))


def walk(side, *, rewarded, until):
    """Let a robot see its states until a time step, and the rewards of some steps."""
    for step in range(1, until + 1):
        side.state(step, step)
        if step in rewarded:
            side.reward(step, Reward(0.0, 0.0, 0.0, 0.0))


@pytest.mark.parametrize(
    ("rewarded", "until", "asks", "done"),
    [
        ((1, 2), END, False, True),
        ((1,), END, False, False),
        ((1,), END - 1, False, False),
        ((1, 2), END, True, False),
    ],
    ids=["all is learned", "a reward is due", "the last state is due", "it asks"],
)
def test_a_robot_leaves_when_all_is_learned_or_some_seconds_later(
    begun, rewarded, until, asks, done
):
    """They count from the first message on the run's end."""
    node = begun()
    side = node.lockstep
    q_star = side.agent.mind.q_star[side.agent.number]
    q_star[:, COORDINATE] = -1e6
    q_star[END, COORDINATE] = 1e6 if asks else -1e6
    walk(side, rewarded=rewarded, until=until)
    say(node, RunState.STOPPED, END, END - 1)
    ended = node.presence.ended
    say(node, RunState.STOPPED, END, END - 1)
    assert node.presence.ended == ended
    assert node.all_done(ended + LAST_REWARD_SECONDS) is done
    assert node.all_done(ended + LAST_REWARD_SECONDS + 0.1)


def test_who_learns_from_the_states_of_its_peers_listens_to_them(begun):
    node = begun(peers_seen="while_learning")
    side = node.lockstep
    side.agent.mind.q_star[side.agent.number, :, COORDINATE] = -1e6
    messages = messages_of(node.run)
    node.hear(STATES, cell_pose(messages, 1, 3))
    assert side.self_report_of(1) is None, "it has not acted"
    node.hear(PEERS_STATES, cell_pose(messages, 1, 5))
    assert side.self_report_of(1) is not None


@pytest.mark.parametrize("peers_seen", ["when_asked", "while_learning"])
def test_who_goes_back_listens_anew(begun, peers_seen):
    """Messages in flight belong to the time that is taken back, with the same step numbers."""
    node = begun(peers_seen)
    state = cell_pose(messages_of(node.run), 1, 3)
    peers = listening(node, PEERS_STATES)
    assert len(peers) == (peers_seen == "while_learning")
    [before] = listening(node)
    say(node, RunState.LEARNING, 1, 0, Order("the second", 0))
    node.hear(STATES, state)
    assert (node.joined, node.lockstep.newest[0]) == (False, 0)
    node.tick()
    [after] = listening(node)
    assert node.joined and after is not before
    assert not set(peers) & set(listening(node, PEERS_STATES))
    before.callback(serialize_message(cell_pose(messages_of(node.run), 2, 3)))
    assert node.lockstep.newest[0] == 0, "a late message of the time before"
    node.hear(STATES, state)
    assert node.lockstep.newest == (1, 3)


def listening(node, topic=STATES):
    """Return the node's subscriptions to a topic; by default to its local state."""
    return [one for one in node.subscriptions if one.topic == topic]
