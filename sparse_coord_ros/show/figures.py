# Copyright 2026 The sparse_coord_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Pictures of runs: greedy moves with questions, learning curves."""

import html
from collections.abc import Callable, Iterable, Iterator, Sequence
from functools import partial
from textwrap import fill
from typing import Any, NamedTuple

import numpy as np
import pandas as pd
from matplotlib.artist import Artist
from matplotlib.axes import Axes
from matplotlib.figure import Figure, SubFigure
from matplotlib.lines import Line2D
from matplotlib.patches import Circle, Patch
from matplotlib.ticker import MaxNLocator

from sparse_coord_ros.base.errors import SettingError, did_you_mean
from sparse_coord_ros.base.palette import LINE_COLOURS, robot_colour
from sparse_coord_ros.core.game.actions import DIRECTIONS
from sparse_coord_ros.show.charts import CURVE_LABELS, embedded, panel_grid
from sparse_coord_ros.show.map_pictures import draw_map
from sparse_coord_ros.show.policy import entered, policy_of
from sparse_coord_ros.show.sources import OpenedRun

LINE_WIDTH = 12.0
"""Greatest width of a line of panels, in inches."""

LEAST_FIGURE_WIDTH = 4.0
"""Least width of a figure, in inches."""

CURVE = (2.75, 2.5)
"""Width and height of a panel with a curve, in inches."""

LEAST_PANEL_WIDTH = 2.8
"""Least width of a panel with a map, in inches."""

POLICY_MAP = 3.4
SMALLEST_FIGURE_CELL = 0.3
"""Inches of the longer side of a small map, and of a cell of a large one."""

TITLE_SIZE = 10
"""Points of the titles of maps."""

LETTERS = 120
"""Letters in an inch of a text of one point; larger letters in proportion."""

HIGHEST_RATIO = 2.0
"""Greatest ratio of the heights of the highest and the lowest panel of a line."""

MOST_POINTS = 1000
"""Most points of a curve; longer ones are thinned evenly."""

LINES = (
    "-",
    "--",
    ":",
    "-.",
    (0, (5, 1, 1, 1, 1, 1)),
    (0, (1, 3)),
    (0, (8, 3)),
    (0, (3, 5)),
)
"""What tells lines apart beside colour."""

CURVES = ("length", "miscoordinations", "asks")
"""The learning curves."""

WHATS = ("policy", "curves")
"""The figures of a run."""


ARROW: dict[str, Any] = {"angles": "xy", "units": "xy", "scale_units": "xy", "scale": 1}
ARROW |= {"width": 0.05, "linewidth": 0.9, "zorder": 3}
ARROW |= {"headwidth": 4, "headlength": 3.4, "headaxislength": 3}
"""The arrow of a greedy move."""


class Panel(NamedTuple):
    """One panel.

    Attributes:
        width: least width in inches.
        height: height in inches.
        draw: draws it.
        stretches: whether it may become wider; maps may not.
    """

    width: float
    height: float
    draw: Callable[[Axes], None]
    stretches: bool = False


def literal(text: str) -> str:
    """Return a foreign text so that Matplotlib prints it unchanged, not as a formula."""
    return text.replace("$", r"\$")


def runs_figure(runs: Sequence[OpenedRun], whats: Sequence[str]) -> Figure:
    """Draw runs side by side.

    Args:
        runs: the runs, at least one.
        whats: some of `WHATS`, in the order of the figure.

    Raises:
        SparseCoordError: a run lacks data to draw.
    """
    lines = _balanced([group for what in whats for group in _groups(what, runs)])
    heights = [max(panel.height for panel in line) for line in lines]
    width = max(LEAST_FIGURE_WIDTH, *map(_width, lines))
    figure = Figure(figsize=(width, sum(heights)), layout="constrained")
    parts = figure.subfigures(len(lines), 1, height_ratios=heights, squeeze=False)[:, 0]
    for part, line in zip(parts, lines, strict=True):
        _draw_line(part, line, width)
    return figure


