# Copyright 2026 The sparse_coord_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Robots that know their map learn in fewer steps. The study of docs/leaderboard.md.

python studies/known_map.py [--list LIST] [--learners NAME...] [--steps N...] [--runs N]
    [--seed N] > docs/tables/known_map.md

The table, in Markdown, has the share of the gap that teams close after some steps of learning,
failed teams and the least arrival of a team, without the map and with it.
"""

import argparse

from script import run_script

import sparse_coord_ros as sc
from sparse_coord_ros.base.percents import percent

PRIORS = ("none", "map")

HEADS = ["learner", "steps"]
for each in PRIORS:
    HEADS += [f"prior={each}", "failed", "least arrival"]


def row(learner: str, steps: int, options) -> list[str]:
    """Return the cells of a learner after some steps, without the map and with it."""
    cells = [f"`{learner}`", f"{steps:,}"]
    for prior in PRIORS:
        [stood] = sc.benchmark(
            learner,
            lists=[options.list],
            steps=steps,
            runs=options.runs,
            trials=options.trials,
            seed=options.seed,
            prior=prior,
        )
        cells += [
            f"{percent(stood['share'])} ({100 * stood['error']:.1f})",
            f"{stood['failed']} of {stood['teams']}",
            percent(stood["arrived"]),
        ]
    return cells


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(
        description=__doc__.split("\n")[0],
        formatter_class=argparse.ArgumentDefaultsHelpFormatter,
    )
    parser.add_argument("--list", default="unseen2-pairs")
    parser.add_argument("--learners", nargs="+", default=["voi", "coop"])
    steps = [2_000, 5_000, 10_000, 100_000]
    parser.add_argument("--steps", type=int, nargs="+", default=steps)
    parser.add_argument("--runs", type=int, default=20)
    parser.add_argument("--trials", type=int, default=200)
    parser.add_argument("--seed", type=int, default=4_100_000)
    options = parser.parse_args()
    print("| " + " | ".join(HEADS) + " |")
    print("| :-- |" + " --: |" * (len(HEADS) - 1))
    for learner in options.learners:
        for steps in options.steps:
            print("| " + " | ".join(row(learner, steps, options)) + " |", flush=True)


if __name__ == "__main__":
    run_script(main)
