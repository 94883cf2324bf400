# Copyright 2026 The sparse_coord_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Shared parts of all figures: the style of each line, the axes, the legend, and saving."""

import base64
import io
import math
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from typing import Any

import matplotlib
import pandas as pd
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import FixedLocator, ScalarFormatter
from matplotlib.transforms import Bbox
from PIL import Image

from sparse_coord_ros.base.palette import LINE_COLOURS

LABELS = {
    "returns": "return of a robot",
    "time_to_goal": "time to goal [steps]",
    "miscoordinations": "miscoordinations\nper episode",
    "asks": "COORDINATE per\nrobot and episode",
    "loss": "loss against\nrobots alone",
    "variance": "variance of the return",
}
"""What the vertical axis of each measure is called."""

CURVE_LABELS = {
    "returns": "return of a robot",
    "length": "steps of an episode",
    "miscoordinations": "miscoordinations\nof an episode",
    "asks": "questions of a robot\nin an episode",
    "arrived": "share of the robots\nthat arrive",
}
"""What the vertical axis of each learning curve is called."""

LOGARITHMIC = {"penalty", "steps", "loss", "variance"}
"""Settings and measures with a logarithmic axis in every figure. All others have a linear one."""

LEAST_SPANS = {
    "returns": 0.5,
    "time_to_goal": 0.5,
    "miscoordinations": 0.2,
    "asks": 0.2,
    "loss": 0.5,
    "variance": 1.0,
}
"""Smallest span of the vertical axis, so that rounding noise looks like none."""

OPTIMUM = "exact joint optimum"
BOUND = "bound of the optimum"
SHORTEST = "shortest paths, exact"
BEST_ASKING = "best asking team found"
REFERENCES = (OPTIMUM, BOUND, BEST_ASKING, SHORTEST)
"""Lines that learners are compared with: columns of the data that `draw_*` take."""

INDIV, NONCOOP, COOP, VOI = ("indiv", "noncoop", "coop", "voi")
HYSTERETIC, CQ, JOINT = ("hysteretic", "cq", "joint")

HOLLOW = {"markerfacecolor": "white"}
LEARNER_STYLES: Mapping[str, Mapping[str, Any]] = {
    INDIV: {"color": LINE_COLOURS[2], "marker": "s", "linestyle": ":"},
    NONCOOP: {"color": LINE_COLOURS[3], "marker": "^", "linestyle": "--"},
    COOP: {"color": LINE_COLOURS[1], "marker": "o", "linestyle": "-"},
    VOI: {"color": LINE_COLOURS[0], "marker": "P", "linestyle": (0, (5, 1))},
    HYSTERETIC: {"color": "#B8507A", "marker": "v", "linestyle": (0, (3, 1, 1, 1))},
    CQ: {"color": "#7F9C4D", "marker": "D", "linestyle": (0, (2, 1))},
    JOINT: {"color": "#5D5D8A", "marker": "X", "linestyle": (0, (4, 1, 1, 1, 1, 1))},
}
ALL_PEERS = f"{COOP}, all peers"
STYLES: Mapping[str, Mapping[str, Any]] = {
    **LEARNER_STYLES,
    **{
        f"{name}, {whose}": {**style, **fill}
        for name, style in LEARNER_STYLES.items()
        for whose, fill in (("ours", {}), ("paper", HOLLOW))
    },
    ALL_PEERS: {**LEARNER_STYLES[COOP], **HOLLOW, "linestyle": "-."},
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
    BEST_ASKING: {
        "color": "0.45",
        "linestyle": "-",
        "linewidth": 1.2,
        "zorder": 1.5,
    },
    SHORTEST: {"color": "0.8", "linestyle": "-", "linewidth": 4, "zorder": 1},
}
"""How each line is drawn, in the order of the legend; told apart in greyscale too."""

OTHER: Mapping[str, Any] = {
    "color": "#A08070",
    "marker": "*",
    "linestyle": (0, (1, 1)),
}
"""How users' own learners are drawn."""