def _draw_line(part: SubFigure, line: Sequence[Panel], width: float) -> None:
    """Draw a line of panels: those that stretch fill the width, else the line is centred."""
    rest = width - _width(line)
    stretching = sum(panel.stretches for panel in line)
    more = rest / stretching if stretching else 0.0
    margin = 0.01 if stretching else max(0.01, rest / 2)
    widths = [panel.width + more * panel.stretches for panel in line]
    left, *axes, right = part.subplots(
        1, len(line) + 2, width_ratios=[margin, *widths, margin]
    )
    for panel, panel_axes in zip(line, axes, strict=True):
        panel.draw(panel_axes)
    left.set_axis_off()
    right.set_axis_off()


def available(shown: OpenedRun) -> list[str]:
    """Return the possible figures of a run, of `WHATS`."""
    needed = {"policy": "tables", "curves": "history"}
    return [what for what, data in needed.items() if shown.has(data)]


def names_of(runs: Sequence[OpenedRun]) -> list[str]:
    """Return the names of runs: the scenario of a single run, else name or path."""
    if len(runs) == 1:
        return [literal(runs[0].config.scenario.name)]
    names = [literal(run.name) for run in runs]
    if len(set(names)) < len(names):
        return [literal(str(run.path)) for run in runs]
    return names


def parse_whats(text: str | None, runs: Sequence[OpenedRun]) -> list[str]:
    """Return the figures to draw, from names between commas; None: all figures of every run.

    Raises:
        SettingError: an unknown name.
        SparseCoordError: the first run has no figure.
    """
    if text is None:
        of_runs = [available(run) for run in runs]
        common = [what for what in WHATS if all(what in whats for whats in of_runs)]
        if not common:
            _ = [run.tables for run in runs]  # raises an error if tables are missing
            raise SettingError("these runs have no plot in common; plot one run")
        return common
    whats = [part.strip() for part in text.split(",")]
    for what in whats:
        if what not in WHATS:
            raise SettingError(
                f"--what {what!r}: allowed of a run: {', '.join(WHATS)}, several with commas "
                f"between{did_you_mean(what, WHATS)}"
            )
    return whats


def _groups(what: str, runs: Sequence[OpenedRun]) -> Iterator[list[Panel]]:
    """Yield the panels of one figure, in groups that share a line if they fit.

    Curves show all runs in one panel; maps have a group for each run.
    """
    labels = names_of(runs)
    if what == "curves":
        draws = [partial(_draw_curve, runs, labels, name) for name in CURVES]
        yield [Panel(*CURVE, draw, stretches=True) for draw in draws]
        return
    for shown, label in zip(runs, labels, strict=True):
        yield list(_policy(shown, label))


def _balanced(groups: Sequence[list[Panel]]) -> list[list[Panel]]:
    """Break panels into as few lines as possible, and these into lines of similar widths."""
    lines = _lines(groups, LINE_WIDTH)
    while True:
        widest = max(map(_width, lines))
        narrower = _lines(groups, 0.99 * widest)
        if len(narrower) > len(lines) or max(map(_width, narrower)) >= widest:
            return lines
        lines = narrower


def _lines(groups: Iterable[list[Panel]], width: float) -> list[list[Panel]]:
    """Break panels into lines of at most that width, unless one panel is wider.

    A group stays together unless it is wider than a line.
    """
    lines: list[list[Panel]] = []
    for group in groups:
        if lines and _go_together([*lines[-1], *group], width):
            lines[-1] += group
        elif _width(group) <= width:
            lines.append(list(group))
        elif len(group) > 1:
            lines += _lines([[panel] for panel in group], width)
        else:
            lines.append(group)
    return lines


def _go_together(panels: Sequence[Panel], width: float) -> bool:
    """Return whether panels fit in a line of a width, and are of similar heights."""
    heights = [panel.height for panel in panels]
    return _width(panels) <= width and max(heights) <= HIGHEST_RATIO * min(heights)


