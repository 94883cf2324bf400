# Copyright 2026 The sparse_coord_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Choices and update of Algorithm 1, by exact enumeration and by hand."""

import math
from collections import Counter
from unittest import mock

import numpy as np
import pytest

from sparse_coord_ros.core.game.actions import ACTIONS, COORDINATE, PRIMITIVES
from sparse_coord_ros.core.game.draws import TIE
from sparse_coord_ros.core.game.scenario import load_scenario
from sparse_coord_ros.core.learners import rules
from sparse_coord_ros.core.learners.coop import Coop
from sparse_coord_ros.core.learners.rules import (
    asks_at_times,
    asks_surely,
    greatest,
    ql_update,
    step_size,
)

N = 60
DRAWS = [(i + 0.5) / N for i in range(N)]
"""A uniform grid of draws: frequencies over it are exact probabilities (60 divides by 1 to 5)."""

LARGEST_DRAW = 1.0 - 2.0**-53


def greedy(values, count, tie):
    """Return the greedy action of a robot that draws this number."""
    with mock.patch.object(rules, "draw", lambda key, step, column: tie):
        return rules.greedy(values, count, 0, 0, TIE)


def frequencies(choose):
    return {action: count / N for action, count in Counter(map(choose, DRAWS)).items()}


def test_actions():
    assert ACTIONS == ("north", "south", "east", "west", "coordinate")
    assert (PRIMITIVES, COORDINATE) == (4, 4)


@pytest.mark.parametrize(
    ("values", "count", "maxima"),
    [
        ([1, 2, 3, 4, 5], 5, [4]),
        ([5, 4, 3, 2, 1], 5, [0]),
        ([1, 2, 3, 4, 5], 4, [3]),
        ([7, 0, 7, 0, 9], 4, [0, 2]),
        ([7, 0, 7, 0, 7], 5, [0, 2, 4]),
        ([0, 1, 1, 1, 1], 5, [1, 2, 3, 4]),
        ([-1, -1, -1, -1, -1], 5, [0, 1, 2, 3, 4]),
        ([0, 0, 0, 0, math.nan], 4, [0, 1, 2, 3]),
        ([1, 3, 2, 3, math.nan], 4, [1, 3]),
        (
            [0.1 + 0.2, 0.3, 0, 0, 0],
            5,
            [0],
        ),  # exact maxima: the next float below is no tie
        ([-math.inf, -math.inf, -5, -math.inf, 0], 4, [2]),
    ],
)
def test_greedy_is_uniform_among_the_exact_maxima(values, count, maxima):
    expected = {action: 1 / len(maxima) for action in maxima}
    assert frequencies(lambda tie: greedy(values, count, tie)) == expected


ROWS = [
    [1, 2, 3, 4, 5],
    [1, 2, 3, 4, 4],
    [4, 4, 3, 4, 4],
    [2, 2, 2, 2, 2],
    [1, 2, 3, 4, 3],
    [5, 2, 3, 4, 4],
    [1, 2, 3, 4, math.nan],
    [0.3, 0, 0, 0, 0.1 + 0.2],
]


@pytest.mark.parametrize("row", ROWS)
def test_a_robot_surely_asks_where_it_asks_whatever_it_draws(row):
    count = PRIMITIVES if math.isnan(row[COORDINATE]) else len(ACTIONS)
    asks = frequencies(lambda tie: greedy(row, count, tie)).get(COORDINATE, 0.0)
    assert asks_surely(row) == (asks == 1.0)
    assert asks_at_times(row) == (asks > 0.0)


def test_of_all_cells_at_once_as_of_each_row():
    q_star = np.array(ROWS, dtype=float)
    for rule in (asks_surely, asks_at_times):
        assert rule(q_star.T).tolist() == [rule(row) for row in q_star]


@pytest.mark.parametrize("ties", [1, 2, 3, 4, 5])
def test_greedy_at_the_ends_of_the_draw(ties):
    values = [0.0] * ties + [-1.0] * (5 - ties)
    assert greedy(values, 5, 0.0) == 0
    assert greedy(values, 5, LARGEST_DRAW) == ties - 1


@pytest.mark.parametrize(
    ("values", "count", "maximum"),
    [
        ([1.0, 4.0, 2.0, 3.0, 5.0], 5, 5.0),
        ([1.0, 4.0, 2.0, 3.0, 5.0], 4, 4.0),
        ([-3.0, -2.0, -4.0, -9.0, math.nan], 4, -2.0),
        ([7.0, 4.0, 2.0, 3.0, 5.0], 5, 7.0),
    ],
)
def test_greatest(values, count, maximum):
    assert greatest(values, count) == maximum


@pytest.mark.parametrize(
    ("value", "alpha", "reward", "discount", "after", "expected"),
    [
        (10.0, 0.5, 4.0, 0.5, 20.0, 12.0),  # 0.5 * 10 + 0.5 * (4 + 0.5 * 20)
        (10.0, 0.25, -20.0, 0.95, 100.0, 26.25),  # 7.5 + 0.25 * (-20 + 95)
        (10.0, 1.0, -1.0, 0.95, 0.0, -1.0),
        (10.0, 0.0, 99.0, 0.95, 99.0, 10.0),
    ],
)
def test_ql_update_by_hand(value, alpha, reward, discount, after, expected):
    task = Coop().task(load_scenario("env1"))
    task = task._replace(discount=discount, step_sizes=[9.0, alpha], floors=[0.0])
    values = [1.0, value, 3.0, 4.0]
    updates = [0, 0, 7, 0]
    ql_update(values, updates, 1, task, 3, reward, after)
    assert values == [1.0, pytest.approx(expected, rel=1e-15), 3.0, 4.0]
    assert updates == [0, 1, 7, 0]


def test_a_step_size_is_never_below_its_floor():
    task = Coop().task(load_scenario("env1"))
    task = task._replace(step_sizes=[9.0, 1.0, 0.5, 0.25], floors=[0.0, 0.4])
    assert [step_size(task, n, 1) for n in (1, 2, 3)] == [1.0, 0.5, 0.4]
    assert step_size(task, 3, 9) == 0.4  # after its end the last floor holds
