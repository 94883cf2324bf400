# Copyright 2026 The sparse_coord_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The data of a run's occupancy grids, as they are published and must be in a log."""

import numpy as np

from sparse_coord_ros.core.learners.rules import asks_surely
from sparse_coord_ros.protocol.wire.frame import Frame

UNKNOWN = -1
EMPTY = 0
OCCUPIED = 100


class OccupancyData:
    """The data of the run's occupancy grids, as bytes: southmost row first.

    Args:
        frame: the run's frame.

    Attributes:
        map: walls occupied, all else empty.
        places: index of each free cell in the data, shape (cells,).
    """

    def __init__(self, frame: Frame) -> None:
        rows, columns = frame.grid.shape
        walls = [[OCCUPIED * (sign == "#") for sign in row] for row in frame.grid.rows]
        self.map = np.flipud(np.array(walls, dtype=np.int8)).tobytes()
        self._grid = np.full(rows * columns, UNKNOWN, dtype=np.int8)
        self.places = np.array(
            [(rows - 1 - r) * columns + c for r, c in frame.grid.cells]
        )

    def coordination(self, q_star: np.ndarray) -> bytes:
        """Return the cells where a greedy robot with this Q* asks, by `asks_surely`."""
        asks = asks_surely(q_star.T)
        self._grid[self.places] = np.where(asks, OCCUPIED, EMPTY)
        return self._grid.tobytes()
