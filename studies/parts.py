# Copyright 2026 The sparse_coord_ros authors
# SPDX-License-Identifier: Apache-2.0
"""What each part of learner voi is worth: teams learn without it. A table of docs/learners.md.

python studies/parts.py [--parts PART...] [--lists LIST...] [--seed N] > docs/tables/parts.md

A learner without a part is the file of `voi` with some lines replaced, in a module of its own. The
table, in Markdown, has a column for each list: what is lost without the part, in points of the
share of the gap, with a bootstrap over buildings, and teams in each, as its standard error, and
failed teams. Teams without the part and with it have the same seeds.
"""

import argparse
import functools
import importlib
import sys
import tempfile
from pathlib import Path
from typing import NamedTuple

import numpy as np
from script import run_script

import sparse_coord_ros as sc
from sparse_coord_ros.base.percents import percent
from sparse_coord_ros.core.learners import voi
from sparse_coord_ros.core.solve.shipped import known_top
from sparse_coord_ros.studies.benchmark import pooled_share
from sparse_coord_ros.studies.lists import LISTS, PENALTY

COLUMNS = {
    "pairs": ("unseen2-pairs", 4, {}),
    "pairs, 2,000 steps": ("unseen2-pairs", 8, {"steps": 2_000}),
    "`block:anywhere`": ("block-pairs", 6, {}),
    "answers that fail": ("percepts", 10, {}),
    "eight robots": ("unseen2-eight", 2, {}),
}
"""List, teams in each building, and settings, by the column's title."""

TRIALS = 500

MADE = "is_known(mind.led[k, x, b], mind.tries[k, x, b]):\n            out ="


class Part(NamedTuple):
    """A part of the learner.

    Attributes:
        words: the row's title: what is done without it.
        lines: lines that are replaced, by the old ones.
        settings: settings that are changed.
    """

    words: str
    lines: dict[str, str]
    settings: dict[str, object] = {}


PARTS = {
    "none": Part("all parts", {}),
    "future": Part(
        "V is max Q\\*, as in line 13",
        {
            "m = best_move(mind.q_star[k, y])\n    if mind.q_star[k, y, COORDINATE]": (
                "m = best_move(mind.q_star[k, y])\n"
                "    if task.actions > 0:\n"
                "        return float(greatest(mind.q_star[k, y], task.actions))\n"
                "    if mind.q_star[k, y, COORDINATE]"
            )
        },
    ),
    "moves": Part(
        "a step teaches only the move that was made",
        {f"if {MADE}": f"if b == move and {MADE}"},
    ),
    "credit": Part("r^C counts once", {}, {"credit": "own"}),
    "worst": Part(
        "the sum of peers, not the worst",
        {
            "if task.robots == 2 or value < values[b]:\n                    values[b] = value": (
                "values[b] += value"
            )
        },
    ),
    "weights": Part(
        "no weights",
        {"min(1.0, alpha * weight_of(made, went, share, b, move))": "min(1.0, alpha)"},
    ),
    "given": Part(
        "moves not given z'", {"\nOWN_TRIES = 2\n": "\nOWN_TRIES = 1_000_000_000\n"}
    ),
    "felt": Part(
        "no r^C of the cells where a step ends",
        {"return r if r != NOT_FELT else 0.0": "return 0.0"},
    ),
    "wall": Part("a wall after one try", {"\nWALL = 6\n": "\nWALL = 1\n"}),
    "arrivals": Part(
        "means over all steps, not over arrivals",
        {"if not follows or mind.last[k, CELL] != x:": "if task.robots > 0:"},
    ),
    "replay": Part(
        "no other cell learns in a step",
        {"again = int(mind.visited[k, int(chance * mind.count[k, 0])])": "again = x"},
    ),
    "share": Part(
        "r^C counts for the team also where no question is answered",
        {"(1.0 - share) * min(weight, 1.0)": "(1.0 - share) * weight"},
    ),
    "patience": Part(
        "no patience", {"\nPATIENCE = 4\n": "\nPATIENCE = 1_000_000_000\n"}
    ),
}


