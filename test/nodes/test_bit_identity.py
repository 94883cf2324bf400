# Copyright 2026 The sparse_coord_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Real topics and services learn what the simulation without ROS learns, to the last bit."""

from itertools import count

import pytest
import yaml
from mcap.reader import make_reader
from nav_msgs.msg import Path
from rclpy.serialization import deserialize_message

from sparse_coord_ros.core.runs.run_config import load_run
from sparse_coord_ros.log.runlog import verify
from sparse_coord_ros.protocol.lockstep.robot_side import RobotSide
from sparse_coord_ros.protocol.lockstep.world_side import WorldSide
from sparse_coord_ros.ros.nodes.messages import Converter
from sparse_coord_ros.ros.nodes.spin import ros_context
from sparse_coord_ros.ros.nodes.team import run_team

SEED = 7
STEPS = 250


@pytest.fixture(scope="module")
def env1(simulate):
    """Return what a run in env1 should come to."""
    said = simulate("env1", {"steps": STEPS}, seed=SEED)
    assert any(percept[1] is not None for percept in said.percepts.values())
    return said


def values(out, scenario="env1", steps=STEPS, **more):
    sets = [f"steps={steps}", *more.pop("set", [])]
    base = {"scenario": scenario, "seed": SEED, "out": str(out), "set": sets}
    return {**base, "claim_window": 0.0, "record": False, **more}


@pytest.mark.parametrize(
    ("executor", "record", "namespace"),
    [("events", True, "team_a"), ("single", False, "")],
)
def test_team_in_one_process(
    tmp_path, env1, assert_same_tables, executor, record, namespace
):
    out = tmp_path / "out"
    given = values(out, executor=executor, record=record)
    with ros_context() as context:
        summary = run_team(given, context=context, namespace=namespace)
    assert_same_tables(out, env1)
    assert summary == yaml.safe_load((out / "summary.yaml").read_text())
    assert summary["transitions"] == STEPS
    assert summary["timeouts"] == 0
    assert not summary["interrupted"]
    for k, asks in enumerate(summary["asks"].values()):
        mine = [peer for (asker, _), (_, peer) in env1.percepts.items() if asker == k]
        assert asks["answered"] == len(mine)
        assert asks["refused"] == asks["late"] == 0
    assert summary["transitions_dropped"] == 0
    assert (out / "bag" / "metadata.yaml").exists() == record


def test_team_of_three_that_perceive_all_peers_and_pay_differently(
    tmp_path, simulate, assert_same_tables
):
    settings = {
        "steps": 150,
        "peers": "all",
        "perception": "probability:0.7",
        "penalty": -100,
        "common_reward": "each:1:0.5:2",
        "conflict": "any_doorway",
    }
    scenario = tmp_path / "trio.yaml"
    scenario.write_text(
        "map: env2\nrobots: {a: {start: 1, goal: 3}, b: {start: 2, goal: 4}, "
        "c: {start: 3, goal: 1}}\n"
    )
    said = simulate(str(scenario), settings, seed=SEED)
    sets = [f"{name}={value}" for name, value in settings.items()]
    out = tmp_path / "out"
    with ros_context() as context:
        summary = run_team(
            values(out, str(scenario), 150, set=sets, record=True), context=context
        )
    assert_same_tables(out, said)
    assert summary["timeouts"] == 0
    assert any(reward.common == -200.0 for reward in said.rewards.values())
    for k, asks in enumerate(summary["asks"].values()):
        mine = [peers for (asker, _), (_, peers) in said.percepts.items() if asker == k]
        assert asks["refused"] == mine.count(None) > 0
        assert asks["answered"] == len(mine) - mine.count(None) > 5
        assert {len(peers) for peers in mine if peers} == {2}
    assert {said.actions[key].peer for key in said.percepts} == {-1}
    convert = Converter(load_run(out))
    recorded = {}
    with next((out / "bag").glob("*.mcap")).open("rb") as file:
        topics = [f"/{robot.name}/percept" for robot in said.scenario.robots]
        for _, channel, message in make_reader(file).iter_messages(topics=topics):
            path = deserialize_message(message.data, Path)
            step = convert.step(path.header.stamp.sec, path.header.stamp.nanosec)
            places = [stamped.pose.position for stamped in path.poses]
            cells = tuple(convert.cell(place.x, place.y) for place in places)
            recorded[topics.index(channel.topic), step] = cells
    assert recorded == {
        key: (own, *(perceived or ()))
        for key, (own, perceived) in said.percepts.items()
    }


