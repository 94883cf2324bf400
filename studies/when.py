# Copyright 2026 The sparse_coord_ros authors
# SPDX-License-Identifier: Apache-2.0
"""When should robots coordinate? The study of docs/when.md.

python studies/when.py [--maps NAME...] [--runs N] [--steps N] [--seed N] [--out FILE.csv]
python studies/when.py --advice --runs 6 --seed 6100000

Teams that know their map learn on many maps, at several penalties, costs of a question and
chances of an answer. The ratio of a condition is what a robot loses if all robots ignore each
other on shortest paths, in questions: divided by the cost of one. The table has, by the ratio,
the questions of a robot in an episode and the share of the gap that teams close: from shortest
paths to the joint optimum (of larger teams: to robots alone in the world). Gains and gaps are
counted in questions, and pooled. `--advice` uses buildings by which no threshold of the advice
was chosen, and has a table by what the advice said beforehand. The CSV file has each condition.
"""

import argparse
import sys

import numpy as np
import pandas as pd

import sparse_coord_ros as sc
from sparse_coord_ros.base.errors import SparseCoordError
from sparse_coord_ros.core.game.percepts import chance_of_answer
from sparse_coord_ros.core.runs.measures import fails
from sparse_coord_ros.core.solve.advice import (
    advice,
    in_questions,
    loss_of_ignoring,
    relative_gain,
)
from sparse_coord_ros.core.solve.optimum import payment, successors

PAIRS = [
    *("env1", "isr", "env2-2r", "mit", "pentagon", "suny", "cit", "cmu"),
    *("unseen1-door-2r-1", "unseen1-door-2r-3", "unseen1-door-2r-101"),
    *("unseen1-doors-2r-1", "unseen1-doors-2r-101"),
    *("unseen1-corridor-2r-1", "unseen1-corridor-2r-3"),
    *("unseen1-rooms-2r-1", "unseen1-rooms-2r-3", "unseen1-rooms-2r-105"),
    *("unseen1-loop-2r-1", "unseen1-loop-2r-105"),
    *("unseen1-crossing-2r-5", "unseen1-crossing-2r-103", "unseen1-crossing-2r-105"),
    *("building-2x2x3-2r-1", "building-2x2x3-2r-3", "building-3x2x3-2r-0"),
    *("building-2x1x4-2r-0", "building-2x1x4-2r-3"),
    *("building-4x1x3-2r-1", "building-4x1x3-2r-3"),
]
"""They meet, on shortest paths, in 0 to 75 of 100 episodes."""

KINDS = ("door", "doors", "corridor", "rooms", "loop", "crossing")
TEAMS = [
    *(f"unseen1-{kind}-4r-1" for kind in KINDS if kind != "corridor"),
    "building-3x2x3-4r-1",
    *(f"unseen1-{kind}-8r-1" for kind in KINDS if kind != "corridor"),
    "building-4x2x3-8r-1",
]

OTHER_PAIRS = [f"unseen1-{kind}-2r-{6_000_000 + n}" for kind in KINDS for n in range(4)]
OTHER_PAIRS += [
    f"building-{shape}-2r-{6_000_000 + n}"
    for shape in ("2x1x4", "2x2x3", "4x1x3", "3x2x3")
    for n in range(2)
]
OTHER_TEAMS = [f"unseen1-{kind}-4r-{6_000_000 + n}" for kind in KINDS for n in range(3)]
"""Buildings by which no threshold of the advice was chosen."""

PENALTIES = (-5, -20, -100, -500)
TEAM_PENALTIES = (-1, -5, -20, -100)
COSTS = (0.2, 1, 5)
MOVE_COSTS = (0.2, 1, 5, 20)
"""Where robots stop each other nobody pays; so the cost of a question varies more."""

