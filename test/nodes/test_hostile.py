# Copyright 2026 The sparse_coord_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Nodes survive any message on a topic, learn nothing from it, and count it."""

import os
import signal
import subprocess
import sys
from types import SimpleNamespace

import pytest
import yaml
from builtin_interfaces.msg import Time
from geometry_msgs.msg import PoseStamped
from patience import PATIENCE_SECONDS
from rcl_interfaces.msg import Log
from rclpy.serialization import serialize_message
from std_msgs.msg import Header, String
from teams import tables_in

from sparse_coord_ros.base.errors import FaultError, NameTakenError, RunError
from sparse_coord_ros.core.game.settings import SettingTable
from sparse_coord_ros.core.learners.agent import Agent
from sparse_coord_ros.log.bags import open_bag
from sparse_coord_ros.log.runlog.verify import verify
from sparse_coord_ros.protocol.wire.services import ACTIVE_PERCEPTION
from sparse_coord_ros.protocol.wire.status import RunStatus
from sparse_coord_ros.ros.nodes import ros_topics, spin
from sparse_coord_ros.ros.nodes.environment import (
    SECURITY_MARK,
    check_participants,
    check_security,
)
from sparse_coord_ros.ros.nodes.messages import status
from sparse_coord_ros.ros.nodes.parameters import ParameterNode
from sparse_coord_ros.ros.nodes.recorder import Recorder
from sparse_coord_ros.ros.nodes.robot import RobotNode
from sparse_coord_ros.ros.nodes.spin import ending, ros_context, run_node, signals
from sparse_coord_ros.ros.nodes.team import run_team
from sparse_coord_ros.ros.nodes.world_simulator import WorldSimulator

GARBAGE = (b"", b"abcd", b"\x00\x01\x00\x00\xff\xff\xff\xff", bytes(range(12)))
SETTINGS = ["steps=60", "epsilon=constant:1"]
NAMES = ("robot_1", "robot_2")


class Attacker:
    """Publishes arbitrary messages on the topics of a team."""

    def __init__(self, bench, namespace=""):
        self.node = bench.observer(namespace)
        self._bench = bench
        self._publishers = {}

    def say(self, topic, data, owner=""):
        """Publish once a node of the team subscribes."""
        name = topic.of(owner) if owner else topic.name
        if name not in self._publishers:
            self._publishers[name] = self.node.create_publisher(
                topic.type, name, topic.qos
            )
        publisher = self._publishers[name]
        self._bench.spin_until(
            publisher.get_subscription_count, f"somebody hears {name}"
        )
        publisher.publish(data)


def pose(cell_of, step, cell):
    return serialize_message(cell_of.pose(step, cell))


def forged(*said):
    return status("env1", said[1], RunStatus(*said).values())


def test_a_team_under_fire_learns_what_it_would_have_learned(
    bench, tmp_path, simulate, assert_same_tables
):
    """Garbage, far steps, other frames, other runs, forged ends and claims; and verify agrees."""
    attacker = Attacker(bench)
    world = bench.world(out=str(tmp_path), set=SETTINGS, recorded=True, rate=0.001)
    recorder = bench.recorder(tmp_path / "bag")
    robots = bench.robots(out=str(tmp_path))
    bench.spin_until(lambda: world.lockstep.complete, "the first barrier")
    convert = world.topics.convert
    for data in GARBAGE:
        for topic in (ros_topics.RUN, ros_topics.STATUS, ros_topics.CLOCK):
            attacker.say(topic, data)
        for topic in (
            ros_topics.LOCAL_STATE,
            ros_topics.REWARD,
            ros_topics.ACTION,
            ros_topics.CLAIM,
        ):
            attacker.say(topic, data, "robot_1")
        attacker.say(ros_topics.TABLES, data, "robot_1")
        attacker.say(ros_topics.MAP, data)
    for step in (1_000_000, 20):
        attacker.say(ros_topics.LOCAL_STATE, pose(convert, step, 3), "robot_1")
    late = PoseStamped(header=Header(frame_id="map", stamp=Time(sec=2**31 - 1)))
    attacker.say(ros_topics.LOCAL_STATE, serialize_message(late), "robot_2")
    late.header.stamp.sec = -5
    attacker.say(ros_topics.LOCAL_STATE, serialize_message(late), "robot_2")
    for run in ("", "another"):
        attacker.say(ros_topics.STATUS, forged(run, "finished", 1, 60))
    attacker.say(ros_topics.STATUS, forged(world.run.id, "finished", 1, 7))
    attacker.say(ros_topics.RUN, String(data="steps: [1"))
    for stamp in (Time(), Time(sec=2**31 - 1)):
        for name in (*NAMES, "world_simulator"):
            attacker.say(
                ros_topics.CLAIM, Header(frame_id="0 joined", stamp=stamp), name
            )
    robot = robots[0]
    bench.spin_until(
        lambda: (
            {"robot_1/local_state", "status", "run", "~/_claim"}
            <= set(robot.subscriber.dropped)
            and robots[1].subscriber.dropped["robot_2/local_state"] >= 2
            and world.subscriber.dropped["robot_1/action"] >= len(GARBAGE)
            and recorder.subscriber.dropped["clock"] >= 2
        ),
        "all has arrived",
    )
    bench.destroy(attacker.node)  # the recorder would wait for its last words
    world.values["rate"] = 0.0
    bench.spin_until_done()
    said = simulate("env1", {"steps": 60, "epsilon": "constant:1"})
    assert_same_tables(tmp_path, said)
    assert recorder.error is None
    assert world.summary()["messages_dropped"] >= len(GARBAGE)


