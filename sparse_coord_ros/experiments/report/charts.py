# Copyright 2026 The sparse_coord_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Figures: points in a data frame, one style for all, the same bytes for the same results."""

import base64
import io
import math
from collections.abc import Callable, Iterable, Mapping
from pathlib import Path
from typing import Any

import matplotlib
import pandas as pd
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from PIL import Image

from sparse_coord_ros.experiments.catalogue import LEARNERS
from sparse_coord_ros.experiments.report.analysis import loss_alone
from sparse_coord_ros.experiments.report.rows import best_asking_team
from sparse_coord_ros.experiments.store import ConditionResult
from sparse_coord_ros.learn.evaluation import Measure
from sparse_coord_ros.learn.learners import learner_of
from sparse_coord_ros.solve.optimum import independent_bound

BYTES, GAIN = "$Q^C$ of one robot [bytes]", "reward above\nNon-coop. (paired)"
LABELS = {
    "reward": "total discounted reward",
    "time_to_goal": "time to goal [steps]",
    "miscoordinations": "miscoordinations\nper episode",
    "asks": "COORDINATE per\nrobot and episode",
    "loss": "loss against\nrobots alone",
    "variance": "variance of the reward",
}
OPTIMUM, BOUND, SHORTEST = "exact joint optimum", "bound of the optimum", "shortest paths, exact"
ASKING = "best asking team found"
INDIV, NONCOOP, COOP, FACTORED = (learner_of(name).title for name in LEARNERS)
ONE, ALL, SIGHT = (f"{COOP}, {what}" for what in ("one peer", "all peers", "line of sight"))
LEARNER_STYLES: Mapping[str, Mapping[str, Any]] = {
    INDIV: {"color": "#D55E00", "marker": "s", "linestyle": ":"},
    NONCOOP: {"color": "#0072B2", "marker": "^", "linestyle": "--"},
    COOP: {"color": "#009E73", "marker": "o", "linestyle": "-"},
    FACTORED: {"color": "#CC79A7", "marker": "P", "linestyle": (0, (5, 1))},
}
HOLLOW, ALONE = {"markerfacecolor": "white"}, {"linestyle": "none"}
STYLES: Mapping[str, Mapping[str, Any]] = {
    **LEARNER_STYLES,
    **{
        f"{name}, {whose}": {**style, **ALONE, **fill}
        for name, style in LEARNER_STYLES.items()
        for whose, fill in (("ours", {}), ("paper", HOLLOW))
    },
    SIGHT: {**LEARNER_STYLES[COOP], **ALONE, **HOLLOW, "marker": "D"},
    ONE: LEARNER_STYLES[COOP],
    ALL: {"color": "#AA4499", "marker": "D", "linestyle": "-.", **HOLLOW},
    f"{ONE}, dense table": {"color": "0.35", "marker": "x", "linestyle": "-"},
    f"{ALL}, dense table": {"color": "black", "marker": "+", "linestyle": "-."},
    OPTIMUM: {"color": "black", "linestyle": (0, (6, 2)), "linewidth": 1.2, "zorder": 1.5},
    BOUND: {"color": "black", "linestyle": (0, (1, 1.5)), "linewidth": 1.2, "zorder": 1.5},
    ASKING: {"color": "#E69F00", "linestyle": "-", "linewidth": 1.2, "zorder": 1.5},
    SHORTEST: {"color": "0.8", "linestyle": "-", "linewidth": 4, "zorder": 1},
}
"""How each line is drawn, in the order of the legend; told apart in greyscale too."""

OTHER: Mapping[str, Any] = {"color": "#56B4E9", "marker": "v", "linestyle": (0, (3, 1, 1, 1))}
"""How other learners are drawn."""

OUTPUT: Any = {"svg.hashsalt": "sparse_coord_ros", "svg.fonttype": "path"}
"""Without a fixed salt the ids in an SVG file are random."""

UNDATED: Mapping[str, Mapping[str, Any]] = {
    "svg": {"Date": None, "Creator": None},
    "pdf": {"CreationDate": None, "Creator": None, "Producer": None},
    "png": {"Software": None},
}
"""What else a file would say of when and by what it was made."""

Where = Callable[[ConditionResult], Mapping[str, Any]]
"""What `point` needs of a condition; scenario and learner where panel and line are missing."""


def measured(result: ConditionResult, name: str) -> Measure:
    """Return a measure of a condition; also `loss` and `variance`, which has no error."""
    if name == "loss":
        return loss_alone(result)
    if name == "variance":
        return Measure(result.best("reward").spread ** 2, math.nan, 0.0)
    return result.best(name)


def point(
    measure: Measure, label: str, bars: str = "standard_error", **where: Any
) -> dict[str, Any]:
    """Return a point of a figure.

    Args:
        measure: its height.
        label: what the axis shows; one of `LABELS` or a text.
        bars: which of the measure's fields is drawn as bars.
        where: `panel`, `line`, `x` and, where they differ from none, `tick`, `shift`, `xlabel`.
    """
    error = getattr(measure, bars)
    negative = label not in LABELS or label in ("reward", "loss")  # others cannot fall below 0
    low = error if negative else min(error, measure.mean)
    return {"y": measure.mean, "low": low, "high": error, "ylabel": LABELS.get(label, label)} | {
        "shift": 0.0,
        "tick": None,
        "xlabel": "",
        **where,
    }


