# Copyright 2026 The sparse_coord_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The figures: one function for each experiment, and one for any conditions."""

import math
from collections.abc import Callable, Collection, Iterable, Mapping, Sequence
from functools import partial

import pandas as pd
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from sparse_coord_ros.base.errors import SettingError
from sparse_coord_ros.core.game.settings import as_text
from sparse_coord_ros.core.runs.evaluation import Measure
from sparse_coord_ros.core.solve.optimum import independent_bound
from sparse_coord_ros.studies.catalogue import REPORTED_LEARNERS
from sparse_coord_ros.studies.condition_result import ConditionResult
from sparse_coord_ros.studies.report.analysis import difference, loss_alone
from sparse_coord_ros.studies.report.charts import (
    ALL,
    BASELINE,
    BEST_ASKING,
    BOOTSTRAP,
    BOUND,
    ERRORS,
    FACTORED,
    NESTED_TEXT,
    NO_BARS,
    ONE,
    OPTIMUM,
    SHORTEST,
    SPREADS,
    add_legend,
    draw_lines,
    draw_points,
    finish_measure,
    label_axes,
    panel_grid,
)
from sparse_coord_ros.studies.report.data import (
    best_asking_team,
    by_scenario,
    names,
    paper,
    pick,
)
from sparse_coord_ros.studies.report.map_pictures import asked_maps
from sparse_coord_ros.studies.report.when_figures import when, when_kinds, when_more
from sparse_coord_ros.studies.standings import standings

SWEPT_MEASURES = ("returns", "miscoordinations", "asks")
"""What `swept_figure` shows of conditions."""

MOST_COLUMNS = 4
"""Panels in a row of any conditions."""

Results = Sequence[ConditionResult]


def figures_of(name: str, results: Results) -> dict[str, Figure]:
    """Return the figures of an experiment, by the names of their files."""
    return {file: draw(results) for file, draw in DRAWN[name].items()}


def beside_paper(
    results: Results, measures: Sequence[str], bars: str, said: str
) -> Figure:
    """Draw learners side by side, ours and the paper's: Tables 1 to 3, and penalty -100.

    Args:
        results: the conditions.
        measures: a panel for each of these and each scenario.
        bars: the field of a measure that its bar shows.
        said: the legend's text for the bars.
    """
    scenarios = by_scenario(results)
    figure, panels = panel_grid(len(measures) * len(scenarios), columns=3)
    titles = [one.learner.title for one in scenarios[0]]
    for row, measure in enumerate(measures):
        drawn = panels[row * len(scenarios) : (row + 1) * len(scenarios)]
        for axes, own in zip(drawn, scenarios, strict=True):
            ours = measured(own, measure, bars)
            ours["learner"] = ours["line"]
            ours["line"] = ours["line"] + ", ours"
            ours["side"] = -1
            papers = []
            for one in own:
                printed = paper(one, measure)
                if printed is not None:
                    learner = one.learner.title
                    place = {"line": f"{learner}, paper", "learner": learner, "side": 1}
                    papers.append(place | value_and_bar(printed, measure, bars))
            data = pd.concat([ours, pd.DataFrame(papers)], ignore_index=True)
            draw_points(axes, data, "learner", titles)
            axes.set_title(own[0].scenario.name, fontsize=11)
        label_axes(drawn, 3, measure)
        finish_measure(drawn, measure)
    add_legend(figure, said.format(runs=results[0].runs))
    return figure


def ask_cost(results: Results) -> Figure:
    """Draw Coop. against the cost, beside Non-coop., which never pays it."""
    scenarios = by_scenario(results)
    columns = len(scenarios)
    figure, panels = panel_grid(2 * columns, columns)
    upper = panels[:columns]
    asks = panels[columns:]
    for number, own in enumerate(scenarios):
        coop = pick(own, learner="coop")
        [base] = pick(own, learner="noncoop")
        returns = measured(coop, "returns")
        returns[BASELINE] = base.best("returns").mean
        draw_lines(upper[number], returns, "ask_cost")
        draw_lines(asks[number], measured(coop, "asks"), "ask_cost")
        for axes in (upper[number], asks[number]):
            axes.set_title(base.scenario.name, fontsize=11)
    label_axes(upper, columns, "returns")
    label_axes(asks, columns, "asks", "ask_cost")
    finish_measure(upper, "returns")
    finish_measure(asks, "asks")
    add_legend(figure, ERRORS.format(runs=results[0].runs) + NESTED_TEXT)
    return figure


