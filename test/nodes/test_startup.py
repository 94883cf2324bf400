# Copyright 2026 The sparse_coord_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Nodes start in any order, and nodes that cannot take part report the reason."""

import re
import time

import pytest
from patience import PATIENCE_SECONDS
from rclpy.node import Node
from std_msgs.msg import String
from teams import tables_in

from sparse_coord_ros.base.errors import (
    NameTakenError,
    RunError,
    SettingError,
    TablesError,
)
from sparse_coord_ros.core.runs.saved_tables import save_team
from sparse_coord_ros.log.runlog import verify
from sparse_coord_ros.protocol import wire
from sparse_coord_ros.protocol.lockstep.robot_side import RobotSide
from sparse_coord_ros.protocol.wire.status import NO_ATTEMPT, Progress
from sparse_coord_ros.ros.nodes import parameters, robot, ros_topics
from sparse_coord_ros.ros.nodes.recorder import Recorder
from sparse_coord_ros.ros.nodes.robot import RobotNode
from sparse_coord_ros.ros.nodes.ros_messages import status
from sparse_coord_ros.ros.nodes.spin import ros_context
from sparse_coord_ros.ros.nodes.team import run_team
from sparse_coord_ros.ros.nodes.world_simulator import WorldSimulator

SHORT = 40


@pytest.fixture(scope="module")
def said(simulate):
    return simulate("env1", {"steps": 40})


def start_in_order(bench, out, order, *, wait):
    """Start the nodes named by w(orld), r(ecorder), 1 and 2, the last one settled."""
    made = {
        "w": lambda: bench.world(out=str(out), steps=SHORT, recorded="r" in order),
        "r": lambda: bench.recorder(out / "bag"),
        "1": lambda: bench.robot("robot_1", out=str(out)),
        "2": lambda: bench.robot("robot_2", out=str(out)),
    }
    nodes = []
    for letter in order:
        nodes.append(made[letter]())
        if wait:
            ticks = []
            timer = nodes[-1].create_timer(0.03, lambda ticks=ticks: ticks.append(1))
            bench.spin_until(lambda ticks=ticks: len(ticks) >= 4, "node has settled")
            nodes[-1].destroy_timer(timer)
    return nodes


@pytest.mark.parametrize(
    ("order", "wait"),
    [("w12", True), ("2w1", True), ("12wr", True), ("r21w", False)],
)
def test_any_order(bench, tmp_path, said, assert_same_tables, order, wait):
    start_in_order(bench, tmp_path, order, wait=wait)
    bench.spin_until_done()
    assert_same_tables(tmp_path, said)
    assert "r" not in order or verify(tmp_path / "bag").same


def test_a_robot_that_the_scenario_does_not_have(bench):
    bench.world()
    bench.robot("robot_3")
    with pytest.raises(RunError, match="robot 'robot_3': .* robot_1, robot_2;"):
        bench.spin_until(lambda: False)


@pytest.fixture
def looking(monkeypatch):
    """Let nodes look for others before they begin, and ghosts be gone soon."""
    monkeypatch.setattr(parameters, "DISCOVERY_SECONDS", 1.0)
    monkeypatch.setattr(robot, "GHOST_SECONDS", 1.5)


def test_a_second_robot_of_a_name_stops(bench, looking):
    world = bench.world(rate=0.001)
    first, _ = bench.robots()
    bench.spin_until(lambda: world.lockstep.complete, "first barrier")
    second = bench.robot("robot_1", place="elsewhere")
    with pytest.raises(NameTakenError, match="^node /robot_1: another node has this"):
        bench.spin_until(lambda: False)
    assert second.presence is None
    bench.destroy(second)
    world.values["rate"] = 0.0
    before = world.lockstep.world.transitions
    bench.spin_until(
        lambda: world.lockstep.world.transitions > before + 20, "the first goes on"
    )
    assert first.lockstep.newest[0] > 20


def test_a_robot_waits_until_a_ghost_of_its_name_is_gone(bench, looking, monkeypatch):
    monkeypatch.setattr(robot, "GHOST_SECONDS", PATIENCE_SECONDS)
    ghost = bench.add(Node("robot_1", context=bench.place("killed")[0]), "killed")
    bench.world()
    one = bench.robot("robot_1")
    bench.spin_until(lambda: one.run and one.looked_around(time.monotonic()), "a run")
    assert one.presence is None
    bench.destroy(ghost)
    bench.spin_until(lambda: one.presence, "it begins")


