# Copyright 2026 The sparse_coord_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Figures: points in a data frame, one style for all, the same bytes for the same results."""

import base64
import io
import math
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import matplotlib
import numpy as np
import pandas as pd
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import FixedLocator, ScalarFormatter
from matplotlib.transforms import Bbox, ScaledTranslation
from PIL import Image

from sparse_coord_ros.core.learners.registry import learner_of
from sparse_coord_ros.core.runs.evaluation import Measure
from sparse_coord_ros.core.solve.optimum import independent_bound
from sparse_coord_ros.studies.catalogue import LEARNERS
from sparse_coord_ros.studies.report.analysis import loss_alone
from sparse_coord_ros.studies.report.rows import best_asking_team
from sparse_coord_ros.studies.store import ConditionResult

BYTES = "$Q^C$ of one robot [bytes]"
GAIN = "reward above\nNon-coop. (paired)"
LABELS = {
    "reward": "total discounted reward",
    "time_to_goal": "time to goal [steps]",
    "miscoordinations": "miscoordinations\nper episode",
    "asks": "COORDINATE per\nrobot and episode",
    "loss": "loss against\nrobots alone",
    "variance": "variance of the reward",
}
LOGARITHMIC = {"penalty", "steps", BYTES, LABELS["loss"], LABELS["variance"]}
"""What stands on a logarithmic axis in every figure; all else stands on a linear one."""

LEAST_SPANS = {
    LABELS["reward"]: 0.5,
    LABELS["time_to_goal"]: 0.5,
    LABELS["miscoordinations"]: 0.2,
    LABELS["asks"]: 0.2,
    LABELS["loss"]: 0.5,
    LABELS["variance"]: 1.0,
    GAIN: 0.5,
}
"""How much each vertical axis spans at least, so that rounding noise looks like none."""

OPTIMUM = "exact joint optimum"
BOUND = "bound of the optimum"
SHORTEST = "shortest paths, exact"
ASKING = "best asking team found"
BASELINE = "Non-coop., at any cost"
INDIV, NONCOOP, COOP, FACTORED = (learner_of(name).title for name in LEARNERS)
ONE, ALL = (f"{COOP}, {what}" for what in ("one peer", "all peers"))
LEARNER_STYLES: Mapping[str, Mapping[str, Any]] = {
    INDIV: {"color": "#D55E00", "marker": "s", "linestyle": ":"},
    NONCOOP: {"color": "#0072B2", "marker": "^", "linestyle": "--"},
    COOP: {"color": "#009E73", "marker": "o", "linestyle": "-"},
    FACTORED: {"color": "#CC79A7", "marker": "P", "linestyle": (0, (5, 1))},
}
HOLLOW = {"markerfacecolor": "white"}
ALONE = {"linestyle": "none"}
STYLES: Mapping[str, Mapping[str, Any]] = {
    **LEARNER_STYLES,
    **{
        f"{name}, {whose}": {**style, **ALONE, **fill}
        for name, style in LEARNER_STYLES.items()
        for whose, fill in (("ours", {}), ("paper", HOLLOW))
    },
    ONE: LEARNER_STYLES[COOP],
    ALL: {"color": "#AA4499", "marker": "D", "linestyle": "-.", **HOLLOW},
    f"{ONE}, dense table": {"color": "0.35", "marker": "x", "linestyle": "-"},
    f"{ALL}, dense table": {"color": "black", "marker": "+", "linestyle": "-."},
    OPTIMUM: {
        "color": "black",
        "linestyle": (0, (6, 2)),
        "linewidth": 1.2,
        "zorder": 1.5,
    },
    BOUND: {
        "color": "black",
        "linestyle": (0, (1, 1.5)),
        "linewidth": 1.2,
        "zorder": 1.5,
    },
    ASKING: {"color": "#E69F00", "linestyle": "-", "linewidth": 1.2, "zorder": 1.5},
    BASELINE: {"color": "#A6CEE3", "linestyle": "-", "linewidth": 3.5, "zorder": 1.2},
    SHORTEST: {"color": "0.8", "linestyle": "-", "linewidth": 4, "zorder": 1},
}
"""How each line is drawn, in the order of the legend; told apart in greyscale too."""

