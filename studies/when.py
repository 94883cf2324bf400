# Copyright 2026 The sparse_coord_ros authors
# SPDX-License-Identifier: Apache-2.0
"""When should robots coordinate? The study of docs/when.md.

python studies/when.py [--maps NAME...] [--runs N] [--seed N] [--out FILE.csv] [--figure FILE.png]
    [--tables FOLDER]
python studies/when.py --found FILE.csv --figure FILE.png --tables FOLDER
python studies/when.py --advice --runs 6 --seed 6100000

Teams that know their map learn on many maps, at several penalties, costs of a question and
chances of an answer. The *possible gain* of a condition is what a robot can win by coordination,
in questions: the joint optimum less shortest paths, divided by the cost of a question, times the
square of the chance of an answer. (Two robots see each other if both are answered. Of larger
teams the gain ends at robots alone in the world.)

Tables in Markdown have, by the possible gain, the questions of a robot in an episode, and the
share of the possible gain that teams win: pooled, in questions, with a bootstrap over maps as
standard error. `--found` prints them of an earlier file. `--advice`
uses buildings by which no threshold of the advice was chosen, and has a table by what the advice
said beforehand. The CSV file has each condition.
"""

import argparse
import sys
from pathlib import Path

import numpy as np
import pandas as pd
from script import run_script

import sparse_coord_ros as sc
from sparse_coord_ros.base.palette import LINE_COLOURS
from sparse_coord_ros.core.game.percepts import chance_of_answer
from sparse_coord_ros.core.learners.registry import learner_of
from sparse_coord_ros.core.runs.measures import fails
from sparse_coord_ros.core.solve.advice import (
    AVOIDABLE,
    MAY_PAY,
    WILL_NOT_PAY,
    WILL_PAY,
    advice,
    in_questions,
    loss_of_ignoring,
    relative_gain,
)
from sparse_coord_ros.core.solve.optimum import payment, successors
from sparse_coord_ros.show.charts import STYLES

LEARNER = "voi"
"""Whose teams the study is about; other learners stand beside it in one part."""

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
    "all costs": (PAIRS, {"penalty": PENALTIES, "ask_cost": COSTS}),
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
"""Maps of each part, and what varies; `LEARNER` learns where none is named."""

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

EDGES = [0, 0.3, 1, 3, 10, 30, 100, np.inf]
"""Possible gains between which conditions are taken together."""

HEADS = ("< 0.3", *("0.3 to 1", "1 to 3", "3 to 10", "10 to 30", "30 to 100"), "> 100")

RESAMPLES = 1000
"""Of a bootstrap."""

LOUD = 30
"""A share of the gap with a larger error says nothing, and is left out."""

FEW = 0.2
"""Robots that ask less often in an episode hardly ask."""

BEST = "best asking team found"
ALWAYS = "always asks, and pays"

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
    close_half = (returns - paths) / max(gap, TINY) >= 0.5
    hardly_ask = measures.each("asks") < FEW
    said = advice(scenario).kind
    right = {
        WILL_PAY: close_half,
        WILL_NOT_PAY: hardly_ask,
        AVOIDABLE: close_half & hardly_ask,
        MAY_PAY: np.nan,
    }
    return {
        "part": part,
        "line": line_of(part, result),
        "scenario": scenario.name,
        "kind": kind_of(scenario.name),
        "penalty": scenario.penalty,
        "ask_cost": scenario.ask_cost,
        "chance": chance_of_answer(scenario),
        "ratio": in_questions(loss_of_ignoring(scenario), scenario),
        "possible_gain": relative_gain(gap, scenario),
        "advice": said,
        "questions": np.mean(measures.each("asks")[~failed])
        if not failed.all()
        else np.nan,
        "gained": in_questions(returns.mean() - paths, scenario),
        "gap": in_questions(gap, scenario),
        "close_half": close_half.mean(),
        "right": np.mean(right[said]),
        "failed": failed.sum(),
        "teams": len(failed),
    }


def line_of(part: str, result) -> str:
    """Return the line of the tables to which a condition belongs."""
    robots = len(result.scenario.robots)
    if part in ("learners", "all costs"):
        return result.learner.label
    if robots > 2:
        return f"{robots} robots"
    return part


