# Copyright 2026 The sparse_coord_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The figures of the experiment on when robots should coordinate."""

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
import pandas as pd
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import FixedLocator, FuncFormatter, NullLocator, PercentFormatter

from sparse_coord_ros.core.solve.advice import LEAST_RELATIVE_GAIN
from sparse_coord_ros.studies.condition_result import ConditionResult
from sparse_coord_ros.studies.report.charts import (
    BEST_ASKING,
    COOP,
    FACTORED,
    LEARNER_STYLES,
    STYLES,
    Drawing,
)
from sparse_coord_ros.studies.report.when import (
    ALWAYS,
    ALWAYS_PAYS,
    AVOIDABLE_LINE,
    CQ,
    KINDS,
    NEVER,
    TINY,
    means,
    points,
    with_ways_apart,
)

Style = Mapping[str, Any]

LINES: Mapping[str, Style] = {
    FACTORED: {"color": "#CC79A7", "marker": "P", "linewidth": 2.6, "zorder": 3},
    COOP: LEARNER_STYLES[COOP],
    CQ: {"color": "#56B4E9", "marker": "v", "linestyle": "-."},
    NEVER: {"color": "#0072B2", "marker": "^", "linestyle": ":"},
    ALWAYS: {"color": "black", "marker": "s", "linestyle": "--"},
    BEST_ASKING: {**STYLES[BEST_ASKING], "marker": "*", "linestyle": "none"},
}
"""The lines of the first figure, in the order of its legend."""

MORE_LINES: Mapping[str, Style] = {
    FACTORED: LINES[FACTORED],
    "50 % of questions answered": {
        "color": "#E69F00",
        "marker": "o",
        "linestyle": "--",
    },
    "20 % of questions answered": {"color": "#D55E00", "marker": "v", "linestyle": ":"},
    "4 robots": {"color": "#009E73", "marker": "s", "linestyle": "-."},
    "8 robots": {"color": "#0072B2", "marker": "D", "linestyle": "--"},
    AVOIDABLE_LINE: {"color": "0.45", "marker": "x", "linestyle": "-"},
}
"""The lines of the second figure."""

KIND_LINES: Mapping[str, Style] = {
    FACTORED: {**LINES[FACTORED], "label": "in one doorway"},
    KINDS["together:anywhere"]: {"color": "#56B4E9", "marker": "v", "linestyle": "-."},
    KINDS["swap"]: {"color": "#009E73", "marker": "o", "linestyle": "-"},
    KINDS["block"]: {"color": "#E69F00", "marker": "s", "linestyle": "--"},
    KINDS["block:anywhere"]: {"color": "#D55E00", "marker": "D", "linestyle": ":"},
}
"""The lines of the third figure."""

REGIONS = (
    (0.0, LEAST_RELATIVE_GAIN, "no need to", "#FFFFFF"),
    (LEAST_RELATIVE_GAIN, ALWAYS_PAYS, "ask where it matters", "#F2F2F2"),
    (ALWAYS_PAYS, np.inf, "may always ask", "#DDDDDD"),
)
"""Ratios, name and colour of each region."""

TICKS = (0.03, 0.1, 0.3, 1, 3, 10, 30, 100, 300, 1000)
LIMITS = (0.04, 1500.0)
"""Of the axis of ratios."""

LOWEST_SHARE = -0.6
MOST_QUESTIONS = 4.0
MOST_QUESTIONS_MORE = 5.2
"""Ends of the vertical axes: lines leave the panel beyond them. The second one is that of larger
teams, failing answers and other interactions."""

XLABELS = {
    "ratio": "loss of a robot if they ignore each other / cost of a question (log scale)",
    "relative_gain": "possible gain of a robot / cost of a question * (chance of an answer)² "
    "(log scale)",
}