def points(
    results: Iterable[ConditionResult],
    measure: str,
    where: Where,
    bars: str = "standard_error",
    span: float = 0.0,
) -> list[dict[str, Any]]:
    """Return the points of conditions, with what they are to be compared with.

    Those are the joint optimum, or its bound, the best asking team found where there is one, and
    the exact value of shortest-path policies.

    Args:
        results: the conditions.
        measure: one of `LABELS`.
        where: returns the place of a condition.
        bars: see `point`.
        span: by how much the lines to compare with reach beyond a condition, to both sides.
    """
    places = [
        (one, {"panel": one.scenario.name, "line": one.learner.title, **where(one)})
        for one in results
    ]
    found = [point(measured(one, measure), measure, bars, **place) for one, place in places]
    bounded = {place["panel"] for one, place in places if not one.optimum_exact}
    for one, place in places:
        values = {SHORTEST: one.reference[measure]} if measure in one.reference else {}
        if measure == "reward":
            values[BOUND if place["panel"] in bounded else OPTIMUM] = one.optimum
            known = best_asking_team(one) if one.learner.asks else None
            values |= {} if known is None else {ASKING: known}
        if measure == "loss":
            values[SHORTEST] = independent_bound(one.scenario) - one.reference["reward"]
        for line, value in values.items():
            for shift in {-span, span}:
                here = {**place, "line": line, "shift": shift}
                found.append(point(Measure(value, 0, 0), measure, **here))
    return found


class Drawing(Figure):
    """A figure that notebooks show, whether or not they use pyplot."""

    def _repr_png_(self) -> bytes:
        return rendered(self, "png")


def plot(
    shown: Iterable[dict[str, Any]], columns: int, width: float = 3.4, height: float = 2.5
) -> Figure:
    """Draw points: a panel for each title and measure, `columns` a row, of that size in inches."""
    panels = list(pd.DataFrame(shown).groupby(["ylabel", "panel"], sort=False, dropna=False))
    rows = math.ceil(len(panels) / columns)
    figure = Drawing(figsize=(columns * width, rows * height + 0.7), layout="constrained")
    grid = figure.subplots(rows, columns, squeeze=False).flatten().tolist()
    handles: dict[str, Any] = {}
    for number, (((ylabel, title), data), axes) in enumerate(zip(panels, grid, strict=False)):
        handles |= _panel(axes, data)
        axes.set_title(title, fontsize=11)
        if number % columns == 0 or panels[number - 1][0][0] != ylabel:
            axes.set_ylabel(ylabel)
        xlabel = data["xlabel"].iloc[0]
        below = panels[number + columns :][:1]
        if not below or below[0][1]["xlabel"].iloc[0] != xlabel:
            axes.set_xlabel(xlabel)
    for axes in grid[len(panels) :]:
        axes.remove()
    named = sorted(handles, key=[*STYLES, *handles].index)
    figure.legend(
        [handles[name] for name in named],
        named,
        loc="outside lower center",
        ncols=min(math.ceil(len(named) / 2), int(columns * width / 2)),
        frameon=False,
    )
    return figure


def _panel(axes: Axes, data: pd.DataFrame) -> dict[str, Any]:
    """Draw a panel and return the handle of each line for the legend."""
    handles = {}
    data = data.assign(place=data["x"] + data["shift"]).sort_values("place", kind="stable")
    for line, own in data.drop_duplicates(["line", "place"]).groupby("line", sort=False):
        style = {"linewidth": 1.3, "markersize": 4.5, "capsize": 2, **STYLES.get(str(line), OTHER)}
        bars = [own["low"], own["high"]] if own["high"].any() else None
        handles[str(line)] = axes.errorbar(own["place"], own["y"], bars, **style)
    ticks = data.dropna(subset="tick").drop_duplicates("x")
    if len(ticks):
        axes.set_xticks(ticks["x"], ticks["tick"])
    if data["ylabel"].iloc[0] == BYTES:
        axes.set_yscale("log")
    axes.ticklabel_format(axis="y", useOffset=False) if axes.get_yscale() == "linear" else None
    axes.grid(alpha=0.3)
    return handles


def rendered(figure: Figure, kind: str, dpi: float = 110, *, few: bool = False) -> bytes:
    """Return a figure as a file of a kind, free of dates, versions and random ids.

    Args:
        figure: the figure.
        kind: "png", "svg" or "pdf".
        dpi: dots an inch of a PNG.
        few: whether 128 colours do for a PNG: a third of the size.
    """
    drawn = io.BytesIO()
    with matplotlib.rc_context(OUTPUT):
        figure.savefig(drawn, format=kind, dpi=dpi, metadata=UNDATED[kind])
    if kind != "png" or not few:
        return drawn.getvalue()
    reduced = Image.open(drawn).convert("RGB").quantize(128, dither=Image.Dither.NONE)
    small = io.BytesIO()
    reduced.save(small, "png", optimize=True)
    return small.getvalue()


def embedded(figure: Figure, what: str) -> str:
    """Return a figure within HTML."""
    data = base64.b64encode(rendered(figure, "png", few=True)).decode()
    style = "max-width: 100%; min-width: 0; height: auto"
    return f'<img alt="{what}" style="{style}" src="data:image/png;base64,{data}">'


def save(figure: Figure, stem: Path) -> None:
    """Write `stem`.png and `stem`.svg."""
    stem.with_name(f"{stem.name}.svg").write_bytes(rendered(figure, "svg"))
    figure.set_layout_engine("none")  # laid out by now: once is enough
    stem.with_name(f"{stem.name}.png").write_bytes(rendered(figure, "png", few=True))
