# Copyright 2026 The sparse_coord_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Draw a recorded run: the map with what was learned, and how episodes grew shorter.

python docs/picture.py RUN_DIRECTORY PICTURE.png      (needs: pip install matplotlib rosbags)
"""

import sys
from pathlib import Path

import matplotlib.pyplot as plt
import numpy as np
from matplotlib.patches import Circle
from rosbags.highlevel import AnyReader

from sparse_coord_ros.core.algorithm import COORDINATE, PRIMITIVES
from sparse_coord_ros.core.grid import MOVES
from sparse_coord_ros.core.run_config import load_run
from sparse_coord_ros.core.tables import load_team
from sparse_coord_ros.engine.report.maps import draw_map

COLOURS = ("#0072B2", "#E69F00", "#009E73", "#CC79A7", "#56B4E9", "#F0E442", "#D55E00", "black")


def draw_policies(axes, run, tables):
    """Draw the map and every robot's greedy action in every cell; a ring: it asks there."""
    scenario = run.scenario
    draw_map(axes, scenario, label_size=8, label_height=0.13)
    team = len(scenario.robots)
    for k, robot in enumerate(scenario.robots):
        shift = 0.18 * (k - (team - 1) / 2)
        for x, (row, column) in enumerate(scenario.map.cells):
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
    axes.set_title(f"{scenario.name}: greedy actions after learning")


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
    draw_policies(left, run, tables)
    first, length = episode_lengths(directory / "bag", [r.name for r in run.scenario.robots])
    right.semilogy(first, length, ".", color="0.7", markersize=4, label="one episode")
    window = 25
    if len(length) >= window:
        medians = [np.median(length[i : i + window]) for i in range(len(length) - window + 1)]
        middle = first[window // 2 : window // 2 + len(medians)]
        right.semilogy(middle, medians, color=COLOURS[0], label=f"median of {window}")
    right.set(xlabel="time step", ylabel="steps until all robots have arrived")
    right.set_title("live over ROS 2, read from the bag")
    right.legend()
    right.grid(alpha=0.3)
    figure.savefig(picture, dpi=110)


if __name__ == "__main__":
    if len(sys.argv) != 3:
        sys.exit(__doc__)
    main(Path(sys.argv[1]), Path(sys.argv[2]))
