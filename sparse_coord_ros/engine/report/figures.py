# Copyright 2026 The sparse_coord_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Figures: one style, the same bytes for the same results."""

import math
from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path

import matplotlib
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from sparse_coord_ros.core.evaluation import Measure
from sparse_coord_ros.core.optimum import independent_bound
from sparse_coord_ros.engine.report.analysis import loss_alone
from sparse_coord_ros.engine.report.entries import LEARNER_NAMES, Entries, Entry

LABELS = {
    "reward": "total discounted reward",
    "time_to_goal": "time to goal [steps]",
    "miscoordinations": "miscoordinations\nper episode",
    "asks": "COORDINATE\nper robot and episode",
    "loss": "loss against robots alone",
    "variance": "variance of the reward",
}
COLOURS = {"indiv": "#D55E00", "noncoop": "#0072B2", "coop": "#009E73"}
MARKERS = {"indiv": "s", "noncoop": "^", "coop": "o"}
SHIFTS = {"indiv": -0.06, "noncoop": 0.0, "coop": 0.06}
GREY = "0.6"
OPTIMUM, BOUND, SHORTEST = "exact joint optimum", "bound of the optimum", "shortest paths, exact"
YARDSTICKS = (OPTIMUM, BOUND, SHORTEST)
OUTPUT = {"svg.hashsalt": "sparse_coord_ros", "svg.fonttype": "path"}
"""Without a fixed salt the ids in an SVG file are random."""


@dataclass(frozen=True)
class Curve:
    """One learner over the values of a setting.

    Attributes:
        label: what the legend calls it.
        learner: whose colour and marker it has.
        xs: positions on the axis, one an entry.
        entries: the cells.
        dashed: whether the line is dashed, its markers hollow.
        shift: by how much it is moved sideways, so that equal curves are both seen.
    """

    label: str
    learner: str
    xs: Sequence[float]
    entries: Entries
    dashed: bool = False
    shift: float = 0.0

    def draw(self, axes: Axes, measure: str) -> None:
        """Draw means with standard errors; the variance without."""
        colour = COLOURS[self.learner]
        if measure == "variance":
            values = [entry.measure("reward").spread ** 2 for entry in self.entries]
            errors = None
        elif measure == "loss":
            losses = [loss_alone(entry) for entry in self.entries]
            values = [m.mean for m in losses]
            errors = [m.standard_error for m in losses]
        else:
            measures = [entry.measure(measure) for entry in self.entries]
            values = [m.mean for m in measures]
            errors = [m.standard_error for m in measures]
        axes.errorbar(
            [x + self.shift for x in self.xs],
            values,
            errors,
            label=self.label,
            color=colour,
            marker=MARKERS[self.learner],
            markersize=4.5,
            markerfacecolor="white" if self.dashed else colour,
            linestyle="--" if self.dashed else "-",
            linewidth=1.3,
            capsize=2,
        )


@dataclass(frozen=True)
class Panel:
    """Curves over one setting, with what the rewards are to be compared with.

    Attributes:
        title: what the panel shows.
        xlabel: the setting and its unit.
        curves: the learners.
        ticks: positions of the axis that bear a text.
        ends: over what the optimum and shortest-path policies are drawn where it is not the
            positions of the first curve.
    """

    title: str
    xlabel: str
    curves: Sequence[Curve]
    ticks: dict[float, str] = field(default_factory=dict)
    ends: Sequence[float] = ()

    def draw(self, axes: Axes, measure: str) -> None:
        """Draw one measure; reward and loss with the worth of shortest-path policies.

        The reward has the optimum beside it too.
        """
        if measure == "reward":
            first = self.curves[0]
            if self.ends:
                yardsticks(axes, self.ends, [first.entries[0]] * len(self.ends))
            else:
                yardsticks(axes, first.xs, list(first.entries))
        if measure == "loss":
            first = self.curves[0]
            values = [
                independent_bound(entry.scenario) - entry.result.reference["reward"]
                for entry in first.entries
            ]
            axes.plot(first.xs, values, color=GREY, linewidth=1, label=SHORTEST)
        for curve in self.curves:
            curve.draw(axes, measure)
        if self.ticks:
            axes.set_xticks(list(self.ticks), list(self.ticks.values()))
        axes.grid(alpha=0.3)


def yardsticks(axes: Axes, xs: Sequence[float], entries: Sequence[Entry]) -> None:
    """Draw the joint optimum (or its bound) and the exact value of shortest-path policies."""
    exact = all(entry.result.optimum_exact for entry in entries)
    axes.plot(
        xs,
        [entry.result.optimum for entry in entries],
        color="black",
        linestyle="--" if exact else ":",
        linewidth=1.3,
        label=OPTIMUM if exact else BOUND,
    )
    axes.plot(
        xs,
        [entry.result.reference["reward"] for entry in entries],
        color=GREY,
        linewidth=1,
        label=SHORTEST,
    )


