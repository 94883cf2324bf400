# Copyright 2026 The sparse_coord_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The floor for driving bodies: cells and walls in metres."""

import math
from functools import cached_property

import numpy as np

from sparse_coord_ros.base.errors import SettingError
from sparse_coord_ros.core.game.actions import PRIMITIVES
from sparse_coord_ros.core.game.grid import CLEAR, WALL
from sparse_coord_ros.core.game.pose import Pose
from sparse_coord_ros.core.runs.run_config import RunConfig

RADIUS_SHARE = 0.15
"""Default radius of a body, as a share of a cell."""

LANE = 0.27
"""Distance of a lane from the middle of its cell, in cells, if walls leave space for it."""

QUADRANTS = ((1.0, 1.0), (-1.0, -1.0), (-1.0, 1.0), (1.0, -1.0))
"""Places of robots 1 to 4 in a shared cell: signs of x, y."""


class MetricMap:
    """A run's map in metres.

    Free cells other than doorways may contain several robots; the grid does not give their places
    in the cell. Each robot has a place of its own there, a lane off the middle, so that up to four
    robots fit side by side and pass each other. Beside a wall, also one of the next cell along the
    lane, the place is further from the wall, as far as the cell allows. In a doorway the place is
    the middle.

    Args:
        run: the run.
        radius: of a body, in metres; 0: the map's, or `RADIUS_SHARE` of a cell.

    Attributes:
        grid: the map.
        side: metres a cell.
        radius: of a body.
        room: metres beside a body in the middle of a cell; less than `CLEAR` cells are too few.

    Raises:
        SettingError: the body does not fit a cell.
    """

    def __init__(self, run: RunConfig, radius: float = 0.0) -> None:
        self.grid = run.scenario.map
        self.side = run.resolution
        self.radius = radius or self.grid.radius or RADIUS_SHARE * self.side
        if not self.radius < self.side / 2:
            raise SettingError(
                f"setting radius: value is {radius:g}, allowed: less than half a cell "
                f"({self.side / 2:g} m), as doorways are one cell wide; choose a smaller radius, "
                "or larger cells"
            )
        self.room = self.side / 2 - self.radius

    def place(self, robot: int, cell: int) -> tuple[float, float]:
        """Return (x, y) of a robot's place in a free cell, in metres."""
        x, y = self.grid.squares.centre(*self.grid.cells[cell])
        if cell in self.grid.doorways:
            return x, y
        east, north = QUADRANTS[robot % len(QUADRANTS)]
        lane = LANE * self.side
        (west_most, east_most, south_most, north_most) = self._lanes[cell]
        ahead = min(max(east * lane, west_most), east_most)
        left = min(max(north * lane, south_most), north_most)
        return Pose(x, y, self.grid.origin.yaw).absolute(ahead, left)

    @cached_property
    def _lanes(self) -> list[list[float]]:
        """Largest distance of a body from the middle of each cell: west, east, south, north."""
        lead = self.grid.next_cell
        clear = self.room - CLEAR * self.side
        lane = LANE * self.side
        itself = np.arange(len(lead))
        north, south, east, west = (lead[:, move] for move in range(PRIMITIVES))
        bounds = []
        for low, high, along in (
            (west, east, (north, south)),
            (south, north, (east, west)),
        ):
            walls = [side == itself for side in (low, high)]
            walls = [wall | wall[along[0]] | wall[along[1]] for wall in walls]
            # Between two walls that are too near, the place is the middle.
            most = np.where(walls[0] & walls[1], max(clear, 0.0), clear)
            least = np.where(walls[0], -most, -lane), np.where(walls[1], most, lane)
            bounds += [np.maximum(least[0], -lane), np.minimum(least[1], lane)]
        return np.column_stack(bounds).tolist()

    def cell(self, x: float, y: float) -> int | None:
        """Return the free cell at a place; off the grid the nearest one, if within a cell's side.

        None: no such cell.
        """
        cell = self.grid.cell_at(x, y)
        if cell is not None or not (math.isfinite(x) and math.isfinite(y)):
            return cell
        far = np.hypot(self._centres[:, 0] - x, self._centres[:, 1] - y)
        near = int(far.argmin())
        return near if far[near] <= self.side else None

    def inside(self, cell: int, x: float, y: float) -> bool:
        """Return whether a place lies in the square of a free cell."""
        return self.grid.cell_at(x, y) == cell

    def blocked(self, x: float, y: float) -> bool:
        """Return whether a body there would touch a wall, or the space outside the map."""
        rows, columns = self.grid.shape
        side = self.side
        radius = self.radius
        east, north = self.grid.origin.relative(x, y)
        first = math.floor((east - radius) / side)
        last = math.floor((east + radius) / side)
        below = math.floor((north - radius) / side)
        above = math.floor((north + radius) / side)
        for column in range(first, last + 1):
            for level in range(below, above + 1):
                row = rows - 1 - level
                inside = 0 <= row < rows and 0 <= column < columns
                if inside and self.grid.rows[row][column] != WALL:
                    continue
                dx = max(column * side - east, 0.0, east - (column + 1) * side)
                dy = max(level * side - north, 0.0, north - (level + 1) * side)
                if dx * dx + dy * dy < radius * radius:
                    return True
        return False

    def slide(self, here: Pose, x: float, y: float) -> tuple[float, float]:
        """Return where a body gets that drives to (x, y): a wall lets it slide along its side."""
        axes = Pose(here.x, here.y, self.grid.origin.yaw)
        ahead, left = axes.relative(x, y)
        for place in (
            (x, y),
            axes.absolute(ahead, 0.0),
            axes.absolute(0.0, left),
        ):
            if not self.blocked(*place):
                return place
        return here.x, here.y

    def in_doorway(self, x: float, y: float) -> bool:
        """Return whether a place lies in a doorway."""
        return self.grid.cell_at(x, y) in self.grid.doorways

    @cached_property
    def _centres(self) -> np.ndarray:
        return np.column_stack(self.grid.squares.centre(*self.grid.places.T))
