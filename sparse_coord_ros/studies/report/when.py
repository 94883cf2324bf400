# Copyright 2026 The sparse_coord_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The data of the experiment on when robots should coordinate: points, and their means.

A point is a condition: its ratio (`core.solve.advice`), the questions of a robot, and what its
teams gain. Gains and gaps are counted in questions: so conditions of one ratio weigh the same.
"""

from collections.abc import Iterator, Sequence
from typing import Any

import numpy as np
import pandas as pd

from sparse_coord_ros.base.percents import percent
from sparse_coord_ros.core.game.percepts import chance_of_answer
from sparse_coord_ros.core.learners.registry import learner_of
from sparse_coord_ros.core.solve.advice import (
    in_questions,
    is_avoidable,
    relative_gain,
)
from sparse_coord_ros.core.solve.asking_search import tables_of_policies
from sparse_coord_ros.core.solve.exact import evaluate_exact
from sparse_coord_ros.core.solve.optimum import always_asking, independent_bound
from sparse_coord_ros.core.solve.shipped import shipped_asking_team
from sparse_coord_ros.core.solve.verdict import ENOUGH
from sparse_coord_ros.studies.condition_result import ConditionResult
from sparse_coord_ros.studies.report.charts import BEST_ASKING
from sparse_coord_ros.studies.standings import teams_that_fail

Results = Sequence[ConditionResult]
Row = dict[str, Any]

FACTORED, COOP, CQ = (learner_of(name).title for name in ("factored", "coop", "cq"))
NEVER = "Non-coop., never asks"
LEARNED = {"factored": FACTORED, "coop": COOP, "cq": CQ, "noncoop": NEVER}
"""Lines of the learners of pairs, where each question is answered."""

KINDS = {
    "together:anywhere": "in one cell, anywhere",
    "swap": "exchange of cells",
    "block": "a doorway holds one robot",
    "block:anywhere": "a cell holds one robot",
}
"""Lines of Factored where pairs interact in other ways than in one doorway."""

ALWAYS = "always asks, and pays"
AVOIDABLE_LINE = "pairs with ways apart"
"""The line of Factored where robots can avoid each other for nothing."""

ALWAYS_PAYS = 300.0
"""From this ratio on a team that always asks gains as much as one that learned to ask."""

EDGES = (0.0, 0.3, 1.0, 2.0, 5.0, 10.0, 30.0, 100.0, 300.0, np.inf)
"""Ratios between which conditions are taken together."""

RESAMPLES = 2000
"""Of a bootstrap over maps."""

WIDTH = 0.35
"""Of the weights of `tightness`: 1.4 times as large a ratio is near."""

MOST_CELLS = 30
"""Cells of a map on which the team that always asks is computed: it takes value iteration."""

MOST_SHARE_ERROR = 30.0
"""A share with a larger error says nothing: on some of its maps there is next to no gap."""

TINY = 1e-6
"""Smaller gaps are rounding."""


def points(results: Results) -> pd.DataFrame:
    """Return the points of the experiment, one a row.

    Its columns:

    - `line`: whose point it is; `scenario`, `robots`.
    - `ratio`, `relative_gain`: as of `core.solve.advice`.
    - `undiscounted`: penalty times miscoordinations on shortest paths, in questions.
    - `avoidable`: whether pairs can avoid each other for nothing; False where nobody knows.
    - `questions`: of a robot in an episode, a mean over the teams that arrive.
    - `gained`: what a robot earns more than on shortest paths, in questions.
    - `gap`: what it would earn more at the joint optimum, or at its bound, in questions.
    - `failed`, `teams`: teams that fail, of how many.
    - `half`: share of the teams that close at least half of the gap.
    """
    rows = []
    for one in results:
        rows.append(_learned(one))
        if line_of(one) == FACTORED:
            rows += [*_always(one), *_best(one)]
    return pd.DataFrame(rows)


def with_ways_apart(found: pd.DataFrame) -> pd.DataFrame:
    """Return points without those of pairs that can avoid each other for nothing.

    Those of Factored stay, as a line of their own.
    """
    own = found["avoidable"] & (found["line"] == FACTORED)
    line = found["line"].mask(own, AVOIDABLE_LINE)
    return found.assign(line=line)[~found["avoidable"] | own]


def line_of(result: ConditionResult) -> str:
    """Return the line of a condition."""
    robots = len(result.scenario.robots)
    if robots > 2:
        return f"{robots} robots"
    if result.scenario.interactions in KINDS:
        return KINDS[result.scenario.interactions]
    chance = chance_of_answer(result.scenario)
    if chance < 1.0:
        return f"{percent(chance, whole=True)} of questions answered"
    return LEARNED[result.condition.learner]


def _learned(result: ConditionResult) -> Row:
    arrives = ~teams_that_fail(result)
    returns = result.run_means("returns")
    asks = result.run_means("asks")
    row = _place(result)
    paths = result.reference["returns"]
    share = (returns - paths) / max(result.optimum - paths, TINY)
    return {
        "line": line_of(result),
        **row,
        "questions": asks[arrives].mean() if arrives.any() else np.nan,
        "gained": in_questions(returns.mean() - paths, result.scenario),
        "failed": int((~arrives).sum()),
        "teams": len(returns),
        "half": float((share >= ENOUGH).mean()),
    }


def _always(result: ConditionResult) -> Iterator[Row]:
    """Yield the point of the best team whose robots ask in every step, on a small map."""
    scenario = result.scenario
    if len(scenario.map.cells) > MOST_CELLS:
        return
    value = always_asking(scenario)
    assert value is not None  # pairs on small maps
    gained = value - result.reference["returns"]
    yield {
        "line": ALWAYS,
        **_place(result),
        "questions": np.nan,
        "gained": in_questions(gained, scenario),
    }


def _best(result: ConditionResult) -> Iterator[Row]:
    """Yield the point of the best asking team found, where one is shipped."""
    scenario = result.scenario
    team = shipped_asking_team(scenario)
    if team is None:
        return
    gained = team.value - result.reference["returns"]
    found = evaluate_exact(scenario, tables_of_policies(scenario, team.robots))
    yield {
        "line": BEST_ASKING,
        **_place(result),
        "questions": found.asks.mean,
        "gained": in_questions(gained, scenario),
    }


def _place(result: ConditionResult) -> Row:
    """Return what all points of a condition have in common."""
    scenario = result.scenario
    alone = independent_bound(scenario)
    paths = result.reference["returns"]
    loss = max(alone - paths, 0.0)
    gap = max(result.optimum - paths, 0.0)
    meetings = result.reference["miscoordinations"]
    mean_penalty = -float(np.mean(scenario.penalties))
    avoidable = result.optimum_exact and is_avoidable(loss, gap)
    return {
        "scenario": scenario.name,
        "robots": len(scenario.robots),
        "cost": scenario.ask_cost,
        "ratio": in_questions(loss, scenario),
        "undiscounted": in_questions(meetings * mean_penalty, scenario),
        "relative_gain": relative_gain(gap, scenario),
        "avoidable": avoidable,
        "gap": in_questions(gap, scenario),
    }


def means(found: pd.DataFrame, x: str = "ratio") -> pd.DataFrame:
    """Return the means of each line between `EDGES`, with standard errors.

    Args:
        found: points.
        x: the column that lies between the edges: `ratio` or `relative_gain`.

    Returns:
        A row for each line and interval: `line`, `interval` (its number), x (geometric mean),
        `conditions`, `maps`, `questions`, `share` (of the pooled gap, in questions; NaN where its
        error exceeds `MOST_SHARE_ERROR`), the errors
        `questions_error` and `share_error` (a bootstrap over maps; NaN of a single one),
        `failed`, `teams`, and `half`.
    """
    found = found[(found[x] > 0.0) & (found["gap"] > TINY)]
    interval = np.searchsorted(EDGES, found[x], side="right") - 1
    groups = found.assign(interval=interval).groupby(["line", "interval"], sort=False)
    rows = []
    for (line, number), own in groups:
        middle = float(np.exp(np.log(own[x]).mean()))
        rows.append({"line": line, "interval": number, x: middle, **_mean(own)})
    return pd.DataFrame(rows).sort_values(["line", "interval"], kind="stable")


def interval_name(number: int) -> str:
    """Return the name of an interval between `EDGES`."""
    low, high = EDGES[number : number + 2]
    if low == 0.0:
        return f"< {high:g}"
    if np.isinf(high):
        return f"> {low:g}"
    return f"{low:g} to {high:g}"


def tightness(found: pd.DataFrame, x: str, line: str = FACTORED) -> tuple[float, float]:
    """Return how far the points of a line lie from the curve of Factored over a column.

    The curve at a point is the mean of Factored's points of other maps, weighted by their
    distance: a Gaussian on the logarithm of x. All columns are judged by the same points: those
    whose ratio lies between the first and the last of the inner `EDGES`, and that have a gap.

    Args:
        found: points.
        x: the column.
        line: whose points; where robots interact in other ways they do not make the curve.

    Returns:
        Root mean squares: in questions, and in the share of the gap (-1 where it is less).
    """
    kept = found[~found["avoidable"] & found["questions"].notna()]
    kept = kept[kept["ratio"].between(EDGES[1], EDGES[-2]) & (kept["gap"] > TINY)]
    kept = kept.assign(share=(kept["gained"] / kept["gap"]).clip(lower=-1.0))
    own = kept[kept["line"] == line]
    curve = kept[kept["line"] == FACTORED]
    apart = np.log(own[x].to_numpy())[:, None] - np.log(curve[x].to_numpy())
    weight = np.exp(-0.5 * (apart / WIDTH) ** 2)
    weight *= own["scenario"].to_numpy()[:, None] != curve["scenario"].to_numpy()
    rest = []
    for measure in ("questions", "share"):
        expected = weight @ curve[measure].to_numpy() / weight.sum(axis=1)
        missed = own[measure].to_numpy() - expected
        rest.append(float(np.sqrt(np.mean(missed**2))))
    return rest[0], rest[1]


def _mean(own: pd.DataFrame) -> Row:
    maps = own["scenario"].nunique()
    columns = ["questions", "asked", "gained", "gap"]
    known = own.assign(asked=own["questions"].notna().astype(float))
    sums: np.ndarray = known.groupby("scenario")[columns].sum().to_numpy(dtype=float)
    rng = np.random.default_rng(0)
    times = rng.multinomial(maps, np.full(maps, 1.0 / maps), size=RESAMPLES)
    drawn = times @ sums
    asked = drawn[drawn[:, 1] > 0.0]
    questions = asked[:, 0] / asked[:, 1]
    share_error = _spread(drawn[:, 2] / drawn[:, 3], maps)
    said = not share_error > MOST_SHARE_ERROR
    return {
        "conditions": len(own),
        "maps": maps,
        "questions": own["questions"].mean(),
        "questions_error": _spread(questions, maps),
        "share": own["gained"].sum() / own["gap"].sum() if said else np.nan,
        "share_error": share_error,
        "failed": own["failed"].sum(),
        "teams": own["teams"].sum(),
        "half": own["half"].mean(),
    }


def _spread(resampled: np.ndarray, maps: int) -> float:
    """Return the standard error that resamples of maps tell; NaN of a single map."""
    if maps < 2 or len(resampled) < 2:
        return np.nan
    return float(resampled.std(ddof=1))
