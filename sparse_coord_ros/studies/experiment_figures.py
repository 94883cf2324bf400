# Copyright 2026 The sparse_coord_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The figures of experiments, and one of any conditions."""

import textwrap
from collections.abc import Callable, Collection, Iterable, Iterator, Mapping, Sequence
from functools import partial
from pathlib import Path

import numpy as np
import pandas as pd
from matplotlib import colormaps
from matplotlib.axes import Axes
from matplotlib.cm import ScalarMappable
from matplotlib.colors import PowerNorm
from matplotlib.figure import Figure

from sparse_coord_ros.base.errors import ResultsError, SettingError, did_you_mean
from sparse_coord_ros.core.game.settings import as_text
from sparse_coord_ros.core.solve.optimum import independent_bound
from sparse_coord_ros.show.charts import (
    ALL_PEERS,
    BEST_ASKING,
    BOUND,
    COOP,
    ERRORS,
    LABELS,
    NESTED_TEXT,
    NO_BARS,
    OPTIMUM,
    SHORTEST,
    WHISKERS,
    add_legend,
    are_long,
    draw_bars,
    draw_lines,
    draw_points,
    finish_measure,
    label_axes,
    panel_grid,
)
from sparse_coord_ros.show.map_pictures import COLOUR_MAP, draw_map
from sparse_coord_ros.studies.catalogue import (
    NAMES,
    REPORTED_LEARNERS,
    Experiment,
    experiment,
)
from sparse_coord_ros.studies.compared import (
    best_asking_team,
    by_scenario,
    paper,
)
from sparse_coord_ros.studies.condition_result import ConditionResult
from sparse_coord_ros.studies.paper import PAPER_MEASURES
from sparse_coord_ros.studies.store import Say, read_results

CELL_INCHES = 0.3
"""Inches a cell, on maps of asks."""

LINE_CELLS = 41
"""Cells that fit in a line of maps."""

SCALE = 0.8
"""Inches of the scale below them."""

LEAST = 8
"""Cells that a map's title needs."""

TITLE_LETTERS = 27
"""Letters in a line of a map's title."""

TITLE_LINE = 0.6
"""Cells that such a line takes."""

SWEPT_MEASURES = ("returns", "miscoordinations", "asks")
"""What `swept_figure` shows of conditions."""

MOST_COLUMNS = 4
"""Panels in a row of any conditions."""

Results = Sequence[ConditionResult]


def beside_paper(results: Results, measures: Sequence[str]) -> Figure:
    """Draw learners side by side, ours and the paper's: Tables 1 to 3, and penalty -100.

    The paper prints no standard errors.

    Args:
        results: the conditions.
        measures: a panel for each of these and each scenario.
    """
    scenarios = by_scenario(results)
    figure, rows = _panel_rows(measures, len(scenarios), columns=3)
    titles = [result.learner.label for result in scenarios[0]]
    for measure, drawn in rows:
        for axes, group in zip(drawn, scenarios, strict=True):
            ours = measured(group, measure)
            ours["learner"] = ours["line"]
            ours["line"] = ours["line"] + ", ours"
            ours["side"] = -1
            papers = []
            for result in group:
                printed = paper(result, measure)
                if printed is not None:
                    learner = result.learner.label
                    point = {"line": f"{learner}, paper", "learner": learner, "side": 1}
                    mean, _ = printed
                    papers.append(point | value_and_bar(measure, mean, 0.0))
            data = pd.concat([ours, pd.DataFrame(papers)], ignore_index=True)
            draw_points(axes, data, "learner", titles)
            axes.set_title(group[0].scenario.name, fontsize=11)
        label_axes(drawn, 3, measure)
        finish_measure(drawn, measure)
    add_legend(figure, ERRORS.format(runs=results[0].runs))
    return figure


def crowd_figure(results: Results) -> Figure:
    """Draw learners against the number of robots, a panel for each measure."""
    figure, panels = panel_grid(len(SWEPT_MEASURES), len(SWEPT_MEASURES))
    for axes, measure in zip(panels, SWEPT_MEASURES, strict=True):
        data = measured(results, measure)
        data["robots"] = [len(result.scenario.robots) for result in results]
        asked_all = (data["line"] == COOP) & (data["peers"] == "all")
        data.loc[asked_all, "line"] = ALL_PEERS
        draw_lines(axes, data, "robots")
        axes.set(xlabel="robots", ylabel=LABELS[measure])
        finish_measure([axes], measure)
    add_legend(figure, (ERRORS + NESTED_TEXT).format(runs=results[0].runs))
    return figure


