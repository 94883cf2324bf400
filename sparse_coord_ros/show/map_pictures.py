# Copyright 2026 The sparse_coord_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Maps: walls, doorways, starts and goals; cells coloured by a value."""

import numpy as np
from matplotlib import colormaps
from matplotlib.axes import Axes
from matplotlib.patches import Rectangle

from sparse_coord_ros.base.palette import DOORWAY_COLOUR
from sparse_coord_ros.core.game.scenario import Scenario

COLOUR_MAP = "Blues"
WALL_GREY = "0.25"


def draw_map(
    axes: Axes,
    scenario: Scenario,
    shades: np.ndarray | None = None,
    *,
    corner: tuple[float, float] = (0, 0),
    label_size: float = 6,
    label_height: float = 0.5,
) -> None:
    """Draw cells, doorways (framed), and starts (S) and goals (G) of robots.

    Args:
        axes: where to draw; a cell is a unit square, row 0 on top.
        scenario: the map and its robots.
        shades: how dark each cell is, from 0 to 1, shape (cells,); None: white.
        corner: column and row of the map's upper left corner.
        label_size: size of the labels of starts and goals in points.
        label_height: their place in the cell, 0 at its top, 1 at its bottom.
    """
    grid = scenario.map
    (left, top) = corner
    rows, columns = grid.shape
    dark = np.zeros(len(grid.cells)) if shades is None else shades
    labels: dict[int, list[str]] = {}
    for number, robot in enumerate(scenario.robots, start=1):
        labels.setdefault(robot.start, []).append(f"S{number}")
        labels.setdefault(robot.goal, []).append(f"G{number}")
    axes.add_patch(Rectangle(corner, columns, rows, color=WALL_GREY, linewidth=0))
    for x, (row, column) in enumerate(grid.cells):
        face = colormaps[COLOUR_MAP](0.9 * dark[x]) if dark[x] > 0 else "white"
        corner_of_cell = (left + column, top + row)
        axes.add_patch(
            Rectangle(
                corner_of_cell, 1, 1, facecolor=face, edgecolor="0.85", linewidth=0.6
            )
        )
        axes.text(
            corner_of_cell[0] + 0.5,
            corner_of_cell[1] + label_height,
            " ".join(labels.get(x, [])),
            ha="center",
            va="center",
            fontsize=label_size,
            color="white" if dark[x] > 0.6 else "black",
        )
    for x in grid.doorways:
        row, column = grid.cells[x]
        inner = (left + column + 0.06, top + row + 0.06)
        axes.add_patch(
            Rectangle(
                inner, 0.88, 0.88, fill=False, edgecolor=DOORWAY_COLOUR, linewidth=1.8
            )
        )
    axes.add_patch(Rectangle(corner, columns, rows, fill=False, edgecolor="black"))
    axes.set(xlim=(0, columns), ylim=(rows, 0), xticks=[], yticks=[], aspect="equal")
