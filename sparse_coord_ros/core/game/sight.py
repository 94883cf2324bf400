# Copyright 2026 The sparse_coord_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Probability that a robot in one cell perceives a robot in another, computed on demand.

Memory grows with the map, not with its pairs of cells. Only a user's own model is a table of all
pairs. The functions run in plain Python and in compiled loops.
"""

from typing import Any, NamedTuple

import numpy as np

from sparse_coord_ros.base.compiling import jitable, viewed
from sparse_coord_ros.core.game.grid import GridMap

CONSTANT, RANGE, LINE_OF_SIGHT, TABLE = range(4)
"""Kinds of `Sight`."""


class Sight(NamedTuple):
    """A perception model on a map; x is the cell of the robot that asks, z its peer's.

    Attributes:
        kind: CONSTANT, RANGE, LINE_OF_SIGHT or TABLE.
        constant: of CONSTANT the probability.
        reach: of RANGE the greatest squared distance, in cells.
        places: of RANGE and LINE_OF_SIGHT the row and the column of each cell [x, 2].
        free: of LINE_OF_SIGHT whether a square of the grid is no wall [row, column].
        table: of TABLE the probabilities [x, z].
    """

    kind: int
    constant: float
    reach: int
    places: Any
    free: Any
    table: Any


BLIND = Sight(
    kind=CONSTANT,
    constant=0.0,
    reach=0,
    places=np.zeros((0, 2), dtype=np.int64),
    free=np.zeros((0, 0), dtype=np.bool_),
    table=np.zeros((0, 0)),
)
"""That of percepts that never succeed."""


# Models.


def constant(grid: GridMap, probability: float) -> Sight:
    """Return the model of a probability that is the same everywhere."""
    return _on(grid, CONSTANT, constant=float(probability))


def within(grid: GridMap, distance: float) -> Sight:
    """Return the model that succeeds up to a distance in cells, between the cells' centres."""
    reach = 0
    longest = np.hypot(*grid.shape)
    if distance >= longest:
        reach = sum(side**2 for side in grid.shape)
    else:
        # The greatest whole number whose square root is not above the distance.
        reach = int(distance**2) + 1
        while reach and np.sqrt(reach) > distance:
            reach -= 1
    return _on(grid, RANGE, reach=reach, places=grid.places)


def line_of_sight(grid: GridMap) -> Sight:
    """Return the model that succeeds where no wall is between the cells' centres."""
    return _on(grid, LINE_OF_SIGHT, places=grid.places, free=grid.free)


def tabled(grid: GridMap, table: np.ndarray) -> Sight:
    """Return the model of a table, shape (cells, cells), float64."""
    return _on(grid, TABLE, table=table)


def _on(grid: GridMap, kind: int, **more: Any) -> Sight:
    return BLIND._replace(kind=kind, **more)


# Pairs of cells.


@jitable
def probability(sight: Sight, x: int, z: int) -> float:
    """Return the probability that a percept succeeds."""
    if sight.kind == CONSTANT:
        return sight.constant
    if sight.kind == TABLE:
        in_table: float = sight.table[x, z]
        return in_table
    row = sight.places[x, 0]
    column = sight.places[x, 1]
    rows = sight.places[z, 0] - row
    columns = sight.places[z, 1] - column
    if sight.kind == RANGE:
        seen = rows * rows + columns * columns <= sight.reach
    else:
        seen = is_in_sight(sight.free, row, column, rows, columns)
    return 1.0 if seen else 0.0


@jitable
def is_in_sight(free: Any, row: int, column: int, rows: int, columns: int) -> bool:
    """Return whether the straight line between two squares' centres crosses no wall.

    It walks in exact integer steps through every square whose inside the line crosses. A line
    through a corner point of four squares passes if one of the two squares beside the corner is
    free.

    Args:
        free: whether a square is no wall [row, column].
        row: of the first square.
        column: likewise.
        rows: how far down the second square is.
        columns: how far to the right.
    """
    to_row = row + rows
    to_column = column + columns
    down = 1 if rows > 0 else -1
    right = 1 if columns > 0 else -1
    rows = abs(rows)
    columns = abs(columns)
    # Twice the (signed) distance to the next row border against that to the next column border.
    error = columns - rows
    while row != to_row or column != to_column:
        if error == 0:
            if not (free[row + down, column] or free[row, column + right]):
                return False
            row += down
            column += right
            error += 2 * (columns - rows)
        elif error > 0:
            column += right
            error -= 2 * rows
        else:
            row += down
            error += 2 * columns
        if not free[row, column]:
            return False
    return True


# All pairs.


def probabilities_between(sight: Sight, cells: np.ndarray) -> np.ndarray:
    """Return the probabilities between some cells, shape (n, n), float64: the asker's first.

    Args:
        sight: the model.
        cells: numbers of cells, shape (n,).
    """
    n = len(cells)
    if sight.kind == CONSTANT:
        return np.full((n, n), sight.constant)
    if sight.kind == TABLE:
        probabilities: np.ndarray = sight.table[np.ix_(cells, cells)]
        return probabilities
    if sight.kind == RANGE:
        rows, columns = sight.places[cells].T
        apart = (rows[:, None] - rows) ** 2 + (columns[:, None] - columns) ** 2
        return np.asarray(apart <= sight.reach, dtype=np.float64)
    probabilities = np.eye(n)
    views = viewed(sight)
    numbers = cells.tolist()
    for i, x in enumerate(numbers):
        for j, z in enumerate(numbers[:i]):
            seen = probability(views, x, z)
            probabilities[i, j] = probabilities[j, i] = seen
    return probabilities