STUDY = {
    "learners": (
        PAIRS,
        {"learner": ["coop", "cq", "noncoop"], "penalty": PENALTIES},
    ),
    "factored": (PAIRS, {"penalty": PENALTIES, "ask_cost": COSTS}),
    "half of the questions answered": (
        PAIRS,
        {"penalty": PENALTIES, "perception": ["probability:0.5"]},
    ),
    "one question in five answered": (
        PAIRS,
        {"penalty": PENALTIES, "perception": ["probability:0.2"]},
    ),
    "four and eight robots": (TEAMS, {"penalty": TEAM_PENALTIES}),
    "in one cell, anywhere": (
        PAIRS,
        {
            "interactions": ["together:anywhere"],
            "penalty": PENALTIES,
            "ask_cost": (1, 5),
        },
    ),
    "exchange of cells": (
        PAIRS,
        {"interactions": ["swap"], "penalty": PENALTIES, "ask_cost": (1, 5)},
    ),
    "a doorway holds one robot": (
        PAIRS,
        {"interactions": ["block"], "penalty": [-100], "ask_cost": MOVE_COSTS},
    ),
    "a cell holds one robot": (
        PAIRS,
        {"interactions": ["block:anywhere"], "penalty": [-100], "ask_cost": MOVE_COSTS},
    ),
}
"""Maps of each part, and what varies; the learner is factored where none is named."""

ADVICE = {
    "doorways": (OTHER_PAIRS, {"penalty": PENALTIES, "ask_cost": COSTS}),
    "half of the questions answered": (
        OTHER_PAIRS,
        {"penalty": PENALTIES, "perception": ["probability:0.5"]},
    ),
    "four robots": (OTHER_TEAMS, {"penalty": TEAM_PENALTIES}),
    "exchange of cells": (
        OTHER_PAIRS,
        {"interactions": ["swap"], "penalty": PENALTIES, "ask_cost": (1, 5)},
    ),
    "a cell holds one robot": (
        OTHER_PAIRS,
        {"interactions": ["block:anywhere"], "ask_cost": MOVE_COSTS},
    ),
}

EDGES = [0, 0.3, 1, 2, 5, 10, 30, 100, 300, np.inf]
"""Ratios between which conditions are taken together."""

SMALL = 30
"""Cells of a map on which the team that always asks is computed."""

TINY = 1e-6
"""Smaller gaps are rounding."""


def condition(part: str, result) -> dict[str, object]:
    """Return the row of a condition; gains and gaps are of a robot, in questions."""
    scenario = result.scenario
    paths = result.shortest_paths.mean("returns")
    measures = result.measures
    returns = measures.each("returns")
    failed = np.array([fails(share) for share in measures.arrived])
    gap = max(result.optimum - paths, 0.0)
    share = (returns - paths) / max(gap, TINY)
    line = f"{part}, {result.learner.label}"
    if len(scenario.robots) > 2:
        line = f"{len(scenario.robots)} robots, {result.learner.label}"
    return {
        "line": line,
        "scenario": scenario.name,
        "penalty": scenario.penalty,
        "ask_cost": scenario.ask_cost,
        "chance": chance_of_answer(scenario),
        "ratio": in_questions(loss_of_ignoring(scenario), scenario),
        "possible_gain": relative_gain(gap, scenario),
        "advice": advice(scenario).kind,
        "questions": np.mean(measures.each("asks")[~failed])
        if not failed.all()
        else np.nan,
        "gained": in_questions(returns.mean() - paths, scenario),
        "gap": in_questions(gap, scenario),
        "close_half": np.mean(share >= 0.5),
        "failed": failed.sum(),
        "teams": len(failed),
    }


