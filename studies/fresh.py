# Copyright 2026 The sparse_coord_ros authors
# SPDX-License-Identifier: Apache-2.0
"""What a learner reaches in buildings that nobody looked at. A table of docs/leaderboard.md.

python studies/fresh.py [--rows ROW...] [--learner NAME] [--set NAME=VALUE...]

The buildings of each kind are the first from seed `FIRST` on in which coordination can win more
than `CONFLICT`. A gap begins at shortest paths. It ends at the best asking team that a search
found (two robots), at a planner with full sight (four and eight; `studies/unseen.py`), or at
robots that are alone in the world (more). The table is in Markdown. Errors are a bootstrap over
buildings and teams.
"""

import argparse
import sys
import time
from itertools import count

import numpy as np
import unseen

import sparse_coord_ros as sc
from sparse_coord_ros.base.errors import SparseCoordError
from sparse_coord_ros.base.percents import percent
from sparse_coord_ros.core.game.unseen import KINDS
from sparse_coord_ros.studies.benchmark import pooled_share
from sparse_coord_ros.studies.lists import PENALTY

FIRST = 5_100_000
CONFLICT = 1.0
RESTARTS = 20
"""Of a search for the best asking team."""

FEW_STEPS = {"steps": 2_000}
ROWS = {
    "pairs": (2, 4, 10, {}),
    "pairs, 2,000 steps": (2, 4, 10, FEW_STEPS),
    "pairs, 2,000 steps, map known": (2, 4, 10, FEW_STEPS | {"prior": "map"}),
    "swap": (2, 4, 10, {"interactions": "swap"}),
    "block": (2, 4, 10, {"interactions": "block"}),
    "block:anywhere": (2, 4, 10, {"interactions": "block:anywhere"}),
    "four": (4, 2, 4, {}),
    "eight": (8, 2, 2, {}),
    "sixteen": (16, 2, 2, {}),
    "thirty-two": (32, 1, 2, {}),
}
"""Robots, buildings of each kind, teams in each building, and settings."""

OFFICES = {16: "building-3x2x4", 32: "building-4x2x5"}
"""The kind of building of the largest teams; that of 32 robots has 257 cells."""

GAME = ("interactions",)
"""Settings by which buildings are chosen, and where their gaps end."""


def buildings(robots: int, number: int, settings):
    """Yield scenarios with the ends of their gaps."""
    game = {name: settings[name] for name in GAME if name in settings}
    for kind in [OFFICES[robots]] if robots in OFFICES else KINDS:
        found = 0
        for seed in count(FIRST):
            if found == number:
                break
            name = f"{kind}-{robots}r-{seed}"
            if robots not in OFFICES:
                name = f"unseen1-{name}"
            scenario = sc.load_scenario(name, penalty=PENALTY, **game)
            low = sc.shortest_paths(scenario).mean("returns")
            best = sc.optimum(scenario).value
            if robots in (4, 8):
                best = unseen.planned(scenario, PLAN)
            if best <= low + CONFLICT:
                continue
            if robots == 2:
                best = sc.find_asking_team(scenario, restarts=RESTARTS, seed=1).value
            found += 1
            yield scenario, low, best


PLAN = argparse.Namespace(searched=unseen.SEARCHED, judged=unseen.JUDGED)


def row(title: str, options) -> str:
    """Let teams learn in the buildings of a row; return the row."""
    robots, number, runs, settings = ROWS[title]
    known = list(buildings(robots, options.buildings or number, settings))
    learned, arrived, asks = [], [], []
    failed = 0
    for scenario, _, _ in known:
        teams = sc.train_many(
            scenario.with_settings(settings | options.set),
            options.learner,
            runs=options.runs or runs,
            trials=options.trials,
            seed=options.seed,
            history=False,
        )
        measures = sc.by_run([team.measures for team in teams])
        learned.append(measures.each("returns"))
        arrived.append(measures.arrived.min())
        asks.append(measures.mean("asks"))
        failed += measures.failed
    low = np.array([one for _, one, _ in known])
    high = np.array([one for _, _, one in known])
    share, error = pooled_share(learned, low, high)
    shares = [
        (own.mean() - a) / (b - a) for own, a, b in zip(learned, low, high, strict=True)
    ]
    worst = int(np.argmin(shares))
    cells = [
        title,
        f"{percent(share)} ({100 * error:.1f})",
        f"{failed} of {sum(map(len, learned))}",
        percent(min(arrived)),
        f"{np.mean(asks):.2f}",
        f"{percent(shares[worst])}, `{known[worst][0].name}`",
        f"{step_time(known[0][0], settings | options.set, options):.1f}",
    ]
    return "| " + " | ".join(cells) + " |"


def step_time(scenario, settings, options) -> float:
    """Return the processor time of a time step of learning, all robots, in microseconds."""
    scenario = scenario.with_settings(settings)
    began = time.process_time()
    sc.train(scenario, options.learner, seed=options.seed)
    return (time.process_time() - began) / scenario.steps * 1e6


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(
        description=__doc__.split("\n")[0],
        formatter_class=argparse.ArgumentDefaultsHelpFormatter,
    )
    parser.add_argument("--rows", nargs="+", default=[*ROWS], choices=ROWS)
    parser.add_argument("--learner", default="voi")
    parser.add_argument("--set", action="append", default=[], metavar="NAME=VALUE")
    parser.add_argument("--buildings", type=int, help="of each kind (default: by row)")
    parser.add_argument("--runs", type=int, help="teams (default: by row)")
    parser.add_argument("--trials", type=int, default=1000, help="of larger teams")
    parser.add_argument("--seed", type=int, default=5_200_000)
    options = parser.parse_args()
    options.set = dict(one.split("=", 1) for one in options.set)
    heads = (
        "buildings",
        "share of the gap",
        "failed teams",
        "least arrival",
        "questions",
    )
    heads += ("worst building", "us a step")
    print("| " + " | ".join(heads) + " |")
    print("| :-- |" + " --: |" * (len(heads) - 1))
    for title in options.rows:
        print(row(title, options), flush=True)


# plain Python learns in processes, which import this file again
if __name__ == "__main__":
    try:
        main()
    except SparseCoordError as error:
        print(f"error: {error}", file=sys.stderr)
        sys.exit(2)