def when(results: Sequence[ConditionResult]) -> Figure:
    """Draw questions and share of the gap against the ratio, for each way to coordinate."""
    found = points(results)
    figure = _figure(found[~found["avoidable"]], LINES, "ratio", MOST_QUESTIONS)
    upper, lower = figure.axes
    for axes in (upper, lower):
        _mark_regions(axes)
    _name_regions(upper)
    return figure


def when_more(results: Sequence[ConditionResult]) -> Figure:
    """Draw other chances of an answer, larger teams, and pairs with ways apart.

    They stand against the possible gain, in questions, as `core.solve.advice` counts it.
    """
    found = points(results)
    figure = _figure(
        with_ways_apart(found), MORE_LINES, "relative_gain", MOST_QUESTIONS_MORE
    )
    # The gap of larger teams ends at robots alone in the world.
    lower = figure.axes[1]
    lower.set_ylabel("share of the gap")
    return figure


def when_kinds(results: Sequence[ConditionResult]) -> Figure:
    """Draw pairs that interact in other ways against the ratio, beside those in one doorway."""
    found = points(results)
    return _figure(found[~found["avoidable"]], KIND_LINES, "ratio", MOST_QUESTIONS_MORE)


def _figure(
    found: pd.DataFrame, lines: Mapping[str, Style], x: str, most: float
) -> Figure:
    figure = Drawing(figsize=(8.2, 7.0), layout="constrained")
    upper, lower = figure.subplots(2, 1, sharex=True)
    own = found[(found["line"] == FACTORED) & (found["gap"] > TINY)]
    dots = {"s": 7, "color": "#CC79A7", "alpha": 0.35, "linewidths": 0, "zorder": 2}
    upper.scatter(own[x], own["questions"], **dots)
    lower.scatter(own[x], own["gained"] / own["gap"], **dots)
    averages = means(found, x)
    for line, style in lines.items():
        average = averages[averages["line"] == line]
        _draw(upper, average, x, "questions", line, style)
        _draw(lower, average, x, "share", line, style)
    upper.set_ylim(-0.1, most)
    upper.set_ylabel("questions of a robot\nin an episode")
    lower.set_ylim(LOWEST_SHARE, 1.08)
    lower.set_ylabel("share of the gap\nto the joint optimum")
    lower.yaxis.set_major_formatter(PercentFormatter(1.0))
    lower.axhline(0.0, color="black", linewidth=0.8)
    lower.set_xlabel(XLABELS[x])
    for axes in (upper, lower):
        axes.set_xscale("log")
        axes.set_xlim(*LIMITS)
        axes.xaxis.set_major_locator(FixedLocator(TICKS))
        axes.xaxis.set_minor_locator(NullLocator())
        axes.xaxis.set_major_formatter(FuncFormatter(lambda value, _: f"{value:g}"))
        axes.grid(alpha=0.3)
    handles, names = lower.get_legend_handles_labels()
    said = "Dots: Factored, each map, penalty and cost. Bars: one standard error over maps."
    figure.legend(
        handles, names, title=said, loc="outside lower center", ncols=3, frameon=False
    )
    return figure


def _draw(
    axes: Axes, average: pd.DataFrame, x: str, measure: str, line: str, style: Style
) -> None:
    known = average[average[measure].notna()]
    if len(known):
        error = known[f"{measure}_error"].fillna(0.0)
        said = {"label": line, "capsize": 2, **style}
        axes.errorbar(known[x], known[measure], error, **said)


def _mark_regions(axes: Axes) -> None:
    for low, high, _, colour in REGIONS:
        left, right = np.clip((low, high), *LIMITS)
        axes.axvspan(left, right, color=colour, zorder=0)


def _name_regions(axes: Axes) -> None:
    for low, high, name, _ in REGIONS:
        left, right = np.clip((low, high), *LIMITS)
        middle = float(np.sqrt(left * right))
        axes.text(
            middle,
            1.02,
            name,
            transform=axes.get_xaxis_transform(),
            ha="center",
            va="bottom",
            fontweight="bold",
        )
