# Copyright 2026 The sparse_coord_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Maps: walls, doorways, starts and goals, cells coloured by a value."""

from collections.abc import Sequence

import numpy as np
from matplotlib import colormaps
from matplotlib.axes import Axes
from matplotlib.cm import ScalarMappable
from matplotlib.colors import Normalize, PowerNorm
from matplotlib.figure import Figure
from matplotlib.patches import Rectangle

from sparse_coord_ros.core.scenario import Scenario
from sparse_coord_ros.engine.report.entries import Entry

COLOUR_MAP = "Blues"
DOORWAY = "#D55E00"
WALL = "0.25"
CELL = 0.3
"""Inches a cell."""

WIDTH = 40
"""Cells that fit in a line of maps."""

LEAST = 8
"""Cells that a map's title needs."""


def draw_map(
    axes: Axes,
    scenario: Scenario,
    values: np.ndarray | None = None,
    norm: Normalize | None = None,
    *,
    label_size: float = 6,
    label_height: float = 0.5,
) -> None:
    """Draw cells, doorways (framed), and starts (S) and goals (G) with their robots' numbers.

    Args:
        axes: where to draw; a cell is a unit square, row 0 on top.
        scenario: the map and its robots.
        values: colour of each cell, shape (cells,); None: white.
        norm: scale of the values; required where there are values.
        label_size: size of the labels of starts and goals in points.
        label_height: their place in the cell, 0 at its top, 1 at its bottom.
    """
    grid = scenario.map
    rows, columns = grid.shape
    axes.add_patch(Rectangle((0, 0), columns, rows, color=WALL, linewidth=0))
    shades = np.zeros(len(grid.cells)) if values is None else np.asarray(norm(values))
    colours = colormaps[COLOUR_MAP](0.9 * shades)
    for x, (row, column) in enumerate(grid.cells):
        face = colours[x] if shades[x] > 0 else "white"
        place = (column, row)
        axes.add_patch(Rectangle(place, 1, 1, facecolor=face, edgecolor="0.85", linewidth=0.6))
    for x in grid.doorways:
        row, column = grid.cells[x]
        place = (column + 0.06, row + 0.06)
        axes.add_patch(Rectangle(place, 0.88, 0.88, fill=False, edgecolor=DOORWAY, linewidth=1.8))
    for x, text in _labels(scenario).items():
        row, column = grid.cells[x]
        axes.text(
            column + 0.5,
            row + label_height,
            text,
            ha="center",
            va="center",
            fontsize=label_size,
            color="white" if shades[x] > 0.6 else "black",
        )
    axes.set(xlim=(0, columns), ylim=(rows, 0), xticks=[], yticks=[], aspect="equal")


def _labels(scenario: Scenario) -> dict[int, str]:
    texts: dict[int, list[str]] = {}
    for number, robot in enumerate(scenario.robots, start=1):
        texts.setdefault(robot.start, []).append(f"S{number}")
        texts.setdefault(robot.goal, []).append(f"G{number}")
    return {x: " ".join(parts) for x, parts in texts.items()}


def asked_maps(entries: Sequence[Entry]) -> Figure:
    """Draw where COORDINATE is chosen: a map an entry, all with one scale of colours."""
    totals = [np.array(entry.result.asked).sum(axis=0) for entry in entries]
    highest = max(float(total.max()) for total in totals)
    norm = PowerNorm(0.5, vmin=0, vmax=highest or 1)
    lines = _lines(entries)
    heights = [max(e.scenario.map.shape[0] for _, e in line) * CELL + 0.6 for line in lines]
    figure = Figure(figsize=(WIDTH * CELL, sum(heights) + 0.7))
    figure_width, figure_height = figure.get_size_inches()
    top = figure_height
    for line, height in zip(lines, heights, strict=True):
        used = sum(_columns(entry) for _, entry in line)
        gap = (WIDTH - used) / (len(line) + 1)
        left = gap
        for i, entry in line:
            rows, columns = entry.scenario.map.shape
            inset = (_columns(entry) - columns) / 2
            axes = figure.add_axes(
                (
                    (left + inset) * CELL / figure_width,
                    (top - 0.5 - rows * CELL) / figure_height,
                    columns * CELL / figure_width,
                    rows * CELL / figure_height,
                )
            )
            draw_map(axes, entry.scenario, totals[i], norm, label_size=6.5)
            asks = entry.measure("asks").mean
            axes.set_title(f"{entry.name}\n{asks:.3f} asks a robot", fontsize=9)
            left += _columns(entry) + gap
        top -= height
    bar = figure.add_axes((0.25, 0.45 / figure_height, 0.5, 0.12 / figure_height))
    figure.colorbar(
        ScalarMappable(norm, colormaps[COLOUR_MAP].resampled(256)),
        cax=bar,
        orientation="horizontal",
        label="COORDINATE chosen in the cell, per episode, all robots together",
    )
    return figure


def _columns(entry: Entry) -> int:
    return max(LEAST, entry.scenario.map.shape[1])


def _lines(entries: Sequence[Entry]) -> list[list[tuple[int, Entry]]]:
    """Break the maps into lines, the widest first to where it still fits, small maps on top."""
    lines: list[list[tuple[int, Entry]]] = []
    for i, entry in sorted(enumerate(entries), key=lambda item: -_columns(item[1])):
        for line in lines:
            if sum(_columns(e) + 1 for _, e in line) + _columns(entry) <= WIDTH - 1:
                line.append((i, entry))
                break
        else:
            lines.append([(i, entry)])
    return lines[::-1]
