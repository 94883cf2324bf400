# Copyright 2026 The sparse_coord_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Sparse cooperative Q-learning: its rule by hand, the example's bits, and the joint optimum."""

import runpy
from pathlib import Path

import numpy as np
import pytest

import sparse_coord_ros as sc
from sparse_coord_ros.base.compiling import has_numba
from sparse_coord_ros.studies.benchmark import Entry
from sparse_coord_ros.studies.leaderboard import load_leaderboard
from sparse_coord_ros.studies.lists import ABOUT, LISTS
from tools.study import central
from tools.study.__main__ import DOCS

EXAMPLE = Path(__file__).parents[2] / "examples" / "sparse_cooperative.py"


@pytest.fixture(scope="module")
def example():
    return runpy.run_path(str(EXAMPLE))


def scenario_of(name, steps, **settings):
    chosen = {**central.PROTOCOL, "steps": steps, **settings}
    return sc.load_scenario(name, penalty=-100).with_settings(chosen)


def test_places_are_as_many_moves_from_a_doorway():
    scenario = sc.load_scenario("env1")
    grid = scenario.map
    [doorway] = grid.doorways
    for reach, numbers in ((n, central.places(scenario, n)) for n in range(3)):
        near = {doorway}
        for _ in range(reach):
            near |= {x for x in range(len(grid.cells)) if set(grid.next_cell[x]) & near}
        joint = {tuple(map(int, pair)) for pair in np.argwhere(numbers >= 0)}
        assert joint == {(a, b) for a in near for b in near}
        assert sorted(numbers[numbers >= 0]) == list(range(len(joint)))


def test_a_value_moves_by_the_errors_of_its_robots(example):
    """By hand: 40 for both, of which each has 20; own values of 20 are touched elsewhere alone."""
    found = example["Teams"](sc.load_scenario("env1"), teams=2, reach=0)
    assert np.argwhere(found.numbers >= 0).tolist() == [
        [*sc.load_scenario("env1").map.doorways] * 2
    ]
    state = np.array([0, -1])
    cells = np.array([[3, 4], [5, 6]])
    moves = np.array([[1, 2], [3, 0]])
    parts = found.parts(np.arange(2), cells, state, moves)
    assert parts.tolist() == [[20, 20], [20, 20]]
    errors = np.array([[1.0, 2.0], [4.0, 8.0]])
    acts = np.array([[True, True], [True, False]])
    sizes = np.array([0, 0.5, 0.25])
    for _ in range(2):
        found.learn(state, cells, moves, errors, acts, sizes, floor=0.3)
    joint = np.full((2, 1, 16), 40.0)
    joint[0, 0, 6] += (0.5 + 0.3) * (1 + 2)
    assert found.joint == pytest.approx(joint)
    own = np.full(found.own.shape, 20.0)
    own[1, 0, 5, 3] += (0.5 + 0.3) * 4
    assert found.own == pytest.approx(own)


@pytest.mark.parametrize(
    ("name", "reach", "settings"),
    [
        ("env1", 2, {}),
        ("env2-2r", 1, {"interactions": "block:anywhere"}),
        ("env2-2r", 0, {"step_size": "constant:0.1", "starts": "fixed"}),
    ],
)
def test_the_compiled_loops_have_the_bits_of_the_example(
    example, name, reach, settings
):
    scenario = scenario_of(name, 1500, **settings)
    wanted = example["learn"](scenario, 3, seed=5, reach=reach)
    found = central.learn(scenario, 3, 5, reach=reach, first_value=20)
    assert np.array_equal(found.own, wanted.own)
    assert np.array_equal(found.joint, wanted.joint)
    assert found.joint_updates.sum() > 0
    returns, arrived = example["play"](scenario, wanted, 1, seed=7)
    own_returns, own_arrived = central.play(scenario, found, 2, 7)
    assert np.array_equal(own_returns[:, :1], returns)
    assert np.array_equal(own_arrived[:, :1], arrived)


@pytest.mark.skipif(not has_numba(), reason="minutes in plain Python")
def test_with_joint_values_everywhere_it_finds_the_joint_optimum():
    scenario = scenario_of("env1", 1_000_000, epsilon="constant:0.3")
    tables = central.learn(scenario, 4, 0, reach=20, first_value=60)
    assert tables.joint.shape[1] == len(scenario.map.cells) ** 2
    returns, arrived = central.play(scenario, tables, 20_000, 1)
    error = returns.mean(axis=2).std() / returns[..., 0].size ** 0.5
    optimum = sc.optimum(scenario).value
    assert optimum - 1 < returns.mean() < optimum + 4 * error
    assert arrived.mean() > 0.999


def test_it_is_judged_in_the_lists_of_pairs_alone():
    judge = central.CentralJudge(50, 2, 2, 0, None, {})
    entry = Entry(central.TITLE, central.TITLE)
    for name in ("crowds", "percepts", "unseen2-four"):
        assert judge.place(entry, name, LISTS[name]).judged == ()
    place = judge.place(entry, "paper", LISTS["paper"])
    assert [one.scenario for one in place.judged] == [
        one.scenario for one in LISTS["paper"]
    ]
    assert place.teams == 16 and place.row()["steps to 90 %"] == "> 50"


def test_the_page_shows_the_results_and_the_best_of_twelve_trials():
    page = (DOCS / central.PAGE).read_text("utf-8")
    board = load_leaderboard(central.RESULTS)
    assert {one.list for one in board.places} <= set(ABOUT)
    for place in board.places:
        assert place.settings == {k: str(v) for k, v in central.CHOSEN.said().items()}
        row = place.row()
        del row["entry"]
        assert f"| {' | '.join(row.values())} |\n" in page
    tried = [line for line in page.splitlines() if f"| {central.TITLE} |" in line]
    assert len(tried) == len(central.TRIED) == 12
    [best] = [line for line in tried if "| yes |" in line]
    assert f"| {central.CHOSEN} |" in best