def _width(line: Iterable[Panel]) -> float:
    return sum(panel.width for panel in line)


# Maps.


def _panel_width(shown: OpenedRun) -> float:
    width, _ = _map_size(shown)
    return max(LEAST_PANEL_WIDTH, width + 0.3)


def _put_title(shown: OpenedRun, title: str, axes: Axes) -> None:
    """Set the title of a map, in lines that fit into its panel."""
    letters = int(_panel_width(shown) * LETTERS / TITLE_SIZE)
    axes.set_title(fill(title, letters), fontsize=TITLE_SIZE)


def _map_size(shown: OpenedRun) -> tuple[float, float]:
    """Return width and height of a map, in inches."""
    rows, columns = shown.config.scenario.map.shape
    cell = max(SMALLEST_FIGURE_CELL, POLICY_MAP / max(rows, columns))
    return columns * cell, rows * cell


def _names(shown: OpenedRun) -> list[str]:
    return [literal(robot.name) for robot in shown.config.scenario.robots]


def _policy(shown: OpenedRun, label: str) -> Iterator[Panel]:
    names = _names(shown)
    groups = {name: range(k, k + 1) for k, name in enumerate(names)}
    if len(names) <= 2:
        groups = {f"{label}: greedy moves": range(len(names))}
    for title, robots in groups.items():
        last = robots.stop == len(names)
        draw = partial(_draw_policy, shown, robots, title, key=last)
        _, height = _map_size(shown)
        below = 0.5 if last else 0.0
        yield Panel(_panel_width(shown), height + 0.6 + below, draw)


def _draw_policy(
    shown: OpenedRun, robots: Sequence[int], title: str, axes: Axes, *, key: bool
) -> None:
    """Draw robots' greedy moves as arrows, and the cells where they ask as rings.

    Cells to which a robot never comes from its start are pale. The arrows of every second robot
    are hollow and its rings dashed: in greyscale its colour may look like another one's, pale.
    """
    scenario = shown.config.scenario
    draw_map(axes, scenario, label_height=0.14)
    rows, columns = np.array(scenario.map.cells).T
    south, east = np.array(DIRECTIONS).T
    for index, k in enumerate(robots):
        policy = policy_of(shown.tables[k], scenario.robots[k].goal)
        side = index - (len(robots) - 1) / 2
        x = columns + 0.5 + 0.4 * side
        y = rows + 0.6 + 0.2 * side
        colour = robot_colour(k)
        alpha = np.full(len(scenario.map.cells), 0.3)
        alpha[entered(policy, scenario.map, scenario.robots[k].start)] = 1.0
        cells, moves = np.nonzero(policy.moves & policy.learned[:, None])
        if len(cells):
            axes.quiver(
                *(x[cells] - 0.2 * east[moves], y[cells] - 0.2 * south[moves]),
                *(0.4 * east[moves], 0.4 * south[moves]),
                facecolor="white" if index % 2 else colour,
                edgecolor=colour,
                alpha=alpha[cells],
                **ARROW,
            )
        for cell in np.flatnonzero(policy.asks).tolist():
            ring = Circle((x[cell], y[cell]), 0.25, fill=False, linewidth=1.8, zorder=4)
            ring.set(edgecolor=colour, linestyle=LINES[index % 2], alpha=alpha[cell])
            axes.add_patch(ring)
    _put_title(shown, title, axes)
    if key:
        _policy_key(shown, robots if len(robots) > 1 else (), axes)


def _policy_key(shown: OpenedRun, robots: Sequence[int], axes: Axes) -> None:
    handles: list[Artist] = []
    for index, k in enumerate(robots):
        face = "white" if index % 2 else robot_colour(k)
        handles.append(
            Patch(facecolor=face, edgecolor=robot_colour(k), label=_names(shown)[k])
        )
    if shown.asks:
        ring: dict[str, Any] = {
            "marker": "o",
            "markersize": 9,
            "markerfacecolor": "none",
        }
        handles.append(
            Line2D([], [], color="0.3", ls="none", label="asks here first", **ring)
        )
    pale = Line2D([], [], color="0.3", alpha=0.3, linewidth=2.2, label="never visited")
    handles.append(pale)
    axes.legend(handles=handles, ncols=2, loc="upper center", bbox_to_anchor=(0.5, 0))


