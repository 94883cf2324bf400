# Copyright 2026 The sparse_coord_ros authors
# SPDX-License-Identifier: Apache-2.0
"""A floor plan in pixels, the main direction of its walls, and the plan turned along them."""

import dataclasses
import math
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path

import numpy as np
from PIL import Image

from sparse_coord_ros.core.game.pose import Pose

MOST_POINTS = 40_000
"""Pixels of walls that are looked at for their main direction."""

COARSE = 1.0
FINE = 0.1
"""Degrees between the directions that are tried: first everywhere, then about the best."""

BAND = 2.0
"""Pixels across which wall pixels count as one line."""

CLEAR_DIRECTION = 1.25
"""How much better the main direction must explain the walls than the median direction."""

FEWEST_POINTS = 50
"""Pixels of walls; fewer show no direction."""


@dataclass(frozen=True)
class FloorPlan:
    """A floor plan: the kind of each pixel, and the pose of the image.

    Attributes:
        path: the file that it was read from.
        free: pixels known to be free, shape (rows, columns), bool, top row first.
        occupied: pixels known to be occupied; all other pixels are unknown.
        resolution: metres per pixel.
        origin: the pose of the image's lower left corner; its rows lie along the yaw.
        remarks: warnings about the pixels, one line each.
        unturned: the plan of which this one is a turned copy; None: it is as it was read.
    """

    path: Path
    free: np.ndarray
    occupied: np.ndarray
    resolution: float
    origin: Pose
    remarks: tuple[str, ...] = ()
    unturned: "FloorPlan | None" = None

    @property
    def name(self) -> str:
        """The file's stem."""
        return self.path.stem

    @cached_property
    def wall_direction(self) -> float | None:
        """The direction of most of its walls, in radians from -pi/4 to pi/4; None: there is none.

        A turned copy has that of its plan: its own pixels show edges of the old image, too.
        """
        if self.unturned is None:
            return _wall_direction(self)
        direction = self.unturned.wall_direction
        if direction is None:
            return None
        turn = self.origin.yaw - self.unturned.origin.yaw
        return math.remainder(direction - turn, math.pi / 2)


def turned(plan: FloorPlan, yaw: float) -> FloorPlan:
    """Return a floor plan whose rows lie at an angle to those of the given one.

    Places keep their coordinates. A pixel of the new image is what the old image shows in its
    middle; pixels outside of the old image are unknown. Each occupied pixel stays occupied, so
    that no thin wall gets a hole.

    Args:
        plan: the floor plan.
        yaw: the angle, in radians counterclockwise.
    """
    height, width = plan.free.shape
    axes = Pose(0.0, 0.0, yaw)
    corners = np.array([(0, 0), (width, 0), (0, height), (width, height)])
    ahead, left = axes.relative(corners[:, 0], corners[:, 1])
    columns = math.ceil(ahead.max() - ahead.min() - 1e-6)
    rows = math.ceil(left.max() - left.min() - 1e-6)
    # The new image's lower left corner, in pixels from the old one's.
    corner = Pose(*axes.absolute(ahead.min(), left.min()), yaw)
    x, y = corner.absolute(0, rows)
    cos = math.cos(yaw)
    sin = math.sin(yaw)
    # Pillow asks for the place in the old image of each place in the new one, y downwards.
    to_old = (cos, sin, x, -sin, cos, height - y)
    free, occupied = (
        np.asarray(
            Image.fromarray(pixels).transform(
                (columns, rows), Image.Transform.AFFINE, to_old
            )
        ).copy()
        for pixels in (plan.free, plan.occupied)
    )
    down, across = np.nonzero(plan.occupied)
    ahead, left = corner.relative(across + 0.5, height - down - 0.5)
    occupied[(rows - left).astype(int), ahead.astype(int)] = True
    free &= ~occupied
    corner_in_metres = plan.origin.absolute(
        corner.x * plan.resolution, corner.y * plan.resolution
    )
    origin = Pose(*corner_in_metres, math.remainder(plan.origin.yaw + yaw, math.tau))
    return dataclasses.replace(
        plan, free=free, occupied=occupied, origin=origin, unturned=plan
    )


def _wall_direction(plan: FloorPlan) -> float | None:
    """Return the angle between the walls and the image's rows, in radians counterclockwise.

    It lies between -45 and 45 degrees. Seen along the walls, their pixels fall on few lines: the
    angle is that for which the numbers of pixels on each line of rows and of columns have the
    largest sum of squares. Occupied pixels are tried, and all at the edge of free space; the
    clearer direction counts.

    Returns:
        None if there are few walls, or if no direction is much better than the others.
    """
    from scipy import ndimage  # a map's picture does not need it

    edges = ~plan.free & ndimage.binary_dilation(plan.free, np.ones((3, 3)))
    clearest = CLEAR_DIRECTION
    direction = None
    for walls in (plan.occupied & edges, edges):
        points = _points(walls)
        if len(points) < FEWEST_POINTS:
            continue
        coarse = np.arange(-45.0, 45.0, COARSE)
        sharpness = np.array([_sharpness(points, angle) for angle in coarse])
        clear = float(sharpness.max() / np.median(sharpness))
        if clear < clearest:
            continue
        clearest = clear
        best = coarse[sharpness.argmax()]
        fine = np.arange(best - COARSE, best + COARSE, FINE)
        _, best = max((_sharpness(points, angle), angle) for angle in fine)
        direction = math.remainder(math.radians(best), math.pi / 2)
    return direction


def _points(walls: np.ndarray) -> np.ndarray:
    """Return (x, y) of pixels, shape (points, 2); of many a sample."""
    down, across = np.nonzero(walls)
    points = np.column_stack([across, -down]).astype(np.float64)
    if len(points) > MOST_POINTS:
        random = np.random.default_rng(0)
        points = points[random.choice(len(points), MOST_POINTS, replace=False)]
    return points


def _sharpness(points: np.ndarray, degrees: float) -> float:
    """Return how well points fall on lines at an angle, and on lines at right angles to it."""
    total = 0.0
    for along in Pose(0.0, 0.0, math.radians(degrees)).relative(*points.T):
        lines = ((along - along.min()) / BAND).astype(np.int64)
        total += float((np.bincount(lines).astype(np.float64) ** 2).sum())
    return total
