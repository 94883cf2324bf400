# Copyright 2026 The sparse_coord_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Poses on the floor, and the squares of a grid that lies there at any angle."""

import math
from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np


class Pose(NamedTuple):
    """A pose: metres in the frame `map`, radians counterclockwise from its x axis."""

    x: float
    y: float
    yaw: float = 0.0

    def absolute(self, ahead: Any, left: Any) -> tuple[Any, Any]:
        """Return the (x, y) of places that lie metres ahead and left of the pose."""
        cos = math.cos(self.yaw)
        sin = math.sin(self.yaw)
        return (
            self.x + cos * ahead - sin * left,
            self.y + sin * ahead + cos * left,
        )

    def relative(self, x: Any, y: Any) -> tuple[Any, Any]:
        """Return the metres ahead and left of the pose of places: the inverse of `absolute`."""
        cos = math.cos(self.yaw)
        sin = math.sin(self.yaw)
        dx = x - self.x
        dy = y - self.y
        return cos * dx + sin * dy, cos * dy - sin * dx


class Squares(NamedTuple):
    """The squares of a grid; row 0 is the furthest from the corner, column 0 the nearest.

    Attributes:
        corner: the pose of the grid's lower left corner; the rows lie along its yaw.
        side: the side of a square, in metres.
        rows: their number.
    """

    corner: Pose
    side: float
    rows: int

    def centre(self, row: Any, column: Any) -> tuple[Any, Any]:
        """Return the (x, y) of the middle of squares, in metres."""
        return self.corner.absolute(
            (column + 0.5) * self.side, (self.rows - row - 0.5) * self.side
        )

    def at(self, x: float, y: float) -> tuple[int, int] | None:
        """Return (row, column) of the square at a place, also beyond the grid; None: too far."""
        ahead, left = self.corner.relative(x, y)
        column = ahead // self.side
        level = left // self.side
        if not (math.isfinite(column) and math.isfinite(level)):
            return None
        return self.rows - 1 - int(level), int(column)

    def outline(self, columns: int) -> np.ndarray:
        """Return the corners of a grid of so many columns: (x, y) of each, shape (4, 2)."""
        width = columns * self.side
        height = self.rows * self.side
        corners = [(0.0, 0.0), (width, 0.0), (width, height), (0.0, height)]
        return np.array([self.corner.absolute(*corner) for corner in corners])


def metres(position: Sequence[float]) -> str:
    """Return the (x, y) of a place in metres as text, to the centimetre."""
    # `+ 0.0` makes -0 a 0.
    x, y = (round(float(coordinate), 2) + 0.0 for coordinate in position[:2])
    return f"{x:.12g},{y:.12g}"


def pose_in_words(pose: Pose) -> str:
    """Return a pose as text: metres, and degrees if it is turned."""
    turn = f", turned by {math.degrees(pose.yaw):.1f} degrees" if pose.yaw else ""
    return f"{metres(pose)} m{turn}"
