# Copyright 2026 The sparse_coord_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The leaderboard: learners, each with its tuned settings, in all lists. docs/leaderboard.md.

python studies/leaderboard.py [--lists LIST...] [--runs N] [--trials N] [--steps N] [--seed N]
python studies/leaderboard.py --tune --runs 6 --seed 3100000

It prints a table: the share of the gap of each entry in each list, failed teams, the least
number of steps that closes 90 % of the gap, and processor seconds of a learning run. `--tune`
prints the twelve trials by which the settings of each learner were chosen, on buildings that no
list of the leaderboard has. The upper bounds of larger teams come with the package:
studies/group_bound.py computes them.
"""

import argparse
import sys
import time

import pandas as pd

import sparse_coord_ros as sc
from sparse_coord_ros.base.errors import SparseCoordError
from sparse_coord_ros.core.learners.hysteretic import (
    Hysteretic,
    hysteretic_update,
)

LISTS = [
    *("paper", "crowds", "unseen2-pairs", "unseen2-four", "unseen2-eight"),
    *("swap-pairs", "block-pairs", "percepts"),
]

LIKE_FACTORED = {
    "epsilon": "linear:0.3:0.02:0.8",
    "starts": "exploring:1:0:0.5",
    "step_size": "floored:0.6:0.1:0.01",
}
TEXTBOOK = {
    "q_star_init": 0,
    "epsilon": "constant:0.1",
    "step_size": "constant:0.1",
    "starts": "fixed",
}
"""Plain Q-learning: values begin at 0, everything else stays as it is."""

ENTRIES = {
    "factored": ("factored", {"starts": "exploring:1:0:0.3"}),
    "coop, tuned": ("coop", {**LIKE_FACTORED, "credit": "team"}),
    "coop, the defaults": ("coop", {}),
    "cq, all peers": ("cq", {"peers": "all", "starts": "exploring:1:0:0.5"}),
    "joint": ("joint", {"step_size": "constant:0.1"}),
    "hysteretic": ("hysteretic", LIKE_FACTORED),
    "independent, tuned": ("noncoop", LIKE_FACTORED),
    "independent, as its users start it": ("noncoop", TEXTBOOK),
}
"""Learner and settings, by the entry's title."""

BUDGETS = (2_000, 5_000, 10_000, 30_000)
"""Steps that are tried before the whole budget."""

NEARLY_ALL = 0.9


class Tenth(Hysteretic):
    """Learns bad news by a tenth of the step size."""

    @staticmethod
    def learn(mind, task, k, now, after):
        """Update Q*."""
        hysteretic_update(mind, task, k, now, after, 0.1)


class Third(Hysteretic):
    """Learns bad news by three tenths of the step size."""

    @staticmethod
    def learn(mind, task, k, now, after):
        """Update Q*."""
        hysteretic_update(mind, task, k, now, after, 0.3)


PROTOCOLS = [
    {},
    {"epsilon": "linear:0.3:0.02:0.8"},
    {"epsilon": "linear:0.05:0.02:0.8"},
    {"step_size": "floored:0.6:0.1:0.01"},
    {"step_size": "floored:0.7:0.05:0.01"},
    {"step_size": "constant:0.1"},
    {"starts": "exploring:1:0:0.5"},
    {"starts": "exploring:1:0.2:0.8"},
    {"credit": "team"},
    LIKE_FACTORED,
    {**LIKE_FACTORED, "credit": "team"},
]
SOME = [{}, {"epsilon": "linear:0.3:0.02:0.8"}, LIKE_FACTORED]
SOME += [{"step_size": "constant:0.1"}]
NUMBERS = [
    {},
    *({"step_size": f"floored:{power}:0.1:0.01"} for power in (0.5, 0.7)),
    *({"step_size": f"floored:0.6:{floor}"} for floor in ("0.2:0.01", "0.05:0.01")),
    {"step_size": "floored:0.6:0.1:0.03"},
    *({"epsilon": f"linear:{ends}:0.8"} for ends in ("0.2:0.02", "0.5:0.02", "0.3:0")),
    *({"starts": f"exploring:1:0:{share}"} for share in (0.3, 0.8)),
    {"q_coord_init": 50},
]
TRIALS = {
    "noncoop": [*PROTOCOLS, TEXTBOOK],
    Tenth: SOME,
    Third: SOME,
    "hysteretic": SOME,
    "coop": [*PROTOCOLS, {"q_coord_init": 20}],
    "cq": [
        {"peers": "all", **one}
        for one in (*PROTOCOLS, {"starts": "exploring:1:0.5:0.8"})
    ],
    "joint": [*PROTOCOLS, {"starts": "exploring:1:0.5:0.8"}],
    "factored": NUMBERS,
}
"""Settings that were tried; of the hysteretic learners beta is 0.1, 0.3 and 0.5 of alpha."""

