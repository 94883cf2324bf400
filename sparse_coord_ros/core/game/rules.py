# Copyright 2026 The sparse_coord_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The rules of the game: starts, moves, percepts, rewards.

The rules of interactions are in `core.game.interactions`. The world node, the loop of a team,
evaluation, planners and logs call these functions, plain or compiled.
"""

from typing import Any, NamedTuple

import numpy as np

from sparse_coord_ros.base.compiling import jitable
from sparse_coord_ros.core.game.draws import (
    ENVIRONMENT,
    MOTION,
    PEER,
    PERCEPT,
    ROBOT,
    START,
    START_CELL,
    draw,
)
from sparse_coord_ros.core.game.interactions import (
    Interactions,
    interactions_of,
)
from sparse_coord_ros.core.game.perception import drawn_peer, sight_of
from sparse_coord_ros.core.game.scenario import Scenario
from sparse_coord_ros.core.game.sight import BLIND, Sight, probability

EPISODE_GAP = 2
"""Time steps from an episode's last state to the next one's first: no robot learns across it."""

UNKNOWN_PARTNERS = -1
"""In place of partners: they are not told; every bit of it is set."""


class Problem(NamedTuple):
    """A scenario as arrays; k is a robot, x its cell.

    Attributes:
        starts: start cell [k].
        goals: goal cell [k].
        next_cell: where a move leads [x, move].
        interactions: how robots affect each other.
        sight: probabilities that percepts succeed.
        all_peers: whether COORDINATE perceives every peer (footnote 3), or one drawn at random; of
            two robots it perceives every peer.
        penalties: r^C of a miscoordination [k].
        start_cells: cells where an exploring start can be [k, number].
        start_counts: their number [k].
        move_success: probability that a move succeeds.
        goal_reward: r^I at the goal.
        ask_cost: cost of COORDINATE.
        discount: gamma.
        goal_total: the sum of what the goal pays from the arrival on, for ever.
    """

    starts: Any
    goals: Any
    next_cell: Any
    interactions: Interactions
    sight: Sight
    all_peers: bool
    penalties: Any
    start_cells: Any
    start_counts: Any
    move_success: float
    goal_reward: float
    ask_cost: float
    discount: float
    goal_total: float


def problem_of(scenario: Scenario, *, percepts: bool = True) -> Problem:
    """Return a scenario as arrays.

    Args:
        scenario: the problem.
        percepts: whether `perceive` will be called; the model of percepts may be unknown.
    """
    grid = scenario.map
    robots = scenario.robots
    free = [grid.leading_to(robot.goal) for robot in robots]
    start_cells = np.zeros((len(robots), max(map(len, free))), dtype=np.int64)
    for k, choices in enumerate(free):
        start_cells[k, : len(choices)] = choices
    return Problem(
        starts=np.array([robot.start for robot in robots]),
        goals=np.array([robot.goal for robot in robots]),
        next_cell=np.ascontiguousarray(grid.next_cell, dtype=np.int64),
        interactions=interactions_of(scenario),
        sight=sight_of(scenario.perception, scenario.map) if percepts else BLIND,
        all_peers=scenario.peers == "all" or len(robots) <= 2,
        penalties=np.array(scenario.penalties),
        start_cells=start_cells,
        start_counts=np.array([len(choices) for choices in free]),
        move_success=scenario.move_success,
        goal_reward=scenario.goal_reward,
        ask_cost=scenario.ask_cost,
        discount=scenario.discount,
        goal_total=scenario.arrival_value,
    )


@jitable
def start_of(problem: Problem, keys: Any, k: int, step: int, exploring: float) -> int:
    """Return the cell where robot k begins an episode: its start, or an exploring start.

    Args:
        problem: the scenario.
        keys: the keys of the team's draws [role, k], from `keys_of`.
        k: the robot.
        step: the episode's first time step.
        exploring: probability of an exploring start: any cell with a way to the goal.
    """
    key = keys[ENVIRONMENT, k]
    if exploring > 0.0 and draw(key, step, START) < exploring:
        pick = int(draw(key, step, START_CELL) * problem.start_counts[k])
        chosen: int = problem.start_cells[k, pick]
        return chosen
    start: int = problem.starts[k]
    return start


@jitable
def led(problem: Problem, keys: Any, k: int, step: int, cell: int, move: int) -> int:
    """Return the cell in which a move of robot k ends: where it leads, or the same cell."""
    if draw(keys[ENVIRONMENT, k], step, MOTION) < problem.move_success:
        cell = problem.next_cell[cell, move]
    return cell


@jitable
def perceive(problem: Problem, keys: Any, k: int, step: int, cells: Any) -> int:
    """Return the peers that robot k perceives by COORDINATE, the sum of 2^j; 0: it fails."""
    team = len(cells)
    chance = draw(keys[ENVIRONMENT, k], step, PERCEPT)
    first = 0
    end = team
    if not problem.all_peers:
        first = drawn_peer(k, team, draw(keys[ROBOT, k], step, PEER))
        end = first + 1
    seen = 0
    for j in range(first, end):
        if j != k:
            if chance >= probability(problem.sight, cells[k], cells[j]):
                return 0
            seen |= 1 << j
    return seen


@jitable
def episode_ends(all_arrived: bool, steps: int, most: int) -> bool:
    """Return whether an episode ends: all robots have arrived, or its steps are used up.

    Args:
        all_arrived: whether every robot that acts has arrived.
        steps: the steps made in the episode.
        most: the largest number allowed.
    """
    return all_arrived or steps >= most


@jitable
def rewards_of(
    problem: Problem, k: int, conflict: bool, arrives: bool, asked: bool
) -> tuple[float, float, float]:
    """Return the parts of R_k(t): r^I, r^C, and minus the cost of asking.

    Args:
        problem: the scenario.
        k: the robot.
        conflict: whether the step is a miscoordination; it costs robots that have arrived, too.
        arrives: whether robot k arrives with it.
        asked: whether it chose COORDINATE, answered or not.
    """
    individual = problem.goal_reward if arrives else 0.0
    common = problem.penalties[k] if conflict else 0.0
    asking = -problem.ask_cost if asked else 0.0
    return individual, common, asking


@jitable
def paid_for_ever(
    problem: Problem, arrives: bool, common: float, ask_cost: float
) -> float:
    """Return R_k(t) of a step with all that the goal pays from the arrival on.

    Environments for other people's learners pay this: the discounted sum over an episode is the
    return that `evaluate` reports.

    Args:
        problem: the scenario.
        arrives: whether the robot arrives with this step.
        common: r^C of the step.
        ask_cost: minus the cost of asking, likewise.
    """
    goal = problem.goal_total if arrives else 0.0
    return goal + common + ask_cost
