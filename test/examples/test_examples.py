# Copyright 2026 The sparse_coord_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Every file of examples/ does what its first lines say, in a folder of its own."""

import runpy
from pathlib import Path

import pytest
from live_teams import same_tables
from teams import in_parts, learn, tables_equal, tables_in

from sparse_coord_ros.cli.main import main
from sparse_coord_ros.core.engine.batch import run_batch, uses_numba
from sparse_coord_ros.core.engine.training import train
from sparse_coord_ros.core.game.plugins import allow_modules
from sparse_coord_ros.core.game.scenario import load_scenario
from sparse_coord_ros.core.learners.registry import learner_of
from sparse_coord_ros.core.runs.measures import by_run
from sparse_coord_ros.log.runlog import verify
from sparse_coord_ros.ros.nodes.spin import ros_context
from sparse_coord_ros.ros.nodes.team import run_team

EXAMPLES = Path(__file__).parents[2] / "examples"
ELSEWHERE = ("own_robot.py",)
"""Run by test/nodes/test_own_robot.py."""


@pytest.fixture
def said(tmp_path, monkeypatch, capsys):
    """Return a function that runs an example in an empty folder and returns what it printed."""
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("MPLBACKEND", "Agg")

    def run(name, *words):
        monkeypatch.setattr("sys.argv", [name, *map(str, words)])
        runpy.run_path(str(EXAMPLES / name), run_name="__main__")
        return capsys.readouterr().out

    return run


def test_all_of_them_are_listed_and_run_here():
    names = {path.name for path in EXAMPLES.glob("*.py")}
    source = Path(__file__).read_text()
    listed = (EXAMPLES / "README.md").read_text()
    run = [f"{one.partition(':')[0]}.py" for one in OWN]
    assert [n for n in names if n not in run and f'"{n}"' not in source] == []
    assert [name for name in names if f"({name})" not in listed] == []


def test_train_and_plot(said, tmp_path, capsys):
    out = said("train_and_plot.py", 2000)
    assert [line.split(":")[0] for line in out.splitlines()] == [
        "noncoop",
        "coop",
        "exact joint optimum",
    ]
    assert (tmp_path / "learning_curve.png").read_bytes()[1:4] == b"PNG"
    assert main(["evaluate", "runs/coop", "--trials", "5"]) == 0
    assert "  5 trials\n" in capsys.readouterr().out


def test_own_perception(said):
    lines = said("own_perception.py", 3000).splitlines()
    assert [line.rpartition(": returns")[0] for line in lines] == [
        "always",
        "fog:4",
        "fog:1",
    ]
    assert len({line.partition("return")[2] for line in lines}) > 1


def test_own_learner(said):
    lines = said("own_learner.py", 5000).splitlines()
    assert [line.split(":")[0] for line in lines] == ["coop", "careful"]
    assert len({line.partition(":")[2] for line in lines}) == 2


OWN = ("expected_sarsa:ExpectedSarsa", "ucb:UCB", "boltzmann:Boltzmann")
"""Learners with a rule of their own: an update, and two ways to explore."""

SETTINGS = {"steps": 600, "penalty": -20, "perception": "probability:0.7"}


@pytest.fixture(
    params=[OWN[0], *(pytest.param(name, marks=pytest.mark.long) for name in OWN[1:])]
)
def own(request, monkeypatch):
    """Return the name of a learner of an example."""
    monkeypatch.syspath_prepend(EXAMPLES)
    allow_modules(request.param.partition(":")[0])
    return request.param


def test_own_rules_live_stopped_resumed_and_from_the_log(own, tmp_path):
    """The bits of plain Python without ROS, which are not those of Algorithm 1."""
    out = tmp_path / "out"
    values = {"scenario": "env1", "learner": own, "seed": 5, "checkpoint": 100}
    saved = (out / "checkpoint").glob
    with ros_context() as context:
        first = run_team(
            {**values, **SETTINGS, "out": str(out)},
            context=context,
            stop=lambda: len(list(saved("*_[0-9]*.npz"))) >= 3,
        )
    assert first["interrupted"]
    with ros_context() as context:
        run_team({"out": str(out)}, context=context)
    assert same_tables(out)
    assert verify(out).same
    scenario = load_scenario("env1", **SETTINGS)
    assert not tables_equal(tables_in(out), learn(scenario, "coop", 5))


@pytest.mark.long
def test_own_rules_compiled(own, said, tmp_path):
    """Compiled and plain in turn, through checkpoints, they learn what they learn plain."""
    scenario = load_scenario("env1", **SETTINGS)
    rule = learner_of(own)
    plain = learn(scenario, rule, 5)
    assert uses_numba("auto", rule)
    assert tables_equal(
        in_parts(scenario, rule, 5, (1, 100, 301, 600), tmp_path).tables, plain
    )
    compiled = train(scenario, rule, seed=5, engine="numba")
    assert tables_equal(compiled.tables, plain)
    name = own.partition(":")[0]
    lines = said(f"{name}.py", 2000).splitlines()
    assert [line.split(":")[0] for line in lines] == ["coop", name]


@pytest.mark.long
@pytest.mark.parametrize("own", OWN[1:], indirect=True)
def test_own_exploration_learns_to_earn_nearly_what_coop_does(own):
    scenario = load_scenario("env1", penalty=-20, steps=50_000)
    means = []
    for learner in ("coop", own):
        runs = run_batch(scenario, learner, range(20), trials=100)
        means.append(by_run(run.measures for run in runs).mean("returns"))
    assert means[0] - 1.5 < means[1] < means[0] + 0.5


@pytest.mark.long
def test_vector_learner(said):
    """In seconds a team learns more than shortest paths earn."""
    lines = dict(line.split(": ") for line in said("vector_learner.py").splitlines())
    mean, error = map(float, lines["learned"].split(" ± "))
    assert mean - 4 * error > float(lines["shortest paths"])
    assert mean - 4 * error < float(lines["best asking team found"])


def test_sparse_cooperative(said):
    """In seconds a team that one controller moves earns more than shortest paths do."""
    out = said("sparse_cooperative.py", "env1", 8000, 4)
    lines = dict(line.split(": ") for line in out.splitlines())
    mean, error = map(float, lines["learned, central"].split(",")[0].split(" ± "))
    assert mean - 2 * error > float(lines["shortest paths"])
    assert mean - 4 * error < float(lines["joint optimum"])


@pytest.mark.long
def test_pettingzoo_learners(said):
    pytest.importorskip("open_spiel")
    lines = said("pettingzoo_learners.py", 600, 2, 3).splitlines()
    titles = [line.split("|")[1].strip() for line in lines[2:-1]]
    assert titles == [
        "OpenSpiel Q-learner",
        "OpenSpiel Q-learner, asks",
        "ours: noncoop",
        "ours: coop",
        "ours: voi",
    ]
    assert all(line.count("±") == 4 for line in lines[2:-1])
    assert lines[-1] == "best asking team found 118.51, joint optimum 120.56"


@pytest.mark.long
def test_ppo(said):
    pytest.importorskip("stable_baselines3")
    lines = said("ppo.py", "env1", 20_000).splitlines()
    assert lines[0] == "env1; shortest paths: 92.60"
    assert len(lines) == 11 and all("±" in line for line in lines[1:])


def test_analyse_log(said, good):
    title, verdict, *lines = said("analyse_log.py", good.bag).splitlines()
    assert title.startswith("env1, coop: ") and verdict == "identical"
    assert "robot_1 asked " in lines[0] and "  row " in lines[1]
