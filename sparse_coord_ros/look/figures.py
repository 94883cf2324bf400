# Copyright 2026 The sparse_coord_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Pictures of runs: policies and ask maps, learning curves, what Q^C holds, how percepts ended."""

from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from functools import partial
from typing import Any, NamedTuple

import numpy as np
from matplotlib.artist import Artist
from matplotlib.axes import Axes
from matplotlib.cm import ScalarMappable
from matplotlib.collections import EllipseCollection
from matplotlib.colors import Normalize
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Patch
from matplotlib.ticker import FuncFormatter, LogLocator, NullFormatter

from sparse_coord_ros.errors import SettingError, did_you_mean
from sparse_coord_ros.experiments.report.map_pictures import COLOUR_MAP, draw_map
from sparse_coord_ros.game.actions import DIRECTIONS
from sparse_coord_ros.look.policy import policy_of, sparsity_of
from sparse_coord_ros.look.sources import TRIALS, Shown
from sparse_coord_ros.look.steps import ended
from sparse_coord_ros.palette import OUTCOME_COLOURS, robot_colour

LINE_WIDTH = 11.0
"""Inches that a line of panels may take."""

CURVE, LONE_CURVE = (2.75, 2.5), (4.6, 3.4)
"""Width and height of a panel with a curve, in inches: one of several, and one alone."""

POLICY_MAP, SHADED_MAP = 3.4, 2.8
"""Inches of the longer side of a small map."""

MOST_POINTS = 1000
"""Points of a curve; of longer ones some are left out, evenly."""

LINES = ("-", "--", ":", "-.", (0, (5, 1, 1, 1, 1, 1)), (0, (1, 3)), (0, (8, 3)), (0, (3, 5)))
"""What tells lines apart beside colour."""

HATCHES = {"answered": "", "refused": "////", "failed": "xx"}
"""What tells outcomes apart beside colour."""

CURVES: Mapping[str, str] = {
    "length": "steps of an episode",
    "reward": "reward of a robot\n(undiscounted)",
    "miscoordinations": "miscoordinations\nof an episode",
    "asks": "COORDINATE of a robot\nin an episode",
}
"""The learning curves, and how their axes are called."""

WHATS = ("policy", "asks", "sparsity", "curves", "percepts", "length")
"""What can be drawn of a run."""


ARROW: dict[str, Any] = {"angles": "xy", "units": "xy", "scale_units": "xy", "scale": 1}
ARROW |= {"width": 0.05, "linewidth": 0.9, "zorder": 3}
ARROW |= {"headwidth": 4, "headlength": 3.4, "headaxislength": 3}
"""How a greedy move is drawn."""


class Panel(NamedTuple):
    """One panel: its size in inches, and what draws it."""

    width: float
    height: float
    draw: Callable[[Axes], None]


def literal(text: str) -> str:
    """Return a text from outside so that Matplotlib prints it as it is, not as a formula."""
    return text.replace("$", r"\$")


def runs_figure(runs: Sequence[Shown], whats: Sequence[str]) -> Figure:
    """Draw runs side by side.

    Args:
        runs: the runs, at least one.
        whats: of `WHATS`, in the order in which they are to appear.

    Raises:
        SparseCoordError: a run lacks what is to be drawn.
    """
    lines = list(_lines(list(_panels(what, runs)) for what in whats))
    heights = [max(panel.height for panel in line) for line in lines]
    width = max(sum(panel.width for panel in line) for line in lines)
    figure = Figure(figsize=(width, sum(heights)), layout="constrained")
    parts = figure.subfigures(len(lines), 1, height_ratios=heights, squeeze=False)[:, 0]
    for part, line in zip(parts, lines, strict=True):
        left = width - sum(panel.width for panel in line)
        widths = [panel.width for panel in line] + ([left] if left > 0.01 else [])
        axes = part.subplots(1, len(widths), width_ratios=widths, squeeze=False)[0]
        for panel, one in zip(line, axes, strict=False):
            panel.draw(one)
        if left > 0.01:
            axes[-1].set_axis_off()
    return figure


def available(shown: Shown) -> list[str]:
    """Return what can be drawn of a run: of `WHATS`."""
    found = []
    if shown.has("tables"):
        found += ["policy", "asks", "sparsity"] if shown.config.rule.asks else ["policy"]
    if shown.has("history"):
        found.append("curves")
    if shown.bag is not None and shown.log.asked.any():
        found.append("percepts")
    return found


