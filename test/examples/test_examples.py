# Copyright 2026 The sparse_coord_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Every file of examples/ does what its first lines say, in a folder of its own."""

import csv
import os
import subprocess
import sys
from pathlib import Path

import pytest

EXAMPLES = Path(__file__).parents[2] / "examples"


@pytest.fixture
def python(tmp_path):
    """Return a function that runs Python in an empty folder and returns what it printed."""

    def run(*arguments):
        done = subprocess.run(
            [sys.executable, *map(str, arguments)],
            cwd=tmp_path,
            env={
                **os.environ,
                "PYTHONPATH": os.pathsep.join(filter(None, sys.path)),
                "MPLBACKEND": "Agg",
            },
            capture_output=True,
            text=True,
            timeout=100,
        )
        assert done.returncode == 0, done.stderr
        assert "Traceback" not in done.stderr
        return done.stdout

    return run


def test_all_of_them_are_listed_and_run_here():
    names = {path.name for path in EXAMPLES.glob("*.py")}
    source, listed = Path(__file__).read_text(), (EXAMPLES / "README.md").read_text()
    assert [name for name in names if f'"{name}"' not in source] == []
    assert [name for name in names if f"({name})" not in listed] == []


def test_train_and_plot(python, tmp_path):
    out = python(EXAMPLES / "train_and_plot.py", 2000)
    assert [line.split(":")[0] for line in out.splitlines()] == [
        "noncoop",
        "coop",
        "exact joint optimum",
    ]
    assert (tmp_path / "learning_curve.png").read_bytes()[1:4] == b"PNG"
    verb = ("-m", "sparse_coord_ros.cli.main", "evaluate")
    assert "Coop., 5 trials" in python(*verb, "runs/coop", "--trials", 5)


def test_twenty_runs(python, tmp_path):
    assert "miscoordinations" in python(EXAMPLES / "twenty_runs.py", 500, 2)
    with (tmp_path / "twenty_runs.csv").open(newline="") as file:
        rows = list(csv.DictReader(file))
    assert [(row["learner"], row["seed"]) for row in rows] == [
        ("noncoop", "0"),
        ("noncoop", "1"),
        ("coop", "0"),
        ("coop", "1"),
    ]


def test_own_perception(python):
    lines = python(EXAMPLES / "own_perception.py", 2000).splitlines()
    assert [line.rpartition(": reward")[0] for line in lines] == ["always", "fog:4", "fog:1"]
    assert len({line.partition("reward")[2] for line in lines}) > 1


def test_own_learner(python):
    lines = python(EXAMPLES / "own_learner.py", 20000).splitlines()
    assert [line.split(":")[0] for line in lines] == ["coop", "careful"]
    assert len({line.partition(":")[2] for line in lines}) == 2


BOTH = """
from sparse_coord_ros.compiling import has_numba
from sparse_coord_ros.engine.batch import run_batch
from sparse_coord_ros.game.scenario import load_scenario
from sparse_coord_ros.learn.simulation import tables_equal

scenario = load_scenario("env1", steps=3000, penalty=-20)
first, second = (
    next(run_batch(scenario, learner, [5], trials=9, engine=engine, jobs=1))
    for learner, engine in PAIRS
)
same = first.trials.reward.tobytes() == second.trials.reward.tobytes()
print(has_numba(), same, tables_equal(first.tables, second.tables))
"""


def test_expected_sarsa(python):
    """Compiled, with the bits of plain Python, which are not those of Algorithm 1."""
    lines = python(EXAMPLES / "expected_sarsa.py", 2000).splitlines()
    assert [line.split(":")[0] for line in lines] == ["coop", "expected_sarsa"]
    own, path = "expected_sarsa:ExpectedSarsa", f"import sys; sys.path.append({str(EXAMPLES)!r})"
    engines = [(own, "auto"), (own, "python")]
    has_numba, *same = python("-c", f"{path}\nPAIRS = {engines}{BOTH}").split()
    assert same == ["True", "True"]
    if has_numba == "True":
        pairs = [(own, "numba"), ("coop", "numba")]
        assert python("-c", f"{path}\nPAIRS = {pairs}{BOTH}").split()[-1] == "False"


@pytest.mark.long
def test_pettingzoo_learners(python):
    pytest.importorskip("open_spiel")
    lines = python(EXAMPLES / "pettingzoo_learners.py", 600, 2, 3).splitlines()
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


def test_analyse_log(python):
    verb = ("-m", "sparse_coord_ros.cli.main", "run")
    python(*verb, "env1", "--steps", 300, "--seed", 2, "--out", "runs/demo")
    out = python(EXAMPLES / "analyse_log.py", "runs/demo")
    assert out.splitlines()[0].startswith("env1, coop: ")
    assert out.splitlines()[1] == "identical"
    assert "robot_1 asked " in out
    assert "  row " in out