def perception(results: Results) -> Figure:
    """Draw Coop. against the probability of an answer, then by the robots' places."""
    columns = len(names(results))
    figure, panels = panel_grid(4 * columns, columns)
    drawn = [one for one in results if one.scenario.perception.kind == "probability"]
    placed = [one for one in results if one.scenario.perception.kind != "probability"]
    rows = [panels[at * columns : (at + 1) * columns] for at in range(4)]
    for row, measure in zip(rows[:2], ("returns", "asks"), strict=True):
        for axes, own in zip(row, by_scenario(drawn), strict=True):
            data = measured(own, measure)
            data["chance"] = [one.scenario.perception.numbers[0] for one in own]
            draw_lines(axes, data, "chance")
            axes.set_title(own[0].scenario.name, fontsize=11)
    for row, measure in zip(rows[2:], ("returns", "asks"), strict=True):
        for axes, own in zip(row, by_scenario(placed), strict=True):
            data = measured(own, measure)
            data["place"] = [_place_name(one) for one in own]
            draw_points(axes, data, "place", _place_names(placed))
            axes.set_title(f"{own[0].scenario.name}, by place", fontsize=11)
    label_axes(rows[0], columns, "returns")
    label_axes(rows[1], columns, "asks", "probability of an answer")
    label_axes(rows[2], columns, "returns")
    label_axes(rows[3], columns, "asks", "range [cells]; sight: line of sight")
    finish_measure(rows[0] + rows[2], "returns")
    finish_measure(rows[1] + rows[3], "asks")
    add_legend(figure, ERRORS.format(runs=results[0].runs) + NESTED_TEXT)
    return figure


def _place_name(result: ConditionResult) -> str:
    numbers = result.scenario.perception.numbers
    return f"{numbers[0]:g}" if numbers else "sight"


def _place_names(results: Results) -> list[str]:
    """Return the ranges from the smallest on, then line of sight."""
    ordered = sorted(
        results, key=lambda one: one.scenario.perception.numbers or (math.inf,)
    )
    return list(dict.fromkeys(map(_place_name, ordered)))


def crowd(results: Results) -> Figure:
    """Draw six measures against the number of robots."""
    asking = [one for one in results if one.learner.asks]
    data = {
        "returns": _crowd_data(results, "returns"),
        "loss": _crowd_data(results, "loss"),
        "gain": _crowd_gains(results),
        "miscoordinations": _crowd_data(results, "miscoordinations"),
        "asks": _crowd_data(asking, "asks"),
        "bytes": _crowd_bytes(asking),
    }
    figure, panels = panel_grid(len(data), columns=3)
    for axes, (measure, points) in zip(panels, data.items(), strict=True):
        draw_lines(axes, points, "robots")
        label_axes([axes], 1, measure, "robots")
        finish_measure([axes], measure)
    for axes in panels[:3]:
        axes.set_xlabel("")
    add_legend(figure, ERRORS.format(runs=results[0].runs) + NESTED_TEXT)
    return figure


def _crowd_data(results: Results, measure: str) -> pd.DataFrame:
    data = measured(results, measure)
    data["line"] = [crowd_line(one) for one in results]
    data["robots"] = [len(one.scenario.robots) for one in results]
    # The best asking team is known for two robots only, which makes no line.
    return data.drop(columns=BEST_ASKING, errors="ignore")


def _crowd_gains(results: Results) -> pd.DataFrame:
    """Return the gain of each way to coordinate over Non-coop., run by run."""
    sizes = [len(one.scenario.robots) for one in pick(results, learner="noncoop")]
    points = []
    for line, gains in crowd_gains(results).items():
        for robots, gain in zip(sizes, gains, strict=True):
            point = value_and_bar(gain, "gain", "standard_error")
            points.append({"line": line, "robots": robots, **point})
    return pd.DataFrame(points)


def _crowd_bytes(results: Results) -> pd.DataFrame:
    """Return the bytes of the rows visited; for Coop. also those of a dense table."""
    points = []
    for one in results:
        line = crowd_line(one)
        point = {"robots": len(one.scenario.robots), "low": 0.0, "high": 0.0}
        points.append({"line": line, "value": one.visited_bytes, **point})
        if one.condition.learner == "coop":
            dense = {"line": f"{line}, dense table", "value": float(one.dense_bytes)}
            points.append({**dense, **point})
    return pd.DataFrame(points)


def crowd_line(result: ConditionResult) -> str:
    """Return the line of a condition of the crowd: the learner, for Coop. with its peers."""
    if result.condition.learner != "coop":
        return result.learner.title
    return {"one": ONE, "all": ALL}[result.scenario.peers]


