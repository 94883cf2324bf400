# Copyright 2026 The sparse_coord_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The loop behind exact means: a team of two robots, its probabilities carried forward.

Plain Python over NumPy arrays, compiled by numba where it is installed; the same bits.
"""

import functools
from collections.abc import Callable
from typing import Any, NamedTuple

import numpy as np

from sparse_coord_ros.compiling import has_numba, inner, jit
from sparse_coord_ros.game.actions import PRIMITIVES, STAY


class Pair(NamedTuple):
    """Two robots that act greedily.

    Attributes:
        lead: where each move leads, and `STAY`; (cells, moves + 1).
        start: the joint state that they start in: first robot's cell * cells + second robot's.
        goals: goal cell of each robot; (2,).
        moves: probability of each move, whether asked or not; (2, own cell,
            peer's cell, moves).
        asks: probability of asking; (2, cells).
        meets: whether a step that ends in these cells is a miscoordination; (cells, cells).
        penalties: r^C of each robot; (2,).
        worth: of a robot's arrival, carried to infinity.
        cost: of asking.
        discount: gamma.
        success: probability that a move succeeds.
        horizon: steps of a trial.
    """

    lead: np.ndarray
    start: int
    goals: np.ndarray
    moves: np.ndarray
    asks: np.ndarray
    meets: np.ndarray
    penalties: np.ndarray
    worth: float
    cost: float
    discount: float
    success: float
    horizon: int


REWARD, TIME, ASKS = range(3)
"""Rows of the sums of each robot."""

CONFLICTS, ARRIVED = range(2)
"""Entries of the sums of the team."""


def carry(
    pair: Pair,
    likely: np.ndarray,
    later: np.ndarray,
    here: np.ndarray,
    there: np.ndarray,
    sums: np.ndarray,
    team: np.ndarray,
) -> None:
    """Add up what a trial brings on average.

    Args:
        pair: the two robots.
        likely: space for the probabilities of the joint states, 0; (cells^2,).
        later: as `likely`.
        here: space for the joint states that are possible; (cells^2,).
        there: as `here`.
        sums: filled: `REWARD`, `TIME` and `ASKS` of each robot; (3, 2).
        team: filled: `CONFLICTS`, and the probability that all have `ARRIVED`; (2,).
    """
    cells = len(pair.lead)
    one, other = pair.goals[0], pair.goals[1]
    here[0] = pair.start
    likely[pair.start] = 1.0
    count, factor = 1, 1.0
    for _ in range(pair.horizon):
        found = 0
        for i in range(count):
            state = here[i]
            p = likely[state]
            likely[state] = 0.0
            x, z = state // cells, state % cells
            if x != one:
                sums[TIME, 0] += p
                sums[ASKS, 0] += p * pair.asks[0, x]
                sums[REWARD, 0] -= factor * p * pair.asks[0, x] * pair.cost
            if z != other:
                sums[TIME, 1] += p
                sums[ASKS, 1] += p * pair.asks[1, z]
                sums[REWARD, 1] -= factor * p * pair.asks[1, z] * pair.cost
            for a in range(PRIMITIVES + 1):
                first = p * outcome(pair, 0, x, z, a)
                if first == 0.0:
                    continue
                y = pair.lead[x, a]
                for b in range(PRIMITIVES + 1):
                    q = first * outcome(pair, 1, z, x, b)
                    if q == 0.0:
                        continue
                    w = pair.lead[z, b]
                    if pair.meets[y, w]:
                        team[CONFLICTS] += q
                        sums[REWARD, 0] += factor * q * pair.penalties[0]
                        sums[REWARD, 1] += factor * q * pair.penalties[1]
                    if y == one and x != one:
                        sums[REWARD, 0] += factor * q * pair.worth
                    if w == other and z != other:
                        sums[REWARD, 1] += factor * q * pair.worth
                    if y == one and w == other:
                        team[ARRIVED] += q
                        continue
                    target = y * cells + w
                    if later[target] == 0.0:
                        there[found] = target
                        found += 1
                    later[target] += q
        likely, later = later, likely
        here, there = there, here
        count = found
        factor *= pair.discount
        if count == 0:
            break


@inner
def outcome(pair: Pair, k: int, x: int, z: int, outcome: int) -> float:
    """Return how likely robot k's step from x, its peer in z, is one move, or that it stays."""
    arrived = x == pair.goals[k]
    if outcome != STAY:
        return 0.0 if arrived else pair.success * pair.moves[k, x, z, outcome]
    return 1.0 if arrived else 1.0 - pair.success


@functools.cache
def compiled() -> Callable[..., Any]:
    """Return `carry`, compiled by numba where it is installed (when it is first called)."""
    return jit([carry])[0] if has_numba() else carry
