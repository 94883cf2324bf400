# Copyright 2026 The sparse_coord_ros authors
# SPDX-License-Identifier: Apache-2.0
"""What a robot is worth that is alone in the world: where the later learners begin."""

import numpy as np

from sparse_coord_ros.game.actions import COORDINATE, PRIMITIVES
from sparse_coord_ros.game.scenario import Scenario
from sparse_coord_ros.learn.agent import Tables, initial_tables
from sparse_coord_ros.learn.rows import Rows, make_rows


def lone_values(scenario: Scenario, number: int, price: float = 0.0) -> np.ndarray:
    """Return Q* of a robot (from 0) with nobody else in its world, shape (cells, 4), float64.

    Value iteration on its own model, from below, until no bit changes. Where it pays a price in
    every step until it arrives, that is as if it paid for ever and got it all back at the goal.
    """
    goal, success = scenario.robots[number].goal, scenario.move_success
    for_ever = price / (1.0 - scenario.discount)
    arrival = scenario.goal_reward + scenario.discount * (scenario.goal_value + for_ever)
    value = np.zeros(len(scenario.map.cells))
    while True:
        after = scenario.discount * value
        after[goal] = arrival
        q: np.ndarray = success * after[scenario.map.next_cell] + (1.0 - success) * after[:, None]
        if np.array_equal(q.max(axis=1), value):
            return q - for_ever
        value = q.max(axis=1)


def lone_tables(scenario: Scenario, number: int, *, above: float, price: float = 0.0) -> Tables:
    """Return tables of which every row is the lone robot's Q*.

    Args:
        scenario: the problem; Q^C is over pairs of cells, and dense.
        number: the robot, from 0.
        above: how much COORDINATE is above the best move.
        price: as of `lone_values`.
    """
    q, tables = lone_values(scenario, number, price), initial_tables(scenario)
    tables.q_star[:, :PRIMITIVES] = q
    tables.q_star[:, COORDINATE] = q.max(axis=1) + above
    tables.q_coord[:] = q[:, None, :]  # type: ignore[index, assignment]
    return tables


def lone_rows(q_star: np.ndarray) -> Rows:
    """Return Q^C of robots before learning, of which every row is that of Q* [k, x, action]."""
    team, cells = q_star.shape[:2]
    rows = make_rows(team, cells * cells, 0.0)
    rows.values[:] = np.repeat(q_star[:, :, :PRIMITIVES], cells, axis=1)
    return rows