def always_asking(scenario) -> float:
    """Return the best value of a pair that asks in every step and pays for it.

    It sees as much as the joint optimum; value iteration over the joint states finds it.
    """
    gamma = scenario.discount
    p = scenario.move_success
    goal = tuple(robot.goal for robot in scenario.robots)
    start = tuple(robot.start for robot in scenario.robots)
    first, second = (successors(scenario, k) for k in range(2))
    paid = payment(scenario)
    price = np.full(paid.shape, scenario.ask_cost)
    price[goal[0], :] /= 2
    price[:, goal[1]] /= 2
    value = np.zeros(paid.shape)
    while True:
        entering = gamma * value + paid
        by_first = p * entering[first] + (1 - p) * entering
        best = np.max(
            [p * by_first[:, :, to] + (1 - p) * by_first for to in second], axis=(0, 1)
        )
        best -= price
        best[goal] = scenario.arrival_value
        if np.abs(best - value).max() < 1e-9:
            return float(best[start])
        value = best


def yardsticks(row: dict[str, object], scenario, paths: float):
    """Yield rows of the team that always asks, and of the best asking team found."""
    known = sc.shipped_asking_team(scenario)
    values = {"best asking team found": None if known is None else known.value}
    if len(scenario.map.cells) <= SMALL:
        values["always asks, and pays"] = always_asking(scenario)
    for line, value in values.items():
        if value is not None:
            gained = in_questions(value - paths, scenario)
            nobody = {"questions": np.nan, "close_half": np.nan}
            yield (
                row
                | nobody
                | {
                    "line": line,
                    "gained": gained,
                    "failed": 0,
                    "teams": 0,
                }
            )


def measure(study, options) -> pd.DataFrame:
    """Return a row for each condition of a study."""
    rows = []
    for part, (maps, over) in study.items():
        for name in maps:
            if options.maps and name not in options.maps:
                continue
            scenario = sc.load_scenario(name, prior="map", steps=options.steps)
            print(f"{part}: {name}", flush=True)
            swept = sc.sweep(
                scenario,
                over,
                learner="factored",
                runs=options.runs,
                trials=options.trials,
                seed=options.seed,
            )
            for result in swept.values():
                row = condition(part, result)
                rows.append(row)
                if part == "factored":
                    paths = result.shortest_paths.mean("returns")
                    rows += yardsticks(row, result.scenario, paths)
    return pd.DataFrame(rows)


def pooled(own: pd.DataFrame) -> pd.Series:
    """Return the means of some conditions, and the share of their pooled gap."""
    return pd.Series(
        {
            "maps": own["scenario"].nunique(),
            "conditions": len(own),
            "questions": own["questions"].mean(),
            "share of the gap": own["gained"].sum() / own["gap"].sum(),
            "close half of the gap": own["close_half"].mean(),
            "failed": own["failed"].sum(),
            "teams": own["teams"].sum(),
        }
    )


def main() -> None:
    """Measure, and print the table."""
    parser = argparse.ArgumentParser(
        description=__doc__.split("\n")[0],
        formatter_class=argparse.ArgumentDefaultsHelpFormatter,
    )
    parser.add_argument("--advice", action="store_true", help="test the advice")
    parser.add_argument("--maps", nargs="+", help="some of the maps (default: all)")
    parser.add_argument("--runs", type=int, default=10)
    parser.add_argument("--trials", type=int, default=200)
    parser.add_argument("--steps", type=int, default=30_000)
    parser.add_argument("--seed", type=int, default=2_700_000)
    parser.add_argument("--out", help="a CSV file with a row for each condition")
    options = parser.parse_args()
    found = measure(ADVICE if options.advice else STUDY, options)
    if found.empty:
        parser.error("--maps: none of the study's maps has such a name")
    if options.out:
        found.to_csv(options.out, index=False)
    found = found[found["gap"] > TINY]
    by = "advice"
    if not options.advice:
        by = "interval of the ratio"
        found[by] = pd.cut(found["ratio"], EDGES)
    groups = found.groupby(["line", by], sort=False, observed=True)
    table = pd.DataFrame([pooled(own) for _, own in groups], index=groups.groups.keys())
    print(table.sort_index().round(2).to_string())


# plain Python learns in processes, which import this file again
if __name__ == "__main__":
    try:
        main()
    except SparseCoordError as error:
        print(f"error: {error}", file=sys.stderr)
        sys.exit(2)