NESTED: Mapping[str, Mapping[str, Any]] = {
    SHORTEST: {"linewidth": 7.0},
    INDIV: {"linewidth": 3.6, "markersize": 9.0, "zorder": 2.1},
    NONCOOP: {"linewidth": 2.7, "markersize": 7.5, "zorder": 2.2},
    COOP: {"linewidth": 1.9, "markersize": 5.5, "zorder": 2.3},
    VOI: {"linewidth": 1.0, "markersize": 4.0, "zorder": 2.5},
}
"""Sizes of joined lines: where lines are equal, each later one lies within the one before.

On an axis of numbers no line is moved aside, as its points would then stand at wrong numbers.
"""

THINNEST: Mapping[str, Any] = {"linewidth": 1.0, "markersize": 3.5, "zorder": 2.6}
"""Sizes of all other learners' joined lines."""

POINT: Mapping[str, Any] = {
    "linewidth": 1.3,
    "markersize": 4.5,
    "linestyle": "none",
}
"""Sizes of points that no line joins."""

ERRORS = "Bars: one standard error of the mean over {runs} learning runs."
WHISKERS = ERRORS.replace("Bars", "Whiskers")
NO_BARS = "Each point: {runs} learning runs."
NESTED_TEXT = "\nLines that coincide lie on one another, the thinner on top."
"""What the legend of a figure says above its lines."""

DODGE = 0.06
"""Distance of the points of neighbouring learners at one name, so that all are seen.

The names on an axis are 1 apart.
"""

MARGIN_SHARE = 0.08
"""Room above and below the points, as a share of the vertical axis: no mark is cut off."""

MOST_TICKS = 7
"""Numbers that an axis names one by one."""

PLAINLY = 1e5
"""Larger numbers on a logarithmic axis are named by their power of ten."""

MOST_LETTERS = 42
"""Letters of all names below a panel that fit side by side; more are written upwards."""

LETTER = 0.03
"""Width of a letter beside an axis, as a share of its length, in the narrowest panel."""

NARROWEST = 6.0
"""Inches of the narrowest figure: room for the legend and the labels of the axes."""


class Drawing(Figure):
    """A figure that notebooks show, whether or not they use pyplot."""

    def _repr_png_(self) -> bytes:
        return rendered(self, "png")


def panel_grid(count: int, columns: int) -> tuple[Figure, list[Axes]]:
    """Return a figure with panels in rows.

    Args:
        count: number of panels.
        columns: panels of a row.
    """
    rows = math.ceil(count / columns)
    size = (max(NARROWEST, columns * 3.4), rows * 2.5 + 1.1)  # inches
    figure = Drawing(figsize=size, layout="constrained")
    panels: list[Axes] = figure.subplots(rows, columns, squeeze=False).ravel().tolist()
    for unused in panels[count:]:
        unused.remove()
    return figure, panels[:count]


def draw_lines(axes: Axes, data: pd.DataFrame, x: str) -> None:
    """Draw lines over an axis of numbers.

    Args:
        axes: the panel.
        data: points: `line` (whose), `value`, `low` and `high` (lengths of its bar), and a
            column for each of `REFERENCES` that is shown, NaN where it is not known.
        x: the column of the places.
    """
    data = data.sort_values(x, kind="stable")
    for reference in _references(data):
        known = data.dropna(subset=reference).drop_duplicates(x)
        style = {**STYLES[reference], **NESTED.get(reference, {}), "label": reference}
        if data[x].nunique() == 1:
            axes.axhline(known[reference].iloc[0], **style)
        elif len(known) == 1:
            axes.plot(known[x], known[reference], marker="_", markersize=12, **style)
        else:
            axes.plot(known[x], known[reference], **style)
    for line, points in data.groupby("line", sort=False):
        style = {**STYLES.get(str(line), OTHER), **NESTED.get(str(line), THINNEST)}
        _draw_learner(axes, str(line), points[x], points, style)
    _number_axis(axes, x, data[x].unique().tolist())
    _finish_panel(axes)


