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
ONE, ALL = (f"{COOP}, {what}" for what in ("one peer", "all peers"))
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

PLACE_DIGITS = 6
"""Decimals of the place of axes, as a share of the figure: a thousandth of a pixel."""

Where = Callable[[ConditionResult], Mapping[str, Any]]
"""What `point` needs of a condition; scenario and learner where panel and line are missing."""

MOST_TICKS = 7
"""Numbers that an axis names one by one."""

NEXT_NAME = 4.0
"""Ratio of neighbouring numbers that are both named on a logarithmic axis."""

NARROWEST = 6.0
"""Inches of the narrowest figure: room for the legend and the labels of the axes."""

STEEP = 100.0
"""An axis is logarithmic if its largest value is more than this many times its smallest."""

DODGE = 3.0
"""Points (1/72 inch) between the marks of learners at one place, so that all are seen."""

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
            `shift`, how many marks it stands beside its place; `xlabel`; `runs`, the learning
            runs behind it; `reference`, whether it is what others are compared with.
    """
    error = getattr(measure, bars)
    negative = label not in LABELS or label in ("reward", "loss")  # others cannot fall below 0
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
        found.append(point(measured(one, measure), measure, bars, runs=one.runs, **place))
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
    steep: bool = False,
) -> Figure:
    """Draw points: a panel for each title and measure.

    Numbers stand on an axis with their true distances, joined by lines; names stand side by side,
    each learner a point. The panels of one measure share their vertical axis, so that a small
    difference looks small; those of the reward share its length only, as its level depends on the
    scenario.

    Args:
        shown: the points, as of `point`.
        columns: panels of a row.
        width: of a panel, in inches.
        height: of a panel, in inches.
        bars: what the bars are, one of `BARS`.
        steep: whether the vertical axis is logarithmic above 1.
    """
    data = pd.DataFrame(shown)
    panels = list(data.groupby(["ylabel", "panel"], sort=False, dropna=False))
    rows = math.ceil(len(panels) / columns)
    size = max(NARROWEST, columns * width)
    figure = Drawing(figsize=(size, rows * height + 0.9), layout="constrained")
    grid = figure.subplots(rows, columns, squeeze=False).flatten().tolist()
    handles: dict[str, Any] = {}
    drawn: dict[Any, list[Axes]] = {}
    for number, (((ylabel, title), own), axes) in enumerate(zip(panels, grid, strict=False)):
        handles |= _panel(axes, own)
        axes.set_title(title, fontsize=11)
        if number % columns == 0 or panels[number - 1][0][0] != ylabel:
            axes.set_ylabel(f"{ylabel}\n(log scale)" if steep else ylabel)
        xlabel = own["xlabel"].iloc[0]
        below = panels[number + columns :][:1]
        if not below or below[0][1]["xlabel"].iloc[0] != xlabel:
            axes.set_xlabel(xlabel if axes.get_xscale() == "linear" else f"{xlabel} (log scale)")
        drawn.setdefault(ylabel, []).append(axes)
    for axes in grid[len(panels) :]:
        axes.remove()
    for ylabel, own_axes in drawn.items():
        if steep:
            _steepen(own_axes)
        _share(own_axes, level=ylabel != LABELS["reward"])
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
    """Return how many runs a figure shows, and what its bars are."""
    runs = data["runs"].dropna()
    if runs.empty:
        return None
    if not data["high"].any():
        return f"Each point: {int(runs.iloc[0])} learning runs"
    return "Bars: " + BARS[bars].format(runs=int(runs.iloc[0]))


def _share(panels: Sequence[Axes], *, level: bool) -> None:
    """Give panels vertical axes of the same length; `level`: and of the same level."""
    lows, highs = zip(*(axes.get_ylim() for axes in panels), strict=True)
    length = max(high - low for low, high in zip(lows, highs, strict=True))
    for axes, low, high in zip(panels, lows, highs, strict=True):
        if level:
            axes.set_ylim(min(lows), max(highs))
        else:
            middle = (low + high) / 2
            axes.set_ylim(middle - length / 2, middle + length / 2)


def _steepen(panels: Sequence[Axes]) -> None:
    """Give panels a logarithmic vertical axis; where there are values below 1, from 1 on only."""
    linear = min(axes.dataLim.y0 for axes in panels) < 1.0
    for axes in panels:
        if linear:
            axes.set_yscale("symlog", linthresh=1.0)
        else:
            axes.set_yscale("log")
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
        style = {"linewidth": 1.3, "markersize": 4.5, "capsize": 2, **STYLES.get(str(line), OTHER)}
        if own["reference"].any():
            alone = data["x"].nunique() == 1
            handles[str(line)] = _reference(axes, own, style, joined=joined, alone=alone)
            continue
        if not joined:
            style["linestyle"] = "none"
        bars = [own["low"], own["high"]] if own["high"].any() else None
        beside = ScaledTranslation(
            own["shift"].iloc[0] * DODGE / 72, 0, axes.figure.dpi_scale_trans
        )
        moved = axes.transData + beside
        for end in (own["y"] - own["low"], own["y"] + own["high"]):
            axes.update_datalim(np.column_stack([own["x"], end]))  # `moved` hides the data
        handles[str(line)] = axes.errorbar(own["x"], own["y"], bars, transform=moved, **style)
    axes.autoscale_view()
    if joined:
        _number_axis(axes, data["x"].unique().tolist())
    else:
        axes.set_xticks(names["x"], names["tick"])
        axes.set_xlim(names["x"].min() - 0.5, names["x"].max() + 0.5)
    if data["ylabel"].iloc[0] == BYTES:
        axes.set_yscale("log")
    else:
        axes.ticklabel_format(axis="y", useOffset=False)
    axes.grid(alpha=0.3)
    return handles


def _reference(
    axes: Axes, own: pd.DataFrame, style: Mapping[str, Any], *, joined: bool, alone: bool
) -> Any:
    """Draw what learners are compared with.

    Args:
        axes: the panel.
        own: its points.
        style: of its line.
        joined: whether places are numbers, joined by a line; else each place gets a dash.
        alone: whether the panel has one place only, so that the line may go all across.
    """
    line = {key: value for key, value in style.items() if key not in ("capsize", "markersize")}
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


def _number_axis(axes: Axes, values: Sequence[float]) -> None:
    """Scale the horizontal axis of numbers: logarithmic where they differ by orders of magnitude.

    Penalties grow to the right.
    """
    sizes = [abs(value) for value in values if value]
    if sizes and max(sizes) > STEEP * min(sizes):
        axes.set_xscale("symlog", linthresh=min(sizes))
        named = _far_apart(values)
        axes.set_xticks(named, [f"{value:g}" for value in named])
        axes.xaxis.set_minor_locator(FixedLocator(values))
        axes.autoscale_view(scaley=False)
    elif len(values) <= MOST_TICKS:
        axes.set_xticks(values, [f"{value:g}" for value in values])
    if min(values) < 0 and max(values) <= 0:
        axes.invert_xaxis()


def _far_apart(values: Sequence[float]) -> list[float]:
    """Return the numbers whose names do not overlap on a logarithmic axis, the largest first."""
    found: list[float] = []
    for value in sorted(values, key=abs, reverse=True):
        if not found or abs(found[-1]) >= NEXT_NAME * abs(value):
            found.append(value)
    return found


def rendered(figure: Figure, kind: str, dpi: float = 110, *, few: bool = False) -> bytes:
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
        part.bbox_relative.set_points(part.bbox_relative.get_points().round(PLACE_DIGITS))
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
