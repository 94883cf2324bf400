# Copyright 2026 The sparse_coord_ros authors
# SPDX-License-Identifier: Apache-2.0
"""A picture of an imported map: its cells, doorways and robots over the original."""

import base64
import io
import math
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
from PIL import Image, ImageColor, ImageDraw

from sparse_coord_ros.files import write_whole
from sparse_coord_ros.game.grid import DOORWAY, GridMap
from sparse_coord_ros.game.scenario import Robot
from sparse_coord_ros.maps.image import FloorPlan, floor_plan_of
from sparse_coord_ros.palette import DOORWAY_COLOUR, robot_colour

LARGEST = 1600
"""Pixels of a preview along its longer side."""

SHARPEST = 4096
"""Of a picture into which one can zoom."""

MARGIN, TICKS = 48, 60
"""Pixels beside the picture for its axes, and the fewest between two of their numbers."""

CELL_SIDE = 8
"""Pixels along the side of a cell, where the picture stays small enough."""

CELL, DOOR = (150, 190, 230, 200), ImageColor.getrgb(DOORWAY_COLOUR)
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


def framed(picture: Image.Image, origin: tuple[float, float], metre: float) -> Image.Image:
    """Return a picture of a floor with axes in metres at its left and below.

    Args:
        picture: the floor.
        origin: (x, y) of its lower left corner, in metres.
        metre: pixels of a metre.
    """
    wide, high = picture.size
    frame = Image.new("RGB", (wide + MARGIN + MARGIN // 3, high + MARGIN), "white")
    frame.paste(picture, (MARGIN, 0))
    draw = ImageDraw.Draw(frame)
    draw.line([(MARGIN - 1, 0), (MARGIN - 1, high), (wide + MARGIN, high)], fill="black")
    power = 10 ** math.floor(math.log10(TICKS / metre))
    step = next(power * k for k in (1, 2, 5, 10) if power * k * metre >= TICKS)
    for axis, (begin, size) in enumerate(zip(origin, (wide, high), strict=True)):
        for number in range(
            math.ceil(begin / step), math.floor((begin + size / metre) / step) + 1
        ):
            at = (number * step - begin) * metre
            text = f"{number * step:g}" + (" m" if number == math.ceil(begin / step) else "")
            if axis == 0:
                draw.line([(MARGIN + at, high), (MARGIN + at, high + 5)], fill="black")
                draw.text((MARGIN + at, high + 8), text, fill="black", anchor="ma")
            else:
                draw.line([(MARGIN - 6, high - at), (MARGIN - 1, high - at)], fill="black")
                draw.text((MARGIN - 8, high - at), text, fill="black", anchor="rm")
    return frame


def write_preview(
    path: Path, plan: FloorPlan, grid: GridMap, robots: Sequence[Robot] = ()
) -> None:
    """Write a PNG file: the original in grey, free cells blue, doorways orange.

    Robots' starts are discs, their goals rings, in their colours; axes are in metres.

    Args:
        path: the file.
        plan: the original.
        grid: the map made of it.
        robots: those of the scenario.

    Raises:
        OSError: it cannot be written.
    """
    side = grid.resolution or 1.0
    height, width = plan.free.shape
    shade = grey(plan)
    wanted = CELL_SIDE * plan.resolution / side  # the scale at which a cell has that side
    scale = min(max(1.0, wanted), LARGEST / max(height, width))
    size = max(1, round(width * scale)), max(1, round(height * scale))
    if scale < 1:
        picture = Image.fromarray(shade).reduce(max(1, round(1 / scale))).resize(size)
    else:
        picture = Image.fromarray(shade).resize(size, Image.Resampling.NEAREST)
    picture = picture.convert("RGB")
    draw = ImageDraw.Draw(picture, "RGBA")
    metre = scale / plan.resolution

    def box(cell: tuple[int, int], share: float) -> list[float]:
        """Return the corners of the middle share of a cell, in pixels of the picture."""
        row, column = cell
        x = grid.origin[0] - plan.origin[0] + (column + 0.5) * side
        y = grid.origin[1] - plan.origin[1] + (grid.shape[0] - row - 0.5) * side
        half = share * side * metre / 2
        x, y = x * metre, size[1] - y * metre
        return [x - half, y - half, x + half, y + half]

    for cell in grid.cells:
        door = grid.rows[cell[0]][cell[1]] == DOORWAY
        draw.rectangle(box(cell, 0.9 if door else 0.7), fill=DOOR if door else CELL)
    for k, robot in enumerate(robots):
        colour = robot_colour(k)
        draw.ellipse(box(grid.cells[robot.start], 1.6), fill=colour)
        draw.ellipse(box(grid.cells[robot.goal], 1.6), outline=colour, width=3)
    file = io.BytesIO()
    framed(picture, plan.origin, metre).save(file, format="PNG", compress_level=3)
    write_whole(path, file.getvalue())