TASKS = [("tuning-pairs", 10_000), ("tuning-pairs", 100_000), ("tuning-four", 100_000)]


def judge(options) -> pd.DataFrame:
    """Return how each entry stands in each list."""
    rows = []
    for name in options.lists:
        for title, (learner, settings) in ENTRIES.items():
            row = {"list": name, "entry": title}

            def standing(steps, name=name, learner=learner, settings=settings):
                [found] = sc.benchmark(
                    learner,
                    lists=[name],
                    steps=steps,
                    runs=options.runs,
                    trials=options.trials,
                    seed=options.seed,
                    **settings,
                )
                return found

            whole = standing(options.steps)
            print(row, flush=True)
            if whole["share"] is None:
                rows.append(row)
                continue
            row |= {name: whole[name] for name in ("share", "error", "failed", "teams")}
            row["steps to 90 %"] = f"> {options.steps}"
            if whole["share"] >= NEARLY_ALL:
                enough = [steps for steps in BUDGETS if steps < options.steps]
                row["steps to 90 %"] = next(
                    (n for n in enough if standing(n)["share"] >= NEARLY_ALL),
                    options.steps,
                )
            row["seconds a run"] = seconds(learner, settings, options.steps)
            rows.append(row)
    return pd.DataFrame(rows)


def seconds(learner, settings: dict[str, object], steps: int) -> float:
    """Return the processor time of a learning run in env1."""
    scenario = sc.load_scenario("env1", penalty=-100, steps=steps, **settings)
    sc.train(scenario, learner)  # a first one compiles
    began = time.process_time()
    sc.train(scenario, learner)
    return time.process_time() - began


def tune(options) -> pd.DataFrame:
    """Return the share of the gap of each trial of each learner, in the buildings for tuning."""
    rows = []
    for learner, tried in TRIALS.items():
        for settings in tried:
            name = learner if isinstance(learner, str) else learner.__name__
            row = {"learner": name, "settings": settings}
            for name, steps in TASKS:
                [found] = sc.benchmark(
                    learner,
                    lists=[name],
                    steps=min(steps, options.steps),
                    runs=options.runs,
                    trials=options.trials,
                    seed=options.seed,
                    **settings,
                )
                row[f"{name}, {steps}"] = found["share"]
            rows.append(row)
            print(row, flush=True)
    return pd.DataFrame(rows)


def main() -> None:
    """Judge the entries, or tune the learners, and print a table."""
    parser = argparse.ArgumentParser(
        description=__doc__.split("\n")[0],
        formatter_class=argparse.ArgumentDefaultsHelpFormatter,
    )
    parser.add_argument("--tune", action="store_true", help="the twelve trials of each")
    parser.add_argument("--lists", nargs="+", default=LISTS)
    parser.add_argument("--runs", type=int, default=20)
    parser.add_argument("--trials", type=int, default=200)
    parser.add_argument("--steps", type=int, default=100_000)
    parser.add_argument("--seed", type=int, default=4_100_000)
    parser.add_argument("--out", help="a CSV file")
    options = parser.parse_args()
    found = tune(options) if options.tune else judge(options)
    if options.out:
        found.to_csv(options.out, index=False)
    print(found.round(3).to_string(index=False))


# plain Python learns in processes, which import this file again
if __name__ == "__main__":
    try:
        main()
    except SparseCoordError as error:
        print(f"error: {error}", file=sys.stderr)
        sys.exit(2)
