# Copyright 2026 The sparse_coord_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The values of a robot that is alone in the world: what it could know from its map."""

import numpy as np

from sparse_coord_ros.core.game.scenario import Scenario


def lone_values(scenario: Scenario, robot: int, price: float = 0.0) -> np.ndarray:
    """Return Q* of a robot (from 0) with no other robot in its world, shape (cells, 4), float64.

    Value iteration on its own model, from below, until no bit changes.

    Args:
        scenario: the problem.
        robot: the robot, from 0.
        price: what it pays in every step until it arrives. That is as if it paid for ever and got
            it all back at the goal.
    """
    goal = scenario.robots[robot].goal
    success = scenario.move_success
    for_ever = price / (1.0 - scenario.discount)
    arrival = scenario.goal_reward + scenario.discount * (
        scenario.goal_value + for_ever
    )
    value = np.zeros(len(scenario.map.cells))
    while True:
        after = scenario.discount * value
        after[goal] = arrival
        q: np.ndarray = (
            success * after[scenario.map.next_cell] + (1.0 - success) * after[:, None]
        )
        if np.array_equal(q.max(axis=1), value):
            return q - for_ever
        value = q.max(axis=1)
