# Copyright 2026 The sparse_coord_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Corridors of a grid that are one cell wide, in which two robots cannot pass each other.

`together` counts robots that end a step in one doorway. In a corridor two robots also face each
other, and would have to exchange their cells. `swap+block` covers this, if the corridor's cells
are doorways.
"""

import numpy as np
from scipy import ndimage

IN_CORRIDORS = "swap+block"
"""The interactions for a map with such a corridor, whose cells then are doorways."""

IN_DOORWAYS = "together"
"""The interactions for a map without one."""

SHORTEST_CORRIDOR = 2
"""Cells: in one cell robots are together, in two they also face each other."""


def narrow_corridors(free: np.ndarray) -> np.ndarray:
    """Return the corridors that are one cell wide, numbered from 1, and 0 elsewhere.

    A cell is narrow if no square of two by two free cells covers it: so bends and forks are narrow
    too. Dead ends do not count, as no robot goes through them. A corridor has two narrow cells or
    more, one beside the other.

    Args:
        free: the grid's free cells, shape (rows, columns), bool; as the numbers returned, int64.
    """
    through = _without_dead_ends(free, free & ~_covered_by_squares(free))
    labels, count = ndimage.label(through)
    sizes = np.bincount(labels.ravel(), minlength=count + 1)
    long = sizes >= SHORTEST_CORRIDOR
    long[0] = False
    numbers = np.where(long, long.cumsum(), 0)
    return np.asarray(numbers[labels], dtype=np.int64)


def _covered_by_squares(free: np.ndarray) -> np.ndarray:
    """Return the cells that some square of two by two free cells covers."""
    squares = free[:-1, :-1] & free[1:, :-1] & free[:-1, 1:] & free[1:, 1:]
    padded = np.pad(squares, 1)
    return padded[:-1, :-1] | padded[1:, :-1] | padded[:-1, 1:] | padded[1:, 1:]


def _without_dead_ends(free: np.ndarray, narrow: np.ndarray) -> np.ndarray:
    """Return the narrow cells without dead ends."""
    open_cells = free.copy()
    while True:
        padded = np.pad(open_cells, 1).astype(np.int8)
        neighbours = (
            padded[:-2, 1:-1] + padded[2:, 1:-1] + padded[1:-1, :-2] + padded[1:-1, 2:]
        )
        ends = open_cells & narrow & (neighbours <= 1)
        if not ends.any():
            return narrow & open_cells
        open_cells &= ~ends
