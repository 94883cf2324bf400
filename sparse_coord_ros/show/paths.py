# Copyright 2026 The sparse_coord_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Pictures of a floor in metres: a map's cells, or the paths of bodies."""

from collections.abc import Sequence
from itertools import groupby

import numpy as np
from matplotlib.colors import to_rgba
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Circle
from matplotlib.transforms import Affine2D

from sparse_coord_ros.base.palette import DOORWAY_COLOUR, robot_colour
from sparse_coord_ros.core.game.grid import DOORWAY, WALL, GridMap
from sparse_coord_ros.core.game.scenario import Robot
from sparse_coord_ros.core.runs.run_config import RunConfig
from sparse_coord_ros.lab.driving.trials import Drive
from sparse_coord_ros.lab.maps.floor_plan import FloorPlan
from sparse_coord_ros.lab.maps.image import floor_plan_of, grey
from sparse_coord_ros.show.figures import LINES

LONGEST_FIGURE_SIDE = 10.0
"""Inches of the picture's longer side, without its key."""

CELL_COLOUR = to_rgba("#96bee6", 0.7)

WIDE_COLOUR = "#007a33"
DUSTY_COLOUR = "#c00000"

THINNEST_PATH = 0.25
"""Opacity of one of many paths."""


def floor_figure(
    grid: GridMap,
    robots: Sequence[Robot],
    plan: FloorPlan | None,
    *,
    cells: bool = False,
    title: str = "",
    wide: Sequence[tuple[float, float]] = (),
    dusty: Sequence[tuple[float, float]] = (),
) -> Figure:
    """Draw a map over its floor plan, in metres.

    Starts are discs, goals rings, doorways orange.

    Args:
        grid: the map.
        robots: the robots on it.
        plan: the floor plan, turned as the map; None: the map's walls are drawn.
        cells: whether free cells are blue, as on a chessboard.
        title: the title above the picture.
        wide: (x, y) of passages that are two cells wide.
        dusty: (x, y) of cells that are free, or doorways, only because spots were dropped.
    """
    rows, columns = grid.shape
    squares = grid.squares
    side = squares.side
    outline = squares.outline(columns)
    low = outline.min(axis=0)
    high = outline.max(axis=0)
    width, height = (high - low).tolist()
    scale = LONGEST_FIGURE_SIDE / max(width, height)
    figure = Figure(figsize=(width * scale, height * scale + 0.9), layout="constrained")
    axes = figure.add_subplot()
    signs = np.array([list(row) for row in grid.rows])
    floor = np.where(signs == WALL, 64, 255)
    box = 0.0, columns * side, 0.0, rows * side
    extent = box
    if plan is not None:
        x, y = grid.origin.relative(plan.origin.x, plan.origin.y)
        tall, long = (count * plan.resolution for count in plan.free.shape)
        floor = grey(plan)
        extent = (x, x + long, y, y + tall)
    # Pictures are drawn along the grid, and turned as it lies.
    lies = Affine2D().rotate(grid.origin.yaw).translate(grid.origin.x, grid.origin.y)
    turn = lies + axes.transData
    axes.imshow(
        floor,
        cmap="gray",
        vmin=0,
        vmax=255,
        extent=extent,
        interpolation="nearest",
        interpolation_stage="data",  # colours for the pixels of the picture alone
        transform=turn,
    )
    shades = np.zeros((*grid.shape, 4))
    if cells:
        shades[signs != WALL] = CELL_COLOUR
        # As on a chessboard: each cell must be visible.
        odd = np.indices(grid.shape).sum(axis=0) % 2 > 0
        shades[odd, 3] *= 0.75
    shades[signs == DOORWAY] = to_rgba(DOORWAY_COLOUR, 0.6)
    axes.imshow(shades, extent=box, interpolation="nearest", transform=turn)
    axes.set(
        xlim=(low[0], high[0]),
        ylim=(low[1], high[1]),
        xlabel="x (m)",
        ylabel="y (m)",
        title=title,
    )
    axes.ticklabel_format(useOffset=False, style="plain")
    for marked, colour, label in (
        (wide, WIDE_COLOUR, "two cells wide"),
        (dusty, DUSTY_COLOUR, "free as spots were dropped"),
    ):
        if marked:
            for centre in marked:
                ring = Circle(
                    centre, 0.6 * side, zorder=3, ec=colour, fill=False, lw=1.5
                )
                axes.add_patch(ring)
            axes.plot([], [], "o", mfc="none", color=colour, label=label)
    for k, robot in enumerate(robots):
        for cell, look in (
            (robot.start, {"color": robot_colour(k)}),
            (robot.goal, {"edgecolor": robot_colour(k), "fill": False, "lw": 2.5}),
        ):
            centre = squares.centre(*grid.cells[cell])
            axes.add_patch(Circle(centre, 0.35 * side, zorder=3, **look))
    if wide or dusty:
        figure.legend(loc="outside lower center", ncols=2, frameon=False)
    return figure


def paths_figure(run: RunConfig, driven: Drive) -> Figure:
    """Draw the paths of the recorded episodes over the floor.

    A cross is the place of a collision, in any episode.

    Args:
        run: the run.
        driven: the results of the drive.
    """
    scenario = run.scenario
    episodes = 1 + max((moment.episode for moment in driven.team.path), default=0)
    title = f"{scenario.name}: {episodes} episodes driven"
    plan = floor_plan_of(scenario.map)
    figure = floor_figure(scenario.map, scenario.robots, plan, title=title)
    axes = figure.axes[0]
    key = []
    for k, robot in enumerate(scenario.robots):
        colour = robot_colour(k)
        style = LINES[k % len(LINES)]
        for _, moments in groupby(driven.team.path, key=lambda moment: moment.episode):
            path = np.array([moment.places[k] for moment in moments])
            axes.plot(
                *path.T,
                color=colour,
                ls=style,
                lw=1.2,
                alpha=max(THINNEST_PATH, 1 / episodes),
            )
        key.append(Line2D([], [], color=colour, ls=style, label=robot.name))
    touches = np.array(
        [touch.place for touch in driven.team.simulator.touches]
    ).reshape(-1, 2)
    axes.plot(*touches.T, "x", color="black", ms=7, mew=2, zorder=4)
    if len(touches):
        key.append(
            Line2D([], [], color="black", marker="x", ls="", label="bodies touched")
        )
    figure.legend(
        handles=key, loc="outside lower center", ncols=min(6, len(key)), frameon=False
    )
    return figure
