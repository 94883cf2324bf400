# Copyright 2026 The sparse_coord_ros authors
# SPDX-License-Identifier: Apache-2.0
"""An upper bound for teams too large to solve: groups of robots, each at its joint optimum.

Let the team be split into groups, and let V(S) be the joint optimum of group S in the same
scenario without the other robots, as the sum over its robots. The value of every policy of the
whole team is at most the sum of all V(S), for three reasons.

1. Two robots of one group that meet are two robots of the team that meet, and r^C falls on each
   robot of the team. So in each step the team pays at least what its groups would pay that meet.
2. Arrivals are paid to each robot as in its group, and asking is never a gain.
3. Where the other robots are does not change where a move leads. So what the team's policy makes
   of group S, the other robots being draws of chance, is a policy of S, with value at most V(S).

A group of all robots gives the joint optimum. Values are computed from above: they begin at the
bound by pairs, and each backup leaves an upper bound. So it remains a bound though only states are
backed up to which the best known policy leads (real-time dynamic programming; Barto, Bradtke &
Singh, Artificial Intelligence 1995), and whenever that ends.
"""

import functools
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from itertools import combinations
from typing import Any, NamedTuple

import numpy as np

from sparse_coord_ros.base.compiling import has_numba, inner, jit
from sparse_coord_ros.core.game.actions import PRIMITIVES
from sparse_coord_ros.core.game.interactions import check_only_together
from sparse_coord_ros.core.game.scenario import Scenario
from sparse_coord_ros.core.game.specs import Spec
from sparse_coord_ros.core.solve.optimum import payment, successors, value_alone

TOLERANCE = 1e-5
"""Where all values fall by less in a sweep, it is the last one."""

LEAST_FALL = 1e-3
"""Where the start's value falls by less in a block of trials, it is the last one."""

LARGEST_GROUP = 4
"""Robots of a group: of four robots there are up to 50 million joint states on 85 cells."""

TRIALS = 2000
"""Trials of a block."""

LONGEST = 200
"""Steps of a trial."""

CHOICES = PRIMITIVES + 1
"""Cells where a step can end: it fails, or one of the moves succeeds."""


@dataclass(frozen=True)
class GroupBound:
    """An upper bound of the value of every policy of a team.

    Attributes:
        value: total discounted reward from the scenario's starts, averaged over the robots.
        groups: the groups, each as its robots (from 0); if it is one, the bound is the joint
            optimum, from above.
    """

    value: float
    groups: tuple[tuple[int, ...], ...]


class Group(NamedTuple):
    """The joint game of a group as arrays.

    Attributes:
        ends: the different cells where a step of a robot may end, first its own cell;
            (robots, cells, CHOICES).
        counts: their number; (robots, cells).
        stays: whether a move leads nowhere; (robots, cells).
        strides: of each robot's cell in the number of a joint state; (robots,).
        paid: average reward of a step that ends in a joint state; (cells ** robots,).
        start: the joint state in which trials begin.
        end: the one in which all have arrived.
        discount: gamma.
        success: probability that a move succeeds.
    """

    ends: np.ndarray
    counts: np.ndarray
    stays: np.ndarray
    strides: np.ndarray
    paid: np.ndarray
    start: int
    end: int
    discount: float
    success: float


class GroupWorkspace(NamedTuple):
    """Working memory of a backup.

    Attributes:
        cells, moves: of each robot; (robots,), int64.
        after: joint states where a step may end; (CHOICES ** robots,), int64.
        values: their values; (2, CHOICES ** robots).
    """

    cells: np.ndarray
    moves: np.ndarray
    after: np.ndarray
    values: np.ndarray


def group_bound(scenario: Scenario, size: int = LARGEST_GROUP) -> GroupBound:
    """Return an upper bound by groups of at most so many robots.

    Robots are in one group that lose most by each other, as pairs.

    Args:
        scenario: the problem.
        size: robots of a group at most. A group of 4 takes seconds to minutes.

    Raises:
        SettingError: robots exchange cells or stop each other.
    """
    check_only_together(
        scenario, "bound by groups", "the joint optimum knows all interactions"
    )
    groups = split(pair_losses(scenario), size)
    values = [len(group) * group_optimum(scenario, group) for group in groups]
    return GroupBound(sum(values) / len(scenario.robots), groups)


def pair_losses(scenario: Scenario) -> np.ndarray:
    """Return the loss of each pair against two lone robots, shape (robots, robots)."""
    team = range(len(scenario.robots))
    alone = [group_optimum(scenario, (k,)) for k in team]
    losses = np.zeros((len(team), len(team)))
    for i, j in combinations(team, 2):
        loss = alone[i] + alone[j] - 2 * group_optimum(scenario, (i, j))
        losses[i, j] = loss
        losses[j, i] = loss
    return losses