def swept_figure(
    results: Results, x: str = "", measures: Sequence[str] = SWEPT_MEASURES
) -> Figure:
    """Draw any conditions against a setting in which they differ.

    There is a panel for each measure and combination of the other settings. A setting of numbers
    gets an axis of numbers, any other one names.

    Args:
        results: the conditions.
        x: the setting; empty: the first in which they differ.
        measures: of `LABELS`.

    Raises:
        SettingError: the conditions do not differ in `x`, or the measure is unknown.
    """
    results = [result for group in by_scenario(results) for result in group]
    varied = _varied(results)
    if not x and not _differ(results):
        return learners_figure(results, measures)
    x = x or varied[0]
    _check("x", [x], varied)
    _check("measure", measures, MEASURABLE)
    values = list(
        dict.fromkeys(result.scenario.plain_settings[x] for result in results)
    )
    numbers = all(map(_is_number, values))
    names = None if numbers else list(map(as_text, values))
    groups = _by_panel(results, [name for name in varied if name != x])
    columns = _columns(measures, len(groups))
    figure, rows = _panel_rows(measures, len(groups), columns)
    bars = False
    for row, (measure, drawn) in enumerate(rows):
        for axes, (title, group) in zip(drawn, groups.items(), strict=True):
            data = measured(group, measure)
            bars = bars or bool(data["high"].any())
            _draw_swept(axes, data, x, names)
            axes.set_title(title, fontsize=11)
        finish_measure(drawn, measure)
        last = row == len(rows) - 1 or len(groups) == 1
        if not last and columns == len(groups) and names is not None:
            _hide_long_names(drawn, names)
        label_axes(drawn, columns, measure, x if last else "")
    text = (ERRORS if bars else NO_BARS) + (NESTED_TEXT if numbers else "")
    add_legend(figure, text.format(runs=results[0].runs))
    return figure


def _columns(measures: Sequence[str], groups: int) -> int:
    """Return how many panels a row has: a panel for each group, or measure of the only one."""
    return min(MOST_COLUMNS, groups if groups > 1 else len(measures))


def _panel_rows(
    measures: Sequence[str], groups: int, columns: int
) -> tuple[Figure, list[tuple[str, list[Axes]]]]:
    """Return a figure, and each measure with its panels: one for each group of results."""
    figure, panels = panel_grid(len(measures) * groups, columns)
    rows = []
    for row, measure in enumerate(measures):
        rows.append((measure, panels[row * groups : (row + 1) * groups]))
    return figure, rows


def _hide_long_names(panels: Sequence[Axes], names: Sequence[str]) -> None:
    """Leave names that are written upwards to the panels below."""
    if are_long(names):
        for axes in panels:
            axes.tick_params(labelbottom=False)


def _differ(results: Results) -> bool:
    """Return whether conditions of one scenario differ in a setting, not only in the learner."""
    return any(
        len({result.condition.settings for result in group}) > 1
        for group in by_scenario(results)
    )


def learners_figure(results: Results, measures: Sequence[str]) -> Figure:
    """Draw learners as bars beside their reference values: a panel for each measure and scenario.

    Args:
        results: the conditions.
        measures: of `LABELS`.
    """
    _check("measure", measures, MEASURABLE)
    groups = by_scenario(results)
    columns = _columns(measures, len(groups))
    figure, rows = _panel_rows(measures, len(groups), columns)
    for measure, drawn in rows:
        for axes, group in zip(drawn, groups, strict=True):
            draw_bars(axes, measured(group, measure))
            axes.set_title(group[0].scenario.name, fontsize=11)
        finish_measure(drawn, measure)
        label_axes(drawn, columns, measure, "")
    add_legend(figure, WHISKERS.format(runs=results[0].runs))
    return figure


def _is_number(value: object) -> bool:
    return isinstance(value, int | float) and not isinstance(value, bool)