def test_a_second_world_stops(bench, looking):
    """Whatever its name; a killed one sends nothing, so the next one begins."""
    first = bench.world(rate=0.001)
    bench.spin_until(lambda: first.looked_around(time.monotonic()), "it has opened")
    named = ["--ros-args", "-r", "__node:=earth", "-p", "scenario:=cit"]
    context, _ = bench.place("elsewhere", named)
    second = bench.add(WorldSimulator(context=context), "elsewhere")
    with pytest.raises(NameTakenError, match="^another world announces a run on /run;"):
        bench.spin_until(lambda: False)
    assert second.may_stop()
    second.finish(interrupted=True)
    bench.destroy(second)
    bench.robots()
    bench.spin_until(lambda: first.lockstep.complete, "the first goes on")


def ends_without(bench, world, *missing, start):
    """Let a world give up once it lacks just these; it names them, and what starts the first."""

    def lacks():
        return hasattr(world, "restart") and world.restart.silent == [*missing]

    bench.spin_until(lacks, f"it lacks {missing}")
    world.startup_timeout = 0.001
    text = f"^after .* {re.escape(', '.join(missing))};.*: ros2 run "
    text += re.escape(f"sparse_coord_ros {start}") + "$"
    with pytest.raises(RunError, match=text):
        bench.spin_until(lambda: False)


def test_robots_that_are_missing_are_named(bench, monkeypatch):
    monkeypatch.setattr("sparse_coord_ros.ros.nodes.robot.PEER_PATIENCE_SECONDS", 0.1)
    world = bench.world(scenario="env2-4r")
    for name in ("robot_1", "robot_3"):
        bench.robot(name)
    start = "robot --ros-args -r __node:=robot_2"
    ends_without(bench, world, "robot_2", "robot_4", start=start)


def test_a_recorder_that_is_missing_is_named(bench):
    world = bench.world(recorded=True)
    bench.robots()
    ends_without(bench, world, "recorder", start="recorder")


def test_a_robot_that_is_missing_in_a_namespace_is_started_there(bench):
    world = bench.world(namespace="/team_a")
    start = "robot --ros-args -r __node:=robot_1 -r __ns:=/team_a"
    ends_without(bench, world, "robot_1", "robot_2", start=start)


def test_a_greedy_robot_without_tables(bench):
    bench.world(greedy=True)
    bench.robots()
    with pytest.raises(TablesError, match="the run is greedy .* .tables."):
        bench.spin_until(lambda: False)


def test_a_recorder_that_comes_back_is_heard_of_although_the_killed_one_is_still_listed(
    bench,
):
    """Else earlier messages are missing in the log, and `verify` finds a difference."""
    world = bench.world()
    states = world.topics.states[0]

    def recorder(place):
        node = bench.add(Node(wire.RECORDER, context=bench.place(place)[0]), place)
        node.create_publisher(String, ros_topics.RECORDING.name, 1)
        return node

    def listens(node):
        node.create_subscription(
            ros_topics.LOCAL_STATE.type,
            states.topic_name,
            print,
            ros_topics.LOCAL_STATE.qos,
        )

    listens(recorder("killed"))  # it stays in the graph
    bench.spin_until(
        lambda: world.heard_by(states, wire.RECORDER), "the first one is heard of"
    )
    back = recorder("back")

    def known():
        infos = world.get_publishers_info_by_topic(f"/{ros_topics.RECORDING.name}")
        return [info.node_name for info in infos] == [wire.RECORDER] * 2

    bench.spin_until(known, "the second one is known")
    assert not world.heard_by(states, wire.RECORDER)
    listens(back)
    bench.spin_until(lambda: world.heard_by(states, wire.RECORDER), "it listens")


@pytest.mark.parametrize("name", ["robot_1", "recorder"])
def test_who_hears_of_no_world_ends(bench, tmp_path, name):
    if name == "recorder":
        node = bench.recorder(tmp_path / "bag")
    else:
        node = bench.robot(name)
    node.startup_timeout = 0.2
    with pytest.raises(RunError, match=f"^node {name} .* /run"):
        bench.spin_until(lambda: False)


def contents(folder):
    return {path.name: path.read_bytes() for path in folder.iterdir()}


def test_a_bag_is_left_alone(bench, tmp_path):
    (tmp_path / "metadata.yaml").write_text("precious")
    before = contents(tmp_path)
    with pytest.raises(RunError, match=str(tmp_path)):
        bench.recorder(tmp_path)
    assert contents(tmp_path) == before


def test_a_teams_output_directory_is_left_alone(tmp_path):
    (tmp_path / "tables.npz").write_text("precious")
    before = contents(tmp_path)
    values = {"scenario": "env1", "out": str(tmp_path)}
    with (
        ros_context() as context,
        pytest.raises(RunError, match=str(tmp_path)),
    ):
        run_team(values, context=context)
    assert contents(tmp_path) == before


@pytest.mark.parametrize("wrong", [{"steps": 0}, {"scenari": "env1"}])
def test_a_team_that_is_refused_makes_no_directory(tmp_path, wrong):
    out = tmp_path / "out"
    values = {"scenario": "env1", "out": str(out), **wrong}
    with ros_context() as context, pytest.raises(SettingError):
        run_team(values, context=context)
    assert not out.exists()


