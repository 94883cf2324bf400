# Copyright 2026 The sparse_coord_ros authors
# SPDX-License-Identifier: Apache-2.0
"""`sparse_coord optimum`: values, JSON, and bad input."""

import json

import pytest

from sparse_coord_ros.core.game.scenario import load_scenario
from sparse_coord_ros.core.solve.asking_search import WARNING
from sparse_coord_ros.core.solve.shipped import shipped_asking_team


def test_exact(sparse_coord):
    code, out, err = sparse_coord("optimum", "env1")
    assert (code, err) == (0, "")
    assert "env1, penalty -100, 441 joint states" in out
    assert "exact joint optimum    120.56" in out
    assert "bound (robots alone)   126.45" in out
    data = json.loads(sparse_coord("optimum", "env1", "--penalty", "-20", "--json")[1])
    assert data["value"] == pytest.approx(121.89, abs=0.01)
    assert (data["scenario"], data["exact"], data["joint_states"]) == (
        "env1",
        True,
        441,
    )


def test_the_shipped_asking_team_stands_beside_the_optimum(sparse_coord):
    out = sparse_coord("optimum", "env1")[1]
    assert f"best asking team found 118.51, {WARNING}" in out
    assert (
        json.loads(sparse_coord("optimum", "env1", "--json")[1])["best_asking_team"][
            "value"
        ]
        > 118.5
    )
    out = sparse_coord("optimum", "env1", "--penalty", "-21")[1]
    assert "best asking team found" not in out


def test_numbers_of_the_horizon_are_named(sparse_coord):
    lines = sparse_coord("optimum", "env1", "--set", "horizon=1")[1].splitlines()
    assert lines[-2].endswith("92.60, 0.00 miscoordinations, all arrive in 0 %")
    assert lines[-1] == (
        "Miscoordinations and arrivals are counted within the horizon of 1 step; values have "
        "no horizon."
    )
    assert "horizon" not in sparse_coord("optimum", "env1")[1]
    lines = sparse_coord("optimum", "lane", "--set", "horizon=20")[1].splitlines()
    assert lines[-1] == (
        "Shortest paths are evaluated within the horizon of 20 steps; the other values have no "
        "horizon."
    )


@pytest.fixture
def corridor(folder):
    """Return the path of a scenario that is searched in no time."""
    (folder / "corridor.txt").write_text("title: corridor\n---\n1D.2\n")
    robots = "robots:\n  a: {start: 1, goal: 2}\n  b: {start: 2, goal: 1}\n"
    (folder / "corridor.yaml").write_text(
        f"map: corridor.txt\nask_cost: 0.01\n{robots}"
    )
    return "corridor.yaml"


@pytest.mark.long
def test_search_for_the_best_asking_team(sparse_coord, folder, corridor):
    search = ("optimum", corridor, "--class", "--seed", 4, "--out", "search.json")
    code, out, err = sparse_coord(*search, "--restarts", 2)
    assert (code, err) == (0, "")
    for words in (
        WARNING,
        "2 of 2 restarts agree, seed 4",
        "a: (0, 0)",
        "b: (0, 3) west",
    ):
        assert words in out
    assert "asks in" in out
    assert "shipped" not in out
    code, out, err = sparse_coord(*search, "--restarts", 3, "--json")
    data = json.loads(out)
    assert (code, err, data["restarts"], data["seed"]) == (0, "", 3, 4)
    assert len(json.loads((folder / "search.json").read_text())["values"]) == 3


@pytest.mark.long
def test_the_shipped_one_stands_beside_a_search(sparse_coord):
    shipped = shipped_asking_team(load_scenario("pentagon"))
    out = sparse_coord("optimum", "pentagon", "--class", "--restarts", 1)[1]
    agreed = f"{shipped.agreed} of {shipped.restarts} restarts"
    assert f"shipped      {shipped.value:.3f}, {agreed}" in out
    assert "as far as the search found: an equilibrium" in out
