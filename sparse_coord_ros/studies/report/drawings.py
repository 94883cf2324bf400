# Copyright 2026 The sparse_coord_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The figures of each experiment."""

import math
from collections.abc import Callable, Collection, Iterable, Mapping, Sequence
from typing import Any

from matplotlib.figure import Figure

from sparse_coord_ros.base.errors import SettingError
from sparse_coord_ros.core.game.settings import as_text
from sparse_coord_ros.core.runs.evaluation import Measure
from sparse_coord_ros.studies.catalogue import LEARNERS
from sparse_coord_ros.studies.report.analysis import difference
from sparse_coord_ros.studies.report.charts import (
    ALL,
    ASKING,
    BASELINE,
    BYTES,
    FACTORED,
    GAIN,
    LABELS,
    NONCOOP,
    ONE,
    Where,
    plot,
    point,
    points,
)
from sparse_coord_ros.studies.report.map_pictures import asked_maps
from sparse_coord_ros.studies.report.rows import by_scenario, names, paper, pick
from sparse_coord_ros.studies.standings import standings
from sparse_coord_ros.studies.store import ConditionResult

MEASURES = ("reward", "miscoordinations", "asks")

MOST_PANELS = 4
"""In a line, of any conditions."""

Results = Sequence[ConditionResult]

Draw = Callable[[str, Results], dict[str, Figure]]
"""Draws results; returns figures by the names of their files, the first one given."""


def figures_of(name: str, results: Results) -> dict[str, Figure]:
    """Return the figures of an experiment, by the names of their files."""
    return DRAWN[name](name, results)


def _comparison(bars: str, *measures: str) -> Draw:
    """Draw learners side by side, ours and the paper's, a panel a scenario and measure."""

    def where(
        result: ConditionResult, whose: str = "ours", shift: float = -1.0
    ) -> dict[str, Any]:
        place = {
            "x": LEARNERS.index(result.condition.learner),
            "tick": result.learner.title,
        }
        line = f"{result.learner.title}, {whose}"
        return {"panel": result.scenario.name, "line": line, "shift": shift, **place}

    def draw(name: str, results: Results) -> dict[str, Figure]:
        shown = []
        for measure in measures:
            shown += points(results, measure, where, bars)
            for one in results:
                printed = paper(one, measure)
                if printed:
                    shown.append(
                        point(printed, measure, bars, **where(one, "paper", 1.0))
                    )
        return {name: plot(shown, 3, bars=bars)}

    return draw


def _swept(x: str = "", *measures: str) -> Draw:
    """Draw learners against a setting."""
    return lambda name, results: {name: swept_figure(results, x, measures or MEASURES)}


def swept_figure(
    results: Results, x: str = "", measures: Sequence[str] = MEASURES
) -> Figure:
    """Draw any conditions against a setting in which they differ; as `ExperimentResults.plot`.

    Args:
        results: the conditions.
        x: the setting; empty: the first in which they differ.
        measures: of `LABELS`.
    """
    results = [one for own in by_scenario(results) for one in own]
    plain = {one.id: one.scenario.plain_settings for one in results}
    own = _varied(results)
    x = x or own[0]
    _check("x", [x], own)
    _check("measure", measures, LABELS)
    order = list(dict.fromkeys(values[x] for values in plain.values()))
    numbers = all(_is_number(value) for value in order)

    def where(one: ConditionResult) -> dict[str, Any]:
        values = plain[one.id]
        others = [
            one.scenario.name,
            *(f"{n}={as_text(values[n])}" for n in own if n != x),
        ]
        place = {"panel": ", ".join(others), "shift": shift_of(one), "xlabel": x}
        if numbers:
            return {**place, "x": values[x]}
        return {**place, "x": order.index(values[x]), "tick": as_text(values[x])}

    shown = [p for measure in measures for p in points(results, measure, where)]
    panels = len({p["panel"] for p in shown})
    columns = min(MOST_PANELS, panels if panels > 1 else len(measures))
    return plot(shown, columns)


def _is_number(value: object) -> bool:
    return isinstance(value, int | float) and not isinstance(value, bool)


def _varied(results: Results) -> list[str]:
    """Return the settings that conditions name and in which they differ; else the penalty."""
    named = dict.fromkeys(key for one in results for key, _ in one.condition.settings)
    values = {name: {getattr(one.scenario, name) for one in results} for name in named}
    return [name for name in named if len(values[name]) > 1] or ["penalty"]


def _check(kind: str, names: Iterable[str], known: Collection[str]) -> None:
    for name in names:
        if name not in known:
            raise SettingError(
                f"plot: {kind} is {name!r}, allowed here: {', '.join(known)}"
            )


def shift_of(result: ConditionResult) -> float:
    """Return by how many marks a learner's points stand aside, so that equal ones are all seen."""
    learner = result.condition.learner
    return LEARNERS.index(learner) - 1.5 if learner in LEARNERS else 0.0


