# Copyright 2026 The sparse_coord_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Draw a recorded run: the map with what was learned, and how episodes grew shorter.

python docs/picture.py RUN_DIRECTORY PICTURE.png      (needs: pip install matplotlib rosbags)
"""

import sys
from pathlib import Path

import matplotlib.pyplot as plt
import numpy as np
from matplotlib.patches import Circle, Rectangle
from rosbags.highlevel import AnyReader

from sparse_coord_ros.core.algorithm import COORDINATE, PRIMITIVES
from sparse_coord_ros.core.grid import MOVES
from sparse_coord_ros.core.run_config import load_run
from sparse_coord_ros.core.tables import load_team

COLOURS = ("tab:blue", "tab:orange", "tab:green", "tab:red")


def draw_map(axes, run, tables):
    """Draw cells, doorways, starts, goals, and every robot's greedy action in every cell."""
    grid = run.scenario.map
    rows, columns = grid.shape
    axes.add_patch(Rectangle((0, 0), columns, rows, color="0.25"))
    for x, (row, column) in enumerate(grid.cells):
        colour = "0.75" if x in grid.doorways else "white"
        axes.add_patch(Rectangle((column, row), 1, 1, facecolor=colour, edgecolor="0.85"))
    team = len(run.scenario.robots)
    for k, robot in enumerate(run.scenario.robots):
        shift = 0.18 * (k - (team - 1) / 2)
        for x, (row, column) in enumerate(grid.cells):
            if x == robot.goal:
                continue
            values = tables[k].q_star[x]
            dr, dc = MOVES[int(values[:PRIMITIVES].argmax())]
            centre = (column + 0.5 + shift, row + 0.5 + shift)
            asks = np.nan_to_num(values, nan=-np.inf).argmax() == COORDINATE
            axes.annotate(
                "",
                (centre[0] + 0.26 * dc, centre[1] + 0.26 * dr),
                (centre[0] - 0.26 * dc, centre[1] - 0.26 * dr),
                arrowprops={"arrowstyle": "->", "color": COLOURS[k], "lw": 1.6},
            )
            if asks:
                axes.add_patch(Circle(centre, 0.2, fill=False, color=COLOURS[k], lw=1.6))
        for cell, text in ((robot.start, f"{k + 1}"), (robot.goal, f"goal {k + 1}")):
            row, column = grid.cells[cell]
            axes.text(column + 0.5, row + 0.12, text, ha="center", va="center", fontsize=8)
    axes.set(xlim=(0, columns), ylim=(rows, 0), xticks=[], yticks=[], aspect="equal")
    axes.set_title(f"{run.scenario.name}: greedy actions after learning")


def episode_lengths(bag, robots):
    """Return the first step and the length in steps of every whole episode in the bag."""
    stamps = set()
    with AnyReader([bag]) as reader:
        wanted = [c for c in reader.connections if c.topic == f"/{robots[0]}/local_state"]
        for _, time, _ in reader.messages(wanted):
            stamps.add(time)
    times = np.array(sorted(stamps))
    steps = np.rint(times / np.diff(times).min()).astype(int)
    ends = np.flatnonzero(np.diff(steps) > 1)
    starts = np.concatenate([[0], ends + 1])[:-1]
    return steps[starts], steps[ends] - steps[starts]


def main(directory, picture):
    run = load_run(directory)
    tables = load_team(directory, run.scenario)
    figure, (left, right) = plt.subplots(1, 2, figsize=(10, 4.2), layout="constrained")
    draw_map(left, run, tables)
    first, length = episode_lengths(directory / "bag", [r.name for r in run.scenario.robots])
    right.semilogy(first, length, ".", color="0.7", markersize=4, label="one episode")
    window = 25
    if len(length) >= window:
        medians = [np.median(length[i : i + window]) for i in range(len(length) - window + 1)]
        middle = first[window // 2 : window // 2 + len(medians)]
        right.semilogy(middle, medians, color="tab:blue", label=f"median of {window}")
    right.set(xlabel="time step", ylabel="steps until all robots have arrived")
    right.set_title("live over ROS 2, read from the bag")
    right.legend()
    right.grid(alpha=0.3)
    figure.savefig(picture, dpi=110)


if __name__ == "__main__":
    if len(sys.argv) != 3:
        sys.exit(__doc__)
    main(Path(sys.argv[1]), Path(sys.argv[2]))
