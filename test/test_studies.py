# Copyright 2026 The sparse_coord_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Every script of studies/ runs, each with next to no budget: in plain Python, on one core."""

import os
import shutil
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]
STUDIES = ROOT / "studies"
TINY = "--runs 2 --trials 2 --steps 20"
RUNS = {
    "central.py": (
        "--lists swap-pairs --buildings 1 --teams 2 --trials 2 --steps 50",
        "share of the gap",
    ),
    "group_bound.py": ("env1 --size 2", "env1: 120.556"),
    "interactions.py": (
        "--kinds door --seeds 1 --runs 1 --steps 20",
        "share of the gap",
    ),
    "known_map.py": (
        "--lists tuning-eight --learners factored --runs 2 --trials 2 --steps 20 "
        "--picture few_steps.png",
        "tuning-eight factored",
    ),
    "leaderboard.py": (f"--lists crowds {TINY}", "independent, tuned"),
    "scale.py": (
        "halls:2 --robots 2 --steps 50 --trials 2 --set prior=map",
        "680 cells, 2 robots",
    ),
    "shipped.py": (
        "teams --scenarios crowd-4r --teams 2 --steps 20 --trials 2 --config config",
        "best of 2 that learned",
    ),
    "unseen.py": (
        "--kinds unseen1-loop-4r --searched 2 --judged 2 --config config",
        "unseen1-loop-4r-0",
    ),
    "when.py": (
        "--maps isr unseen1-door-4r-1 --runs 1 --trials 2 --steps 20 --out when.csv",
        "best asking team found",
    ),
    "where.py": (f"--scenarios env2-4r {TINY}", "asked near"),
}
"""Arguments, and a part of what is printed."""


def test_every_study_is_here():
    assert {path.name for path in STUDIES.glob("*.py")} == set(RUNS)


@pytest.mark.parametrize("name", RUNS)
def test_a_study_runs(name, python, tmp_path):
    shutil.copytree(ROOT / "config", tmp_path / "config")
    missing = tmp_path / "missing/numba"
    missing.mkdir(parents=True)
    (missing / "__init__.py").write_text("raise ImportError\n")
    words, said = RUNS[name]
    cores = os.sched_getaffinity(0)
    os.sched_setaffinity(0, {min(cores)})  # so that it computes in its own process
    try:
        done = python(
            STUDIES / name,
            *words.split(),
            cwd=tmp_path,
            env={"PYTHONPATH": f"{missing.parent}{os.pathsep}{ROOT}"},
        )
    finally:
        os.sched_setaffinity(0, cores)
    assert said in done.stdout
