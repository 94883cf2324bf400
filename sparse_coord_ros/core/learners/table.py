# Copyright 2026 The sparse_coord_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Tables with a row for each key that was met, such as Q^C with its joint states.

A table grows with what its robot visits, not with the number of joint states. Rows stand in the
order in which they were met. An index finds the row of a key: hashing with open addressing and
linear probing (Knuth, The Art of Computer Programming, vol. 3, Section 6.4, Algorithm L).
"""

from typing import Any, NamedTuple

import numpy as np

from sparse_coord_ros.base.compiling import jitable
from sparse_coord_ros.core.game.actions import PRIMITIVES

FIRST_ROWS = 256
"""Rows for which a table has room at first; it doubles when they are used up."""


KEY, ROW = range(2)
"""Entries of a place in an index."""


class Table(NamedTuple):
    """The tables of a team; k is a robot.

    Attributes:
        values: the entries [k, row, column], float64; of most tables a column is a move.
        updates: how often each of them was updated [k, row, column], int64; a learner may count
            in other columns.
        used: rows in use [k], int64.
        index: the keys and their rows: KEY and ROW; row 0: the place is free [k, place, 2], int64.
            The number of places is a power of two, at least twice the number of rows.
        span: the first rows are what rows begin with: row `key // span` is that of a key.
        most: number of possible keys, which are from 0 to `most` - 1.
        a_step: the most rows that a robot adds in a time step.
    """

    values: Any
    updates: Any
    used: Any
    index: Any
    span: int
    most: int
    a_step: int


def table(
    most: int, first: np.ndarray, a_step: int = 1, counts: int = PRIMITIVES
) -> Table:
    """Return the table of one robot before learning: its arrays have no axis [k].

    Args:
        most: number of possible keys.
        first: what rows begin with, shape (n, columns): the first `most / n` keys begin with its
            first row, the next ones with the second, and so on.
        a_step: the most rows that a time step adds.
        counts: columns of `updates`.
    """
    rows = len(first) + a_step + FIRST_ROWS
    values = np.zeros((rows, first.shape[1]))
    values[: len(first)] = first
    return Table(
        values=values,
        updates=np.zeros((rows, counts), dtype=np.int64),
        used=np.array(len(first)),
        index=np.zeros((places_for(rows), 2), dtype=np.int64),
        span=most // len(first),
        most=most,
        a_step=a_step,
    )


def places_for(rows: int) -> int:
    """Return the number of places of an index: a power of two, at least twice the rows."""
    return 1 << (2 * rows - 1).bit_length()


@jitable
def hashed(key: Any) -> Any:
    """Return the hash of a key, or of an array of keys."""
    return key ^ key >> 7 ^ key >> 17


@jitable
def place_of(rows: Table, k: int, key: int) -> int:
    """Return the place of a key in robot k's index, or the free place where it belongs."""
    index = rows.index
    mask = index.shape[1] - 1
    place = hashed(key) & mask
    while index[k, place, ROW] != 0 and index[k, place, KEY] != key:
        place = (place + 1) & mask
    return place


@jitable
def find(rows: Table, k: int, key: int) -> int:
    """Return the row of a key; if it was not met, the row with which it would begin.

    Args:
        rows: the tables of a team.
        k: the robot.
        key: the key, such as the number of a joint state.
    """
    row = rows.index[k, place_of(rows, k, key), ROW]
    return row if row != 0 else key // rows.span


@jitable
def met(rows: Table, task: Any, k: int, key: int) -> int:
    """Return the row of a key, a new one if it was not met.

    If there may be no room for the rows of another time step, it sets `task.full`; the caller of
    the loop then gives room.

    Args:
        rows: the tables of a team, changed.
        task: the task.
        k: the robot.
        key: as for `find`.
    """
    place = place_of(rows, k, key)
    row = rows.index[k, place, ROW]
    if row != 0:
        return row
    row = rows.used[k]
    begun = key // rows.span
    for column in range(rows.values.shape[2]):
        rows.values[k, row, column] = rows.values[k, begun, column]
    rows.index[k, place, KEY] = key
    rows.index[k, place, ROW] = row
    rows.used[k] = row + 1
    if row + 1 + rows.a_step >= rows.values.shape[1]:
        task.full[0] = True
    return row


def grown(rows: Table, needed: int) -> Table:
    """Return a table with room for so many rows of each robot: with copies of the rows."""
    team, before, columns = rows.values.shape
    counts = rows.updates.shape[2]
    larger = Table(
        values=np.zeros((team, needed, columns)),
        updates=np.zeros((team, needed, counts), dtype=np.int64),
        used=rows.used,
        index=np.zeros((team, places_for(needed), 2), dtype=np.int64),
        span=rows.span,
        most=rows.most,
        a_step=rows.a_step,
    )
    for k in range(team):
        used = min(int(rows.used[k]), before)
        larger.values[k, :used] = rows.values[k, :used]
        larger.updates[k, :used] = rows.updates[k, :used]
        _enter(larger, k, *_entries(rows, k))
    return larger


def _entries(rows: Table, k: int) -> tuple[np.ndarray, np.ndarray]:
    """Return the keys that robot k met, and their rows."""
    index = rows.index[k]
    met_places = index[index[:, ROW] != 0]
    return met_places[:, KEY], met_places[:, ROW]


def _enter(rows: Table, k: int, keys: np.ndarray, entered: np.ndarray) -> None:
    """Enter keys and their rows into the index of robot k, which does not have them yet.

    All rows go on at once until each has found a free place; of several that meet there one stays.
    """
    index = rows.index[k]
    mask = len(index) - 1
    places = hashed(keys) & mask
    while len(entered):
        free = index[places, ROW] == 0
        index[places[free], ROW] = entered[free]
        left = index[places, ROW] != entered
        index[places[~left], KEY] = keys[~left]
        keys = keys[left]
        entered = entered[left]
        places = (places[left] + 1) & mask


class LearnedRows(NamedTuple):
    """The rows of one robot's table that were met, in the order of their keys; a copy.

    Attributes:
        keys: shape (rows,), int64.
        values: shape (rows, columns), float64.
        updates: the counts, shape (rows, columns), int64.
    """

    keys: np.ndarray
    values: np.ndarray
    updates: np.ndarray


def learned_rows(rows: Table, k: int) -> LearnedRows:
    """Return the rows of robot k."""
    keys, met_rows = _entries(rows, k)
    order = np.argsort(keys)
    chosen = met_rows[order]
    return LearnedRows(keys[order], rows.values[k, chosen], rows.updates[k, chosen])


def with_rows(rows: Table, k: int, learned: LearnedRows) -> Table:
    """Return a table with these rows of robot k, which has none yet; a copy where it must grow."""
    first = rows.most // rows.span
    used = first + len(learned.keys)
    if used + rows.a_step >= rows.values.shape[1]:
        rows = grown(rows, 2 * used + rows.a_step)
    rows.values[k, first:used] = learned.values
    rows.updates[k, first:used] = learned.updates
    rows.used[k] = used
    _enter(rows, k, learned.keys, np.arange(first, used))
    return rows