# Curves.


def _draw_curve(
    runs: Sequence[OpenedRun], labels: Sequence[str], name: str, axes: Axes
) -> None:
    """Draw a learning curve: each episode as a dot (of a single run), and running means.

    Questions of a single run have a line for each robot.
    """
    lines: list[tuple[OpenedRun, int | None]] = [(shown, None) for shown in runs]
    if len(runs) == 1:
        if name == "asks" and len(_names(runs[0])) > 1:
            labels = _names(runs[0])
            lines = [(runs[0], k) for k in range(1, len(labels) + 1)]
        else:
            labels = [f"mean of {_window(runs[0])} episodes"]
            points = thinned(*runs[0].history.curve(name))
            axes.plot(*points, ".", color="0.72", markersize=3, label="one episode")
    for number, (shown, robot) in enumerate(lines):
        points = thinned(*shown.history.curve(name, _window(shown), robot=robot))
        style = LINES[number % len(LINES)]
        colour = LINE_COLOURS[number % len(LINE_COLOURS)]
        if robot is not None:
            colour = robot_colour(robot - 1)
        axes.plot(
            *points, color=colour, linestyle=style, linewidth=1.6, label=labels[number]
        )
    axes.set_xlabel("learning step")
    ends = [shown.history.steps_before + shown.history.length for shown in runs]
    axes.set_xlim(0, max(int(end.max(initial=1)) for end in ends))
    axes.set_ylabel(CURVE_LABELS[name])
    axes.xaxis.set_major_locator(MaxNLocator(3))
    axes.grid(alpha=0.3)
    axes.legend(fontsize=6, ncols=2 if len(lines) > 4 else 1)


def _window(shown: OpenedRun) -> int:
    """Return the episodes of a running mean."""
    return max(1, min(50, shown.history.episodes // 10))


def thinned(steps: np.ndarray, values: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return at most `MOST_POINTS` points of a curve, evenly chosen, with both ends."""
    count = min(len(steps), MOST_POINTS)
    kept = np.linspace(0, len(steps) - 1, count).astype(np.int64)
    return steps[kept], values[kept]


def curves_figure(curves: pd.DataFrame, names: Sequence[str], title: str) -> Figure:
    """Draw mean learning curves.

    Args:
        curves: the steps, and each curve's mean and `_error`, as `Runs.history` has them.
        names: the curves, a panel each.
        title: of the figure.
    """
    figure, panels = panel_grid(len(names), len(names))
    colour = LINE_COLOURS[0]
    figure.suptitle(title, fontsize=11)
    for axes, name in zip(panels, names, strict=True):
        mean = curves[name]
        error = curves[f"{name}_error"].fillna(0.0)
        axes.fill_between(
            curves["steps"], mean - error, mean + error, color=colour, alpha=0.25, lw=0
        )
        axes.plot(curves["steps"], mean, color=colour)
        axes.set_xlabel("learning step")
        axes.set_ylabel(CURVE_LABELS[name])
        axes.grid(alpha=0.3)
    return figure


def in_html(head: str, shown: OpenedRun) -> str:
    """Return a line, and below it the available pictures of a run, side by side."""
    parts = [
        f"<p>{html.escape(head)}</p>",
        '<div style="display: flex; align-items: flex-start">',
    ]
    if shown.has("tables"):
        parts.append(embedded(runs_figure([shown], ["policy"]), "policy"))
    if shown.has("history") and shown.history.episodes:
        parts.append(embedded(runs_figure([shown], ["curves"]), "learning curves"))
    return "\n".join([*parts, "</div>"])