def split(losses: np.ndarray, size: int) -> tuple[tuple[int, ...], ...]:
    """Return robots in groups of at most so many, in which they lose much by each other.

    A group begins with the robot that loses most by those that are left, and takes the robot that
    adds most, again and again.
    """
    left = list(range(len(losses)))
    groups = []
    while left:
        group: list[int] = []
        while left and len(group) < size:
            others = group or left
            chosen = max(left, key=lambda k: losses[k, others].sum())
            group.append(chosen)
            left.remove(chosen)
        groups.append(tuple(sorted(group)))
    return tuple(groups)


def group_optimum(scenario: Scenario, group: Sequence[int], *, seed: int = 0) -> float:
    """Return a bound, near to it, of the joint optimum of some of the robots without the others.

    Args:
        scenario: the problem.
        group: the robots, from 0.
        seed: of the trials.

    Returns:
        The average over the group, from the scenario's starts.
    """
    alone = without_others(scenario, group)
    starts = tuple(robot.start for robot in alone.robots)
    if len(group) <= 2:
        return float(_solved(alone)[starts])
    game = _game(alone)
    entering = scenario.discount * _by_pairs(alone).ravel() + game.paid
    space = _space(len(group))
    rng = np.random.default_rng(seed)
    while True:
        before = entering[game.start]
        draws = rng.random((TRIALS, LONGEST, len(group)))
        compiled()[1](game, entering, draws, space, np.zeros(LONGEST, dtype=np.int64))
        if before - entering[game.start] < LEAST_FALL:
            break
    return float(entering[game.start] - game.paid[game.start]) / scenario.discount


def _solved(scenario: Scenario) -> np.ndarray:
    """Return the optimum of one robot or two from all joint states, shape (cells,) * robots."""
    lone = _alone(scenario)
    if len(lone) == 1:
        only: np.ndarray = lone[0]
        return only
    value = (lone[0][:, None] + lone[1][None, :]) / 2
    game = _game(scenario)
    entering = scenario.discount * value.ravel() + game.paid
    space = _space(2)
    while compiled()[0](game, entering, space) > TOLERANCE:
        pass
    after: np.ndarray = (entering - game.paid) / scenario.discount
    return after.reshape(value.shape)


def _by_pairs(scenario: Scenario) -> np.ndarray:
    """Return a bound of all joint states: the least that disjoint pairs give."""
    count = len(scenario.robots)
    cells = len(scenario.map.cells)
    bound = np.full((cells,) * count, np.inf)
    groups = {}
    for size in (1, 2):
        for group in combinations(range(count), size):
            groups[group] = _solved(without_others(scenario, group))
    for pairing in _pairings(tuple(range(count))):
        total = np.zeros((cells,) * count)
        for group in pairing:
            shape = [cells if k in group else 1 for k in range(count)]
            total += groups[group].reshape(shape) * (len(group) / count)
        np.minimum(bound, total, out=bound)
    return bound


def _pairings(robots: tuple[int, ...]) -> Iterator[list[tuple[int, ...]]]:
    """Yield each way to split robots into pairs, and one alone if their number is odd."""
    if len(robots) <= 2:
        yield [robots]
        return
    first, *others = robots
    for other in others:
        rest = tuple(k for k in others if k != other)
        for pairing in _pairings(rest):
            yield [(first, other), *pairing]
    if len(robots) % 2:
        for pairing in _pairings(tuple(others)):
            yield [(first,), *pairing]


def _game(scenario: Scenario) -> Group:
    """Return a scenario as arrays."""
    cells = len(scenario.map.cells)
    count = len(scenario.robots)
    ends = np.zeros((count, cells, CHOICES), dtype=np.int64)
    counts = np.zeros((count, cells), dtype=np.int64)
    stays = np.zeros((count, cells), dtype=bool)
    for k in range(count):
        leads = successors(scenario, k).T
        for x in range(cells):
            others = [y for y in dict.fromkeys(leads[x].tolist()) if y != x]
            counts[k, x] = 1 + len(others)
            ends[k, x, : counts[k, x]] = [x, *others]
            stays[k, x] = (leads[x] == x).any()
    strides = cells ** np.arange(count - 1, -1, -1)
    starts = np.array([robot.start for robot in scenario.robots])
    goals = np.array([robot.goal for robot in scenario.robots])
    return Group(
        ends=ends,
        counts=counts,
        stays=stays,
        strides=strides,
        paid=payment(scenario).ravel(),
        start=int(starts @ strides),
        end=int(goals @ strides),
        discount=float(scenario.discount),
        success=float(scenario.move_success),
    )


