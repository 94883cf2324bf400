# Copyright 2026 The sparse_coord_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The loop behind exact evaluation: a team of two robots, its probabilities carried forward.

Plain Python over NumPy arrays, compiled by numba where it is installed; the same bits.
"""

import functools
from collections.abc import Callable
from typing import Any, NamedTuple

import numpy as np

from sparse_coord_ros.base.compiling import has_numba, inner, jit
from sparse_coord_ros.core.game.actions import OUTCOMES, STAY
from sparse_coord_ros.core.game.interactions import (
    Interactions,
    miscoordinates,
    settle,
)


class Pair(NamedTuple):
    """Two robots that act greedily.

    Attributes:
        lead: where each move leads, and `STAY`; (cells, moves + 1).
        starts: start cell of each robot; (2,).
        goals: goal cell of each robot; (2,).
        moves: probability of each move, whether asked or not; (2, own cell,
            peer's cell, moves).
        asks: probability of asking; (2, cells).
        asked: probability of having asked, given what the step came to, a move (stopped or not)
            or `STAY`; (2, own cell, peer's cell, moves + 1).
        interactions: of the two, in these cells.
        penalties: r^C of a miscoordination for each robot; (2,).
        arrival_value: value of a robot's arrival, for ever.
        cost: of asking.
        discount: gamma.
        success: probability that a move succeeds.
        horizon: steps of a trial.
    """

    lead: np.ndarray
    starts: np.ndarray
    goals: np.ndarray
    moves: np.ndarray
    asks: np.ndarray
    asked: np.ndarray
    interactions: Interactions
    penalties: np.ndarray
    arrival_value: float
    cost: float
    discount: float
    success: float
    horizon: int


RETURN, TIME, ASKS = range(3)
"""Rows of the sums of each robot."""

CONFLICTS, ARRIVED = range(2)
"""Entries of the sums of the team."""

QUANTITIES = 7
"""`RETURN`, `TIME` and `ASKS` of both robots, numbered 2 * row + robot, and miscoordinations."""


class Sums(NamedTuple):
    """Sums of a trial, filled by `carry`, and its working memory; initially 0.

    Attributes:
        robots: mean `RETURN`, `TIME` and `ASKS` of each robot; (3, 2).
        team: mean `CONFLICTS`, and the probability that all have `ARRIVED`; (2,).
        squares: mean square of each of the `QUANTITIES`; (QUANTITIES,).
        asked: expected asks of each robot in each cell; (2, cells).
        stays: expected steps that each robot acts in each cell; (2, cells).
        brought: mean and square of a step's change of each quantity; (2, QUANTITIES).
        so_far: mean of each quantity so far, times the probability of the joint state, now and
            after the step; (2, cells^2, QUANTITIES), or (2, 0, QUANTITIES) where squares are not
            wanted.
        step: cells of the robots before and after a step; (2, 2).
    """

    robots: np.ndarray
    team: np.ndarray
    squares: np.ndarray
    asked: np.ndarray
    stays: np.ndarray
    brought: np.ndarray
    so_far: np.ndarray
    step: np.ndarray


class Distribution(NamedTuple):
    """The joint states that are possible at a time step, and how likely each of them is.

    Attributes:
        likely: probability of each joint state, 0 where it is not possible; (cells^2,).
        states: the joint states that are possible, at the beginning of the array; (cells^2,).
        size: how many are possible; (1,).
    """

    likely: np.ndarray
    states: np.ndarray
    size: np.ndarray


def carry(
    pair: Pair, now: Distribution, later: Distribution, sums: Sums, most: float
) -> bool:
    """Add up the means of a trial; return False if steps have more outcomes than `most`.

    Args:
        pair: the two robots.
        now: an empty distribution, which is used.
        later: another one.
        sums: filled.
        most: outcomes of steps after which to give up.
    """
    cells = len(pair.lead)
    home = pair.goals[0] * cells + pair.goals[1]
    squared = sums.so_far.shape[1] > 0
    add(now, pair.starts[0] * cells + pair.starts[1], 1.0)
    factor = 1.0
    outcomes = 0
    for t in range(pair.horizon):
        if outcomes > most:
            return False
        for i in range(now.size[0]):
            state = now.states[i]
            p = now.likely[state]
            now.likely[state] = 0.0
            acts(pair, sums, 0, state // cells, p, factor)
            acts(pair, sums, 1, state % cells, p, factor)
            outcomes += follow(
                pair, sums, later, home, squared, state, p, factor, t % 2
            )
            if squared:
                sums.so_far[t % 2, state] = 0.0
        now.size[0] = 0
        now, later = later, now
        factor *= pair.discount
        if squared:
            sums.so_far[(t + 1) % 2, home] = 0.0
    return True


@inner
def follow(
    pair: Pair,
    sums: Sums,
    later: Distribution,
    home: int,
    squared: bool,
    state: int,
    p: float,
    factor: float,
    now: int,
) -> int:
    """Add up the results of a step from a joint state; return its number of outcomes.

    Args:
        pair: the two robots.
        sums: added to.
        later: the distribution after the step, added to.
        home: the joint state in which both have arrived: a trial ends there.
        squared: whether squares are wanted.
        state: the joint state.
        p: its probability.
        factor: the discount factor of this step's reward.
        now: the row of `sums.so_far` that is before the step.
    """
    cells = len(pair.lead)
    inter = pair.interactions
    before, after = sums.step
    x = state // cells
    z = state % cells
    outcomes = 0
    for a in range(OUTCOMES):
        first = p * outcome(pair, 0, x, z, a)
        if first == 0.0:
            continue
        for b in range(OUTCOMES):
            q = first * outcome(pair, 1, z, x, b)
            if q == 0.0:
                continue
            outcomes += 1
            y = pair.lead[x, a]
            w = pair.lead[z, b]
            before[0] = x
            before[1] = z
            after[0] = y
            after[1] = w
            settle(inter, before, after)
            y = after[0]
            w = after[1]
            conflict = miscoordinates(inter, before, after)
            target = y * cells + w
            pay(pair, sums, x, z, y, w, conflict, factor * q, q)
            if squared:
                bring(pair, sums.brought, 0, x, z, y, conflict, a, factor)
                bring(pair, sums.brought, 1, z, x, w, conflict, b, factor)
                pass_on(sums, now, state, target, q, q / p)
            if target != home:
                add(later, target, q)
    return outcomes


@inner
def add(distribution: Distribution, state: int, p: float) -> None:
    """Add to the probability of a joint state."""
    if distribution.likely[state] == 0.0:
        distribution.states[distribution.size[0]] = state
        distribution.size[0] += 1
    distribution.likely[state] += p


@inner
def acts(pair: Pair, sums: Sums, k: int, x: int, p: float, factor: float) -> None:
    """Add up that robot k acts in cell x, unless it has arrived."""
    if x != pair.goals[k]:
        asks = p * pair.asks[k, x]
        sums.robots[TIME, k] += p
        sums.robots[ASKS, k] += asks
        sums.robots[RETURN, k] -= factor * p * pair.asks[k, x] * pair.cost
        sums.stays[k, x] += p
        sums.asked[k, x] += asks


@inner
def outcome(pair: Pair, k: int, x: int, z: int, outcome: int) -> float:
    """Return the probability that robot k's step from x, its peer in z, has this outcome."""
    arrived = x == pair.goals[k]
    if outcome != STAY:
        return 0.0 if arrived else pair.success * pair.moves[k, x, z, outcome]
    return 1.0 if arrived else 1.0 - pair.success


@inner
def pay(
    pair: Pair,
    sums: Sums,
    x: int,
    z: int,
    y: int,
    w: int,
    conflict: bool,
    weight: float,
    q: float,
) -> None:
    """Add the rewards of a step from (x, z) to (y, w) of probability q; `weight`: discounted q."""
    if conflict:
        sums.team[CONFLICTS] += q
        sums.robots[RETURN, 0] += weight * pair.penalties[0]
        sums.robots[RETURN, 1] += weight * pair.penalties[1]
    if y == pair.goals[0] and x != y:
        sums.robots[RETURN, 0] += weight * pair.arrival_value
    if w == pair.goals[1] and z != w:
        sums.robots[RETURN, 1] += weight * pair.arrival_value
    if y == pair.goals[0] and w == pair.goals[1]:
        sums.team[ARRIVED] += q


@inner
def bring(
    pair: Pair,
    brought: np.ndarray,
    k: int,
    x: int,
    z: int,
    y: int,
    conflict: bool,
    a: int,
    factor: float,
) -> None:
    """Write mean and square of the changes of robot k in a step from x to y.

    The peer was in z, the step comes to `a`, and its reward counts `factor` times. `conflict`:
    it is a miscoordination.
    """
    acting = 1.0 if x != pair.goals[k] else 0.0
    meets = 1.0 if conflict else 0.0
    asked = acting * pair.asked[k, x, z, a]
    paid = meets * pair.penalties[k]
    if acting and y == pair.goals[k]:
        paid += pair.arrival_value
    with_cost = paid - pair.cost
    brought[0, 2 * RETURN + k] = factor * (paid - asked * pair.cost)
    brought[1, 2 * RETURN + k] = factor**2 * (
        asked * with_cost * with_cost + (1.0 - asked) * paid * paid
    )
    brought[:, 2 * TIME + k] = acting
    brought[:, 2 * ASKS + k] = asked
    brought[:, QUANTITIES - 1] = meets


@inner
def pass_on(
    sums: Sums, now: int, state: int, target: int, q: float, share: float
) -> None:
    """Add what was brought to the squares, and to the means of the state that a step leads to.

    (X + c)^2 is X^2 + 2 c X + c^2. The step's probability is q, `share` that of the state's.
    """
    for i in range(QUANTITIES):
        mean = sums.brought[0, i]
        square = sums.brought[1, i]
        before = share * sums.so_far[now, state, i]
        sums.so_far[1 - now, target, i] += before + q * mean
        sums.squares[i] += 2.0 * mean * before + q * square


@functools.cache
def compiled() -> Callable[..., Any]:
    """Return `carry`, compiled by numba where it is installed (when it is first called)."""
    return jit([carry])[0] if has_numba() else carry
