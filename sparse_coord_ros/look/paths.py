# Copyright 2026 The sparse_coord_ros authors
# SPDX-License-Identifier: Apache-2.0
"""A picture of where bodies drove: their paths over the map, in metres."""

from itertools import groupby

import numpy as np
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Circle, Rectangle

from sparse_coord_ros.driving.trials import Drive
from sparse_coord_ros.learn.run_config import RunConfig
from sparse_coord_ros.look.figures import LINES
from sparse_coord_ros.palette import DOORWAY_COLOUR, robot_colour
from sparse_coord_ros.wire.frame import Frame

LONGEST = 10.0
"""Inches of the picture's longer side, without its key."""

THINNEST = 0.25
"""Opacity of one of many paths."""


def paths_figure(
    run: RunConfig,
    driven: Drive,
    title: str,
    *,
    plan: tuple[np.ndarray, tuple[float, float, float, float]] | None = None,
) -> Figure:
    """Draw the paths of the episodes that were followed.

    Starts are discs, goals rings, doorways orange; a cross is where two bodies touched, in any
    episode.

    Args:
        run: the run.
        driven: what came of the drive.
        title: above the picture.
        plan: a grey image of the building, top row first, and where it lies: (left, right, low,
            high) in metres; None: the map's walls are drawn.
    """
    frame = Frame(run)
    (rows, columns), side = run.scenario.map.shape, run.resolution
    left, low = frame.origin
    width, height = columns * side, rows * side
    scale = LONGEST / max(width, height)
    figure = Figure(figsize=(width * scale, height * scale + 0.9), layout="constrained")
    axes = figure.add_subplot()
    if plan is None:
        walls = np.array([[symbol == "#" for symbol in row] for row in run.scenario.map.rows])
        plan = np.where(walls, 64, 255), (left, left + width, low, low + height)
    axes.imshow(plan[0], cmap="gray", vmin=0, vmax=255, extent=plan[1], zorder=0)
    axes.set(xlim=(left, left + width), ylim=(low, low + height), aspect="equal")
    axes.set(xlabel="x (m)", ylabel="y (m)", title=title)
    for cell in run.scenario.map.doorways:
        x, y = frame.centres[cell]
        corner = x - side / 2, y - side / 2
        axes.add_patch(Rectangle(corner, side, side, color=DOORWAY_COLOUR, alpha=0.6, lw=0))
    episodes = 1 + max((moment.episode for moment in driven.path), default=0)
    key: list[Line2D] = []
    for k, robot in enumerate(run.scenario.robots):
        colour = robot_colour(k)
        style = LINES[k % len(LINES)]
        for _, moments in groupby(driven.path, key=lambda moment: moment.episode):
            path = np.array([moment.places[k] for moment in moments])
            axes.plot(*path.T, color=colour, ls=style, lw=1.2, alpha=max(THINNEST, 1 / episodes))
        key.append(Line2D([], [], color=colour, ls=style, label=robot.name))
        start, goal = frame.centres[robot.start], frame.centres[robot.goal]
        axes.add_patch(Circle(start, 0.35 * side, color=colour, zorder=3))
        axes.add_patch(Circle(goal, 0.35 * side, fill=False, edgecolor=colour, lw=2.5, zorder=3))
    touches = np.array([touch.place for touch in driven.touches]).reshape(-1, 2)
    axes.plot(*touches.T, "x", color="black", ms=7, mew=2, zorder=4)
    if len(touches):
        key.append(Line2D([], [], color="black", marker="x", ls="", label="bodies touched"))
    figure.legend(handles=key, loc="outside lower center", ncols=min(6, len(key)), frameon=False)
    return figure