def _by_panel(
    results: Results, settings: Sequence[str]
) -> dict[str, list[ConditionResult]]:
    """Return the results of each combination of some settings, by the title of its panel."""
    groups: dict[str, list[ConditionResult]] = {}
    for result in results:
        groups.setdefault(_panel_title(result, settings), []).append(result)
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
    named = dict.fromkeys(
        key for result in results for key, _ in result.condition.settings
    )
    values = {
        name: {getattr(result.scenario, name) for result in results} for name in named
    }
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
"""What figures show of a condition."""


def measured(results: Results, measure: str) -> pd.DataFrame:
    """Return the points of conditions, one per row, for `draw_lines` and `draw_points`.

    The columns are `line` (the learner), `value`, `low` and `high` (lengths of the bar), `side`,
    the scenario's settings, and what the value is compared with: the joint optimum, or its bound
    where some condition has no exact one, the best asking team found, and the exact value of
    shortest-path policies.

    Args:
        results: the conditions.
        measure: one of `MEASURABLE`.
    """
    exact = all(result.optimum_exact for result in results)
    optimum = OPTIMUM if exact else BOUND
    points = []
    for result in results:
        points.append(
            {
                **result.scenario.plain_settings,
                "line": result.learner.label,
                "side": side_of(result.condition.learner),
                **value_and_bar(measure, *_mean_and_error(result, measure)),
                **compared_with(result, measure, optimum),
            }
        )
    return pd.DataFrame(points)


def side_of(learner: str) -> float:
    """Return the offset of a learner's points to the right of their name, in marks."""
    if learner not in REPORTED_LEARNERS:
        return 0.0
    return REPORTED_LEARNERS.index(learner) - 1.5


def _mean_and_error(result: ConditionResult, name: str) -> tuple[float, float]:
    """Return one of the `MEASURABLE` of a condition, and its standard error.

    The loss is against robots that are each alone on the map: they take shortest paths and never
    miscoordinate, wait or ask. Unlike the return, it does not depend on the lengths of the paths.
    The variance has no bar.
    """
    if name == "variance":
        return result.measures.spread("returns") ** 2, 0.0
    measure = "returns" if name == "loss" else name
    mean = result.measures.mean(measure)
    if name == "loss":
        mean = independent_bound(result.scenario) - mean
    return mean, result.measures.error(measure)


def value_and_bar(name: str, value: float, bar: float) -> dict[str, float]:
    """Return a value and the lengths of its bar; no bar leads below 0 where no value can."""
    signed = name in ("returns", "loss")
    return {"value": value, "low": bar if signed else min(bar, value), "high": bar}


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
        known = measure in PAPER_MEASURES
        return {SHORTEST: result.shortest_paths.mean(measure)} if known else {}
    values = {SHORTEST: result.shortest_paths.mean("returns"), optimum: result.optimum}
    asking = best_asking_team(result)
    if result.learner.asks and asking is not None:
        values[BEST_ASKING] = asking
    if measure == "loss":
        alone = independent_bound(result.scenario)
        return {line: alone - value for line, value in values.items()}
    return values


def asked_maps(results: Sequence[ConditionResult]) -> Figure:
    """Draw where COORDINATE is chosen: a map a condition, all with one scale of colours.

    Each map says its learner and settings.
    """
    totals = {result.id: result.measures.asked.sum(axis=0) for result in results}
    norm = PowerNorm(
        0.5, vmin=0, vmax=max(float(total.max()) for total in totals.values()) or 1
    )
    figure = Figure()
    axes = figure.add_axes((0, 0, 1, 1))
    left = top = deep = 0.0
    for result in sorted(results, key=lambda result: result.scenario.map.shape[1]):
        rows, columns = result.scenario.map.shape
        wide = max(LEAST, columns)
        if left + wide > LINE_CELLS:
            left = 0.0
            top = top + deep
            deep = 0.0
        title = _title(result)
        above = TITLE_LINE * len(title)
        corner = (left + (wide - columns) / 2, top + above + 0.2)
        shades = np.asarray(norm(totals[result.id]))
        draw_map(axes, result.scenario, shades, corner=corner, label_size=6.5)
        axes.text(
            corner[0] + columns / 2,
            top + above,
            "\n".join(title),
            ha="center",
            fontsize=9,
        )
        left = left + wide + 1
        deep = max(deep, rows + above + 0.6)
    axes.set(xlim=(-0.2, LINE_CELLS + 0.2), ylim=(top + deep, 0))
    axes.axis("off")
    height = (top + deep) * CELL_INCHES + SCALE
    figure.set_size_inches(LINE_CELLS * CELL_INCHES, height)
    axes.set_position((0, SCALE / height, 1, 1 - SCALE / height))
    figure.colorbar(
        ScalarMappable(norm, colormaps[COLOUR_MAP].resampled(256)),
        cax=figure.add_axes((0.25, 0.55 / height, 0.5, 0.12 / height)),
        orientation="horizontal",
        label="COORDINATE chosen in the cell, per episode, all robots together",
    )
    return figure