def names_of(runs: Sequence[Shown]) -> list[str]:
    """Return what to call runs: by the scenario if there is one only, else by name or path."""
    if len(runs) == 1:
        return [literal(runs[0].config.scenario.name)]
    names = [literal(run.name) for run in runs]
    return names if len(set(names)) == len(names) else [literal(str(run.path)) for run in runs]


def parse_whats(text: str | None, runs: Sequence[Shown]) -> list[str]:
    """Return what to draw: names between commas; where None, all that there is of every run.

    Raises:
        SettingError: an unknown name.
        SparseCoordError: the first run has nothing that can be drawn.
    """
    if text is None:
        found = [what for what in WHATS if all(what in available(run) for run in runs)]
        if not found:
            _ = [run.tables for run in runs]  # says what is missing
            raise SettingError("these runs have nothing in common that could be drawn; plot one")
        return found
    whats = [part.strip() for part in text.split(",")]
    for what in whats:
        if what not in WHATS:
            raise SettingError(
                f"--what {what!r}: allowed of a run: {', '.join(WHATS)}, several with commas "
                f"between{did_you_mean(what, WHATS)}"
            )
    return whats


def _panels(what: str, runs: Sequence[Shown]) -> Iterator[Panel]:
    """Yield the panels of one thing to be drawn: curves show all runs in one panel."""
    labels = names_of(runs)
    if what in ("curves", "length"):
        size = CURVE if what == "curves" else LONE_CURVE
        _ = [shown.history for shown in runs]  # says what is missing
        for name in CURVES if what == "curves" else (what,):
            yield Panel(*size, partial(draw_curve, runs, labels, name))
    else:
        panels = {"policy": _policy, "asks": _asks, "sparsity": _sparsity, "percepts": _percepts}
        for shown, label in zip(runs, labels, strict=True):
            yield from panels[what](shown, label)


def _lines(groups: Iterable[list[Panel]]) -> Iterator[list[Panel]]:
    """Break groups of panels into lines; a group that does not fit in a line begins a new one."""
    line: list[Panel] = []
    for group in groups:
        begins = sum(one.width for one in (*line, *group)) > LINE_WIDTH
        for panel in group:
            if line and (begins or sum(one.width for one in line) + panel.width > LINE_WIDTH):
                yield line
                line = []
            begins = False
            line.append(panel)
    if line:
        yield line


# Maps.


def cell_inches(shown: Shown, longest: float) -> float:
    """Return how large a cell of a run's map is drawn: such that it can be read."""
    columns = shown.config.scenario.map.shape[1]
    legible = min(0.34, (LINE_WIDTH - 0.6) / columns)
    return max(0.24, legible, longest / max(shown.config.scenario.map.shape))


def _label_size(cell: float) -> float:
    """Return the size of the labels of starts and goals, in points."""
    return max(5.0, min(8.0, 13 * cell))


def _map_panel(
    shown: Shown, longest: float, draw: Callable[[Axes], None], below: float = 0.0
) -> Panel:
    rows, columns = shown.config.scenario.map.shape
    cell = cell_inches(shown, longest)
    return Panel(max(2.8, columns * cell + 0.3), rows * cell + 0.6 + below, draw)


def _names(shown: Shown) -> list[str]:
    return [literal(robot.name) for robot in shown.config.scenario.robots]


def _policy(shown: Shown, label: str) -> Iterator[Panel]:
    _, names = shown.tables, _names(shown)
    if len(names) <= 2:
        groups = {f"{label}: greedy moves": range(len(names))}
    else:
        groups = {name: range(k, k + 1) for k, name in enumerate(names)}
    for title, robots in groups.items():
        last = robots.stop == len(names)
        draw = partial(draw_policy, shown, robots, title, key=last)
        yield _map_panel(shown, POLICY_MAP, draw, 0.5 if last else 0.0)


