# Copyright 2026 The sparse_coord_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Algorithm 1 once more for one robot, fed with what its log says, as one loop.

The loop takes nested lists in plain Python and arrays where numba compiled it: the same bits. The
choices and the update are the functions of `core.algorithm`.
"""

import functools
from collections.abc import Callable
from typing import Any, NamedTuple

import numpy as np

from sparse_coord_ros.core import algorithm
from sparse_coord_ros.core.algorithm import (
    COORDINATE,
    PRIMITIVES,
    epsilon_greedy,
    greatest,
    greedy,
    step_size,
    updated,
    weighed,
)
from sparse_coord_ros.engine.compiled import has_numba

COMPILING_PAYS = 1_000_000
"""Actions from which on compiling the loop, a few seconds, takes less time than it saves."""


class Rule(NamedTuple):
    """What holds at every step.

    Attributes:
        actions: 5 with COORDINATE, 4 without.
        learning: whether anything is learned.
        goal: the cell that ends the robot's episodes.
        discount: gamma.
        goal_value: value of being at the goal while learning.
        weights: how much each part of a reward counts.
    """

    actions: int
    learning: bool
    goal: int
    discount: float
    goal_value: float
    weights: tuple[float, float, float]


class Learned(NamedTuple):
    """What one robot has learned so far.

    Attributes:
        q_star: Q* [x][action].
        q_coord: the rows of Q^C that the log speaks of [row][move].
        star_updates, coord_updates: how often each entry was updated.
        shows: 1 where the robot would choose COORDINATE, else 0 [x].
    """

    q_star: Any
    q_coord: Any
    star_updates: Any
    coord_updates: Any
    shows: Any


class Said(NamedTuple):
    """What the log says of the robot's actions; index i is an action.

    Attributes:
        cell: where it was; next_cell: where it was one step later.
        action: A_k(t), 0 to 4; move: the primitive action that it became.
        row: the row of Q^C that it perceived, or -1.
        learned: whether it has learned from the action.
        reward: individual, common, cost of asking [i][3].
        draws: the draws of the policy at the time step [i][5].
        epsilon: probability of exploring.
        alpha: least step size.
    """

    cell: Any
    next_cell: Any
    action: Any
    move: Any
    row: Any
    learned: Any
    reward: Any
    draws: Any
    epsilon: Any
    alpha: Any


def coordinates(values: Any, actions: int) -> int:
    """Return 1 where COORDINATE is the first greatest of a row's values, else 0."""
    if actions > COORDINATE and values[COORDINATE] > greatest(values, PRIMITIVES):
        return 1
    return 0


def follow(
    rule: Rule, learned: Learned, said: Said, by_count: Any, begin: int, end: int
) -> tuple[int, int, int]:
    """Choose and learn again from action `begin` on, before `end`.

    Returns:
        The first action that is another one than the log says, or `end`; what it chooses there,
        and the primitive action that comes of it.
    """
    q_star, q_coord = learned.q_star, learned.q_coord
    star_updates, coord_updates = learned.star_updates, learned.coord_updates
    last = len(by_count) - 1
    for i in range(begin, end):
        x = said.cell[i]
        values = q_star[x]
        draws = said.draws[i]
        action = epsilon_greedy(
            values, rule.actions, said.epsilon[i], draws[0], draws[1], draws[2]
        )
        row = said.row[i]
        move = action
        if action == COORDINATE:
            if row < 0:
                move = greedy(values, PRIMITIVES, draws[3])
            else:
                move = greedy(q_coord[row], PRIMITIVES, draws[3])
        if action != said.action[i] or move != said.move[i]:
            return i, action, move
        if not said.learned[i] or not rule.learning:
            continue
        parts = said.reward[i]
        reward = weighed(parts[0], parts[1], parts[2], rule.weights)
        y = said.next_cell[i]
        if y == rule.goal:
            bootstrap = rule.goal_value
        else:
            bootstrap = greatest(q_star[y], rule.actions)
        if row >= 0:
            count = coord_updates[row][move] + 1
            coord_updates[row][move] = count
            alpha = step_size(by_count[min(count, last)], said.alpha[i])
            value = q_coord[row][move]
            q_coord[row][move] = updated(value, alpha, reward, rule.discount, bootstrap)
        count = star_updates[x][action] + 1
        star_updates[x][action] = count
        alpha = step_size(by_count[min(count, last)], said.alpha[i])
        values[action] = updated(values[action], alpha, reward, rule.discount, bootstrap)
        learned.shows[x] = coordinates(values, rule.actions)
    return end, 0, 0


def loop(count: int, *, compiled: bool | None = None) -> tuple[Callable[..., Any], bool]:
    """Return the loop for so many actions, and whether it is compiled and takes arrays.

    Args:
        count: how many actions there are to follow.
        compiled: whether to compile it; None: where numba is installed and it pays.
    """
    wanted = count >= COMPILING_PAYS and has_numba() if compiled is None else compiled
    return (_compiled(), True) if wanted else (follow, False)


@functools.cache
def _compiled() -> Callable[..., Any]:
    import numba

    choosing = (algorithm.greedy, algorithm.epsilon_greedy, algorithm.greatest, coordinates)
    for function in (*choosing, algorithm.step_size, algorithm.updated, algorithm.weighed):
        numba.extending.register_jitable(function)
    return numba.njit(nogil=True)(follow)


def as_lists(values: Any) -> Any:
    """Return a tuple of arrays as one of nested lists, for plain Python."""
    return type(values)(*(one.tolist() if isinstance(one, np.ndarray) else one for one in values))
