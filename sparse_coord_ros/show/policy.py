# Copyright 2026 The sparse_coord_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The greedy policy in a robot's tables: its moves, its questions, the values of Q^C."""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from sparse_coord_ros.core.game.actions import PRIMITIVES
from sparse_coord_ros.core.game.grid import GridMap
from sparse_coord_ros.core.learners.rules import asks_at_times, asks_surely
from sparse_coord_ros.core.learners.tables import Tables


class Policy(NamedTuple):
    """One robot's greedy policy before any percept.

    Attributes:
        moves: whether each of the four moves is greatest in Q*, shape (cells, 4), bool: several if
            they are equal, none in the goal and if all entries are equal.
        asks: whether the robot asks in each cell, by `asks_surely`, shape (cells,), bool; False in
            the goal. After a failed percept, the robot takes one of `moves`.
        may_ask: whether it asks at least sometimes: `asks`, and ties with a move; same shape.
        learned: whether it has updated an entry of Q* there, same shape. (A robot that knows its
            map has greedy moves elsewhere, too.)
    """

    moves: np.ndarray
    asks: np.ndarray
    may_ask: np.ndarray
    learned: np.ndarray


def policy_of(tables: Tables, goal: int) -> Policy:
    """Return the greedy policy of a robot's tables; `goal` is its goal cell."""
    differ = np.nanmin(tables.q_star, axis=1) < np.nanmax(tables.q_star, axis=1)
    differ[goal] = False
    values = tables.q_star[:, :PRIMITIVES]
    moves = values == values.max(axis=1, keepdims=True)
    actions = tables.q_star.T
    return Policy(
        moves & differ[:, None],
        asks_surely(actions) & differ,
        asks_at_times(actions) & differ,
        tables.memory["updates"].max(axis=1) > 0,
    )


def entered(policy: Policy, grid: GridMap, start: int) -> np.ndarray:
    """Return the cells that a greedy robot can enter from a start cell, ascending, shape (n,).

    Where it may ask, any of its moves may follow.
    """
    follows = policy.moves | policy.may_ask[:, None]
    after = grid.next_cell
    new = np.array([start])
    reached = np.zeros(len(after), dtype=bool)
    while len(new):
        reached[new] = True
        led = np.unique(after[new][follows[new]])
        new = led[~reached[led]]
    return np.flatnonzero(reached)


def row_asking(
    tables: Tables, cell: int, perceived: Sequence[int] | None
) -> np.ndarray | None:
    """Return the row of values that chooses a move under COORDINATE, shape (4,); or None.

    Args:
        tables: the robot's tables.
        cell: its cell.
        perceived: the cells of the peers that it perceived; None: the percept failed.
    """
    if tables.learner is None:
        return None
    if perceived is None:
        return np.array(tables.values_asking(cell, 0, ()))
    if len(perceived) != tables.scenario.perceived - 1:
        return None
    return np.asarray(tables.q_coord[cell, *perceived])