def comparison(entries: Entries, measures: Sequence[str]) -> Figure:
    """Draw ours and the paper's mean and spread, a panel a scenario and measure."""
    names = entries.names
    columns = min(3, len(names))
    lines = math.ceil(len(names) / columns)
    figure, grid = canvas(len(measures) * lines, columns, 3.3, 2.9)
    for i, measure in enumerate(measures):
        for j, name in enumerate(names):
            axes = grid[i * lines + j // columns][j % columns]
            _compare(axes, entries.pick(name), measure)
            axes.set_title(name)
            if j % columns == 0:
                axes.set_ylabel(LABELS[measure])
    legend(figure, grid)
    return figure


def _compare(axes: Axes, entries: Entries, measure: str) -> None:
    ends = [-0.5, len(entries) - 0.5]
    if measure == "reward":
        yardsticks(axes, ends, [entries[0]] * 2)
    else:
        exact = entries[0].result.reference[measure]
        axes.plot(ends, [exact] * 2, color=GREY, linewidth=1, label=SHORTEST)
    for x, entry in enumerate(entries):
        for shift, source, value in (
            (-0.14, "ours", entry.measure(measure)),
            (0.14, "paper", entry.paper(measure)),
        ):
            if value is not None:
                _point(axes, x + shift, value, entry.cell.learner, source)
    axes.set_xticks(range(len(entries)), [entry.learner for entry in entries])
    axes.grid(alpha=0.3, axis="y")


def _point(axes: Axes, x: float, value: Measure, learner: str, source: str) -> None:
    colour = COLOURS[learner]
    axes.errorbar(
        [x],
        [value.mean],
        [value.spread],
        color=colour,
        marker=MARKERS[learner],
        markersize=6,
        markerfacecolor=colour if source == "ours" else "white",
        alpha=1 if source == "ours" else 0.75,
        capsize=3,
        label=f"{LEARNER_NAMES[learner]}, {source}",
    )


def sweep(panels: Sequence[Panel], measures: Sequence[str], widths: Sequence[float]) -> Figure:
    """Draw a row a measure and a column a panel; `widths` are inches, one a panel."""
    figure = Figure(figsize=(sum(widths), 0.6 + 2.4 * len(measures)), layout="constrained")
    grid = figure.subplots(
        len(measures), len(panels), squeeze=False, gridspec_kw={"width_ratios": widths}
    )
    for i, measure in enumerate(measures):
        for j, panel in enumerate(panels):
            panel.draw(grid[i][j], measure)
            grid[0][j].set_title(panel.title)
            grid[-1][j].set_xlabel(panel.xlabel)
        grid[i][0].set_ylabel(LABELS[measure])
    legend(figure, grid)
    return figure


def wall(panels: Sequence[Panel], measure: str) -> Figure:
    """Draw one measure in many panels, three a row."""
    columns = min(3, len(panels))
    figure, grid = canvas(math.ceil(len(panels) / columns), columns, 3.7, 2.6)
    for j, panel in enumerate(panels):
        axes = grid[j // columns][j % columns]
        panel.draw(axes, measure)
        axes.set_title(panel.title)
        if j % columns == 0:
            axes.set_ylabel(LABELS[measure])
        if j + columns >= len(panels):
            axes.set_xlabel(panel.xlabel)
    for axes in list(grid.flat)[len(panels) :]:
        axes.remove()
    legend(figure, grid)
    return figure


def canvas(rows: int, columns: int, width: float, height: float):
    """Return a figure and its axes, shape (rows, columns), with panels of that size in inches."""
    figure = Figure(figsize=(columns * width, rows * height + 0.6), layout="constrained")
    return figure, figure.subplots(rows, columns, squeeze=False)


def legend(figure: Figure, grid) -> None:
    """Add one legend for all panels, below them."""
    named = {}
    for axes in grid.flat:
        for handle, label in zip(*axes.get_legend_handles_labels(), strict=True):
            named.setdefault(label, handle)
    last = [label for label in YARDSTICKS if label in named]
    named |= {label: named.pop(label) for label in last}
    figure.legend(
        named.values(),
        named.keys(),
        loc="outside lower center",
        ncols=min(math.ceil(len(named) / 2), int(figure.get_figwidth() / 1.9)),
        frameon=False,
    )


def save(figure: Figure, stem: Path) -> None:
    """Write `stem`.png and `stem`.svg, free of dates, versions and random ids."""
    with matplotlib.rc_context(OUTPUT):
        figure.savefig(
            stem.with_name(f"{stem.name}.svg"), metadata={"Date": None, "Creator": None}
        )
        figure.set_layout_engine("none")  # laid out by now: once is enough
        figure.savefig(stem.with_name(f"{stem.name}.png"), dpi=110, metadata={"Software": None})