def draw_policy(
    shown: Shown, robots: Sequence[int], title: str, axes: Axes, *, key: bool = True
) -> None:
    """Draw robots' greedy moves as arrows and where they ask as rings.

    What lies where a robot never gets to in greedy episodes is pale. The arrows of every second
    robot are hollow and its rings dashed: in greyscale its colour may be another one's, pale.
    """
    scenario = shown.config.scenario
    label_size = _label_size(cell_inches(shown, POLICY_MAP))
    draw_map(axes, scenario, label_size=label_size, label_height=0.14)
    rows, columns = np.array(scenario.map.cells).T
    south, east = np.array(DIRECTIONS).T
    for place, k in enumerate(robots):
        policy = policy_of(shown.tables[k], scenario.robots[k].goal)
        side = place - (len(robots) - 1) / 2
        x, y = columns + 0.5 + 0.4 * side, rows + 0.6 + 0.2 * side
        reached, colour = shown.trials.stays[k] > 0, robot_colour(k)
        for there, alpha in ((True, 1.0), (False, 0.3)):
            cells, moves = np.nonzero(policy.moves & (reached == there)[:, None])
            axes.quiver(
                *(x[cells] - 0.2 * east[moves], y[cells] - 0.2 * south[moves]),
                *(0.4 * east[moves], 0.4 * south[moves]),
                facecolor="white" if place % 2 else colour,
                edgecolor=colour,
                alpha=alpha,
                **ARROW,
            )
            asks = np.flatnonzero(policy.asks & (reached == there))
            size = np.full(len(asks), 0.5)
            rings = EllipseCollection(
                *(size, size, np.zeros(len(asks))),
                units="xy",
                offsets=np.column_stack([x[asks], y[asks]]),
                offset_transform=axes.transData,
                facecolors="none",
                edgecolors=colour,
                linewidths=1.8,
                linestyles=LINES[place % 2],
                alpha=alpha,
                zorder=4,
            )
            if len(asks):
                axes.add_collection(rings, autolim=False)
    axes.set_title(title, fontsize=10)
    if key:
        _policy_key(shown, robots if len(robots) > 1 else (), axes)


def _policy_key(shown: Shown, robots: Sequence[int], axes: Axes) -> None:
    handles: list[Artist] = []
    for place, k in enumerate(robots):
        face = "white" if place % 2 else robot_colour(k)
        handles.append(Patch(facecolor=face, edgecolor=robot_colour(k), label=_names(shown)[k]))
    if shown.config.rule.asks:
        ring = Line2D([], [], color="0.3", marker="o", linestyle="none", label="asks here first")
        ring.set(markersize=9, markerfacecolor="none")
        handles.append(ring)
    handles.append(Line2D([], [], color="0.3", alpha=0.3, linewidth=2.2, label="never gets here"))
    below: dict[str, Any] = {"loc": "upper center", "bbox_to_anchor": (0.5, -0.01)}
    axes.legend(handles=handles, ncols=2, frameon=False, fontsize=8, **below)


class Shades(NamedTuple):
    """What shades the maps of one run, all on one scale.

    Attributes:
        values: shape (maps, cells).
        titles: of each map.
        scale: what the values are.
        numbers: how one is written into its cell.
    """

    values: np.ndarray
    titles: Sequence[str]
    scale: str
    numbers: str


def _shaded(shown: Shown, label: str, shades: Shades) -> Iterator[Panel]:
    """Yield a map each, cells shaded by values."""
    for number in range(len(shades.titles)):
        yield _map_panel(shown, SHADED_MAP, partial(_draw_shades, shown, label, shades, number))


def _draw_shades(shown: Shown, label: str, shades: Shades, number: int, axes: Axes) -> None:
    grid, values = shown.config.scenario.map, shades.values[number]
    norm = Normalize(0, float(shades.values.max()) or 1.0)
    cell, dark = cell_inches(shown, SHADED_MAP), np.asarray(norm(values))
    size = _label_size(cell) - 0.5
    draw_map(axes, shown.config.scenario, dark, label_size=size, label_height=0.2)
    for x in np.flatnonzero(values).tolist() if cell >= 0.34 else ():
        row, column = grid.cells[x]
        text, ink = shades.numbers.format(values[x]), "white" if dark[x] > 0.6 else "black"
        axes.text(column + 0.5, row + 0.62, text, ha="center", va="center", fontsize=7, color=ink)
    axes.set_title(f"{label}: {shades.titles[number]}", fontsize=9)
    if number == len(shades.titles) - 1:
        beside = axes.inset_axes((1.03, 0.0, 0.035, 1.0))
        bar = axes.figure.colorbar(ScalarMappable(norm, COLOUR_MAP), cax=beside)
        bar.set_label(shades.scale, fontsize=8)
        bar.ax.tick_params(labelsize=7)


def _asks(shown: Shown, label: str) -> Iterator[Panel]:
    asked, names = shown.trials.asked / TRIALS, _names(shown)
    titles = [f"{name} asks {asked[k].sum():.2f} times" for k, name in enumerate(names)]
    if len(names) > 2:
        asked = asked.sum(axis=0, keepdims=True)
        titles = [f"{len(names)} robots ask {asked.sum():.2f} times"]
    scale = "COORDINATE in a greedy episode"
    return _shaded(shown, label, Shades(asked, titles, scale, "{:.2g}"))


