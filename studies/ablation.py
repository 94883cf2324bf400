# Copyright 2026 The sparse_coord_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Which part of the factored learner brings what. For docs/coordination.md and known_map.md.

python studies/ablation.py [--scenarios NAME...] [--runs N] [--trials N] [--steps N] [--seed N]
python studies/ablation.py --teams --runs 10 --seed 2500000

One part of the rule is off, all else is as it is; penalty -100. The table has, by scenario, the
return of a robot with its standard error, and failed teams. `--teams` has two rules of
larger teams against jams, in buildings for validation.
"""

import argparse
import sys

import pandas as pd

import sparse_coord_ros as sc
from sparse_coord_ros.base.errors import SparseCoordError
from sparse_coord_ros.core.game.actions import ACTIONS
from sparse_coord_ros.core.learners.rules import greatest
from sparse_coord_ros.studies.lists import LISTS


class NoLookingBack(sc.Factored):
    """Does not learn the results of moves that it did not make."""

    @staticmethod
    def look_back(mind, task, now):
        """Learn nothing."""


class NoPerceptUpdate(sc.Factored):
    """Learns r_bar from its own moves alone."""

    @staticmethod
    def update_by_percept(mind, task, cell, floor):
        """Correct nothing."""


class NoReplay(sc.Factored):
    """Does not learn from its own model."""

    @staticmethod
    def replay(mind, task, now):
        """Replay nothing."""


class WholeSurplus(sc.Factored):
    """Each peer in the way is credited with all that waiting brings."""

    @staticmethod
    def share_of_surplus(mind, task, first, here):
        """Return the gain of waiting at the first question."""
        return here


class NoLeastWorth(sc.Factored):
    """The values of a cell may fall to 0 in larger teams, too."""

    @staticmethod
    def cell_value(mind, task, cell):
        """Return max_b Q*(cell, b)."""
        return greatest(mind.q_star[cell], len(ACTIONS))


PARTS = {
    "all of it": ("factored", {}),
    "no looking back": (NoLookingBack, {}),
    "r^C counts once": ("factored", {"credit": "own"}),
    "neither": (NoLookingBack, {"credit": "own"}),
    "no percept update of r_bar": (NoPerceptUpdate, {}),
    "no replay": (NoReplay, {}),
}
"""Learner and changed settings."""

TEAM_PARTS = {
    "all of it": ("factored", {}),
    "a surplus is not shared": (WholeSurplus, {}),
    "no least worth": (NoLeastWorth, {}),
    "all of it, prior=map": ("factored", {"prior": "map"}),
}

SCENARIOS = ["env1", "env2-2r", "pentagon", "cmu", "env2-4r", "crowd-8r"]
TEAMS = [
    item.scenario for name in ("four", "eight") for item in LISTS[f"validation-{name}"]
]


def told(scenario, learner, options) -> str:
    """Return the mean return of learned teams, and the number of failed teams."""
    found = sc.train_many(
        scenario,
        learner,
        runs=options.runs,
        trials=options.trials,
        seed=options.seed,
        history=False,
    )
    teams = sc.by_run(run.measures for run in found)
    return f"{teams.in_words('returns')}; {teams.failed} of {len(teams)} fail"


def main() -> None:
    """Let teams learn without each part, and print the table."""
    parser = argparse.ArgumentParser(
        description=__doc__.split("\n")[0],
        formatter_class=argparse.ArgumentDefaultsHelpFormatter,
    )
    parser.add_argument("--teams", action="store_true", help="rules against jams")
    parser.add_argument("--scenarios", nargs="+")
    parser.add_argument("--runs", type=int, default=40)
    parser.add_argument("--trials", type=int, default=200)
    parser.add_argument("--steps", type=int, default=100_000)
    parser.add_argument("--seed", type=int, default=950_000)
    options = parser.parse_args()
    rows = []
    for what, (learner, settings) in (TEAM_PARTS if options.teams else PARTS).items():
        row = {"what": what}
        for name in options.scenarios or (TEAMS if options.teams else SCENARIOS):
            scenario = sc.load_scenario(
                name, penalty=-100, steps=options.steps, **settings
            )
            row[name] = told(scenario, learner, options)
        print(row, flush=True)
        rows.append(row)
    print(pd.DataFrame(rows).set_index("what").T.to_string())


# plain Python learns in processes, which import this file again
if __name__ == "__main__":
    try:
        main()
    except SparseCoordError as error:
        print(f"error: {error}", file=sys.stderr)
        sys.exit(2)