FACTORED = [
    ("env1", {"steps": 500, "perception": "probability:0.7", "penalty": -60}),
    ("env2-4r", {"steps": 120, "perception": "probability:0.8", "credit": "team"}),
]
"""What the factored learner learns: two robots, and four whose world has a referee. They explore
so much that they ask and meet."""
EXPLORING = {"epsilon": "constant:0.8", "q_coord_init": 20, "max_steps": 25}


@pytest.mark.parametrize(("scenario", "settings"), FACTORED)
def test_factored_learner(tmp_path, simulate, assert_same_tables, scenario, settings):
    said = simulate(scenario, {**EXPLORING, **settings}, seed=SEED, learner="factored")
    assert any(len(tables.memory["rho_keys"]) for tables in said.tables)
    assert said.scenario.referee == (len(said.tables) > 2)
    steps = settings["steps"]
    sets = [f"{name}={value}" for name, value in {**EXPLORING, **settings}.items()]
    out = tmp_path / "out"
    with ros_context() as context:
        summary = run_team(
            values(out, scenario, steps, set=sets, learner="factored", record=True),
            context=context,
        )
    assert_same_tables(out, said)
    assert summary["timeouts"] == 0
    assert sum(asks["answered"] for asks in summary["asks"].values()) > 0
    verdict = verify(out / "bag")
    assert verdict.same, verdict.differences


def test_a_learner_that_marks_cells(tmp_path, simulate, assert_same_tables):
    door = tmp_path / "door.yaml"
    door.write_text(
        'map: {name: door, text: "title: door\\n---\\n1D2\\n"}\n'
        "robots: {a: {start: 1, goal: 2}, b: {start: 2, goal: 1}}\n"
    )
    settings = {"steps": 700, "penalty": -50, "epsilon": "constant:0.3"}
    said = simulate(str(door), settings, seed=SEED, learner="cq")
    assert all((tables.q_coord.std(axis=1) > 0).any() for tables in said.tables)
    sets = [f"{name}={value}" for name, value in settings.items()]
    out = tmp_path / "out"
    with ros_context() as context:
        run_team(
            values(out, str(door), 700, set=sets, learner="cq", record=True),
            context=context,
        )
    assert_same_tables(out, said)
    assert verify(out / "bag").same


def test_links_that_fail_fail_alike(tmp_path, simulate, assert_same_tables):
    """Live, in the simulation and in the log."""
    settings = {"steps": 120, "epsilon": "constant:0.8", "link": "bursts:0.1:0.2"}
    said = simulate("env1", settings, seed=SEED)
    assert any(seen is None for _, seen in said.percepts.values())
    sets = [f"{name}={value}" for name, value in settings.items()]
    out = tmp_path / "out"
    with ros_context() as context:
        summary = run_team(
            values(out, "env1", 120, set=sets, record=True), context=context
        )
    assert_same_tables(out, said)
    assert sum(asks["refused"] for asks in summary["asks"].values()) > 5
    assert verify(out / "bag").same


def test_every_node_in_its_own_process(tmp_path, simulate, start, assert_same_tables):
    settings = {**EXPLORING, "steps": 60, "perception": "probability:0.7"}
    said = simulate("crowd-3r", settings, seed=SEED, learner="factored")
    out = tmp_path / "out"
    arguments = [
        "--learner",
        "factored",
        "--seed",
        str(SEED),
        "--out",
        str(out),
        "--processes",
    ]
    for name, value in settings.items():
        arguments += ["--set", f"{name}={value}"]
    process = start("cli.main", "run", "crowd-3r", *arguments)
    assert process.exit_code() == 0, process.output
    assert_same_tables(out, said)
    assert yaml.safe_load((out / "summary.yaml").read_text())["timeouts"] == 0
    assert (out / "bag" / "metadata.yaml").exists()


def test_what_is_lost_is_said_again(
    bench, tmp_path, simulate, assert_same_tables, monkeypatch
):
    """An action, a reward and a state that do not come."""
    settings = {"steps": 45, "perception": "probability:0.8"}
    said = simulate("env2-4r", settings, seed=SEED)

    def losing(hear, number):
        calls = count(1)
        return lambda *what: next(calls) != number and hear(*what)

    lost = [
        (WorldSide, "action", 20),
        (RobotSide, "reward", 60),
        (RobotSide, "state", 90),
    ]
    for side, kind, number in lost:
        monkeypatch.setattr(side, kind, losing(getattr(side, kind), number))
    sets = [f"{name}={value}" for name, value in settings.items()]
    world = bench.world(scenario="env2-4r", seed=SEED, out=str(tmp_path), set=sets)
    robots = bench.robots(4, out=str(tmp_path))
    bench.spin_until_done()
    assert_same_tables(tmp_path, said)
    assert world.summary()["timeouts"] == 0
    assert sum(robot.member.lockstep.dropped for robot in robots) == 0
