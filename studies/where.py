# Copyright 2026 The sparse_coord_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Where on the map do robots ask? The study of docs/paper.md's central claim.

python studies/where.py [--scenarios NAME...] [--learner NAME] [--runs N] [--trials N] [--steps N]
    [--seed N] [--out RESULTS] > docs/tables/where.md

The table, in Markdown, has, at a penalty of -100, the questions of a robot in an episode, and the
share of them that it asks near a doorway, at most two moves away; beside it the share of their
time that robots spend there, and the share of the cells there. With `--out` the results are kept:
`sparse_coord plot RESULTS --what asks` draws the maps.
"""

import argparse

import numpy as np
from script import run_script

import sparse_coord_ros as sc
from sparse_coord_ros.base.percents import percent

NEAR = 2
SCENARIOS = ["env1", "env2-2r", "env2-4r", "cit", "cmu", "isr", "mit", "pentagon"]
SCENARIOS += ["suny"]


def near_doorways(grid) -> np.ndarray:
    """Return whether a doorway is at most `NEAR` moves away; (cells,)."""
    near = np.zeros(len(grid.cells), dtype=bool)
    for doorway in grid.doorways:
        moves = grid.distances_to(doorway)
        near |= (0 <= moves) & (moves <= NEAR)
    return near


def main() -> None:
    """Let teams learn, and print the table."""
    parser = argparse.ArgumentParser(
        description=__doc__.split("\n")[0],
        formatter_class=argparse.ArgumentDefaultsHelpFormatter,
    )
    parser.add_argument("--scenarios", nargs="+", default=SCENARIOS)
    parser.add_argument("--learner", default="coop")
    parser.add_argument("--runs", type=int, default=100)
    parser.add_argument("--trials", type=int, default=1000)
    parser.add_argument("--steps", type=int, default=100_000)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--out", help="results directory")
    options = parser.parse_args()
    heads = ["scenario", "asks", "asked near", "time near", "cells near"]
    print("| " + " | ".join(heads) + " |\n| :-- |" + " --: |" * (len(heads) - 1))
    for name in options.scenarios:
        [result] = sc.sweep(
            sc.load_scenario(name, steps=options.steps),
            {"penalty": [-100]},
            learner=options.learner,
            out=options.out,
            runs=options.runs,
            trials=options.trials,
            seed=options.seed,
        ).values()
        near = near_doorways(result.scenario.map)
        measures = result.measures
        asked = measures.asked
        stays = measures.stays
        asked_near = asked[:, near].sum() / (asked.sum() or np.nan)
        cells = [
            name,
            f"{measures.mean('asks'):.2f} ({measures.error('asks'):.2f})",
            "-" if np.isnan(asked_near) else percent(asked_near),
            percent(stays[:, near].sum() / stays.sum()),
            percent(near.mean()),
        ]
        print("| " + " | ".join(cells) + " |", flush=True)


# plain Python learns in processes, which import this file again
if __name__ == "__main__":
    run_script(main)
