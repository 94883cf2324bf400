# Copyright 2026 The sparse_coord_ros authors
# SPDX-License-Identifier: Apache-2.0
"""A run that names code of others is announced: no node imports it unasked."""

import sys
from dataclasses import replace

import pytest
from recordings import recorded
from std_msgs.msg import String
from teams import THEIRS, forgotten

from sparse_coord_ros.core.game.plugins import ALLOW_VARIABLE
from sparse_coord_ros.core.game.scenario import load_scenario
from sparse_coord_ros.core.runs.run_config import make_run
from sparse_coord_ros.protocol.wire import RunState
from sparse_coord_ros.protocol.wire.status import RunStatus
from sparse_coord_ros.ros.driving.body import BodyNode
from sparse_coord_ros.ros.driving.driver import CmdVelDriverNode
from sparse_coord_ros.ros.nodes import ros_topics
from sparse_coord_ros.ros.nodes.follower import Follower
from sparse_coord_ros.ros.nodes.player import Player
from sparse_coord_ros.ros.nodes.recorder import Recorder
from sparse_coord_ros.ros.nodes.robot import RobotNode
from sparse_coord_ros.ros.nodes.ros_messages import status
from sparse_coord_ros.ros.nodes.watch import WatchNode

OTHERS = {"learner": "theirs:Team", "model": "coop"}

NODES = {
    "robot": (lambda place, out: RobotNode(name="robot_1", values={}, **place)),
    "recorder": (
        lambda place, out: Recorder(values={"out": str(out / "bag")}, **place)
    ),
    "watch": (lambda place, out: WatchNode(values={"port": 0}, **place)),
    "driver": (
        lambda place, out: CmdVelDriverNode(values={"robot": "robot_1"}, **place)
    ),
    "body": (lambda place, out: BodyNode(values={}, **place)),
}
"""Every node that hears `run`."""


@pytest.fixture
def beside(tmp_path, monkeypatch):
    """Enter a folder with a module of others; return the file that its import writes."""
    (tmp_path / "theirs.py").write_text(THEIRS)
    monkeypatch.chdir(tmp_path)
    with forgotten():
        yield tmp_path / "imported"


def announced(kind):
    """Return the announcement of a run that names such code."""
    run = replace(make_run(load_scenario("env1"), {}), id="theirs")
    if kind == "learner":
        run = replace(run, learner=OTHERS[kind])
    text = run.to_yaml()
    if kind == "model":
        text = text.replace("perception: always", "perception: theirs:fog:0.5")
    assert "theirs:" in text
    return String(data=text)


def say(bench, message):
    """Publish a run and its world's status, latched; return the node that does."""
    node = bench.observer()
    node.create_publisher(String, "run", ros_topics.RUN.qos).publish(message)
    waiting = RunStatus(run="theirs", state=RunState.WAITING, step=0, transitions=0)
    publisher = node.create_publisher(
        ros_topics.STATUS.type, "status", ros_topics.STATUS.qos
    )
    publisher.publish(status("env1", waiting.state, waiting.values()))
    return node


@pytest.mark.parametrize("kind", OTHERS)
def test_no_waiting_node_imports_what_a_run_names(bench, beside, tmp_path, capfd, kind):
    place = {"context": bench.place()[0]}
    nodes = {name: bench.add(start(place, tmp_path)) for name, start in NODES.items()}
    say(bench, announced(kind))
    bench.spin_until(
        lambda: all(
            node.subscriber.dropped["run"] or node.presence for node in nodes.values()
        ),
        "all have heard the run",
    )
    said = capfd.readouterr().err.splitlines()
    for name, node in nodes.items():
        refused = name == "robot"
        assert refused == (node.run is None) == (node.presence is None), name
        lines = [line for line in said if f"[{node.get_name()}]: run: " in line]
        lines = [line for line in lines if "was not imported" in line]
        assert len(lines) == refused, name
        assert all("allow it: --allow theirs, a" in line for line in lines)
    assert not beside.exists() and "theirs" not in sys.modules


@pytest.mark.parametrize("kind", OTHERS)
def test_no_node_of_a_run_under_way_does(bench, beside, tmp_path, monkeypatch, kind):
    """And a robot that refused such a run is there for its own team's."""
    heard = []
    for follower in (Follower, WatchNode):
        note = lambda node, *run: heard.append(node.get_name())  # noqa: E731
        monkeypatch.setattr(follower, "another_run", note)
    early = bench.robot("robot_2")
    other = say(bench, announced(kind))
    bench.spin_until(lambda: early.subscriber.dropped["run"], "the run is refused")
    bench.destroy(other)
    bench.spin_until(
        lambda: not early.get_publishers_info_by_topic("/run"), "it is gone"
    )
    world = bench.world(rate=0.001, steps=60, recorded=True)
    place = {"context": bench.place()[0]}
    nodes = [early, *(bench.add(start(place, tmp_path)) for start in NODES.values())]
    bench.spin_until(lambda: world.lockstep.complete, "the first barrier")
    say(bench, announced(kind))
    bench.spin_until(
        lambda: {node.get_name() for node in nodes} <= {*heard}, "all have heard it"
    )
    assert [node.run.learner for node in nodes] == ["coop"] * len(nodes)
    assert not beside.exists() and "theirs" not in sys.modules


@pytest.mark.parametrize("kind", OTHERS)
def test_a_robot_that_is_told_to_follows_it(bench, beside, monkeypatch, kind):
    robot = bench.robot("robot_1", allow=["theirs"])
    say(bench, announced(kind))
    bench.spin_until(lambda: robot.presence is not None, "the robot joins")
    assert beside.exists()


def test_a_world_is_told_by_its_own_parameters(bench, beside):
    world = bench.world(learner="theirs:Team", perception="theirs:fog:0.5")
    assert world.run.rule.label == "theirs:Team" and beside.exists()


def test_the_player_plays_it_unread(bench, beside, tmp_path, monkeypatch):
    monkeypatch.setenv(ALLOW_VARIABLE, "theirs")
    with forgotten():
        recorded(
            tmp_path / "sent", settings={"steps": 60}, values={"learner": "theirs:Team"}
        )
    monkeypatch.setenv(ALLOW_VARIABLE, "")
    beside.unlink()
    values = {"bag": str(tmp_path / "sent/bag"), "rate": 100.0}
    player = bench.add(Player(context=bench.place()[0], values=values))
    bench.spin_until(lambda: player.done, "the bag is played")
    assert not beside.exists()