def _space(count: int) -> GroupWorkspace:
    return GroupWorkspace(
        cells=np.zeros(count, dtype=np.int64),
        moves=np.zeros(count, dtype=np.int64),
        after=np.zeros(CHOICES**count, dtype=np.int64),
        values=np.zeros((2, CHOICES**count)),
    )


def without_others(scenario: Scenario, group: Sequence[int]) -> Scenario:
    """Return the scenario with some of its robots (from 0) alone; each pays the r^C it paid."""
    shares = scenario.common_reward
    if shares.kind == "each":
        shares = Spec("each", tuple(shares.numbers[k] for k in group))
    robots = tuple(scenario.robots[k] for k in group)
    return replace(scenario, robots=robots, common_reward=shares)


def _alone(scenario: Scenario) -> np.ndarray:
    """Return the value of each robot alone in each cell, arrived robots too; (robots, cells)."""
    goals = [robot.goal for robot in scenario.robots]
    far = np.array([scenario.map.distances_to(goal) for goal in goals])
    values = value_alone(scenario, far)
    values[np.arange(len(goals)), goals] = scenario.arrival_value
    return values


@inner
def backup(
    game: Group, entering: np.ndarray, state: int, space: GroupWorkspace
) -> float:
    """Return the value of a joint state by its best joint move; write the robots' moves.

    A move is written as the place of the cell where it leads in `Group.ends`.

    Args:
        game: the group's game.
        entering: the value of each joint state for a step that ends there: the reward, and what
            follows.
        state: the joint state; not all have arrived.
        space: room.
    """
    count = len(game.strides)
    # The joint states where the step may end, the last robot's cell changing first.
    after = space.after
    after[0] = 0
    filled = 1
    for k in range(count):
        x = state // game.strides[k] % game.counts.shape[1]
        space.cells[k] = x
        several = game.counts[k, x]
        for i in range(filled - 1, -1, -1):
            begun = after[i]
            for c in range(several):
                after[i * several + c] = begun + game.ends[k, x, c] * game.strides[k]
        filled *= several
    values = space.values[0]
    for i in range(filled):
        values[i] = entering[after[i]]
    # The last robot first, the values of its next states become the mean values of its moves.
    inside = 1
    which = 0
    p = game.success
    for k in range(count - 1, -1, -1):
        x = space.cells[k]
        several = game.counts[k, x]
        stays = 1 if game.stays[k, x] else 0
        moves = several - 1 + stays
        filled //= several
        old = space.values[which]
        new = space.values[1 - which]
        for left in range(filled):
            fails = left * several * inside
            for b in range(moves):
                moved = fails + (b + 1 - stays) * inside
                to = (left * moves + b) * inside
                for i in range(inside):
                    new[to + i] = p * old[moved + i] + (1.0 - p) * old[fails + i]
        inside *= moves
        which = 1 - which
    found = space.values[which]
    best = 0
    for i in range(1, inside):
        if found[i] > found[best]:
            best = i
    number = best
    for k in range(count - 1, -1, -1):
        x = space.cells[k]
        stays = 1 if game.stays[k, x] else 0
        moves = game.counts[k, x] - 1 + stays
        space.moves[k] = number % moves + 1 - stays
        number //= moves
    value: float = game.paid[state] + game.discount * found[best]
    return value


def sweep(game: Group, entering: np.ndarray, space: GroupWorkspace) -> float:
    """Back up each joint state once, in place; return the largest change."""
    most = 0.0
    for state in range(len(entering)):
        if state != game.end:
            value = backup(game, entering, state, space)
            most = max(most, entering[state] - value)
            entering[state] = value
    return most


def play(
    game: Group,
    entering: np.ndarray,
    draws: np.ndarray,
    space: GroupWorkspace,
    passed: np.ndarray,
) -> None:
    """Play trials by the best known policy; back up the joint states on the way, and back again.

    Args:
        game: the group's game.
        entering: as of `backup`, an upper bound; lowered.
        draws: in [0, 1), one for each trial, step and robot.
        space: room.
        passed: room for the joint states of a trial; (steps,), int64.
    """
    for trial in range(len(draws)):
        state = game.start
        steps = 0
        while state != game.end and steps < len(passed):
            passed[steps] = state
            entering[state] = backup(game, entering, state, space)
            state = 0
            for k in range(len(game.strides)):
                moved = draws[trial, steps, k] < game.success
                to = space.moves[k] if moved else 0
                state += game.ends[k, space.cells[k], to] * game.strides[k]
            steps += 1
        for t in range(steps - 1, -1, -1):
            before = passed[t]
            entering[before] = backup(game, entering, before, space)


@functools.cache
def compiled() -> list[Callable[..., Any]]:
    """Return `sweep` and `play` compiled by numba, or as they are where it is not installed."""
    loops: list[Callable[..., Any]] = [sweep, play]
    return jit(loops) if has_numba() else loops
