# Copyright 2026 The sparse_coord_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Conversion of time steps and cells to the seconds and metres of messages, and back.

The nodes and the readers of their log share this object, so that both convert equally.
"""

from math import isfinite

from sparse_coord_ros.core.game.actions import DIRECTIONS
from sparse_coord_ros.core.game.grid import GridMap
from sparse_coord_ros.core.runs.run_config import RunConfig

SECOND = 1_000_000_000
"""Nanoseconds."""

EAST_NORTH = [(float(column), float(-row)) for row, column in DIRECTIONS]
"""The primitive actions as unit vectors (x east, y north: REP-103)."""
MOVE_OF = {vector: move for move, vector in enumerate(EAST_NORTH)}


class Frame:
    """The frame `map` and the clock of one run.

    Args:
        run: the run; time step t has the stamp t * step_period seconds, the map's lower left
            corner lies at its `origin`, x points east, y north.

    Attributes:
        grid: the map.
        resolution: metres a cell.
        origin: (x, y) of the map's lower left corner, in metres.
        period: nanoseconds a time step.
        centres: (x, y) of the middle of each free cell, in metres.
        names: the robots' names; robots: their number.
    """

    def __init__(self, run: RunConfig) -> None:
        self.grid: GridMap = run.scenario.map
        self.resolution = run.resolution
        self.origin = x, y = self.grid.origin
        self.names = run.scenario.names
        self.robots = len(self.names)
        self.period = round(run.step_period * SECOND)
        rows = self.grid.shape[0]
        side = self.resolution
        cells = self.grid.cells
        self.centres = [
            (x + (c + 0.5) * side, y + (rows - r - 0.5) * side) for r, c in cells
        ]
        self._cells = {centre: cell for cell, centre in enumerate(self.centres)}

    def stamp(self, step: int) -> tuple[int, int]:
        """Return (sec, nanosec) of a time step."""
        return divmod(step * self.period, SECOND)

    def step(self, sec: int, nanosec: int) -> int:
        """Return the time step of a stamp (the nearest one)."""
        return (sec * SECOND + nanosec + self.period // 2) // self.period

    def cell(self, x: float, y: float) -> int | None:
        """Return the free cell at a position in metres, or None."""
        cell = self._cells.get((x, y))
        if cell is None:
            column = (x - self.origin[0]) // self.resolution
            south = (y - self.origin[1]) // self.resolution
            # far away they may overflow
            if isfinite(column) and isfinite(south):
                position = (self.grid.shape[0] - 1 - int(south), int(column))
                cell = self.grid.number.get(position)
        return cell