def kind_of(scenario: str) -> str:
    """Return the kind of a building by its name."""
    if scenario.startswith("unseen1"):
        return scenario.split("-")[1]
    return "office" if scenario.startswith("building") else "the paper's"


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
    values = {BEST: None if known is None else known.value}
    if len(scenario.map.cells) <= SMALL:
        values[ALWAYS] = always_asking(scenario)
    for line, value in values.items():
        if value is not None:
            gained = in_questions(value - paths, scenario)
            unknown = dict.fromkeys(("questions", "close_half", "right"), np.nan)
            none = dict.fromkeys(("failed", "teams"), 0)
            yield row | unknown | none | {"line": line, "gained": gained}


def measure(study, options) -> pd.DataFrame:
    """Return a row for each condition of a study."""
    rows = []
    for part, (maps, over) in study.items():
        for name in maps:
            if options.maps and name not in options.maps:
                continue
            scenario = sc.load_scenario(name, prior="map", steps=options.steps)
            print(f"{part}: {name}", file=sys.stderr, flush=True)
            swept = sc.sweep(
                scenario,
                over,
                learner=LEARNER,
                runs=options.runs,
                trials=options.trials,
                seed=options.seed,
            )
            for result in swept.values():
                row = condition(part, result)
                rows.append(row)
                if part == "all costs":
                    paths = result.shortest_paths.mean("returns")
                    rows += yardsticks(row, result.scenario, paths)
    return pd.DataFrame(rows)


MEANS = ("questions", "close_half", "right")
"""Measures of conditions that are averaged; shares of the gap are pooled."""


def pooled(own: pd.DataFrame) -> pd.Series:
    """Return the means of some conditions, and the share of their pooled gap.

    Their standard errors are a bootstrap over maps; NaN of one map.
    """
    found = own[[*MEANS]].mean()
    found["share"] = own["gained"].sum() / own["gap"].sum()
    by_map = own.groupby("scenario")
    maps = len(by_map)
    drawn = np.random.default_rng(0).integers(maps, size=(RESAMPLES, maps))
    errors = {}
    for over, under in [*((name, None) for name in MEANS), ("gained", "gap")]:
        sums = by_map[over].sum().to_numpy()[drawn].sum(axis=1)
        counts = by_map[over].count() if under is None else by_map[under].sum()
        divided = sums / np.maximum(counts.to_numpy()[drawn].sum(axis=1), TINY)
        name = over if under is None else "share"
        errors[f"{name}_error"] = divided.std(ddof=1) if maps > 1 else np.nan
    others = {
        "maps": maps,
        "conditions": len(own),
        "gain": own["possible_gain"].median(),
        "failed": own["failed"].sum(),
        "teams": own["teams"].sum(),
    }
    return pd.Series({**found, **errors, **others})


def averages(found: pd.DataFrame, by: str) -> pd.DataFrame:
    """Return means and errors by lines (or kinds) and by the interval of the possible gain."""
    found = found.assign(
        interval=pd.cut(found["possible_gain"], EDGES, labels=HEADS, right=False)
    )
    groups = found.groupby([by, "interval"], sort=False, observed=True)
    rows = [pooled(own) for _, own in groups]
    return pd.DataFrame(rows, index=groups.groups.keys())


def print_tables(found: pd.DataFrame, folder: str | None) -> None:
    """Print the tables of docs/when.md, or write them."""
    nothing = found["gap"] <= TINY
    own = found[(found["part"] == "all costs") & ~found["line"].isin([BEST, ALWAYS])]
    none = (own["gap"] <= TINY).sum()
    print(f"Nothing can be won in {none} of {len(own)} conditions of pairs.")
    beside = found["part"].isin(["learners", "all costs"])
    both = ("questions", "share")
    tables = {
        "when": table_of(found[beside & ~nothing], "line", both),
        "when_kinds": table_of(own[own["gap"] > TINY], "kind", ("share",)),
        "when_others": table_of(found[~beside & ~nothing], "line", both),
    }
    put(tables, folder)


def put(tables: dict[str, str], folder: str | None) -> None:
    """Write tables as Markdown into a folder; None: print them."""
    for name, text in tables.items():
        if folder is None:
            print(f"\n{text}", end="")
        else:
            (Path(folder) / f"{name}.md").write_text(text, "utf-8")


def table_of(found: pd.DataFrame, by: str, measures: tuple[str, ...]) -> str:
    """Return a table in Markdown: lines or kinds of building by the possible gain."""
    table = averages(found, by)
    heads = [by, "measure", *HEADS, "failed teams"]
    lines = [heads, [":--", ":--", *["--:"] * (len(heads) - 2)]]
    for name, own in table.groupby(level=0, sort=False):
        own = own.droplevel(0)
        teams = own["teams"].sum()
        failed = f"{own['failed'].sum():.0f} of {teams:.0f}" if teams else "-"
        for measure in measures:
            cells = [
                in_words(own.loc[head], measure) if head in own.index else "-"
                for head in HEADS
            ]
            if any(cell != "-" for cell in cells):
                lines.append([name, measure, *cells, failed])
    return in_markdown(lines)


