# Copyright 2026 The sparse_coord_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Conversion of time steps and cells to the seconds and metres of messages, and back.

The nodes and the readers of their log share this object, so that both convert equally.
"""

from sparse_coord_ros.core.game.actions import DIRECTIONS
from sparse_coord_ros.core.game.grid import GridMap
from sparse_coord_ros.core.runs.run_config import RunConfig

SECOND = 1_000_000_000
"""Nanoseconds."""

EAST_NORTH = [(float(column), float(-row)) for row, column in DIRECTIONS]
"""The primitive actions as unit vectors (x east, y north: REP-103) along the map's axes."""
MOVE_OF = {vector: move for move, vector in enumerate(EAST_NORTH)}


class Frame:
    """The frame `map` and the clock of one run.

    Args:
        run: the run; time step t has the stamp t * step_period seconds, the map lies at its
            `origin`. If that has no yaw, east is along x, north along y.

    Attributes:
        grid: the map.
        resolution: metres a cell.
        origin: the pose of the map's lower left corner.
        period: nanoseconds a time step.
        centres: (x, y) of the middle of each free cell, in metres.
        names: the robots' names; robots: their number.
    """

    def __init__(self, run: RunConfig) -> None:
        self.grid: GridMap = run.scenario.map
        self.resolution = run.resolution
        self.origin = self.grid.origin
        self.names = run.scenario.names
        self.robots = len(self.names)
        self.period = round(run.step_period * SECOND)
        self.centres = [self.grid.squares.centre(*cell) for cell in self.grid.cells]
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
            square = self.grid.squares.at(x, y)
            cell = None if square is None else self.grid.number.get(square)
        return cell