class Faulty(ParameterNode):
    """A node whose timer raises an unexpected error."""

    def __init__(self, context, error):
        super().__init__("faulty", SettingTable([]), context=context, values={})
        self.said = []
        self.create_timer(0.01, lambda: self._raise(error))

    def _raise(self, error):
        if self.count_subscribers("/rosout"):
            raise error

    def finish(self, *, interrupted):
        self.said.append(interrupted)


@pytest.mark.parametrize(
    ("error", "code", "text", "told"),
    [
        (
            KeyError("x"),
            1,
            "error: unexpected KeyError: 'x' (",
            "Traceback (most recent call",
        ),
        (
            RunError("no such thing"),
            2,
            "error: no such thing",
            "no such thing",
        ),
        (
            OSError(28, "No space left", "/a/b"),
            2,
            "error: /a/b: No space left; ",
            "/a/b: No",
        ),
    ],
)
def test_any_exception_saves_and_is_told(bench, capfd, error, code, text, told):
    """The error is one line, with an exit code, and on /rosout."""
    heard = bench.observer().listen(Log, "/rosout", latched=True)
    nodes = []

    def make(context):
        nodes.append(Faulty(context, error))
        return nodes[0]

    assert run_node(make, []) == code
    assert nodes[0].said == [True]
    line = capfd.readouterr().err.splitlines()[-1]
    assert line.startswith(text)
    bench.spin_until(
        lambda: any(m.msg.startswith(told) for m in heard), "/rosout tells it"
    )


def test_who_gives_way_to_another_node_of_its_name_saves_nothing():
    """Its run directory belongs to the other one."""
    done = []
    node = SimpleNamespace(failure=None, destroy_node=lambda: done.append("gone"))
    with pytest.raises(NameTakenError), ending([node], lambda: done.append("saved")):
        raise NameTakenError
    assert done == ["gone"]


def test_a_fault_of_one_robot_saves_the_tables_of_all(tmp_path, monkeypatch):
    learn = Agent.learn

    def fail_at_last(agent, step, *what):
        if agent.number == 1 and step > 20:
            raise ZeroDivisionError
        learn(agent, step, *what)

    monkeypatch.setattr(Agent, "learn", fail_at_last)
    out = tmp_path / "out"
    values = {"scenario": "env1", "claim_window": 0.0, "out": str(out), "record": True}
    with (
        ros_context() as context,
        pytest.raises(FaultError, match="^unexpected ZeroDivisionErr"),
    ):
        run_team(values, context=context)
    assert len(tables_in(out)) == 2
    assert yaml.safe_load((out / "summary.yaml").read_text())["interrupted"] is True
    assert open_bag(out / "bag").finished


def test_a_closed_terminal_stops_a_node_but_not_one_under_nohup():
    with signals() as stop:
        os.kill(os.getpid(), signal.SIGHUP)
        assert stop.signal == signal.SIGHUP
    before = signal.signal(signal.SIGHUP, signal.SIG_IGN)
    try:
        with signals() as stop:
            os.kill(os.getpid(), signal.SIGHUP)
            assert not stop
    finally:
        signal.signal(signal.SIGHUP, before)


def test_a_node_that_cannot_be_taken_down_ends_with_a_word():
    code = f"import ctypes, {spin.__name__} as spin; spin.SHUTDOWN_SECONDS = 0.1\n"
    hangs = "ctypes.PyDLL(None).sleep(3600)"  # as rclpy does: nothing of Python runs meanwhile
    code += f"with spin.limited_shutdown(): {hangs}"
    done = subprocess.run(
        [sys.executable, "-c", code],
        capture_output=True,
        text=True,
        timeout=PATIENCE_SECONDS,
    )
    assert (done.returncode, done.stdout) == (1, "")
    assert done.stderr.startswith("Timeout") and "in <module>" in done.stderr


def test_a_second_publisher_of_a_topic_is_named(bench, capfd):
    stranger = bench.observer()
    stranger.create_publisher(
        ros_topics.REWARD.type, ros_topics.REWARD.of("robot_2"), 10
    )
    guard = bench.world().guard
    guard.watch(["/robot_1/reward", "/robot_2/reward"])

    def seen():
        guard.look()
        return guard.doubled

    bench.spin_until(seen, "the stranger is seen")
    guard.look()
    assert guard.doubled == {"/robot_2/reward"}
    (line,) = [
        line for line in capfd.readouterr().err.splitlines() if "publishers" in line
    ]
    assert (
        "/robot_2/reward has 2 publishers, /observer, /world_simulator; it should"
        in line
    )


