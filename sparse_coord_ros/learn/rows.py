# Copyright 2026 The sparse_coord_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The second tables of all robots as arrays: Q^C of Algorithm 1, or what a learner has instead.

A table has a row for each of its keys (such as joint states), and a column for each move. A dense
table has them all; a hashed one has those that were met, and grows.
"""

from typing import NamedTuple

import numpy as np

from sparse_coord_ros.compiling import inlined, inner
from sparse_coord_ros.game.actions import PRIMITIVES

FREE_PLACE = -1
"""In place of a key: a free place of a hashed table."""

MOST_ROWS = 2**62
"""Rows of a hashed table over the joint state: as many as memory holds."""


class Rows(NamedTuple):
    """One second table a robot.

    Attributes:
        values: entries [k, row, move], float64; a dense table's row is its key.
        updates: updates of each of them, int32.
        keys: key of each row of a hashed table, or `FREE_PLACE` [k, row]; the number of rows is a
            power of two. Dense tables have none: shape (k, 0).
        used: rows in use of a hashed table [k].
        a_step: rows that a hashed table can grow by in a time step.
        most: rows that it can have.
        first: what entries are before learning.
    """

    values: np.ndarray
    updates: np.ndarray
    keys: np.ndarray
    used: np.ndarray
    a_step: int
    most: int
    first: float

    @property
    def hashed(self) -> bool:
        """Whether only rows that were met are there."""
        return bool(self.keys.shape[1] > 0)

    def learned(self, k: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Return what robot k has updated, in ascending order of the keys; a copy.

        Returns:
            The keys, shape (rows,), int64; their entries, shape (rows, 4), float64; and the
            updates of these, same shape, int64.
        """
        rows = np.flatnonzero(updated_rows(self.updates[k]))
        keys = self.keys[k, rows] if self.hashed else rows
        order = np.argsort(keys)
        rows = rows[order]
        return keys[order], self.values[k, rows], self.updates[k, rows].astype(np.int64)

    def rows_for(self, used: int, block: int) -> int:
        """Return how many rows leave room for a block of time steps, a power of two."""
        needed = 2 * min(used + block * self.a_step, self.most)
        return 1 << (needed - 1).bit_length()

    def empty(self, rows: int) -> "Rows":
        """Return hashed tables with so many rows, all of them free."""
        return make_rows(len(self.used), rows, self.first, self.a_step, self.most, hashed=True)

    def put(self, k: int, keys: np.ndarray, values: np.ndarray, updates: np.ndarray) -> None:
        """Set robot k's rows; a hashed table's in any order: `rehash` finds their places."""
        rows = np.arange(len(keys)) if self.hashed else keys
        self.values[k, rows] = values
        self.updates[k, rows] = updates
        if self.hashed:
            self.keys[k, rows] = keys
            self.used[k] = len(keys)


def make_rows(
    team: int, rows: int, first: float, a_step: int = 0, most: int = 0, *, hashed: bool = False
) -> Rows:
    """Return second tables before learning; arguments as of `Rows`."""
    values = np.zeros((team, rows, PRIMITIVES))  # no memory until it is written to
    if first != 0.0:
        values[:] = first
    return Rows(
        values,
        np.zeros(values.shape, dtype=np.int32),
        np.full((team, rows if hashed else 0), FREE_PLACE, dtype=np.int64),
        np.zeros(team, dtype=np.int64),
        a_step,
        most,
        first,
    )


def updated_rows(counts: np.ndarray) -> np.ndarray:
    """Return which rows have a count that is not 0, shape of `counts` but for the last axis."""
    updated: np.ndarray = counts[..., 0] != 0
    for move in range(1, PRIMITIVES):
        updated |= counts[..., move] != 0
    return updated


@inner
def find_row(keys: np.ndarray, key: int) -> int:
    """Return the row of a joint state in a sparse table, or the free place that it would take.

    Open addressing with linear probing; the table must have a free place.
    """
    mask = len(keys) - 1
    row = (key ^ key >> 7 ^ key >> 17) & mask
    while keys[row] != FREE_PLACE and keys[row] != key:
        row = (row + 1) & mask
    return row


@inlined
def row_to_learn(rows: Rows, k: int, key: int) -> int:
    """Return the row of a key in robot k's table, a new one if there is none."""
    if rows.keys.shape[1] == 0:
        return key
    row = find_row(rows.keys[k], key)
    if rows.keys[k, row] == FREE_PLACE:
        rows.keys[k, row] = key
        rows.used[k] += 1
    return row


@inner
def has_room(rows: Rows, block: int) -> bool:
    """Whether hashed tables stay half empty whatever a block of so many time steps brings."""
    places = rows.keys.shape[1]
    if places > 0:
        for used in rows.used:
            if 2 * min(used + block * rows.a_step, rows.most) > places:
                return False
    return True


def rehash(old: Rows, new: Rows) -> None:
    """Copy hashed tables into larger ones, which have no rows yet."""
    for k in range(len(old.keys)):
        for row in range(old.keys.shape[1]):
            key = old.keys[k, row]
            if key != FREE_PLACE:
                place = find_row(new.keys[k], key)
                new.keys[k, place] = key
                for move in range(PRIMITIVES):  # an array assignment would make an array
                    new.values[k, place, move] = old.values[k, row, move]
                    new.updates[k, place, move] = old.updates[k, row, move]
        new.used[k] = old.used[k]
