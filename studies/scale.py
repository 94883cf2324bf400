# Copyright 2026 The sparse_coord_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Large maps and teams: seconds, memory and arrivals of one learning run. docs/buildings.md.

python studies/scale.py halls:24 --robots 8 --steps 20000 --set prior=map
python studies/scale.py building-3x2x4-32r-4 --steps 100000 --seed 2

`halls:N` is N x N halls of 13 x 13 cells, with a doorway between neighbours; any other scenario
is named as everywhere. It prints one line.
"""

import argparse
import resource
import tempfile
import time
from pathlib import Path

import numpy as np
from script import run_script

import sparse_coord_ros as sc
from sparse_coord_ros.lab.maps.plan import suggested_settings

SIDE = 13
"""Cells along the side of a hall."""


def halls(count: int, robots: int, folder: Path) -> Path:
    """Write a scenario file of halls, in which robots change places across the map in pairs."""
    size = count * (SIDE + 1) - 1
    signs = np.full((size, size), ".")
    walls = np.arange(SIDE, size, SIDE + 1)
    middles = np.arange(SIDE // 2, size, SIDE + 1)
    signs[walls] = "#"
    signs[:, walls] = "#"
    signs[np.ix_(walls, middles)] = "D"
    signs[np.ix_(middles, walls)] = "D"
    rows = ["".join(row) for row in signs]
    (folder / "halls.txt").write_text("title: halls\n---\n" + "\n".join(rows) + "\n")
    free = np.argwhere(signs == ".")
    cells = np.random.default_rng(count).choice(free, 2 * robots, replace=False)
    lines = [f"map: {folder}/halls.txt", "robots:"]
    for k, (start, goal) in enumerate(zip(cells[::2], cells[1::2], strict=True)):
        lines.append(
            f"  robot_{k + 1}: {{start: {start.tolist()}, goal: {goal.tolist()}}}"
        )
    file = folder / "halls.yaml"
    file.write_text("\n".join(lines) + "\n")
    return file


def main() -> None:
    """Learn once, play trials, and print time and memory."""
    parser = argparse.ArgumentParser(
        description=__doc__.split("\n")[0],
        formatter_class=argparse.ArgumentDefaultsHelpFormatter,
    )
    parser.add_argument("scenario")
    parser.add_argument("--robots", type=int, default=8, help="of halls")
    parser.add_argument("--learner", default="voi")
    parser.add_argument("--steps", type=int, default=20_000)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--trials", type=int, default=100)
    parser.add_argument("--set", action="append", default=[], metavar="NAME=VALUE")
    options = parser.parse_args()
    settings = dict(one.split("=", 1) for one in options.set)
    settings = {"penalty": -100, "steps": options.steps, **settings}
    with tempfile.TemporaryDirectory() as folder:
        name = options.scenario
        if name.startswith("halls:"):
            count = int(name.partition(":")[2])
            scenario = sc.load_scenario(halls(count, options.robots, Path(folder)))
            pairs = [(robot.start, robot.goal) for robot in scenario.robots]
            settings = {
                **suggested_settings(scenario.map, pairs, settings),
                **settings,
            }
            scenario = scenario.with_settings(settings)
        else:
            scenario = sc.load_scenario(name, **settings)
    began = time.process_time()
    run = sc.train(scenario, options.learner, seed=options.seed)
    learned = time.process_time() - began
    found = sc.evaluate(run, trials=options.trials, seed=options.seed)
    memory = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 2**20
    print(
        f"{options.scenario} seed {options.seed}: {len(scenario.map.cells):,} cells, "
        f"{len(scenario.robots)} robots, {scenario.steps:,} steps; {learned:.1f} s to learn "
        f"(the first run compiles), {memory:.2f} GB; return {found.in_words('returns')}, all "
        f"arrived {found.in_words('arrived')}, asks {found.in_words('asks')}, "
        f"miscoordinations {found.in_words('miscoordinations')}"
    )


if __name__ == "__main__":
    run_script(main)