def draw_points(axes: Axes, data: pd.DataFrame, x: str, names: Sequence[str]) -> None:
    """Draw points above names, the learners side by side.

    Args:
        axes: the panel.
        data: as in `draw_lines`; and `side`, by how many marks a learner stands to the right.
        x: the column of the names.
        names: all of them, in the order of the axis.
    """
    columns = data[x].map(list(names).index)
    for reference in _references(data):
        known = data[reference].notna()
        style = STYLES[reference]
        axes.hlines(
            data[reference][known],
            columns[known] - 0.4,
            columns[known] + 0.4,
            colors=style["color"],
            linestyles=style["linestyle"],
            linewidths=style["linewidth"],
            zorder=style["zorder"],
            label=reference,
        )
    for line, points in data.groupby("line", sort=False):
        positions = columns[points.index] + DODGE * points["side"]
        style = {**STYLES.get(str(line), OTHER), **POINT}
        _draw_learner(axes, str(line), positions, points, style)
    shown = sorted(columns.unique())
    written = [names[number] for number in shown]
    upright = are_long(written)
    axes.set_xticks(shown, written, rotation=90 if upright else 0)
    axes.set_xlim(shown[0] - 0.5, shown[-1] + 0.5)
    _finish_panel(axes)


def are_long(names: Sequence[str]) -> bool:
    """Return whether names do not fit side by side below a panel, and are written upwards."""
    return sum(map(len, names)) > MOST_LETTERS


def draw_bars(axes: Axes, data: pd.DataFrame) -> None:
    """Draw learners as bars above their names; the axis begins near the lowest one.

    Args:
        axes: the panel.
        data: a row for each learner; columns as in `draw_lines`.
    """
    for reference in _references(data):
        value = data[reference].dropna().iloc[0]
        axes.axhline(value, **{**STYLES[reference], "label": reference})
    for position, (_, point) in enumerate(data.iterrows()):
        style = STYLES.get(str(point["line"]), OTHER)
        error = [[point["low"]], [point["high"]]]
        axes.bar(
            position,
            point["value"],
            yerr=error,
            capsize=3,
            color=style["color"],
        )
    names = list(map(str, data["line"]))
    axes.set_xticks(range(len(names)), names, rotation=90 if are_long(names) else 0)
    axes.set_xlim(-0.7, len(data) - 0.3)
    _finish_panel(axes)


def _references(data: pd.DataFrame) -> list[str]:
    """Return the references for which the data have values."""
    return [name for name in REFERENCES if name in data and data[name].notna().any()]


def _draw_learner(
    axes: Axes,
    line: str,
    positions: "pd.Series[Any]",
    points: pd.DataFrame,
    style: Mapping[str, Any],
) -> None:
    bars = [points["low"], points["high"]] if points["high"].any() else None
    axes.errorbar(positions, points["value"], bars, label=line, capsize=2, **style)


def _finish_panel(axes: Axes) -> None:
    axes.margins(y=MARGIN_SHARE)
    axes.grid(alpha=0.3)


def _number_axis(axes: Axes, name: str, values: Sequence[float]) -> None:
    """Scale the horizontal axis, and name the numbers whose names do not overlap.

    Penalties grow to the right.
    """
    sizes = [abs(value) for value in values if value]
    if name in LOGARITHMIC and sizes:
        axes.set_xscale("symlog", linthresh=min(sizes))
    if name in LOGARITHMIC or len(values) <= MOST_TICKS:
        positions = axes.xaxis.get_transform().transform(values).tolist()
        shown = _far_apart(values, positions)
        axes.set_xticks(shown, [f"{value:g}" for value in shown])
        axes.xaxis.set_minor_locator(FixedLocator(values))
    if min(values) < 0 and max(values) <= 0:
        axes.invert_xaxis()


def _far_apart(values: Sequence[float], positions: Sequence[float]) -> list[float]:
    """Return the numbers whose names do not overlap on an axis, the largest first.

    Args:
        values: the numbers.
        positions: where each stands on the axis, in any unit of length.
    """
    length = max(positions) - min(positions)
    largest_first = sorted(
        zip(values, positions, strict=True), key=lambda pair: -abs(pair[0])
    )
    shown: list[tuple[float, float]] = []
    for value, position in largest_first:
        free = True
        for other, taken in shown:
            letters = len(f"{value:g}{other:g}")
            room = length * LETTER * (1 + letters / 2)
            free = free and abs(position - taken) >= room
        if free:
            shown.append((value, position))
    return [value for value, _ in shown]