def _title(result: ConditionResult) -> list[str]:
    """Return the lines above a map: scenario, learner, settings, and how often a robot asks."""
    settings = ", ".join(f"{name} {value}" for name, value in result.condition.settings)
    return [
        f"{result.scenario.name}, {result.learner.label}",
        *textwrap.wrap(settings, TITLE_LETTERS),
        f"{result.measures.mean('asks'):.3f} asks a robot",
    ]


Draw = Callable[[Results], Figure]

_TABLE = partial(beside_paper, measures=["returns"])

DRAWN: Mapping[str, Mapping[str, Draw]] = {
    "table1": {"table1": _TABLE},
    "table2": {
        "table2": partial(beside_paper, measures=["time_to_goal", "miscoordinations"])
    },
    "table3": {"table3": _TABLE},
    "figure4": {
        "figure4": partial(swept_figure, x="penalty", measures=["loss"]),
        "figure4_variance": partial(swept_figure, x="penalty", measures=["variance"]),
    },
    "penalty100": {"penalty100": _TABLE},
    "crowd": {"crowd": crowd_figure},
}
"""What draws the figures of an experiment, by the names of their files. The other experiments have
one figure, `swept_figure`."""


def figures_of(name: str) -> Mapping[str, Draw]:
    """Return what draws the figures of an experiment, by the names of their files."""
    return DRAWN.get(name, {name: swept_figure})


def results_figure(
    directory: Path, what: str | None = None, say: Say = lambda _: None
) -> tuple[str, Figure]:
    """Draw a figure of a results directory.

    Args:
        directory: the results directory.
        what: `conditions`: all of them; `asks`: a map for each scenario in which robots may ask,
            of the condition of `most_asking`; a complete experiment, or one of its figures; None:
            the first of these.
        say: receives notes on omissions, and on the condition that a map shows.

    Returns:
        The figure's name, and the figure.

    Raises:
        ResultsError: the directory has no results, or a damaged one.
        SettingError: unknown figure.
    """
    _, results = read_results(directory, say)
    if not results:
        remedy = "'sparse_coord reproduce' writes results"
        raise ResultsError(f"{directory}: holds no result yet; {remedy}")
    draws: dict[str, Draw] = {"conditions": swept_figure}
    shown = {"conditions": results}
    for complete, group in _complete(results):
        draws |= figures_of(complete.name)
        shown |= dict.fromkeys(figures_of(complete.name), group)
    asking = by_scenario(result for result in results if result.learner.asks)
    if asking:
        draws["asks"] = asked_maps
        shown["asks"] = [most_asking(group) for group in asking]
    what = what or "conditions"
    if what not in draws:
        why = f"these results have {', '.join(draws)}{did_you_mean(what, draws)}"
        raise SettingError(f"--what {what!r}: {why}")
    if what == "asks":
        for condition in shown[what]:
            say(
                f"asks: {condition.id}, where robots ask most at the hardest penalty there is"
            )
    return what, draws[what](shown[what])


def _complete(results: Results) -> Iterator[tuple[Experiment, list[ConditionResult]]]:
    """Yield the experiments with results of all their conditions, and these results."""
    by_id = {result.id: result for result in results}
    for name in NAMES:
        complete = experiment(name)
        if all(condition.id in by_id for condition in complete.conditions):
            yield complete, [by_id[condition.id] for condition in complete.conditions]


def most_asking(results: Results) -> ConditionResult:
    """Return one scenario's condition with the hardest penalty in which robots ask most.

    It has most to show. Of equal ones the first by its id.
    """
    hardest = min(result.scenario.penalty for result in results)
    candidates = sorted(
        (result for result in results if result.scenario.penalty == hardest),
        key=lambda result: result.id,
    )
    return max(candidates, key=lambda result: result.measures.mean("asks"))
