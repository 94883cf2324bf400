# Copyright 2026 The sparse_coord_ros authors
# SPDX-License-Identifier: Apache-2.0
"""A floor plan as a picture, by itself or under a map's cells."""

import base64
import io
import math
from typing import Any

import numpy as np
from PIL import Image

from sparse_coord_ros.game.grid import GridMap
from sparse_coord_ros.maps.image import FloorPlan, floor_plan_of

SHARPEST = 4096
"""Pixels along the longer side of a picture into which one can zoom."""

UNKNOWN, FREE, OCCUPIED = 200, 255, 0
"""Shades of grey."""


def grey(plan: FloorPlan) -> np.ndarray:
    """Return a floor plan as a grey picture, shape (rows, columns), uint8, top row first."""
    shade = np.full(plan.free.shape, UNKNOWN, dtype=np.uint8)
    shade[plan.free], shade[plan.occupied] = FREE, OCCUPIED
    return shade


def data_url(plan: FloorPlan) -> str:
    """Return a floor plan as a grey picture for a page: a PNG, at most `SHARPEST` pixels long."""
    picture = Image.fromarray(grey(plan))
    picture = picture.reduce(math.ceil(max(picture.size) / SHARPEST))
    file = io.BytesIO()
    picture.save(file, format="PNG")
    return f"data:image/png;base64,{base64.b64encode(file.getvalue()).decode()}"


def under(grid: GridMap) -> dict[str, Any] | None:
    """Return the floor plan under a map, as a picture for a page; None: there is none.

    Its place is that of its upper left corner, and its size, in cells of the map.
    """
    plan = floor_plan_of(grid)
    if plan is None:
        return None
    scale = plan.resolution / (grid.resolution or 1.0)
    height, width = (side * scale for side in plan.free.shape)
    x, y = (
        (a - b) / (grid.resolution or 1.0) for a, b in zip(plan.origin, grid.origin, strict=True)
    )
    place = {"x": x, "y": grid.shape[0] - y - height, "width": width, "height": height}
    return {"href": data_url(plan), **place}
