# Copyright 2026 The sparse_coord_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Every script of studies/ runs, each with next to no budget: in plain Python, on one core."""

import os
import shutil
from pathlib import Path

import pytest
import yaml

ROOT = Path(__file__).parents[1]
STUDIES = ROOT / "studies"
TINY = "--runs 2 --trials 2 --steps 20"
RUNS = {
    "group_bound.py": ("env1 --size 2", "env1: 120.556"),
    "known_map.py": (
        "--list tuning-eight --learners voi --runs 2 --trials 2 --steps 20",
        "| `voi` | 20 |",
    ),
    "parts.py": (
        "--parts future patience --lists pairs --buildings 1 --runs 2 --trials 2 --steps 20",
        "| no patience |",
    ),
    "scale.py": (
        "halls:2 --robots 2 --steps 50 --trials 2 --set prior=map",
        "680 cells, 2 robots",
    ),
    "shipped.py": (
        "teams --scenarios crowd-4r --teams 2 --steps 20 --trials 2 --config config",
        "best of 2 that learned",
    ),
    "stand_offs.py": (
        "--kinds crossing --robots 4 --buildings 1 --teams 1 --trials 2 --steps 20",
        "| crossing | 4 |",
    ),
    "unseen.py": (
        "--kinds unseen1-loop-4r --searched 2 --judged 2 --config config",
        "unseen1-loop-4r-0",
    ),
    "when.py": (
        "--maps env1 unseen1-door-4r-1 --runs 1 --trials 2 --steps 20 --out when.csv "
        "--figure when.png",
        "| best asking team found | share |",
    ),
    "where.py": (f"--scenarios env2-4r {TINY}", "asked near"),
}
"""Arguments, and a part of what is printed."""

LEADERBOARD = ("leaderboard.py", "entries.py", "script.py")
"""A script that writes into its own folder, so it runs in a copy of it; and what it imports."""


def test_every_study_is_here():
    there = {path.name for path in STUDIES.glob("*.py")}
    assert there == {*RUNS, *LEADERBOARD}


@pytest.fixture
def study(python, tmp_path):
    """Return a function that runs a script in plain Python, on one core, in an empty folder."""

    def run(script, words, code=0):
        missing = tmp_path / "missing/numba"
        missing.mkdir(parents=True, exist_ok=True)
        (missing / "__init__.py").write_text("raise ImportError\n")
        path = f"{missing.parent}{os.pathsep}{ROOT}"
        cores = os.sched_getaffinity(0)
        os.sched_setaffinity(0, {min(cores)})  # so that it computes in its own process
        try:
            env = {"PYTHONPATH": path}
            return python(script, *words.split(), cwd=tmp_path, env=env, code=code)
        finally:
            os.sched_setaffinity(0, cores)

    return run


QUICK = ("scale.py", "stand_offs.py", "where.py")
SCRIPTS = [
    pytest.param(name, marks=[pytest.mark.long] * (name not in QUICK)) for name in RUNS
]


@pytest.mark.parametrize("name", SCRIPTS)
def test_a_study_runs(name, study, tmp_path):
    shutil.copytree(ROOT / "config", tmp_path / "config")
    words, said = RUNS[name]
    assert said in study(STUDIES / name, words).stdout


@pytest.mark.long
def test_the_leaderboard_tunes_and_judges(study, tmp_path):
    """The best of twenty protocols stands in the file that the leaderboard reads."""
    for name in LEADERBOARD:
        shutil.copy(STUDIES / name, tmp_path)
    script = tmp_path / "leaderboard.py"
    lists = f"--lists crowds --entries coop GPCQ {TINY}"
    study(script, f"--tune --buildings 1 {lists}")
    tuned = yaml.safe_load((tmp_path / "tuned.yaml").read_text("utf-8"))
    assert list(tuned) == ["crowds"]
    assert tuned["crowds"]["GPCQ"] == {}  # it is for two robots
    settings = ["prior", "credit", "epsilon", "step_size", "starts"]
    assert list(tuned["crowds"]["coop"]) == settings
    table = tmp_path / "crowds.md"
    study(script, f"{lists} --out .")
    written = table.read_text("utf-8")
    heads, _, row = written.splitlines()
    assert heads.startswith("| entry |") and row.startswith("| coop | when_asked |")
    table.write_text(written + row.replace("coop", "other") + "\n")
    study(script, f"{lists} --out .")
    assert "\n| other | when_asked |" in table.read_text("utf-8")


def test_the_tuned_protocols_are_some_of_the_twenty():
    tuned = yaml.safe_load((STUDIES / "tuned.yaml").read_text("utf-8"))
    source = (STUDIES / "leaderboard.py").read_text("utf-8")
    lines = {" ".join(line.split()) for line in source.splitlines()}
    assert len(tuned) == 9
    for entries in tuned.values():
        for protocol in filter(None, entries.values()):
            values = " ".join(protocol.values())
            assert any(line.endswith(values) for line in lines)


def test_a_list_without_tuned_protocols(study, tmp_path):
    for name in LEADERBOARD:
        shutil.copy(STUDIES / name, tmp_path)
    words = "--lists crowds --entries coop"
    said = study(tmp_path / "leaderboard.py", words, code=2).stderr
    assert said == (
        "crowds: coop\nerror: tuned.yaml has no protocol of coop for crowds; python "
        "studies/leaderboard.py --tune --lists crowds --entries 'coop' finds it\n"
    )