def _sparsity(shown: Shown, label: str) -> Iterator[Panel]:
    found = [sparsity_of(tables, shown.config.scenario) for tables in shown.tables]
    titles = [
        f"$Q^C$ of {name}, {one.share:.2%} learned"
        for name, one in zip(_names(shown), found, strict=True)
    ]
    counts = np.array([one.by_cell for one in found], dtype=np.float64)
    if len(found) > 2:
        counts = counts.mean(axis=0, keepdims=True)
        share = sum(one.share for one in found) / len(found)
        titles = [f"$Q^C$, {share:.2%} learned, mean of {len(found)} robots"]
    factored = shown.tables[0].factors is not None
    scale = "corrections that are not 0" if factored else "joint states learned"
    return _shaded(shown, label, Shades(counts, titles, scale, "{:.0f}"))


# Curves.


def draw_curve(runs: Sequence[Shown], labels: Sequence[str], name: str, axes: Axes) -> None:
    """Draw a learning curve: each episode as a dot (of a single run), and running means.

    Of a single run reward and asks have a line a robot.
    """
    single = len(runs) == 1
    for number, (shown, label) in enumerate(zip(runs, labels, strict=True)):
        history, names = shown.history, [r.name for r in shown.config.scenario.robots]
        window = max(1, min(50, history.episodes // 10))
        by_robot = single and name in ("reward", "asks") and len(names) > 1
        if single and not by_robot:
            steps, values = _thinned(*history.curve(name))
            axes.plot(steps, values, ".", color="0.72", markersize=3, label="one episode")
        for place, k in enumerate(range(1, len(names) + 1) if by_robot else [None]):
            line = place if single else number
            said = label if not single else f"mean of {window}"
            axes.plot(
                *_thinned(*history.curve(name, window, robot=k)),
                color=robot_colour(line),
                linestyle=LINES[line % len(LINES)],
                linewidth=1.6,
                label=literal(names[k - 1]) if k is not None else said,
            )
    if name == "length":
        axes.set_yscale("log")
        axes.yaxis.set_major_locator(LogLocator(subs=(1.0, 2.0, 5.0)))
        axes.yaxis.set_major_formatter(FuncFormatter(lambda value, _: f"{value:g}"))
        axes.yaxis.set_minor_formatter(NullFormatter())
    axes.set_xlabel("time step")
    axes.set_ylabel(CURVES[name])
    axes.grid(alpha=0.3)
    many = len(axes.lines) > 4
    if many:  # room for the legend
        low, high = axes.get_ylim()
        axes.set_ylim(low, high + 0.6 * (high - low) if name != "length" else 4 * high)
    axes.legend(fontsize=6 if many else 7, ncols=2 if many else 1)


def _thinned(steps: np.ndarray, values: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    count = min(len(steps), MOST_POINTS)
    kept = np.linspace(0, len(steps) - 1, count).astype(np.int64)
    return steps[kept], values[kept]


def _percepts(shown: Shown, label: str) -> Iterator[Panel]:
    _ = shown.log  # says what is missing
    yield Panel(*LONE_CURVE, partial(draw_percepts, shown, label))


def draw_percepts(shown: Shown, label: str, axes: Axes) -> None:
    """Draw how often was asked over time, and how it ended: stacked bars."""
    log = shown.log
    first, last = (int(log.step[0]), int(log.step[-1])) if len(log.step) else (0, 1)
    ends = np.linspace(first, last, 25)
    acted = np.histogram(np.repeat(log.step, (log.move >= 0).sum(axis=1)), ends)[0]
    below = np.zeros(len(ends) - 1)
    for name, found in ended(log).items():
        if not found.any():
            continue
        asked = np.histogram(np.repeat(log.step, found.sum(axis=1)), ends)[0]
        share = 100 * asked / np.maximum(acted, 1)
        axes.bar(
            *(ends[:-1], share, np.diff(ends), below),
            align="edge",
            color=OUTCOME_COLOURS[name],
            hatch=HATCHES[name],
            edgecolor="white",
            linewidth=0.4,
            label=f"{name} ({int(found.sum())})",
        )
        below += share
    axes.set(xlabel="time step", ylabel="COORDINATE [% of actions]")
    axes.set_ylim(0, 1.3 * max(float(below.max()), 1e-9))  # room for the legend
    axes.set_title(f"{label}: how percepts ended", fontsize=10)
    axes.legend(fontsize=7)