def without(part: str, folder: str) -> type[sc.Learner]:
    """Return the learner without a part."""
    source = Path(voi.__file__).read_text("utf-8")
    changes = {'    name = "voi"\n': f'    name = "without_{part}"\n'}
    changes |= PARTS[part].lines
    for old, new in changes.items():
        if source.count(old) != 1:
            raise SystemExit(f"{part}: voi.py has not one of the lines\n{old}")
        source = source.replace(old, new)
    (Path(folder) / f"without_{part}.py").write_text(source, "utf-8")
    return importlib.import_module(f"without_{part}").Voi


@functools.cache
def ends_of_gap(name: str, number: int) -> tuple[float, float]:
    """Return where the gap of a scenario of a list begins and ends."""
    item = LISTS[name][number]
    settings = {"penalty": PENALTY, **item.settings}
    scenario = sc.load_scenario(item.scenario, **settings)
    low = sc.shortest_paths(scenario).mean("returns")
    return low, known_top(scenario.with_settings({"perception": "always"}))


def stood(learner, column: str, settings, options):
    """Return the teams' returns in each building of a list, and failed teams."""
    name, runs, own = COLUMNS[column]
    returns = []
    failed = 0
    for item in LISTS[name][: options.buildings]:
        chosen = {"penalty": PENALTY, "steps": options.steps, **item.settings}
        scenario = sc.load_scenario(item.scenario, **chosen | own | settings)
        teams = sc.train_many(
            scenario,
            learner,
            runs=options.runs or runs,
            trials=options.trials,
            seed=options.seed,
            history=False,
            jobs=options.jobs,
        )
        measures = sc.by_run([team.measures for team in teams])
        returns.append(measures.each("returns"))
        failed += measures.failed
    return returns, failed


def main() -> None:
    """Let teams learn without each part, and print the table."""
    parser = argparse.ArgumentParser(
        description=__doc__.split("\n")[0],
        formatter_class=argparse.ArgumentDefaultsHelpFormatter,
    )
    parts = [part for part in PARTS if part != "none"]
    parser.add_argument("--parts", nargs="+", default=parts, choices=parts)
    parser.add_argument("--lists", nargs="+", default=[*COLUMNS], choices=COLUMNS)
    parser.add_argument("--runs", type=int, help="teams (default: by list)")
    parser.add_argument("--buildings", type=int, help="the first of each list")
    parser.add_argument("--trials", type=int, default=TRIALS)
    parser.add_argument("--steps", type=int, default=100_000)
    parser.add_argument("--jobs", type=int)
    parser.add_argument("--seed", type=int, default=4_100_000)
    options = parser.parse_args()
    print("| " + " | ".join(["change", *options.lists]) + " |")
    print("| :-- |" + " --: |" * len(options.lists))
    whole = {}
    with tempfile.TemporaryDirectory() as folder:
        sys.path.insert(0, folder)
        for part in ["none", *options.parts]:
            learner = "voi" if part == "none" else without(part, folder)
            cells = [PARTS[part].words]
            for column in options.lists:
                returns, failed = stood(learner, column, PARTS[part].settings, options)
                name = COLUMNS[column][0]
                ends = [ends_of_gap(name, number) for number in range(len(returns))]
                low, high = np.array(ends).T
                if part == "none":
                    whole[column] = returns
                    share, error = pooled_share(returns, low, high)
                    teams = sum(map(len, returns))
                    said = f"{percent(share)} ({100 * error:.1f}); {failed} of {teams}"
                else:
                    pairs = zip(returns, whole[column], strict=True)
                    changes = [partial - complete for partial, complete in pairs]
                    lost, error = pooled_share(changes, np.zeros(len(low)), high - low)
                    said = f"{100 * lost:+.1f} ({100 * error:.1f}); {failed}"
                cells.append(said)
            print("| " + " | ".join(cells) + " |", flush=True)


if __name__ == "__main__":
    run_script(main)