@pytest.mark.parametrize("begins", ["before the run", "in the run"])
def test_a_second_server_of_a_robots_service_changes_nothing(
    begins, bench, tmp_path, simulate, assert_same_tables, capfd
):
    """It answers with a wrong cell, an old step, a refusal, in turn, and before the robot does."""
    settings = {"steps": 70, "epsilon": "constant:1"}
    stranger = bench.observer()
    asked = []
    answered = []

    def lie(request, response):
        asked.append(request)
        response.plan.header = request.start.header
        response.plan.poses = [request.start] * (len(asked) % 3 == 1)
        if len(asked) % 3 == 2:
            response.plan.header.stamp = Time()
        return response

    class Slow(RobotNode):
        """A robot that answers after the foreign server."""

        def create_service(self, kind, name, answer, **more):
            def answer_later(request, response):
                answered.append(request)
                while asked and len(asked) < len(answered):
                    bench.place("observer")[1].spin_once(timeout_sec=0.01)
                for place in ("observer", *["team"] * 5):  # the lie is sent, and heard
                    bench.place(place)[1].spin_once(timeout_sec=0.01)
                return answer(request, response)

            asks = name == ACTIVE_PERCEPTION.of("robot_2")
            then = answer_later if asks else answer
            return super().create_service(kind, name, then, **more)

    world = bench.world(out=str(tmp_path), **settings)
    values = {"out": str(tmp_path), "claim_window": 0.0}
    slow = Slow(name="robot_2", context=bench.place("other")[0], values=values)
    robots = [bench.robot("robot_1", out=str(tmp_path)), bench.add(slow, "other")]
    percepts = stranger.listen(
        ros_topics.PERCEPT.type, ros_topics.PERCEPT.of("robot_1")
    )
    if begins == "in the run":
        bench.spin_until(lambda: world.lockstep.world.step > 9, "the run is under way")
    answered.clear()
    stranger.create_service(
        ros_topics.ACTIVE_PERCEPTION_TYPE, "robot_2/active_perception", lie
    )

    def seen():
        world.guard.look()
        return world.guard.doubled

    bench.spin_until(seen, "the stranger is seen")
    bench.spin_until_done(world, *robots)
    said = simulate("env1", settings)
    assert_same_tables(tmp_path, said)
    true = [
        (step, (c, *(p or ()))) for (k, step), (c, p) in said.percepts.items() if k == 0
    ]
    bench.spin_until(lambda: len(percepts) >= len(true), "all percepts are heard")
    assert percepts == [world.topics.convert.path(*one) for one in true]
    assert (
        len(asked) > 6 and robots[0].subscriber.dropped["robot_2/active_perception"] > 0
    )
    assert world.summary()["services_of_two_servers"] == 1
    [line] = [
        line for line in capfd.readouterr().err.splitlines() if "has 2 servers" in line
    ]
    assert (
        "/robot_2/active_perception has 2 servers, /observer, /robot_2; it should"
        in line
    )


def test_security_is_refused_where_fast_dds_has_none(tmp_path, monkeypatch):
    library = tmp_path / "lib" / "libfastrtps.so"
    monkeypatch.setattr(sys, "prefix", str(tmp_path))
    check_security()
    monkeypatch.setenv("ROS_SECURITY_ENABLE", "true")
    check_security()  # no wheel: a build of the user's own
    library.parent.mkdir()
    library.write_bytes(b"without")
    with pytest.raises(RunError, match="DDS-Security"):
        check_security()
    library.write_bytes(b"with " + SECURITY_MARK)
    check_security()


def test_world_and_recorder_may_be_renamed(bench, tmp_path):
    """Their topics show their roles; and /clock stands still for use_sim_time."""

    def start(kind, name, *parameters):
        own = ["--ros-args", "-r", f"__node:={name}", "-p", "use_sim_time:=true"]
        own += [word for parameter in parameters for word in ("-p", parameter)]
        return bench.add(kind(context=bench.place(name, own)[0]), name)

    start(WorldSimulator, "earth", "scenario:=env1", "steps:=30", "recorded:=true")
    start(Recorder, "scribe", f"out:={tmp_path / 'bag'}")
    for name in NAMES:
        start(RobotNode, name)
    bench.spin_until_done()
    assert "/earth/_claim" in open_bag(tmp_path / "bag").topics
    assert verify(tmp_path / "bag").same


def test_more_processes_than_find_each_other_are_refused(monkeypatch):
    monkeypatch.setenv("ROS_AUTOMATIC_DISCOVERY_RANGE", "LOCALHOST")
    check_participants(32)
    with pytest.raises(RunError, match="^34 nodes in processes"):
        check_participants(34)
    monkeypatch.setenv("ROS_AUTOMATIC_DISCOVERY_RANGE", "SUBNET")
    check_participants(34)