def in_markdown(lines: list[list[str]]) -> str:
    """Return a table in Markdown."""
    return "".join(f"| {' | '.join(line)} |\n" for line in lines)


def in_words(own: pd.Series, measure: str) -> str:
    """Return a cell of a table: a mean with its error, or a dash."""
    value, error = own[[measure, f"{measure}_error"]]
    if np.isnan(value) or error > LOUD:
        return "-"
    words = f"{100 * value:.0f} %", f"{100 * error:.0f}"
    if measure == "questions":
        words = f"{value:.2f}", f"{error:.2f}"
    return f"{words[0]} ({'-' if np.isnan(error) else words[1]})"


ALWAYS_STYLE = {"color": LINE_COLOURS[2], "marker": "s"}
"""How a team that always asks is drawn."""


def draw(found: pd.DataFrame, file: str) -> None:
    """Draw questions and share of the gap of pairs against the possible gain."""
    from matplotlib.figure import Figure

    beside = found[found["part"].isin(["learners", "all costs"])]
    table = averages(beside[beside["gap"] > TINY], "line")
    figure = Figure(figsize=(8, 7), layout="constrained")
    upper, lower = figure.subplots(2, 1, sharex=True)
    main = learner_of(LEARNER).label
    for line, own in table.groupby(level=0, sort=False):
        look = STYLES.get(line, ALWAYS_STYLE)
        own = own.sort_values("gain")
        style = {
            "color": look["color"],
            "marker": look.get("marker", "d"),
            "lw": 2.5 if line == main else 1.2,
            "ls": "none" if line == BEST else "-",
            "label": line,
        }
        for panel, measure in ((upper, "questions"), (lower, "share")):
            known = own[own[measure].notna()]
            panel.errorbar(
                known["gain"],
                known[measure],
                known[f"{measure}_error"].fillna(0),
                **style,
            )
    upper.set(ylabel="questions of a robot in an episode", ylim=(-0.1, 4))
    lower.set(ylabel="share of the possible gain", ylim=(-0.6, 1.05))
    lower.set(xscale="log", xlim=(0.03, 1000))
    lower.set(xlabel="possible gain, in questions (log scale)")
    ticks = [0.1, 1, 10, 100, 1000]
    lower.set_xticks(ticks, [f"{tick:g}" for tick in ticks])
    for panel in (upper, lower):
        panel.grid(alpha=0.3)
    lower.axhline(0.0, color="black", lw=0.8)
    lower.legend()
    figure.savefig(file, dpi=110)


def advice_table(found: pd.DataFrame) -> str:
    """Return how teams stand by what the advice said beforehand."""
    heads = ["condition", "advice", "buildings", "conditions", "win half", "questions"]
    heads += ["advice right", "failed teams"]
    lines = [heads, [":--", *["--:"] * (len(heads) - 1)]]
    groups = found[found["gap"] > TINY].groupby(["line", "advice"], sort=False)
    for (line, said), conditions in groups:
        own = pooled(conditions)
        cells = [line, said, f"{own['maps']:.0f}", f"{own['conditions']:.0f}"]
        cells += [in_words(own, name) for name in ("close_half", "questions", "right")]
        lines.append([*cells, f"{own['failed']:.0f} of {own['teams']:.0f}"])
    return in_markdown(lines)


def main() -> None:
    """Measure, and print the tables."""
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
    parser.add_argument("--found", metavar="FILE.csv", help="an earlier --out")
    parser.add_argument("--out", metavar="FILE.csv", help="a row for each condition")
    parser.add_argument("--figure", metavar="FILE.png")
    parser.add_argument("--tables", metavar="FOLDER", help="write the tables there")
    options = parser.parse_args()
    if options.found:
        found = pd.read_csv(options.found)
    else:
        found = measure(ADVICE if options.advice else STUDY, options)
    if found.empty:
        parser.error("--maps: none of the study's maps has such a name")
    if options.out:
        found.to_csv(options.out, index=False)
    if options.advice:
        put({"advice": advice_table(found)}, options.tables)
        return
    print_tables(found, options.tables)
    if options.figure:
        draw(found, options.figure)


# plain Python learns in processes, which import this file again
if __name__ == "__main__":
    run_script(main)