NESTED: Mapping[str, Mapping[str, Any]] = {
    SHORTEST: {"linewidth": 7.0},
    INDIV: {"linewidth": 3.6, "markersize": 9.0, "zorder": 2.1},
    NONCOOP: {"linewidth": 2.7, "markersize": 7.5, "zorder": 2.2},
    COOP: {"linewidth": 1.9, "markersize": 5.5, "zorder": 2.3},
    ONE: {"linewidth": 1.9, "markersize": 5.5, "zorder": 2.3},
    ALL: {"linewidth": 1.3, "markersize": 4.5, "zorder": 2.4},
    FACTORED: {"linewidth": 1.0, "markersize": 4.0, "zorder": 2.5},
}
"""Sizes of joined lines: where lines are equal, each later one lies within the one before.

On an axis of numbers no line is moved aside, as its points would then stand at wrong numbers.
"""

THINNEST: Mapping[str, Any] = {"linewidth": 1.0, "markersize": 3.5, "zorder": 2.6}
"""Sizes of all others."""

NESTED_TEXT = "Lines that coincide lie on one another, the thinner on top"

OTHER: Mapping[str, Any] = {
    "color": "#56B4E9",
    "marker": "v",
    "linestyle": (0, (3, 1, 1, 1)),
}
"""How other learners are drawn."""

OUTPUT: Any = {"svg.hashsalt": "sparse_coord_ros", "svg.fonttype": "path"}
"""Without a fixed salt the ids in an SVG file are random."""

UNDATED: Mapping[str, Mapping[str, Any]] = {
    "svg": {"Date": None, "Creator": None},
    "pdf": {"CreationDate": None, "Creator": None, "Producer": None},
    "png": {"Software": None},
}
"""What else a file would say of when and by what it was made."""

PLACE_DIGITS = 6
"""Decimals of the place of axes, as a share of the figure: a thousandth of a pixel."""

Where = Callable[[ConditionResult], Mapping[str, Any]]
"""What `point` needs of a condition; scenario and learner where panel and line are missing."""

MOST_TICKS = 7
"""Numbers that an axis names one by one."""

PLAINLY = 1e5
"""Larger numbers on a logarithmic axis are named by their power of ten."""

LETTER = 0.03
"""Width of a letter beside an axis, as a share of its length, in the narrowest panel."""

NARROWEST = 6.0
"""Inches of the narrowest figure: room for the legend and the labels of the axes."""

MARGIN = 0.08
"""Room above and below the points, as a share of the vertical axis: no mark is cut off."""

DODGE = 3.0
"""Points (1/72 inch) between the marks of learners at one name, so that all are seen."""

