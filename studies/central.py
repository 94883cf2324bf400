# Copyright 2026 The sparse_coord_ros authors
# SPDX-License-Identifier: Apache-2.0
"""A central learner on the leaderboard: sparse cooperative Q-learning. docs/leaderboard.md.

python studies/central.py [--lists LIST...] [--buildings N] [--teams N] [--steps N] [--seed N]

The rule is that of examples/sparse_cooperative.py. It is another class of teams: one choice for
both robots, which see each other for nothing; so it can close more than 100 % of the gap, which
ends at the best asking team found. The table has the share of the pooled gap, and failed teams.
"""

import argparse
import sys
from pathlib import Path

import numpy as np
import pandas as pd

import sparse_coord_ros as sc
from sparse_coord_ros.base.errors import SparseCoordError
from sparse_coord_ros.core.runs.measures import fails
from sparse_coord_ros.studies.lists import LISTS

sys.path.insert(0, str(Path(__file__).parents[1] / "examples"))
from sparse_cooperative import LIKE_VOI, learn, play  # noqa: E402

NAMES = ["paper", "unseen2-pairs", "swap-pairs", "block-pairs"]
"""Lists of two robots with sure percepts."""


def main() -> None:
    """Let teams learn in each scenario of the lists, and print how they stand."""
    parser = argparse.ArgumentParser(
        description=__doc__.split("\n")[0],
        formatter_class=argparse.ArgumentDefaultsHelpFormatter,
    )
    parser.add_argument("--lists", nargs="+", default=NAMES, choices=NAMES)
    parser.add_argument("--buildings", type=int, help="of each list (default: all)")
    parser.add_argument("--teams", type=int, default=20, help="in each scenario")
    parser.add_argument("--trials", type=int, default=10_000, help="greedy, of a team")
    parser.add_argument("--steps", type=int, default=100_000)
    parser.add_argument("--seed", type=int, default=4_100_000)
    options = parser.parse_args()
    rows = []
    for name in options.lists:
        gained = gap = failed = 0.0
        items = LISTS[name][: options.buildings]
        for item in items:
            scenario = sc.load_scenario(item.scenario, penalty=-100)
            settings = {**LIKE_VOI, **item.settings, "steps": options.steps}
            scenario = scenario.with_settings(settings)
            teams = learn(scenario, options.teams, options.seed)
            returns, arrived = play(scenario, teams, options.trials, options.seed)
            paths = sc.shortest_paths(scenario).mean("returns")
            gained += returns.mean() - paths
            gap += sc.shipped_asking_team(scenario).value - paths
            failed += sum(fails(one) for one in np.mean(arrived.all(axis=2), axis=1))
            print(f"{item.scenario}: {returns.mean():.2f}", flush=True)
        rows.append(
            {
                "list": name,
                "share of the gap": gained / gap,
                "failed": int(failed),
                "teams": options.teams * len(items),
            }
        )
    print(pd.DataFrame(rows).round(3).to_string(index=False))


if __name__ == "__main__":
    try:
        main()
    except SparseCoordError as error:
        print(f"error: {error}", file=sys.stderr)
        sys.exit(2)
