# Copyright 2026 The sparse_coord_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Real topics and services learn what the simulation without ROS learns, to the last bit.

Each learner that runs live does so in both ways: all nodes in one process, and each in its own.
What a learner computes in which game, test/engine/test_same_run.py compares.
"""

from itertools import count

import pytest
import yaml
from mcap.reader import make_reader
from nav_msgs.msg import Path
from rclpy.serialization import deserialize_message

from sparse_coord_ros.core.learners.registry import LEARNERS, learner_of
from sparse_coord_ros.core.runs.run_config import load_run
from sparse_coord_ros.log.runlog import verify
from sparse_coord_ros.protocol.lockstep.robot_side import RobotSide
from sparse_coord_ros.protocol.lockstep.world_side import WorldSide
from sparse_coord_ros.ros.nodes.ros_messages import messages_of
from sparse_coord_ros.ros.nodes.spin import ros_context
from sparse_coord_ros.ros.nodes.team import run_team

SEED = 7

TRIO = """\
map: env2
robots: {a: {start: 1, goal: 3}, b: {start: 2, goal: 4}, c: {start: 3, goal: 1}}
"""
DOOR = """\
map: {name: door, text: "title: door\\n---\\n1D2\\n"}
robots: {a: {start: 1, goal: 2}, b: {start: 2, goal: 1}}
"""
LANE = """\
map: {name: lane, text: "title: lane\\n---\\n1..D2\\n"}
robots: {a: {start: 1, goal: 2}, b: {start: 2, goal: 1}}
"""

GAMES = {
    "coop": (
        TRIO,
        {
            "steps": 150,
            "peers": "all",
            "perception": "probability:0.7",
            "penalty": -100,
            "common_reward": "each:1:0.5:2",
            "interactions": "together:any_doorway",
        },
        {"record": True, "namespace": "team_a"},
    ),
    "noncoop": ("env1", {"steps": 150}, {"record": False}),
    "voi": (
        "env2-4r",
        {
            "steps": 120,
            "perception": "probability:0.8",
            "credit": "team",
            "epsilon": "constant:0.8",
            "q_coord_init": 20,
            "max_steps": 25,
        },
        {"record": True},
    ),
    "hysteretic": (
        LANE,
        {"steps": 200, "interactions": "swap+block", "max_steps": 30},
        {"record": True},
    ),
    "cq": (
        DOOR,
        {"steps": 300, "penalty": -50, "epsilon": "constant:0.3"},
        {"record": True},
    ),
    "joint": (LANE, {"steps": 150, "epsilon": "constant:0.3"}, {"record": False}),
    "coop, peers seen": (
        TRIO,
        {
            "steps": 120,
            "peers": "all",
            "perception": "probability:0.7",
            "peers_seen": "while_learning",
        },
        {"record": True},
    ),
}
"""Of each learner: a game that shows what its robots say to one another, its settings, and how the
team is run. Percepts fail; robots perceive all peers, and are paid differently; robots know with
whom they interacted; robots mark cells; robots stop each other, and pay for exchanges; robots
learn from the states of their peers."""

OFTEN = "cq"
"""The game that every test run plays in processes."""


@pytest.fixture
def played(tmp_path, simulate):
    """Return a function that gives a game: scenario, learner, settings, and result."""

    def play(game):
        scenario, settings, how = GAMES[game]
        learner = learner_in(game)
        if "\n" in scenario:
            file = tmp_path / "game.yaml"
            file.write_text(scenario)
            scenario = str(file)
        said = simulate(scenario, settings, seed=SEED, learner=learner)
        return scenario, learner, settings, said, how

    return play


def learner_in(game):
    return game.partition(",")[0]


def test_each_learner_that_runs_live_is_here():
    shipped = [name for name in LEARNERS.registered if ":" not in name]
    live = {name for name in shipped if learner_of(name).runs_live}
    assert live == {learner_in(game) for game in GAMES}


@pytest.mark.parametrize("game", GAMES)
def test_team_in_one_process(tmp_path, played, assert_same_tables, game):
    scenario, learner, settings, said, how = played(game)
    out = tmp_path / "out"
    given = {"scenario": scenario, "learner": learner, "seed": SEED, **settings}
    more = {**given, "out": str(out), **how}
    namespace = more.pop("namespace", "")
    with ros_context() as context:
        summary = run_team(more, context=context, namespace=namespace)
    assert_same_tables(out, said)
    assert summary == yaml.safe_load((out / "summary.yaml").read_text())
    assert summary["transitions"] == said.scenario.steps
    assert (summary["timeouts"], summary["interrupted"]) == (0, False)
    assert summary["transitions_dropped"] == 0
    for k, asks in enumerate(summary["asks"].values()):
        mine = [peers for (asker, _), (_, peers) in said.percepts.items() if asker == k]
        assert asks["refused"] == mine.count(None)
        assert asks["answered"] == len(mine) - mine.count(None)
        assert asks["late"] == 0
    assert (out / "bag" / "metadata.yaml").exists() == how["record"]
    if how["record"]:
        found = verify(out / "bag")
        assert found.same, found.first
        assert percepts_in(out / "bag", namespace, load_run(out)) == {
            key: (own, *(perceived or ()))
            for key, (own, perceived) in said.percepts.items()
        }


def percepts_in(bag, namespace, run):
    """Return the robots' published percepts: {(robot, step): own cell, and those of peers}."""
    messages = messages_of(run)
    found = {}
    topics = [
        f"/{namespace}/{robot}/percept".replace("//", "/")
        for robot in run.scenario.names
    ]
    with next(bag.glob("*.mcap")).open("rb") as file:
        for _, channel, message in make_reader(file).iter_messages(topics=topics):
            path = deserialize_message(message.data, Path)
            step = messages.step(path.header.stamp.sec, path.header.stamp.nanosec)
            places = [stamped.pose.position for stamped in path.poses]
            cells = tuple(messages.cell(place.x, place.y) for place in places)
            found[topics.index(channel.topic), step] = cells
    return found


