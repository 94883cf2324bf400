# Copyright 2026 The sparse_coord_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Maps: walls, doorways, starts and goals; cells coloured by a value, or a team's moves."""

import textwrap
from collections.abc import Sequence

import numpy as np
from matplotlib import colormaps
from matplotlib.axes import Axes
from matplotlib.cm import ScalarMappable
from matplotlib.colors import PowerNorm
from matplotlib.figure import Figure
from matplotlib.patches import Rectangle

from sparse_coord_ros.base.palette import DOORWAY_COLOUR
from sparse_coord_ros.core.game.scenario import Scenario
from sparse_coord_ros.studies.condition_result import ConditionResult

COLOUR_MAP = "Blues"
WALL_GREY = "0.25"
CELL_INCHES = 0.3
"""Inches a cell."""

LINE_CELLS = 41
"""Cells that fit in a line of maps."""

SCALE = 0.8
"""Inches of the scale below them."""

LEAST = 8
"""Cells that a map's title needs."""

TITLE_LETTERS = 27
"""Letters in a line of a map's title."""

TITLE_LINE = 0.6
"""Cells that such a line takes."""


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
        place = (left + column, top + row)
        axes.add_patch(
            Rectangle(place, 1, 1, facecolor=face, edgecolor="0.85", linewidth=0.6)
        )
        axes.text(
            place[0] + 0.5,
            place[1] + label_height,
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


def asked_maps(results: Sequence[ConditionResult]) -> Figure:
    """Draw where COORDINATE is chosen: a map a condition, all with one scale of colours.

    Each map says its learner and settings.
    """
    totals = {one.id: np.array(one.asked).sum(axis=0) for one in results}
    norm = PowerNorm(
        0.5, vmin=0, vmax=max(float(total.max()) for total in totals.values()) or 1
    )
    figure = Figure()
    axes = figure.add_axes((0, 0, 1, 1))
    left = top = deep = 0.0
    for one in sorted(results, key=lambda one: one.scenario.map.shape[1]):
        rows, columns = one.scenario.map.shape
        wide = max(LEAST, columns)
        if left + wide > LINE_CELLS:
            left = 0.0
            top = top + deep
            deep = 0.0
        title = _title(one)
        above = TITLE_LINE * len(title)
        corner = (left + (wide - columns) / 2, top + above + 0.2)
        shades = np.asarray(norm(totals[one.id]))
        draw_map(axes, one.scenario, shades, corner=corner, label_size=6.5)
        axes.text(
            corner[0] + columns / 2,
            top + above,
            "\n".join(title),
            ha="center",
            fontsize=9,
        )
        left = left + wide + 1
        deep = max(deep, rows + above + 0.6)
    axes.set(xlim=(-0.2, LINE_CELLS + 0.2), ylim=(top + deep, 0))
    axes.axis("off")
    height = (top + deep) * CELL_INCHES + SCALE
    figure.set_size_inches(LINE_CELLS * CELL_INCHES, height)
    axes.set_position((0, SCALE / height, 1, 1 - SCALE / height))
    figure.colorbar(
        ScalarMappable(norm, colormaps[COLOUR_MAP].resampled(256)),
        cax=figure.add_axes((0.25, 0.55 / height, 0.5, 0.12 / height)),
        orientation="horizontal",
        label="COORDINATE chosen in the cell, per episode, all robots together",
    )
    return figure


def _title(result: ConditionResult) -> list[str]:
    """Return the lines above a map: scenario, learner, settings, and how often a robot asks."""
    settings = ", ".join(f"{name} {value}" for name, value in result.condition.settings)
    return [
        f"{result.scenario.name}, {result.learner.title}",
        *textwrap.wrap(settings, TITLE_LETTERS),
        f"{result.best('asks').mean:.3f} asks a robot",
    ]
