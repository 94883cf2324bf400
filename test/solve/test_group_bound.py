# Copyright 2026 The sparse_coord_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The bound by groups: never below the exact joint optimum, and at it for one group."""

import numpy as np
import pytest

from sparse_coord_ros.core.game.grid import GridMap
from sparse_coord_ros.core.game.scenario import scenario_from_dict
from sparse_coord_ros.core.solve.group_bound import (
    LEAST_FALL,
    group_bound,
    group_optimum,
    pair_losses,
    split,
    without_others,
)
from sparse_coord_ros.core.solve.optimum import independent_bound, joint_optimum

NEAR = 10 * LEAST_FALL
"""How far above the joint optimum a bound may be that is not by groups."""

FORMS = {
    "one door": (
        ("..D..", "..#.."),
        [((0, 0), (0, 4)), ((1, 1), (1, 3)), ((0, 3), (1, 0))],
    ),
    "two doors": (
        (".D.", "...", ".D."),
        [((0, 0), (0, 2)), ((2, 0), (2, 2)), ((1, 2), (0, 0))],
    ),
    "one goal": (
        (".D.", "##."),
        [((0, 0), (1, 2)), ((0, 0), (1, 2)), ((0, 0), (1, 2))],
    ),
}


def game(form, **settings):
    rows, places = FORMS[form]
    robots = {
        f"robot_{k}": {"start": list(start), "goal": list(goal)}
        for k, (start, goal) in enumerate(places)
    }
    hall = {"name": "hall", "text": GridMap("hall", rows).to_text()}
    data = {"map": hall, "robots": robots, "penalty": -40, **settings}
    return scenario_from_dict(data, where="hall", name="hall")


GAMES = [
    *(pytest.param(form, {}, id=form) for form in FORMS),
    pytest.param("one door", {"common_reward": "each:0.5:2:0"}, id="unequal r^C"),
    pytest.param(
        "two doors", {"interactions": "together:any_doorway"}, id="any doorway"
    ),
    pytest.param("one door", {"move_success": 1.0, "penalty": -5}, id="sure moves"),
]


@pytest.mark.parametrize(("form", "settings"), GAMES)
def test_a_bound_is_no_less_than_the_joint_optimum(form, settings):
    scenario = game(form, **settings)
    exact = joint_optimum(scenario)
    assert exact.exact
    by_pairs = group_bound(scenario, 2)
    assert sorted(k for group in by_pairs.groups for k in group) == [0, 1, 2]
    whole = group_bound(scenario, 3)
    assert whole.groups == ((0, 1, 2),)
    assert exact.value - 1e-6 <= whole.value <= exact.value + NEAR
    assert exact.value - 1e-6 <= by_pairs.value <= independent_bound(scenario) + 1e-6


def test_pairs_are_solved_as_the_joint_optimum_is():
    scenario = game("one door")
    for group in [(0, 1), (1, 2), (0, 2)]:
        alone = without_others(scenario, group)
        found = group_optimum(scenario, group)
        assert found == pytest.approx(joint_optimum(alone).value, abs=1e-3)
    losses = pair_losses(scenario)
    assert (losses == losses.T).all() and losses[0, 2] > 1.0


def test_those_are_in_one_group_that_lose_most():
    losses = np.zeros((5, 5))
    for i, j, loss in [(0, 3, 9.0), (3, 4, 2.0), (1, 2, 5.0), (0, 1, 1.0)]:
        losses[i, j] = losses[j, i] = loss
    assert split(losses, 2) == ((0, 3), (1, 2), (4,))
    assert split(losses, 3) == ((0, 3, 4), (1, 2))
    assert split(losses, 5) == ((0, 1, 2, 3, 4),)
