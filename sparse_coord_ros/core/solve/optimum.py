# Copyright 2026 The sparse_coord_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The exact joint optimum: value iteration over joint states and joint actions.

The yardstick for `coop`: a single controller that sees the full joint state, chooses the joint
action and pays nothing for asking. Its value is the average over the robots, as in the paper.

Robots that can only be together move independently, and a step pays by the cells in which it ends:
then each robot's move is a matter of its own axis. With swap or block it is looked up what
becomes of all cells that the robots may want.
"""

import hashlib
from collections.abc import Hashable, Sequence
from dataclasses import dataclass
from itertools import product
from typing import NamedTuple

import numpy as np

from sparse_coord_ros.core.game.actions import OUTCOMES, PRIMITIVES, STAY
from sparse_coord_ros.core.game.interactions import (
    interactions_of,
    miscoordinations,
    only_together,
    settled,
)
from sparse_coord_ros.core.game.scenario import Scenario, ScenarioLike, loaded

MOST_JOINT_STATES = 100_000
"""Largest number of joint states that is solved exactly."""

MOST_JOINT_OUTCOMES = 2**25
"""Largest number of joint outcomes of steps that is solved where robots swap or block: for
each joint state 5^K of K robots. They take up to two gigabytes."""

TOLERANCE = 1e-11
"""Largest change of a sweep, as a share of the greatest value."""


@dataclass(frozen=True)
class Optimum:
    """The best value of any joint policy, averaged over the robots.

    Attributes:
        value: total discounted reward from the scenario's starts.
        exact: True: the optimum itself; False: an upper bound (`independent_bound`).
        joint_states: number of joint states of the scenario.
    """

    value: float
    exact: bool
    joint_states: int


def joint_optimum(scenario: ScenarioLike) -> Optimum:
    """Return the exact joint optimum: full joint state and action, no cost of asking.

    Its `value` is the total discounted reward from the starts, averaged over the robots. Where the
    joint state space is too large (`exact` is False), it is an upper bound.

    It does not depend on how robots learn: it is computed once for all scenarios that are the
    same but for that.
    """
    scenario = loaded(scenario)
    cells = len(scenario.map.cells)
    team = len(scenario.robots)
    states = cells**team
    if is_too_large(scenario):
        return Optimum(independent_bound(scenario), False, states)
    leads = [successors(scenario, k) for k in range(team)]
    paid = payment(scenario)
    inter = interactions_of(scenario)
    starts, goals = zip(
        *((robot.start, robot.goal) for robot in scenario.robots), strict=True
    )
    toll = sum(scenario.penalties)
    numbers = [scenario.discount, scenario.move_success, scenario.goal_reward, toll]
    arrays = [paid.ravel()]
    arrays += [lead.ravel() for lead in leads]
    arrays += [inter.passages, inter.narrow]
    digest = hashlib.sha256(np.concatenate(arrays).tobytes()).digest()
    key = starts, goals, tuple(numbers), paid.shape, digest
    if key not in SOLVED:
        if only_together(inter):
            SOLVED[key] = _solve(scenario, leads, paid)
        else:
            SOLVED[key] = _solve_by_outcomes(scenario, joint_outcomes(scenario))
    return Optimum(SOLVED[key], True, states)


SOLVED: dict[Hashable, float] = {}
"""The optimum of each game that this process has solved, by what the optimum depends on."""


def is_too_large(scenario: Scenario) -> bool:
    """Return whether a scenario has more joint states, or outcomes, than are solved exactly."""
    team = len(scenario.robots)
    states: int = len(scenario.map.cells) ** team
    outcomes: int = states * OUTCOMES**team
    if only_together(interactions_of(scenario)):
        return states > MOST_JOINT_STATES
    return states > MOST_JOINT_STATES or outcomes > MOST_JOINT_OUTCOMES


def _solve(scenario: Scenario, leads: Sequence[np.ndarray], paid: np.ndarray) -> float:
    """Return the best value from the starts, by value iteration.

    Args:
        scenario: the problem.
        leads: as `successors` returns them, one a robot.
        paid: as `payment` returns it.
    """
    value = np.zeros(paid.shape)
    every = (slice(None),) * len(leads)
    p = scenario.move_success
    start = tuple(robot.start for robot in scenario.robots)
    goal = tuple(robot.goal for robot in scenario.robots)
    while True:
        # The value of the next joint state; each robot adds its axis in front.
        values: np.ndarray = scenario.discount * value + paid
        for k, lead in enumerate(leads):
            values = np.stack(
                [p * values.take(to, 2 * k) + (1.0 - p) * values for to in lead]
            )
        # All have arrived: the trial is over, and robots in one doorway do not pay.
        values[every + goal] = scenario.arrival_value
        best = values.max(axis=tuple(range(len(leads))))
        if np.abs(best - value).max() <= TOLERANCE * max(1.0, np.abs(best).max()):
            return float(best[start])
        value = best


class JointOutcomes(NamedTuple):
    """The joint states in which steps end, from every joint state.

    A robot's outcome is the move that succeeds, or `STAY`; an outcome of all is one of each.

    Attributes:
        after: number of the joint state in which the step ends; (outcomes,) * robots + (states,).
        miscoordination: whether the step is one; same shape.
    """

    after: np.ndarray
    miscoordination: np.ndarray


def joint_outcomes(scenario: Scenario) -> JointOutcomes:
    """Return all outcomes of all joint steps; a robot that has arrived wants its own cell."""
    cells = len(scenario.map.cells)
    team = len(scenario.robots)
    inter = interactions_of(scenario)
    shape = (cells,) * team
    before = np.indices(shape).reshape(team, -1)
    stay = np.arange(cells)[None]
    ways = [np.concatenate([successors(scenario, k), stay]) for k in range(team)]
    after = np.empty((OUTCOMES,) * team + (cells**team,), dtype=np.int32)
    miscoordination = np.empty(after.shape, dtype=bool)
    for chosen in product(range(OUTCOMES), repeat=team):
        wanted = np.stack([ways[k][chosen[k], before[k]] for k in range(team)])
        ends = settled(inter, before, wanted)
        after[chosen] = np.ravel_multi_index(tuple(ends), shape)
        miscoordination[chosen] = miscoordinations(inter, before, ends)
    return JointOutcomes(after, miscoordination)


def _solve_by_outcomes(scenario: Scenario, outcomes: JointOutcomes) -> float:
    """Return the optimum by value iteration over all outcomes."""
    after = outcomes.after
    team = len(scenario.robots)
    toll = sum(scenario.penalties) / team
    paid = _paid_at_goals(scenario).ravel()[after]
    paid += np.where(outcomes.miscoordination, toll, 0.0)
    start = _joint_state(scenario, [robot.start for robot in scenario.robots])
    goal = _joint_state(scenario, [robot.goal for robot in scenario.robots])
    p = scenario.move_success
    value = np.zeros(after.shape[-1])
    while True:
        values: np.ndarray = scenario.discount * value[after] + paid
        for k in range(team):
            moved = values.take(range(PRIMITIVES), axis=k)
            stayed = values.take([STAY], axis=k)
            values = p * moved + (1.0 - p) * stayed
        values[..., goal] = scenario.arrival_value
        best = values.max(axis=tuple(range(team)))
        if np.abs(best - value).max() <= TOLERANCE * max(1.0, np.abs(best).max()):
            return float(best[start])
        value = best


def _joint_state(scenario: Scenario, cells: Sequence[int]) -> int:
    """Return the number of the joint state of robots in these cells."""
    shape = (len(scenario.map.cells),) * len(scenario.robots)
    return int(np.ravel_multi_index(cells, shape))


def independent_bound(scenario: Scenario) -> float:
    """Return the value of robots alone in the world, each on a shortest path.

    It is an upper bound for all policies.
    """
    robots = scenario.robots
    ways = scenario.map.distances_to
    far = np.array([ways(robot.goal)[robot.start] for robot in robots])
    return float(np.mean(value_alone(scenario, far)))


def value_alone(scenario: Scenario, far: np.ndarray) -> np.ndarray:
    """Return the value of a robot alone in the world, by the moves to its goal.

    The time to goal T is negative binomial, and the goal pays goal_reward / (1 - gamma) *
    gamma^(T-1). At the goal, and where no way leads to it, that is 0.

    Args:
        scenario: the problem.
        far: moves to the goal; negative: no way.

    Returns:
        Shape of `far`.
    """
    gamma = scenario.discount
    p = scenario.move_success
    later = gamma ** np.maximum(far - 1, 0)
    value = scenario.arrival_value * later * (p / (1.0 - gamma * (1.0 - p))) ** far
    return np.where(far < 1, 0.0, value)


def successors(scenario: Scenario, k: int) -> np.ndarray:
    """Shape (moves, cells): where a successful move leads; an arrived robot stays."""
    table = scenario.map.next_cell.T.copy()
    table[:, scenario.robots[k].goal] = scenario.robots[k].goal
    return table


def payment(scenario: Scenario) -> np.ndarray:
    """Shape (cells,) * robots: average reward of a step that ends there, but for swaps."""
    paid = _paid_at_goals(scenario)
    states = np.indices(paid.shape).reshape(paid.ndim, -1)
    conflict = miscoordinations(interactions_of(scenario), states, states)
    toll = sum(scenario.penalties) / len(scenario.robots)
    return paid + np.where(conflict, toll, 0.0).reshape(paid.shape)


def _paid_at_goals(scenario: Scenario) -> np.ndarray:
    """Shape (cells,) * robots: average reward of a step that ends there, without penalties."""
    cells = len(scenario.map.cells)
    team = len(scenario.robots)
    paid = np.zeros((cells,) * team)
    states = np.indices(paid.shape)
    for k, robot in enumerate(scenario.robots):
        paid += np.where(states[k] == robot.goal, scenario.goal_reward, 0.0)
    return paid / team
