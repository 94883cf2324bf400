# Copyright 2026 The sparse_coord_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Every file of examples/ does what its first lines say, in a folder of its own."""

import csv
from pathlib import Path

import pytest

EXAMPLES = Path(__file__).parents[2] / "examples"


@pytest.fixture
def said(python, tmp_path):
    """Return a function that runs Python in an empty folder and returns what it printed."""
    return lambda *words: python(*words, cwd=tmp_path, env={"MPLBACKEND": "Agg"}).stdout


def test_all_of_them_are_listed_and_run_here():
    names = {path.name for path in EXAMPLES.glob("*.py")}
    source, listed = Path(__file__).read_text(), (EXAMPLES / "README.md").read_text()
    assert [name for name in names if f'"{name}"' not in source] == []
    assert [name for name in names if f"({name})" not in listed] == []


def test_train_and_plot(said, tmp_path):
    out = said(EXAMPLES / "train_and_plot.py", 2000)
    assert [line.split(":")[0] for line in out.splitlines()] == [
        "noncoop",
        "coop",
        "exact joint optimum",
    ]
    assert (tmp_path / "learning_curve.png").read_bytes()[1:4] == b"PNG"
    verb = ("-m", "sparse_coord_ros.cli.main", "evaluate")
    assert "Coop., 5 trials" in said(*verb, "runs/coop", "--trials", 5)


def test_twenty_runs(said, tmp_path):
    assert "miscoordinations" in said(EXAMPLES / "twenty_runs.py", 500, 2)
    with (tmp_path / "twenty_runs.csv").open(newline="") as file:
        rows = list(csv.DictReader(file))
    assert [(row["learner"], row["seed"]) for row in rows] == [
        ("noncoop", "0"),
        ("noncoop", "1"),
        ("coop", "0"),
        ("coop", "1"),
    ]


def test_own_perception(said):
    lines = said(EXAMPLES / "own_perception.py", 2000).splitlines()
    assert [line.rpartition(": reward")[0] for line in lines] == ["always", "fog:4", "fog:1"]
    assert len({line.partition("reward")[2] for line in lines}) > 1


def test_own_learner(said):
    lines = said(EXAMPLES / "own_learner.py", 20000).splitlines()
    assert [line.split(":")[0] for line in lines] == ["coop", "careful"]
    assert len({line.partition(":")[2] for line in lines}) == 2


BOTH = """
from sparse_coord_ros.engine.batch import run_batch
from sparse_coord_ros.game.scenario import load_scenario
from sparse_coord_ros.learn.simulation import tables_equal

scenario = load_scenario("env1", steps=3000, penalty=-20)
first, second = (
    next(run_batch(scenario, learner, [5], trials=9, engine=engine, jobs=1))
    for learner, engine in PAIRS
)
same = first.trials.reward.tobytes() == second.trials.reward.tobytes()
print(same, tables_equal(first.tables, second.tables))
"""


OWN = "expected_sarsa:ExpectedSarsa"


@pytest.fixture
def compared(said):
    """Return a function that compares trials and tables of two pairs of learner and engine."""
    path = f"import sys; sys.path.append({str(EXAMPLES)!r})"
    return lambda *pairs: said("-c", f"{path}\nPAIRS = {pairs}{BOTH}").split()


def test_expected_sarsa(said, compared):
    lines = said(EXAMPLES / "expected_sarsa.py", 2000).splitlines()
    assert [line.split(":")[0] for line in lines] == ["coop", "expected_sarsa"]
    assert compared((OWN, "python"), ("coop", "python"))[-1] == "False"


@pytest.mark.long
def test_expected_sarsa_compiled(compared):
    """A minute of compiling; then the bits of plain Python."""
    assert compared((OWN, "auto"), (OWN, "python")) == ["True", "True"]


@pytest.mark.long
def test_pettingzoo_learners(said):
    pytest.importorskip("open_spiel")
    lines = said(EXAMPLES / "pettingzoo_learners.py", 600, 2, 3).splitlines()
    titles = [line.split("|")[1].strip() for line in lines[2:-1]]
    assert titles == [
        "OpenSpiel Q-learner",
        "OpenSpiel Q-learner, asks",
        "ours: noncoop",
        "ours: coop",
        "ours: factored",
    ]
    assert all(line.count("±") == 4 for line in lines[2:-1])
    assert lines[-1] == "class bound 118.51, joint optimum 120.56"


def test_analyse_log(said):
    verb = ("-m", "sparse_coord_ros.cli.main", "run")
    said(*verb, "env1", "--steps", 300, "--seed", 2, "--out", "runs/demo")
    out = said(EXAMPLES / "analyse_log.py", "runs/demo")
    assert out.splitlines()[0].startswith("env1, coop: ")
    assert out.splitlines()[1] == "identical"
    assert "robot_1 asked " in out
    assert "  row " in out