BARS = {
    "standard_error": "one standard error of the mean over {runs} learning runs",
    "bootstrap": "one standard error, a bootstrap over buildings and {runs} teams in each",
    "spread": "spread (standard deviation) over robots and trials of {runs} learning runs",
}
"""What the bars of a figure mean."""


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
        where: `panel`, `line` and `x`. Optional: `tick`, the name of a place that is no number;
            `shift`, how many marks it stands beside such a place; `xlabel`; `runs`, the learning
            runs behind it; `reference`, whether it is what others are compared with.
    """
    error = getattr(measure, bars)
    negative = label not in LABELS or label in (
        "reward",
        "loss",
    )  # others cannot fall below 0
    low = error if negative else min(error, measure.mean)
    return {
        "y": measure.mean,
        "low": low,
        "high": error,
        "ylabel": LABELS.get(label, label),
        "shift": 0.0,
        "tick": None,
        "xlabel": "",
        "runs": None,
        "reference": False,
        **where,
    }


def points(
    results: Iterable[ConditionResult],
    measure: str,
    where: Where,
    bars: str = "standard_error",
) -> list[dict[str, Any]]:
    """Return the points of conditions, with what they are to be compared with.

    Those are the joint optimum, or its bound, the best asking team found where there is one, and
    the exact value of shortest-path policies.

    Args:
        results: the conditions.
        measure: one of `LABELS`.
        where: returns the place of a condition.
        bars: see `point`.
    """
    found = []
    places = []
    for one in results:
        place = {"panel": one.scenario.name, "line": one.learner.title, **where(one)}
        places.append((one, place))
        found.append(
            point(measured(one, measure), measure, bars, runs=one.runs, **place)
        )
    bounded = {place["panel"] for one, place in places if not one.optimum_exact}
    for one, place in places:
        optimum = BOUND if place["panel"] in bounded else OPTIMUM
        for line, value in compared_with(one, measure, optimum).items():
            here = {**place, "line": line, "shift": 0.0, "reference": True}
            found.append(point(Measure(value, 0, 0), measure, **here))
    return found


def compared_with(one: ConditionResult, measure: str, optimum: str) -> dict[str, float]:
    """Return what a condition's measure is compared with, by the names of the lines.

    Args:
        one: the condition.
        measure: one of `LABELS`.
        optimum: what the line of the joint optimum is called.
    """
    values: dict[str, float] = {}
    if measure in one.reference:
        values[SHORTEST] = one.reference[measure]
    if measure in ("reward", "loss"):
        values[SHORTEST] = one.reference["reward"]
        values[optimum] = one.optimum
        asking = best_asking_team(one) if one.learner.asks else None
        if asking is not None:
            values[ASKING] = asking
    if measure == "loss":
        alone = independent_bound(one.scenario)
        values = {line: alone - value for line, value in values.items()}
    return values


class Drawing(Figure):
    """A figure that notebooks show, whether or not they use pyplot."""

    def _repr_png_(self) -> bytes:
        return rendered(self, "png")


def plot(
    shown: Iterable[dict[str, Any]],
    columns: int,
    width: float = 3.4,
    height: float = 2.5,
    *,
    bars: str = "standard_error",
) -> Figure:
    """Draw points: a panel for each title and measure.

    Numbers stand on an axis at their true places, joined by lines; names stand side by side, each
    learner a point beside its name. The panels of one measure share their vertical axis, so that
    a small difference looks small; those of the reward share its length only, as its level
    depends on the scenario.

    Args:
        shown: the points, as of `point`.
        columns: panels of a row.
        width: of a panel, in inches.
        height: of a panel, in inches.
        bars: what the bars are, one of `BARS`.
    """
    data = pd.DataFrame(shown)
    panels = list(data.groupby(["ylabel", "panel"], sort=False, dropna=False))
    rows = math.ceil(len(panels) / columns)
    size = max(NARROWEST, columns * width)
    figure = Drawing(figsize=(size, rows * height + 1.1), layout="constrained")
    grid = figure.subplots(rows, columns, squeeze=False).flatten().tolist()
    handles: dict[str, Any] = {}
    drawn: dict[Any, list[Axes]] = {}
    for number, (((ylabel, title), own), axes) in enumerate(
        zip(panels, grid, strict=False)
    ):
        handles |= _panel(axes, own)
        axes.set_title(title, fontsize=11)
        if number % columns == 0 or panels[number - 1][0][0] != ylabel:
            axes.set_ylabel(
                f"{ylabel}\n(log scale)" if ylabel in LOGARITHMIC else ylabel
            )
        xlabel = own["xlabel"].iloc[0]
        below = panels[number + columns :][:1]
        if not below or below[0][1]["xlabel"].iloc[0] != xlabel:
            axes.set_xlabel(
                xlabel if axes.get_xscale() == "linear" else f"{xlabel} (log scale)"
            )
        drawn.setdefault(ylabel, []).append(axes)
    for axes in grid[len(panels) :]:
        axes.remove()
    for ylabel, own_axes in drawn.items():
        if ylabel in LOGARITHMIC:
            _steepen(own_axes)
        _share(own_axes, LEAST_SPANS.get(ylabel, 0.0), level=ylabel != LABELS["reward"])
    named = sorted(handles, key=[*STYLES, *handles].index)
    figure.legend(
        [handles[name] for name in named],
        named,
        title=_bars_text(data, bars),
        loc="outside lower center",
        ncols=max(2, min(math.ceil(len(named) / 2), int(size / 2.2))),
        frameon=False,
    )
    return figure


def _bars_text(data: pd.DataFrame, bars: str) -> str | None:
    """Return how many runs a figure shows, what its bars are, and how equal lines are drawn."""
    runs = data["runs"].dropna()
    if runs.empty:
        return None
    said = f"Each point: {int(runs.iloc[0])} learning runs"
    if data["high"].any():
        said = "Bars: " + BARS[bars].format(runs=int(runs.iloc[0]))
    return f"{said}.\n{NESTED_TEXT}." if data["tick"].isna().any() else f"{said}."


def _share(panels: Sequence[Axes], least: float, *, level: bool) -> None:
    """Give panels vertical axes of the same length, at least `least`; `level`: of one level."""
    limits = [axes.get_ylim() for axes in panels]
    if not level:
        length = max(least, *(high - low for low, high in limits))
        for axes, (low, high) in zip(panels, limits, strict=True):
            middle = (low + high) / 2
            axes.set_ylim(middle - length / 2, middle + length / 2)
        return
    bottom = min(low for low, _ in limits)
    top = max(high for _, high in limits)
    if top - bottom < least:
        bottom = max(bottom, min(axes.dataLim.y0 for axes in panels) - 0.05 * least)
        top = bottom + least
    for axes in panels:
        axes.set_ylim(bottom, top)


def _steepen(panels: Sequence[Axes]) -> None:
    """Give panels a logarithmic vertical axis; where there are values below 1, from 1 on only."""
    linear = min(axes.dataLim.y0 for axes in panels) < 1.0
    for axes in panels:
        if linear:
            axes.set_yscale("symlog", linthresh=1.0)
        else:
            axes.set_yscale("log")
        if axes.dataLim.y1 < PLAINLY:
            axes.yaxis.set_major_formatter(ScalarFormatter())
        axes.autoscale_view(scalex=False)
        if linear and axes.dataLim.y0 >= 0.0:
            axes.set_ylim(bottom=-0.2)


def _panel(axes: Axes, data: pd.DataFrame) -> dict[str, Any]:
    """Draw a panel and return the handle of each line for the legend."""
    handles = {}
    data = data.sort_values("x", kind="stable")
    names = data.dropna(subset="tick").drop_duplicates("x")
    joined = names.empty
    for line, own in data.drop_duplicates(["line", "x"]).groupby("line", sort=False):
        style = {
            "linewidth": 1.3,
            "markersize": 4.5,
            "capsize": 2,
            **STYLES.get(str(line), OTHER),
        }
        if joined:
            style |= NESTED.get(str(line), {} if own["reference"].any() else THINNEST)
        if own["reference"].any():
            alone = data["x"].nunique() == 1
            handles[str(line)] = _reference(
                axes, own, style, joined=joined, alone=alone
            )
            continue
        if not joined:
            style["linestyle"] = "none"
        bars = [own["low"], own["high"]] if own["high"].any() else None
        shift = 0.0 if joined else own["shift"].iloc[0]
        beside = ScaledTranslation(shift * DODGE / 72, 0, axes.figure.dpi_scale_trans)
        moved = axes.transData + beside
        low = own["low"].fillna(0.0)
        high = own["high"].fillna(0.0)  # a single run has no error
        for end in (own["y"] - low, own["y"] + high):
            axes.update_datalim(
                np.column_stack([own["x"], end])
            )  # `moved` hides the data
        handles[str(line)] = axes.errorbar(
            own["x"], own["y"], bars, transform=moved, **style
        )
    axes.margins(y=MARGIN)
    axes.autoscale_view()
    if joined:
        _number_axis(axes, data["xlabel"].iloc[0], data["x"].unique().tolist())
    else:
        axes.set_xticks(names["x"], names["tick"])
        axes.set_xlim(names["x"].min() - 0.5, names["x"].max() + 0.5)
    axes.ticklabel_format(axis="y", useOffset=False)
    axes.grid(alpha=0.3)
    return handles


def _reference(
    axes: Axes,
    own: pd.DataFrame,
    style: Mapping[str, Any],
    *,
    joined: bool,
    alone: bool,
) -> Any:
    """Draw what learners are compared with.

    Args:
        axes: the panel.
        own: its points.
        style: of its line.
        joined: whether places are numbers, joined by a line; else each place gets a dash.
        alone: whether the panel has one place only, so that the line may go all across.
    """
    line = {
        key: value
        for key, value in style.items()
        if key not in ("capsize", "markersize")
    }
    if joined and len(own) > 1:
        return axes.plot(own["x"], own["y"], **line)[0]
    if joined and alone:
        return axes.axhline(own["y"].iloc[0], **line)
    if joined:
        return axes.plot(own["x"], own["y"], **line, marker="_", markersize=12)[0]
    return axes.hlines(
        own["y"],
        own["x"] - 0.4,
        own["x"] + 0.4,
        colors=line["color"],
        linestyles=line["linestyle"],
        linewidths=line["linewidth"],
        zorder=line["zorder"],
    )


def _number_axis(axes: Axes, label: str, values: Sequence[float]) -> None:
    """Scale the horizontal axis of numbers, and name those whose names do not overlap.

    Penalties grow to the right.
    """
    sizes = [abs(value) for value in values if value]
    if label in LOGARITHMIC and sizes:
        axes.set_xscale("symlog", linthresh=min(sizes))
    if axes.get_xscale() != "linear" or len(values) <= MOST_TICKS:
        places = axes.xaxis.get_transform().transform(np.array(values)).tolist()
        shown = _far_apart(values, places)
        axes.set_xticks(shown, [f"{value:g}" for value in shown])
        axes.xaxis.set_minor_locator(FixedLocator(values))
    axes.autoscale_view(scaley=False)
    if min(values) < 0 and max(values) <= 0:
        axes.invert_xaxis()


def _far_apart(values: Sequence[float], places: Sequence[float]) -> list[float]:
    """Return the numbers whose names do not overlap on an axis, the largest first.

    Args:
        values: the numbers.
        places: where each stands on the axis, in any unit of length.
    """
    length = max(places) - min(places)
    found: list[tuple[float, float]] = []
    for value, place in sorted(
        zip(values, places, strict=True), key=lambda one: -abs(one[0])
    ):
        if all(
            abs(place - other)
            >= length * LETTER * (1 + (len(f"{value:g}{named:g}")) / 2)
            for named, other in found
        ):
            found.append((value, place))
    return [value for value, _ in found]


def rendered(
    figure: Figure, kind: str, dpi: float = 110, *, few: bool = False
) -> bytes:
    """Return a figure as a file of a kind, free of dates, versions and random ids.

    Args:
        figure: the figure.
        kind: "png", "svg" or "pdf".
        dpi: dots an inch of a PNG.
        few: whether 128 colours do for a PNG: a third of the size.
    """
    drawn = io.BytesIO()
    with matplotlib.rc_context(OUTPUT), _laid_out(figure):
        figure.savefig(drawn, format=kind, dpi=dpi, metadata=UNDATED[kind])
    if kind != "png" or not few:
        return drawn.getvalue()
    reduced = Image.open(drawn).convert("RGB").quantize(128, dither=Image.Dither.NONE)
    small = io.BytesIO()
    reduced.save(small, "png", optimize=True)
    return small.getvalue()


@contextmanager
def _laid_out(figure: Figure) -> Iterator[None]:
    """Lay a figure out, and keep this layout while it is saved.

    The last bits of a constrained layout differ from one time to the next. An SVG file names its
    clip paths by a hash of the places of the axes, so these are rounded.
    """
    engine = figure.get_layout_engine()
    if engine is None:
        yield
        return
    figure.draw_without_rendering()
    for part in figure.subfigs:
        part.bbox_relative.set_points(
            part.bbox_relative.get_points().round(PLACE_DIGITS)
        )
    for axes in figure.axes:
        place = axes.get_position(original=True)
        axes.set_position(Bbox(place.get_points().round(PLACE_DIGITS)))
        axes.set_in_layout(True)  # `set_position` takes it out of the layout
    figure.set_layout_engine("none")
    try:
        yield
    finally:
        figure.set_layout_engine(engine)


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