def crowd_gains(results: Results) -> dict[str, list[Measure]]:
    """Return the gain of each way to coordinate over Non-coop., by team size."""
    base = pick(results, learner="noncoop")
    coop = pick(results, learner="coop")
    ways = {
        ONE: pick(coop, peers="one"),
        ALL: pick(coop, peers="all"),
        FACTORED: pick(results, learner="factored"),
    }
    return {line: list(map(difference, own, base)) for line, own in ways.items()}


def unseen(results: Results) -> Figure:
    """Draw the share of the gap that each learner closes, by team size and kind of building."""
    kinds = list(dict.fromkeys(one.scenario.name.split("-")[1] for one in results))
    points = []
    for learner in REPORTED_LEARNERS:
        own = pick(results, learner=learner)
        for where, standing in standings(own, by_kind=True).items():
            team, kind = where.split()
            points.append(
                {
                    "team": f"{team.removesuffix('r')} robots",
                    "kind": kind,
                    "line": own[0].learner.title,
                    "side": side_of(learner),
                    **value_and_bar(standing.share, "share", "standard_error"),
                }
            )
    teams = list(pd.DataFrame(points).groupby("team", sort=False))
    figure, panels = panel_grid(len(teams), columns=3, width=4.2)
    for axes, (team_robots, data) in zip(panels, teams, strict=True):
        draw_points(axes, data, "kind", kinds)
        axes.set_title(str(team_robots), fontsize=11)
    label_axes(panels, 3, "share")
    finish_measure(panels, "share")
    add_legend(figure, BOOTSTRAP.format(runs=results[0].runs))
    return figure


def swept_figure(
    results: Results, x: str = "", measures: Sequence[str] = SWEPT_MEASURES
) -> Figure:
    """Draw any conditions against a setting in which they differ: `ExperimentResults.plot`.

    There is a panel for each measure and combination of the other settings. A setting of numbers
    gets an axis of numbers, any other one names.

    Args:
        results: the conditions.
        x: the setting; empty: the first in which they differ.
        measures: of `LABELS`.

    Raises:
        SettingError: the conditions do not differ in `x`, or the measure is unknown.
    """
    results = [one for own in by_scenario(results) for one in own]
    varied = _varied(results)
    x = x or varied[0]
    _check("x", [x], varied)
    _check("measure", measures, MEASURABLE)
    values = list(dict.fromkeys(one.scenario.plain_settings[x] for one in results))
    numbers = all(map(_is_number, values))
    groups = _by_panel(results, [name for name in varied if name != x])
    columns = len(groups) if len(groups) > 1 else len(measures)
    columns = min(MOST_COLUMNS, columns)
    figure, panels = panel_grid(len(measures) * len(groups), columns)
    bars = False
    for row, measure in enumerate(measures):
        drawn = panels[row * len(groups) : (row + 1) * len(groups)]
        for axes, (title, own) in zip(drawn, groups.items(), strict=True):
            data = measured(own, measure)
            bars = bars or bool(data["high"].any())
            _draw_swept(axes, data, x, None if numbers else list(map(as_text, values)))
            axes.set_title(title, fontsize=11)
        finish_measure(drawn, measure)
        last = row == len(measures) - 1 or len(groups) == 1
        label_axes(drawn, columns, measure, x if last else "")
    said = (ERRORS if bars else NO_BARS) + (NESTED_TEXT if numbers else "")
    add_legend(figure, said.format(runs=results[0].runs))
    return figure


def _is_number(value: object) -> bool:
    return isinstance(value, int | float) and not isinstance(value, bool)


def _by_panel(
    results: Results, settings: Sequence[str]
) -> dict[str, list[ConditionResult]]:
    """Return the results of each combination of some settings, by the title of its panel."""
    groups: dict[str, list[ConditionResult]] = {}
    for one in results:
        groups.setdefault(_panel_title(one, settings), []).append(one)
    return groups


def _draw_swept(
    axes: Axes, data: pd.DataFrame, x: str, names: list[str] | None
) -> None:
    """Draw a measure against a setting: of numbers as lines, of `names` as points."""
    if names is None:
        draw_lines(axes, data, x)
        return
    data[x] = data[x].map(as_text)
    draw_points(axes, data, x, names)


def _varied(results: Results) -> list[str]:
    """Return the settings that conditions name and in which they differ; else the penalty."""
    named = dict.fromkeys(key for one in results for key, _ in one.condition.settings)
    values = {name: {getattr(one.scenario, name) for one in results} for name in named}
    return [name for name in named if len(values[name]) > 1] or ["penalty"]


