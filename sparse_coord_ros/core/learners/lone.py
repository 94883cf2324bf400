# Copyright 2026 The sparse_coord_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Values of a robot that is alone in the world, computed from its map (`prior: map`)."""

import numpy as np

from sparse_coord_ros.core.game.actions import COORDINATE
from sparse_coord_ros.core.game.scenario import Scenario
from sparse_coord_ros.core.game.world import RewardWeights


def lone_values(
    scenario: Scenario, robot: int, price: float = 0.0, weight: float = 1.0
) -> np.ndarray:
    """Return Q* of a robot (from 0) with no other robot in its world, shape (cells, 4), float64.

    Value iteration on the map, from below, until no bit changes. The value of a cell follows from
    those of cells nearer to the goal, so the cells are settled in the order of their distance.
    (Rounding keeps the order of numbers. So from below every order of updates that goes on until
    nothing changes ends at the same bits.)

    Args:
        scenario: the problem; moves succeed with the probability `known_success`.
        robot: the robot, from 0.
        price: the cost of every step until it arrives. That equals paying for ever, with a refund
            at the goal.
        weight: how much r^I counts.
    """
    lead = scenario.map.next_cell
    goal = scenario.robots[robot].goal
    success = scenario.known_success
    for_ever = price / (1.0 - scenario.discount)
    arrival = weight * scenario.goal_reward + scenario.discount * (
        scenario.goal_value + for_ever
    )
    value = np.zeros(len(lead))

    def backed_up(cells: np.ndarray) -> np.ndarray:
        """Return the values of the moves in some cells by those of all cells, (n, 4)."""
        there = scenario.discount * value[lead[cells]]
        there[lead[cells] == goal] = arrival
        here = scenario.discount * value[cells]
        here[cells == goal] = arrival
        moves: np.ndarray = success * there + (1.0 - success) * here[:, None]
        return moves

    everywhere = np.arange(len(lead))
    distances = scenario.map.distances_to(goal)
    by_distance = np.argsort(distances, kind="stable")
    levels = np.split(by_distance, np.flatnonzero(np.diff(distances[by_distance])) + 1)
    while True:
        for cells in levels:
            settled = False
            while not settled:
                best = backed_up(cells).max(axis=1)
                settled = np.array_equal(best, value[cells])
                value[cells] = best
        moves = backed_up(everywhere)
        if np.array_equal(moves.max(axis=1), value):
            return moves - for_ever


def known_q_star(
    scenario: Scenario, robot: int, weights: RewardWeights, begun: np.ndarray
) -> np.ndarray:
    """Return Q* of a robot (from 0) that knows its map, before it learns, (cells, 5), float64.

    The value of asking is that of the best move minus the cost; NaN where `begun` has NaN.
    """
    alone = lone_values(scenario, robot, weight=weights.individual)
    asking = alone.max(axis=1) - weights.ask_cost * scenario.ask_cost
    asking[np.isnan(begun[:, COORDINATE])] = np.nan
    return np.column_stack([alone, asking])