def _ask_cost(name: str, results: Results) -> dict[str, Figure]:
    """Draw Coop. against the cost, beside Non-coop., which never pays it."""

    def where(result: ConditionResult) -> dict[str, Any]:
        return {"x": result.scenario.ask_cost, "xlabel": "ask_cost"}

    coop = pick(results, learner="coop")
    shown = points(coop, "reward", where)
    for base in pick(results, learner="noncoop"):
        name_of_panel = base.scenario.name
        for one in pick(coop, name=name_of_panel):
            place = {
                **where(one),
                "panel": name_of_panel,
                "line": BASELINE,
                "reference": True,
            }
            shown.append(
                point(Measure(base.best("reward").mean, 0, 0), "reward", **place)
            )
    shown += points(coop, "asks", where)
    return {name: plot(shown, len(names(results)))}


def _perception(name: str, results: Results) -> dict[str, Figure]:
    drawn = [one for one in results if one.scenario.perception.kind == "probability"]
    placed = [one for one in results if one not in drawn]
    specs = {one.scenario.perception for one in placed}
    order = sorted(specs, key=lambda spec: spec.numbers or (math.inf,))

    def chance(result: ConditionResult) -> dict[str, Any]:
        return {
            "x": result.scenario.perception.numbers[0],
            "xlabel": "probability of a percept",
            "shift": shift_of(result),
        }

    def place(result: ConditionResult) -> dict[str, Any]:
        numbers = result.scenario.perception.numbers
        return {
            "panel": f"{result.scenario.name}, by place",
            "x": order.index(result.scenario.perception),
            "tick": f"{numbers[0]:g}" if numbers else "sight",
            "xlabel": "range [cells]; sight: line of sight",
        }

    groups: list[tuple[Results, Where]] = [(drawn, chance), (placed, place)]
    shown = [
        p
        for own, where in groups
        for measure in ("reward", "asks")
        for p in points(own, measure, where)
    ]
    return {name: plot(shown, len(names(results)))}


def crowd_line(result: ConditionResult) -> str:
    """Return the learner of a crowd, with whom it perceives."""
    if result.condition.learner != "coop":
        return result.learner.title
    return {"one": ONE, "all": ALL}[result.scenario.peers]


def crowd_gains(results: Results) -> dict[str, list[Measure]]:
    """Return by how much each way to coordinate is worth more than Non-coop., by team size."""
    base = pick(results, learner="noncoop")
    coop = pick(results, learner="coop")
    ways = {
        ONE: pick(coop, peers="one"),
        ALL: pick(coop, peers="all"),
        FACTORED: pick(results, learner="factored"),
    }
    return {line: list(map(difference, own, base)) for line, own in ways.items()}


def _crowd(name: str, results: Results) -> dict[str, Figure]:
    lines = (NONCOOP, ONE, ALL, FACTORED)

    def where(result: ConditionResult, end: str = "") -> dict[str, Any]:
        x = len(result.scenario.robots)
        line = crowd_line(result)
        place = {"panel": "", "x": x, "shift": lines.index(line) - 1.5}
        return {**place, "line": line + end, "xlabel": "robots"}

    shown = points(results, "reward", where) + points(results, "loss", where)
    shown = [
        p for p in shown if p["line"] != ASKING
    ]  # known for two robots only: no line
    own = {line: [one for one in results if crowd_line(one) == line] for line in lines}
    gains = crowd_gains(results)
    for line, gained in gains.items():
        shown += [
            point(g, GAIN, **where(one))
            for one, g in zip(own[line], gained, strict=True)
        ]
    asking = [one for one in results if one.learner.asks]
    shown += points(results, "miscoordinations", where) + points(asking, "asks", where)
    for one in asking:
        shown.append(point(Measure(one.visited_bytes, 0, 0), BYTES, **where(one)))
        if one.condition.learner == "coop":
            place = where(one, ", dense table")
            shown.append(point(Measure(one.dense_bytes, 0, 0), BYTES, **place))
    return {name: plot(shown, 3)}


def _figure4(name: str, results: Results) -> dict[str, Figure]:
    """Draw losses, not rewards: those of different scenarios can share an axis."""
    return {
        name: swept_figure(results, "penalty", ["loss"]),
        f"{name}_variance": swept_figure(results, "penalty", ["variance"]),
    }


def _unseen(name: str, results: Results) -> dict[str, Figure]:
    shown = []
    kinds = list(dict.fromkeys(one.scenario.name.split("-")[1] for one in results))
    for own in (pick(results, learner=learner) for learner in LEARNERS):
        for where, one in standings(own, by_kind=True).items():
            team, kind = where.split()
            shown.append(
                point(
                    one.share,
                    "share of the gap",
                    panel=f"{team.removesuffix('r')} robots",
                    line=own[0].learner.title,
                    x=kinds.index(kind),
                    tick=kind,
                    shift=shift_of(own[0]),
                    runs=own[0].runs,
                )
            )
    return {name: plot(shown, 3, 4.2, bars="bootstrap")}


DRAWN: Mapping[str, Draw] = {
    "table1": _comparison("spread", "reward"),
    "table2": _comparison("spread", "time_to_goal", "miscoordinations"),
    "table3": _comparison("spread", "reward"),
    "figure4": _figure4,
    "penalty100": _comparison("standard_error", "reward"),
    "ask_cost": _ask_cost,
    "perception": _perception,
    "uneven": _swept("common_reward"),
    "crowd": _crowd,
    "where": lambda name, results: {name: asked_maps(results)},
    "unseen": _unseen,
    "conditions": _swept(),
}
"""What draws each experiment; and `conditions`, what a results directory has, whatever it is."""
