# Copyright 2026 The sparse_coord_ros authors
# SPDX-License-Identifier: Apache-2.0
"""`sparse_coord improve`, and `--improve` of train."""

import json

import numpy as np
import pytest
from teams import tables_in

from sparse_coord_ros.base.compiling import has_numba
from sparse_coord_ros.core.runs.tables import save_team

pytestmark = pytest.mark.skipif(not has_numba(), reason="minutes in plain Python")

TRAIN = ("train", "env1", "--learner", "factored", "--steps", 1500, "--seed", 4)


def test_improve(sparse_coord, refused, folder):
    assert sparse_coord(*TRAIN, "--penalty", -100, "--out", "a")[0] == 0
    code, out, err = sparse_coord("improve", "a")
    assert (code, err) == (0, "")
    for words in (
        "a: Factored, exact",
        "a/improved: Factored, exact",
        "on the learned model: ",
    ):
        assert words in out
    assert "no r^C" not in out
    _, out, _ = sparse_coord("evaluate", "a", "a/improved", "--json")
    learned, improved = (run["returns"]["mean"] for run in json.loads(out)["runs"])
    assert improved > learned + 0.5
    assert "improved: exists already" in refused("improve", "a")
    assert sparse_coord("train", "env2-2r", *TRAIN[2:], "--out", "b")[0] == 0
    (folder / "b" / "tables.npz").replace(folder / "a" / "tables.npz")
    assert "robot 1 of scenario env1 with learner factored" in refused("improve", "a")


def test_train_improves_to_the_same_tables_and_says_which_doorways_nobody_felt(
    sparse_coord, folder
):
    code, out, _ = sparse_coord(
        *TRAIN, "--penalty", 0, "--out", "a", "--improve", "--json"
    )
    plan = json.loads(out)["improved"]
    assert code == 0 and plan["learned_model"]["doorways"] == []
    assert plan["learned_model"]["unfelt"] == [10]
    assert [run["directory"] for run in plan["runs"]] == ["a", "a/improved"]
    assert sparse_coord(*TRAIN, "--penalty", 0, "--out", "b")[0] == 0
    _, out, _ = sparse_coord("improve", "b")
    assert "no robot ever paid r^C in doorway (2, 2)" in out
    teams = [tables_in(folder / name / "improved") for name in "ab"]
    for one, other in zip(*teams, strict=True):
        assert (one.q_star == other.q_star).all()


def test_what_no_run_can_have_learned_is_refused(sparse_coord, refused, folder):
    """Not planned on: it took 13 s, to a value of 10^180."""
    assert sparse_coord(*TRAIN, "--penalty", -100, "--out", "a")[0] == 0
    known = [table.memory for table in tables_in(folder / "a")]
    for name, value, words in (
        ("moved", 2**30, "moved counts"),
        ("u", np.inf, "u has"),
    ):
        false = {**known[0], name: np.full_like(known[0][name], value)}
        save_team(folder / "a", [false, *known[1:]])
        assert words in refused("improve", "a")


def test_it_plans_with_robots_that_are_together_anywhere_and_refuses_other_kinds(
    sparse_coord, refused
):
    kinds = ("--penalty", -100, "--set", "interactions=together:anywhere")
    assert sparse_coord(*TRAIN, *kinds, "--out", "a")[0] == 0
    code, _, err = sparse_coord("improve", "a")
    assert (code, err) == (0, "")
    _, out, _ = sparse_coord("evaluate", "a", "a/improved", "--json")
    learned, improved = (run["reward"]["mean"] for run in json.loads(out)["runs"])
    assert improved > learned
    assert (
        sparse_coord(*TRAIN, "--set", "interactions=swap+block", "--out", "b")[0] == 0
    )
    assert "setting interactions is 'swap+block', allowed: together" in refused(
        "improve", "b"
    )