def test_the_games_show_what_they_are_for(played):
    """The runs above would prove little if robots never met, asked, or marked a cell."""
    *_, coop, _ = played("coop")
    assert any(reward.common == -200.0 for reward in coop.rewards.values())
    seen = [peers for _, peers in coop.percepts.values()]
    assert min(seen.count(None), len(seen) - seen.count(None)) > 5
    assert {len(peers) for peers in seen if peers} == {2}
    *_, voi, _ = played("voi")
    assert voi.percepts
    assert any(len(tables.memory["steps_keys"]) for tables in voi.tables)
    *_, hysteretic, _ = played("hysteretic")
    common = {reward.common for reward in hysteretic.rewards.values()}
    assert common == {0.0, -100.0}
    *_, cq, _ = played("cq")
    assert all((tables.q_coord.std(axis=1) > 0).any() for tables in cq.tables)


@pytest.mark.parametrize(
    "game",
    [
        pytest.param(name, marks=[] if name == OFTEN else pytest.mark.long)
        for name in GAMES
    ],
)
def test_every_node_in_its_own_process(
    tmp_path, played, start, assert_same_tables, game
):
    """The learner has no influence on the way from process to process."""
    scenario, learner, settings, said, how = played(game)
    out = tmp_path / "out"
    words = ["--learner", learner, "--seed", str(SEED), "--out", str(out)]
    words += [word for k, v in settings.items() for word in ("--set", f"{k}={v}")]
    words += ["--processes"] if how["record"] else ["--processes", "--no-record"]
    process = start("cli.main", "run", scenario, *words)
    assert process.exit_code() == 0, process.output
    assert_same_tables(out, said)
    assert yaml.safe_load((out / "summary.yaml").read_text())["timeouts"] == 0
    assert (out / "bag" / "metadata.yaml").exists() == how["record"]


def test_what_is_lost_is_said_again(
    bench, tmp_path, simulate, assert_same_tables, monkeypatch
):
    """An action, a reward, a state and a peer's state that do not come."""
    settings = {
        "steps": 45,
        "perception": "probability:0.8",
        "peers": "all",
        "peers_seen": "while_learning",
    }
    said = simulate("env2-4r", settings, seed=SEED)

    def losing(hear, number):
        calls = count(1)
        return lambda *what: next(calls) != number and hear(*what)

    lost = [
        (WorldSide, "action", 20),
        (RobotSide, "reward", 60),
        (RobotSide, "state", 90),
        (RobotSide, "peer_state", 150),
    ]
    for side, kind, number in lost:
        monkeypatch.setattr(side, kind, losing(getattr(side, kind), number))
    world = bench.world(scenario="env2-4r", seed=SEED, out=str(tmp_path), **settings)
    robots = bench.robots(4, out=str(tmp_path))
    bench.spin_until_done()
    assert_same_tables(tmp_path, said)
    assert world.summary()["timeouts"] == 0
    assert sum(robot.lockstep.dropped for robot in robots) == 0
