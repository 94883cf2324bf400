# Copyright 2026 The sparse_coord_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The exact worth of fixed shortest-path policies: what "Indiv." of the paper tends to.

Each robot walks a shortest path to its goal and never minds the others (paper, Section 4). The
robots are then independent Markov chains, so each is carried forward on its own, and at every
time step the chance of a miscoordination follows from who is how likely in which doorway.
"""

import math
from dataclasses import dataclass

import numpy as np

from sparse_coord_ros.core.game.actions import DIRECTIONS, PRIMITIVES
from sparse_coord_ros.core.game.interactions import (
    NOWHERE,
    any_together,
    interactions_of,
)
from sparse_coord_ros.core.game.scenario import Robot, Scenario, ScenarioLike, loaded
from sparse_coord_ros.core.solve.optimum import independent_bound

NEGLIGIBLE_PROBABILITY = 1e-16
"""Probability (discounted, where the horizon is over) of what is left out at the end."""


@dataclass(frozen=True)
class Reference:
    """What a team on fixed shortest paths is worth from the scenario's starts; all are expected.

    Attributes:
        reward: total discounted reward, averaged over the robots: the goal paid from arrival on
            for ever, and a penalty for each miscoordination until all have arrived. Unlike trials,
            it knows no horizon.
        time_to_goal: steps until arrival, averaged over the robots; without horizon too.
        miscoordinations: steps of a trial that end in a miscoordination, within the horizon.
    """

    reward: float
    time_to_goal: float
    miscoordinations: float


def shortest_path_reference(
    scenario: ScenarioLike, *, keep_right: bool = False
) -> Reference:
    """Return the exact value of fixed shortest paths, with no coordination (paper, Section 4).

    It is what Indiv. tends to. `reward` (total discounted) and `time_to_goal` (steps) are means
    over the robots, `miscoordinations` is that of a trial.

    Args:
        scenario: the problem.
        keep_right: whether robots choose between equally short ways the one furthest to the
            right, as seen by a robot that faces its goal; if not, each move is equally likely at
            every cell, as greedy agents choose between equal values.
    """
    scenario = loaded(scenario)
    conflict = _miscoordination_probability(scenario, keep_right)
    discounted = conflict @ scenario.discount ** np.arange(len(conflict))
    distances = [
        scenario.map.distances_to(robot.goal)[robot.start] for robot in scenario.robots
    ]
    return Reference(
        reward=independent_bound(scenario)
        + float(np.mean(scenario.penalties) * discounted),
        time_to_goal=float(np.mean(distances)) / scenario.move_success,
        miscoordinations=float(conflict[: scenario.horizon].sum()),
    )


def _miscoordination_probability(scenario: Scenario, keep_right: bool) -> np.ndarray:
    """Shape (steps,): that step 1, 2, ... is made and ends in a miscoordination."""
    robots = scenario.robots
    places = interactions_of(scenario).places
    meeting = [
        np.flatnonzero(places == one) for one in np.unique(places[places != NOWHERE])
    ]
    goals = np.array([robot.goal for robot in robots])
    numbers = np.arange(len(robots))
    shares = [_shares(scenario, robot, keep_right) for robot in robots]
    cells = len(scenario.map.cells)
    stay = np.arange(cells)[:, None]
    leads = np.concatenate([scenario.map.next_cell, stay], axis=1).ravel()
    place = np.zeros((len(robots), cells))  # [k, x]: probability of robot k in cell x
    place[numbers, [robot.start for robot in robots]] = 1.0
    in_doorway: list[list[np.ndarray]] = []
    all_arrived: list[float] = []
    moving = np.ones(place.shape, dtype=bool)
    moving[numbers, goals] = False
    while True:
        steps = len(in_doorway)
        rest = float(place[moving].sum())
        if steps >= scenario.horizon:
            rest *= scenario.discount**steps / (1.0 - scenario.discount)
        if rest <= NEGLIGIBLE_PROBABILITY:
            break
        all_arrived.append(place[numbers, goals].prod())
        moved = zip(place, shares, strict=True)
        place = np.stack(
            [np.bincount(leads, (p[:, None] * s).ravel(), cells) for p, s in moved]
        )
        in_doorway.append([place[:, cells].sum(axis=1) for cells in meeting])
    occupied = np.array(in_doorway).reshape(len(in_doorway), len(meeting), len(robots))
    # Robots that have all arrived, in one doorway, end the trial: those steps are not made.
    crowded_at_home = float(any_together(places[goals]))
    apart = _one_each(occupied.T)
    return np.maximum(1.0 - apart - crowded_at_home * np.array(all_arrived), 0.0)


def _one_each(occupied: np.ndarray) -> np.ndarray:
    """Return the probability that no place holds two robots, which are independent.

    Args:
        occupied: probability that a robot is in a place, shape (robots, places, steps).

    Returns:
        Shape (steps,).
    """
    # For each set of robots (bits): the probability that just they are in the places looked at
    # so far, each in one of its own, as to those robots alone.
    placed = {0: np.ones(occupied.shape[2])}
    for place in range(occupied.shape[1]):
        visitors = [k for k in range(len(occupied)) if occupied[k, place].any()]
        for members, probability in list(placed.items()):
            for k in visitors:
                if not members >> k & 1:
                    more = members | 1 << k
                    placed[more] = (
                        placed.get(more, 0.0) + probability * occupied[k, place]
                    )
    outside = 1.0 - occupied.sum(axis=1)
    total = np.zeros(occupied.shape[2])
    for members, probability in placed.items():
        others = [k for k in range(len(occupied)) if not members >> k & 1]
        total += probability * outside[others].prod(axis=0)
    return total


def _shares(scenario: Scenario, robot: Robot, keep_right: bool) -> np.ndarray:
    """Shape (cells, 5): probability of each move from a cell, and to stay; the goal absorbs."""
    grid = scenario.map
    distance = grid.distances_to(robot.goal)
    shares = np.zeros((len(distance), PRIMITIVES + 1))
    shares[:, PRIMITIVES] = 1.0
    for x in np.flatnonzero(distance > 0):
        moves = [
            a for a, y in enumerate(grid.next_cell[x]) if distance[y] == distance[x] - 1
        ]
        if keep_right:
            moves = [_furthest_right(grid.cells[x], grid.cells[robot.goal], moves)]
        shares[x, PRIMITIVES] = 1.0 - scenario.move_success
        shares[x, moves] = scenario.move_success / len(moves)
    return shares


def _furthest_right(
    here: tuple[int, int], goal: tuple[int, int], moves: list[int]
) -> int:
    """Return the move furthest clockwise, seen from `here` with the goal ahead."""
    ahead = (goal[0] - here[0], goal[1] - here[1])

    def clockwise(move: int) -> float:
        down, right = DIRECTIONS[move]
        return math.atan2(
            ahead[1] * down - ahead[0] * right, ahead[0] * down + ahead[1] * right
        )

    return max(moves, key=clockwise)