def finish_measure(panels: Sequence[Axes], measure: str) -> None:
    """Make the vertical axes of a measure's panels comparable.

    All get the same limits, so that a small difference looks small. Those of the return get the
    same length only, as its level depends on the scenario.

    Args:
        panels: the panels of this measure, drawn.
        measure: one of `LABELS`.
    """
    if measure in LOGARITHMIC:
        _make_logarithmic(panels)
    else:
        for axes in panels:
            axes.ticklabel_format(axis="y", useOffset=False)
    limits = [axes.get_ylim() for axes in panels]
    if measure == "returns":
        length = max(LEAST_SPANS[measure], *(high - low for low, high in limits))
        for axes, (low, high) in zip(panels, limits, strict=True):
            middle = (low + high) / 2
            axes.set_ylim(middle - length / 2, middle + length / 2)
        return
    bottom = min(low for low, _ in limits)
    top = max(high for _, high in limits)
    least = LEAST_SPANS.get(measure, 0.0)
    if top - bottom < least:
        lowest = min(axes.dataLim.y0 for axes in panels)
        bottom = max(bottom, lowest - 0.05 * least)
        top = bottom + least
    room = 0.0 if measure in LOGARITHMIC else MARGIN_SHARE / 2 * (top - bottom)
    for axes in panels:
        axes.set_ylim(bottom - room, top + room)


def _make_logarithmic(panels: Sequence[Axes]) -> None:
    """Give panels a logarithmic vertical axis; where values are below 1, from 1 on only."""
    linear_below_1 = min(axes.dataLim.y0 for axes in panels) < 1.0
    for axes in panels:
        if linear_below_1:
            axes.set_yscale("symlog", linthresh=1.0)
        else:
            axes.set_yscale("log")
        if axes.dataLim.y1 < PLAINLY:
            axes.yaxis.set_major_formatter(ScalarFormatter())


def label_axes(
    panels: Sequence[Axes], columns: int, measure: str, xlabel: str = ""
) -> None:
    """Name the vertical axes of the first column and the horizontal ones of the last row.

    Args:
        panels: the panels of a measure, row by row.
        columns: panels of a row.
        measure: one of `LABELS`.
        xlabel: label of the horizontal axis; empty: no label.
    """
    for axes in panels[::columns]:
        axes.set_ylabel(_scaled(LABELS[measure], "\n", measure in LOGARITHMIC))
    for axes in panels[-columns:]:
        axes.set_xlabel(_scaled(xlabel, " ", xlabel in LOGARITHMIC))


def _scaled(label: str, between: str, logarithmic: bool) -> str:
    return f"{label}{between}(log scale)" if logarithmic else label


def add_legend(figure: Figure, title: str) -> None:
    """Name each line of the panels once, below them.

    Args:
        figure: the figure.
        title: the text above the lines.
    """
    handles: dict[str, Any] = {}
    for axes in figure.axes:
        new_handles, new_names = axes.get_legend_handles_labels()
        handles |= dict(zip(new_names, new_handles, strict=True))
    named = sorted(handles, key=[*STYLES, *handles].index)
    wide = int(figure.get_figwidth() / 2.2)
    figure.legend(
        [handles[name] for name in named],
        named,
        title=title,
        loc="outside lower center",
        ncols=max(2, min(math.ceil(len(named) / 2), wide)),
        frameon=False,
    )


OUTPUT: Any = {"svg.hashsalt": "sparse_coord_ros", "svg.fonttype": "path"}
"""Without a fixed salt the ids in an SVG file are random."""

UNDATED: Mapping[str, Mapping[str, Any]] = {
    "svg": {"Date": None, "Creator": None},
    "pdf": {"CreationDate": None, "Creator": None, "Producer": None},
    "png": {"Software": None},
}
"""Metadata left out of a file: when it was made, and by which version."""

POSITION_DIGITS = 6
"""Decimals of the place of axes, as a share of the figure: a thousandth of a pixel."""


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
            part.bbox_relative.get_points().round(POSITION_DIGITS)
        )
    for axes in figure.axes:
        position = axes.get_position(original=True)
        axes.set_position(Bbox(position.get_points().round(POSITION_DIGITS)))
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
