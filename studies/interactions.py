# Copyright 2026 The sparse_coord_ros authors
# SPDX-License-Identifier: Apache-2.0
"""What learners reach in each kind of interaction. The studies of docs/learners.md.

python studies/interactions.py [--kinds KIND...] [--seeds N...] [--runs N] [--steps N] [--seed N]

Pairs learn in generated buildings whose gap, from shortest paths to the joint optimum, is 3 or
more; penalty -100. The table has, by interaction and learner, the share of the pooled gap,
failed teams and questions of a robot.
"""

import argparse
import sys

import numpy as np
import pandas as pd

import sparse_coord_ros as sc
from sparse_coord_ros.base.errors import SparseCoordError

KINDS = ("door", "doors", "corridor", "rooms", "loop", "crossing")
LEAST_GAP = 3.0


LEARNERS = ("voi", "coop", "cq", "joint")
INTERACTIONS = ("swap", "block", "block:anywhere")


def with_a_gap(interactions: str, options):
    """Yield the scenarios, with the value of shortest paths and the joint optimum."""
    for kind in options.kinds:
        for seed in options.seeds:
            scenario = sc.load_scenario(
                f"unseen1-{kind}-2r-{seed}",
                interactions=interactions,
                penalty=-100,
                steps=options.steps,
            )
            paths = sc.shortest_paths(scenario).mean("returns")
            best = sc.optimum(scenario).value
            if best >= paths + LEAST_GAP:
                yield scenario, paths, best


def stood(interactions: str, learner: str, options) -> dict[str, object]:
    """Return how the teams of a learner stand."""
    gained, gaps, asks, failed, teams = [], [], [], 0, 0
    for scenario, paths, best in with_a_gap(interactions, options):
        found = sc.train_many(
            scenario, learner, runs=options.runs, trials=100, seed=options.seed
        )
        measures = sc.by_run(run.measures for run in found)
        asks += measures.each("asks").tolist()
        failed += measures.failed
        teams += len(found)
        gained.append(measures.mean("returns") - paths)
        gaps.append(best - paths)
    row = {"interactions": interactions, "learner": learner, "buildings": len(gaps)}
    if not gaps:
        return row
    return row | {
        "share of the gap": np.sum(gained) / np.sum(gaps),
        "worst building": np.min(np.divide(gained, gaps)),
        "failed": failed,
        "teams": teams,
        "asks": np.mean(asks),
    }


def main() -> None:
    """Let teams learn, and print the table."""
    parser = argparse.ArgumentParser(
        description=__doc__.split("\n")[0],
        formatter_class=argparse.ArgumentDefaultsHelpFormatter,
    )
    seeds = list(range(1, 17, 2))
    parser.add_argument("--seeds", type=int, nargs="+", default=seeds, help="buildings")
    parser.add_argument(
        "--kinds", nargs="+", default=KINDS, choices=KINDS, help="of buildings"
    )
    parser.add_argument("--runs", type=int, default=4)
    parser.add_argument("--steps", type=int, default=100_000)
    parser.add_argument("--seed", type=int, default=77_000, help="of the first team")
    options = parser.parse_args()
    rows = []
    for interactions in INTERACTIONS:
        for learner in LEARNERS:
            rows.append(stood(interactions, learner, options))
            print(rows[-1], flush=True)
    print(pd.DataFrame(rows).round(3).to_string(index=False))


# plain Python learns in processes, which import this file again
if __name__ == "__main__":
    try:
        main()
    except SparseCoordError as error:
        print(f"error: {error}", file=sys.stderr)
        sys.exit(2)
