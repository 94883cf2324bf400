# Copyright 2026 The sparse_coord_ros authors
# SPDX-License-Identifier: Apache-2.0
"""What a robot's tables say it does: its greedy moves, where it asks, what Q^C holds."""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from sparse_coord_ros.game.actions import PRIMITIVES
from sparse_coord_ros.game.grid import GridMap
from sparse_coord_ros.learn.agent import Tables
from sparse_coord_ros.learn.algorithm import asks_at_times, asks_surely
from sparse_coord_ros.learn.factors import UNSEEN
from sparse_coord_ros.learn.sparse import SparseTable


class Policy(NamedTuple):
    """One robot's greedy policy before any percept.

    Attributes:
        moves: which of the four moves are greatest in Q*, shape (cells, 4), bool: several where
            they are equal, none in the goal and where nothing was learned (all entries equal).
        asks: where the robot asks, as `asks_surely` says, shape (cells,), bool; not in the goal.
            Where a percept fails, the robot takes one of `moves`.
        may_ask: where it asks at least at times: `asks`, and ties with a move; same shape.
    """

    moves: np.ndarray
    asks: np.ndarray
    may_ask: np.ndarray


def policy_of(tables: Tables, goal: int) -> Policy:
    """Return the greedy policy of a robot's tables; `goal` is its goal cell."""
    learned = np.nanmin(tables.q_star, axis=1) < np.nanmax(tables.q_star, axis=1)
    learned[goal] = False
    values = tables.q_star[:, :PRIMITIVES]
    moves = values == values.max(axis=1, keepdims=True)
    actions = tables.q_star.T
    return Policy(
        moves & learned[:, None], asks_surely(actions) & learned, asks_at_times(actions) & learned
    )


def entered(policy: Policy, grid: GridMap, start: int) -> np.ndarray:
    """Return the cells that a greedy robot can enter from a start cell, ascending, shape (n,).

    Where it asks, if only at times, any of its moves may follow.
    """
    follows, after = policy.moves | policy.may_ask[:, None], grid.next_cell
    new, reached = np.array([start]), np.zeros(len(after), dtype=bool)
    while len(new):
        reached[new] = True
        led = np.unique(after[new][follows[new]])
        new = led[~reached[led]]
    return np.flatnonzero(reached)


def row_asking(tables: Tables, cell: int, perceived: Sequence[int] | None) -> np.ndarray | None:
    """Return the row by which COORDINATE chooses a move: shape (4,), or None: there is none.

    Args:
        tables: of the robot.
        cell: where it is.
        perceived: the cells of the peers that it perceived; None: the percept failed.
    """
    cells, factors = len(tables.q_star), tables.factors
    if perceived is not None:
        fits = tables.q_coord.shape == (*(cells,) * (1 + len(perceived)), PRIMITIVES)
        return np.asarray(tables.q_coord[cell, *perceived]) if fits else None
    if factors is None:
        return tables.q_star[cell, :PRIMITIVES]
    failed = (factors.states == (cell, UNSEEN, UNSEEN)).all(axis=1)
    row: np.ndarray = factors.individual[cell] + factors.corrections[failed].sum(axis=0)
    return row


class Sparsity(NamedTuple):
    """How much of one robot's Q^C was ever learned.

    Attributes:
        by_cell: joint states with a learned entry, by the own cell, shape (cells,), int64. Of a
            learner that learns in factors: rows of corrections, each of four moves.
        possible: how many there could be in each cell.
    """

    by_cell: np.ndarray
    possible: int

    @property
    def share(self) -> float:
        """Share of the joint states, or of the rows of corrections."""
        return float(self.by_cell.sum()) / (self.possible * len(self.by_cell))


def sparsity_of(tables: Tables, begun: Tables) -> Sparsity:
    """Return how much of a robot's Q^C was learned: entries that are not what they began with."""
    cells, table = len(tables.q_star), tables.q_coord
    if tables.factors is not None:
        states = tables.factors.states
        peers = len(table.shape) - 2
        return Sparsity(np.bincount(states[:, 0], minlength=cells), peers * cells + 1)
    possible = cells ** (len(table.shape) - 2)
    if isinstance(table, SparseTable):
        learned = (table.rows != table.unseen).any(axis=1)
        return Sparsity(np.bincount(table.keys[learned, 0], minlength=cells), possible)
    learned = (np.asarray(table) != begun.q_coord).any(axis=-1)
    return Sparsity(learned.reshape(cells, -1).sum(axis=1), possible)