def test_learned_tables_are_run_greedily(tmp_path, simulate):
    learned = simulate("env1", {"steps": 3000}, seed=3)
    before = tmp_path / "before"
    before.mkdir()
    save_team(before, [table.memory for table in learned.tables])
    values = {"scenario": "env1", "record": False}
    epsilons = []

    acts = RobotNode.act

    def act(node, step, action, report):
        epsilons.append(node.lockstep.agent.epsilon(step))
        acts(node, step, action, report)

    with pytest.MonkeyPatch.context() as patch, ros_context() as context:
        out = tmp_path / "first"
        run_team({**values, "out": str(out), "steps": 1}, context=context)
        (before / "run.yaml").write_text((out / "run.yaml").read_text())
        patch.setattr(RobotNode, "act", act)
        patch.setattr(RobotSide, "peer_state", None)  # it hears nothing of its peers
        out = tmp_path / "greedy"
        more = {
            "out": str(out),
            "steps": 80,
            "greedy": True,
            "tables": str(before),
            "peers_seen": "while_learning",
        }
        summary = run_team({**values, **more}, context=context)
    assert summary["transitions"] == 80
    assert sum(asks["answered"] for asks in summary["asks"].values()) > 0
    assert len(epsilons) > 80
    assert set(epsilons) == {0.0}
    for mine, theirs in zip(tables_in(out), learned.tables, strict=True):
        for name, array in theirs.memory.items():  # the counts, too
            assert mine.memory[name].tobytes() == array.tobytes(), name


def test_learning_goes_on_from_tables(tmp_path, simulate, assert_same_tables):
    first = simulate("env1", {"steps": 40}, seed=3)
    second = simulate("env1", {"steps": 40}, seed=4, tables=first.tables)
    values = {"scenario": "env1", "record": False, "steps": SHORT}
    with ros_context() as context:
        run_team({**values, "seed": 3, "out": str(tmp_path / "one")}, context=context)
        more = {
            "seed": 4,
            "out": str(tmp_path / "two"),
            "tables": str(tmp_path / "one"),
        }
        begun = (tmp_path / "two" / "run.yaml").exists
        assert run_team({**values, **more}, context=context, stop=begun)["interrupted"]
        run_team({"out": more["out"]}, context=context)
    assert_same_tables(tmp_path / "one", first)
    assert_same_tables(tmp_path / "two", second)
    assert second.tables[0].q_star.tobytes() != first.tables[0].q_star.tobytes()


def test_a_robot_that_is_partly_there_is_told_by_what_it_lacks(bench):
    """Such as a user's own program that does not subscribe to its reward."""
    world = bench.world()
    bench.robot("robot_1")
    context = bench.place("mine")[0]
    mine = bench.add(Node("robot_2", context=context), "mine")
    action = ros_topics.ACTION
    state = ros_topics.LOCAL_STATE
    mine.create_publisher(action.type, action.of("robot_2"), action.qos)
    mine.create_subscription(
        state.type, state.of("robot_2"), lambda said: None, state.qos
    )
    progress = ros_topics.PROGRESS
    says = mine.create_publisher(progress.type, progress.of("robot_2"), progress.qos)

    def say(attempt):
        values = Progress((), attempt).values()
        says.publish(status("robot_2", "progress", values))

    say(NO_ATTEMPT)
    bench.spin_until(lambda: hasattr(world, "restart"), "it has opened")
    bench.spin_until(lambda: world.restart.order.attempt, "both are there")
    say(world.restart.order.attempt)
    lacks = "robot_2 (it lacks a subscription to /robot_2/reward)"
    bench.spin_until(lambda: not world.restart.waiting, "both have begun")
    bench.spin_until(lambda: world.topics.missing() == [lacks], "it is half there")
    world.startup_timeout = 0.001
    with pytest.raises(RunError, match=re.escape(lacks)):
        bench.spin_until(lambda: False)


@pytest.mark.long
def test_world_and_recorder_may_be_renamed(bench, tmp_path):
    """Their topics show their roles; and /clock stands still for use_sim_time.

    Each node has a context of its own. On a busy machine, once in a hundred times, two of so many
    participants in one process do not find each other.
    """

    def start(kind, name, *parameters):
        own = ["--ros-args", "-r", f"__node:={name}", "-p", "use_sim_time:=true"]
        own += [word for parameter in parameters for word in ("-p", parameter)]
        return bench.add(kind(context=bench.place(name, own)[0]), name)

    start(WorldSimulator, "earth", "scenario:=env1", "steps:=30", "recorded:=true")
    start(Recorder, "scribe", f"out:={tmp_path / 'bag'}")
    for name in ("robot_1", "robot_2"):
        start(RobotNode, name)
    bench.spin_until_done()
    assert verify(tmp_path / "bag").same
