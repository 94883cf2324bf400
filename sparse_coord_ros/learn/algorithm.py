# Copyright 2026 The sparse_coord_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Algorithm 1 of Melo & Veloso (AAMAS 2009): its choices and its update, once for every user.

Plain functions over NumPy arrays: the robot node, the simulation without ROS and whatever checks
them call these same objects. Q* has a column for each action, Q^C one for each move; for the
baselines, which know no COORDINATE, Q* uses the columns of the moves only.
"""

from collections.abc import Sequence
from typing import Any, TypeAlias

import numpy as np

from sparse_coord_ros.compiling import inner
from sparse_coord_ros.game.actions import COORDINATE, PRIMITIVES

Values: TypeAlias = Sequence[float] | np.ndarray
"""One row of a table: the values of the actions, in their order."""


@inner
def greedy(values: Values, count: int, tie: float) -> int:
    """Return the greedy action pi_g: uniform among the exact maxima of the first `count` values.

    Args:
        values: one row of a table.
        count: how many actions compete.
        tie: draw in [0, 1) that decides between ties.
    """
    best = values[0]
    ties = 1
    for action in range(1, count):
        value = values[action]
        if value > best:
            best = value
            ties = 1
        elif value == best:
            ties += 1
    chosen = int(tie * ties)
    for action in range(count):
        if values[action] == best:
            if chosen == 0:
                return action
            chosen -= 1
    return 0


@inner
def greatest(values: Values, count: int) -> float:
    """Return the maximum of the first `count` values: max_b Q'(y, b) of QLUpdate."""
    best: float = values[0]
    for action in range(1, count):
        if values[action] > best:
            best = values[action]
    return best


@inner
def asks_surely(values: Any) -> Any:
    """Return whether a greedy robot asks here, whatever it draws: what "asks here" means.

    That is where COORDINATE is worth more than every move. Where it is worth as much as the best
    move, pi_g breaks the tie by a draw: the robot asks there at times, and is not said to ask. One
    that knows no COORDINATE (NaN) never asks.

    Args:
        values: a row of Q*; or Q* transposed, shape (5, cells).

    Returns:
        A bool; or bools of shape (cells,).
    """
    asks = values[COORDINATE] > values[0]
    for move in range(1, PRIMITIVES):
        asks = asks & (values[COORDINATE] > values[move])
    return asks


@inner
def asks_at_times(values: Any) -> Any:
    """Return whether a greedy robot may ask here: COORDINATE is worth as much as any move.

    Arguments and what is returned as of `asks_surely`.
    """
    asks = values[COORDINATE] >= values[0]
    for move in range(1, PRIMITIVES):
        asks = asks & (values[COORDINATE] >= values[move])
    return asks


@inner
def step_size(by_count: float, by_step: float) -> float:
    """Return alpha: what the entry's own count asks for, but never less than the step's floor."""
    if by_count > by_step:
        return by_count
    return by_step


@inner
def weighed(parts: Values, weights: Values) -> float:
    """Return what an agent learns from as R_k(t): the weighted sum of its parts.

    With every weight 1 it is R_k(t) itself, bit for bit.

    Args:
        parts: r^I_k, r^C and minus the cost of asking, or 0; whatever follows does not count.
        weights: of these three.
    """
    return weights[0] * parts[0] + weights[1] * parts[1] + weights[2] * parts[2]


@inner
def updated(value: float, alpha: float, reward: float, discount: float, bootstrap: float) -> float:
    """Return the new table entry of QLUpdate (paper, Section 3.2; equation 3).

    Q(x, a) = (1 - alpha) Q(x, a) + alpha (r + gamma max_b Q'(y, b))

    Args:
        value: Q(x, a).
        alpha: the step size.
        reward: r.
        discount: gamma.
        bootstrap: max_b Q'(y, b), or the goal's value where y is the goal.
    """
    return (1.0 - alpha) * value + alpha * (reward + discount * bootstrap)