def _check(kind: str, given: Iterable[str], known: Collection[str]) -> None:
    for name in given:
        if name not in known:
            raise SettingError(
                f"plot: {kind} is {name!r}, allowed here: {', '.join(known)}"
            )


def _panel_title(result: ConditionResult, settings: Sequence[str]) -> str:
    plain = result.scenario.plain_settings
    values = [f"{name}={as_text(plain[name])}" for name in settings]
    return ", ".join([result.scenario.name, *values])


MEASURABLE = (
    "returns",
    "time_to_goal",
    "miscoordinations",
    "asks",
    "loss",
    "variance",
)
"""The measures of a condition: `measure_of`."""


def measured(
    results: Results, measure: str, bars: str = "standard_error"
) -> pd.DataFrame:
    """Return the points of conditions, one per row, for `draw_lines` and `draw_points`.

    The columns are `line` (the learner), `value`, `low` and `high` (lengths of the bar), `side`,
    the scenario's settings, and what the value is compared with: the joint optimum, or its bound
    where some condition has no exact one, the best asking team found, and the exact value of
    shortest-path policies.

    Args:
        results: the conditions.
        measure: one of `MEASURABLE`.
        bars: the field of a measure that its bar shows.
    """
    exact = all(one.optimum_exact for one in results)
    optimum = OPTIMUM if exact else BOUND
    points = []
    for one in results:
        points.append(
            {
                **one.scenario.plain_settings,
                "line": one.learner.title,
                "side": side_of(one.condition.learner),
                **value_and_bar(measure_of(one, measure), measure, bars),
                **compared_with(one, measure, optimum),
            }
        )
    return pd.DataFrame(points)


def side_of(learner: str) -> float:
    """Return the offset of a learner's points to the right of their name, in marks."""
    return (
        REPORTED_LEARNERS.index(learner) - 1.5 if learner in REPORTED_LEARNERS else 0.0
    )


def measure_of(result: ConditionResult, name: str) -> Measure:
    """Return one of the `MEASURABLE` of a condition; the variance has no error."""
    if name == "loss":
        return loss_alone(result)
    if name == "variance":
        return Measure(result.best("returns").spread ** 2, math.nan, 0.0)
    return result.best(name)


def value_and_bar(measure: Measure, name: str, bars: str) -> dict[str, float]:
    """Return the value and the lengths of its bar; no bar leads below 0 where no value can."""
    error = getattr(measure, bars)
    signed = name in ("returns", "loss", "gain", "share")
    low = error if signed else min(error, measure.mean)
    return {"value": measure.mean, "low": low, "high": error}


def compared_with(
    result: ConditionResult, measure: str, optimum: str
) -> dict[str, float]:
    """Return the reference values of a condition's measure, by the names of the lines.

    Args:
        result: the condition.
        measure: one of `MEASURABLE`.
        optimum: name of the joint optimum's line.
    """
    if measure not in ("returns", "loss"):
        known = measure in result.reference
        return {SHORTEST: result.reference[measure]} if known else {}
    values = {SHORTEST: result.reference["returns"], optimum: result.optimum}
    asking = best_asking_team(result)
    if result.learner.asks and asking is not None:
        values[BEST_ASKING] = asking
    if measure == "loss":
        alone = independent_bound(result.scenario)
        return {line: alone - value for line, value in values.items()}
    return values


Draw = Callable[[Results], Figure]

DRAWN: Mapping[str, Mapping[str, Draw]] = {
    "table1": {
        "table1": partial(
            beside_paper, measures=["returns"], bars="spread", said=SPREADS
        )
    },
    "table2": {
        "table2": partial(
            beside_paper,
            measures=["time_to_goal", "miscoordinations"],
            bars="spread",
            said=SPREADS,
        )
    },
    "table3": {
        "table3": partial(
            beside_paper, measures=["returns"], bars="spread", said=SPREADS
        )
    },
    "figure4": {
        "figure4": partial(swept_figure, x="penalty", measures=["loss"]),
        "figure4_variance": partial(swept_figure, x="penalty", measures=["variance"]),
    },
    "penalty100": {
        "penalty100": partial(
            beside_paper, measures=["returns"], bars="standard_error", said=ERRORS
        )
    },
    "ask_cost": {"ask_cost": ask_cost},
    "perception": {"perception": perception},
    "uneven": {"uneven": partial(swept_figure, x="common_reward")},
    "crowd": {"crowd": crowd},
    "where": {"where": asked_maps},
    "unseen": {"unseen": unseen},
    "when": {"when": when, "when_more": when_more, "when_kinds": when_kinds},
    "conditions": {"conditions": swept_figure},
}
"""What draws each figure, by experiment and file; `conditions` draws any conditions."""
