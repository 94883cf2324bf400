# Copyright 2026 The sparse_coord_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Robots that know their map learn in fewer steps. The study of docs/leaderboard.md.

python studies/known_map.py [--lists LIST...] [--learners NAME...] [--steps N...] [--runs N]
    [--seed N] [--picture FILE.png]

The table has the share of the gap that teams close after some steps of learning, and failed
teams, without the map and with it. `--picture` draws the shares against the steps.
"""

import argparse
import sys

import pandas as pd

import sparse_coord_ros as sc
from sparse_coord_ros.base.errors import SparseCoordError

PRIORS = ("none", "map")


def measure(options) -> pd.DataFrame:
    """Return how teams stand after each number of steps."""
    rows = []
    for name in options.lists:
        for learner in options.learners:
            for prior in PRIORS:
                for steps in options.steps:
                    [stood] = sc.benchmark(
                        learner,
                        lists=[name],
                        steps=steps,
                        runs=options.runs,
                        trials=options.trials,
                        seed=options.seed,
                        prior=prior,
                    )
                    row = {**stood, "prior": prior, "steps": steps}
                    print(row, flush=True)
                    rows.append(row)
    return pd.DataFrame(rows)


def draw(found: pd.DataFrame, file: str) -> None:
    """Draw a panel for each list: solid lines with the map, dashed ones without it."""
    from matplotlib.figure import Figure

    lists = list(dict.fromkeys(found["list"]))
    figure = Figure(figsize=(5 * len(lists), 4), layout="constrained")
    panels = figure.subplots(1, len(lists), squeeze=False)[0]
    colours = {learner: f"C{n}" for n, learner in enumerate(found["learner"].unique())}
    for panel, name in zip(panels, lists, strict=True):
        own = found[found["list"] == name]
        for (learner, prior), line in own.groupby(["learner", "prior"], sort=False):
            style = {"color": colours[learner], "ls": "-" if prior == "map" else "--"}
            label = f"{learner}, prior={prior}"
            panel.errorbar(
                line["steps"], line["share"], line["error"], label=label, **style
            )
        panel.set(xscale="log", xlabel="steps of learning", title=name)
        panel.set(ylabel="share of the gap", ylim=(-0.5, 1.05))
        panel.legend()
    figure.savefig(file, dpi=110)


def main() -> None:
    """Measure, print the table, and draw."""
    parser = argparse.ArgumentParser(
        description=__doc__.split("\n")[0],
        formatter_class=argparse.ArgumentDefaultsHelpFormatter,
    )
    parser.add_argument("--lists", nargs="+", default=["unseen2-pairs"])
    parser.add_argument("--learners", nargs="+", default=["voi", "coop"])
    steps = [2_000, 5_000, 10_000, 100_000]
    parser.add_argument("--steps", type=int, nargs="+", default=steps)
    parser.add_argument("--runs", type=int, default=20)
    parser.add_argument("--trials", type=int, default=500)
    parser.add_argument("--seed", type=int, default=2_600_000)
    parser.add_argument("--picture", metavar="FILE.png")
    options = parser.parse_args()
    found = measure(options)
    print(found.round(3).to_string(index=False))
    if options.picture:
        draw(found, options.picture)


# plain Python learns in processes, which import this file again
if __name__ == "__main__":
    try:
        main()
    except SparseCoordError as error:
        print(f"error: {error}", file=sys.stderr)
        sys.exit(2)
