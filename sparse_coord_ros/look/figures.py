# Copyright 2026 The sparse_coord_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Pictures of runs: policies and ask maps, learning curves, what Q^C holds, how percepts ended."""

import html
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from functools import partial
from typing import Any, NamedTuple

import numpy as np
from matplotlib.artist import Artist
from matplotlib.axes import Axes
from matplotlib.cm import ScalarMappable
from matplotlib.colors import Normalize
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Circle, Patch

from sparse_coord_ros.errors import SettingError, did_you_mean
from sparse_coord_ros.experiments.report.charts import embedded
from sparse_coord_ros.experiments.report.map_pictures import COLOUR_MAP, draw_map
from sparse_coord_ros.game.actions import DIRECTIONS
from sparse_coord_ros.learn.evaluation import acting_on
from sparse_coord_ros.learn.learners import learner_of
from sparse_coord_ros.look.policy import policy_of, sparsity_of
from sparse_coord_ros.look.sources import PLAYED_EPISODES, Shown
from sparse_coord_ros.look.steps import ended
from sparse_coord_ros.palette import OUTCOME_COLOURS, robot_colour
from sparse_coord_ros.runlog.log import RunLog

LINE_WIDTH = 11.0
"""Inches that a line of panels may take."""

CURVE, LONE_CURVE = (2.75, 2.5), (4.6, 3.4)
"""Width and height of a panel with a curve, in inches: one of several, and one alone."""

POLICY_MAP, SHADED_MAP, SMALLEST_CELL = 3.4, 2.8, 0.3
"""Inches of the longer side of a small map, and of a cell of a large one."""

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
    lines = [line for what in whats for line in _lines(_panels(what, runs))]
    heights = [max(panel.height for panel in line) for line in lines]
    width = max(sum(panel.width for panel in line) for line in lines)
    figure = Figure(figsize=(width, sum(heights)), layout="constrained")
    parts = figure.subfigures(len(lines), 1, height_ratios=heights, squeeze=False)[:, 0]
    for part, line in zip(parts, lines, strict=True):
        widths = [panel.width for panel in line]
        *axes, rest = part.subplots(
            1, len(line) + 1, width_ratios=[*widths, max(0.01, width - sum(widths))]
        )
        for panel, one in zip(line, axes, strict=True):
            panel.draw(one)
        rest.set_axis_off()
    return figure


def available(shown: Shown) -> list[str]:
    """Return what can be drawn of a run: of `WHATS`."""
    learned = shown.has("tables")
    asking = learned and shown.asks
    there = {
        "policy": learned,
        "asks": asking and shown.played is not None,
        "sparsity": asking,
        "curves": shown.has("history"),
        "percepts": shown.bag is not None and shown.log.asked.any(),
    }
    return [what for what, is_there in there.items() if is_there]


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
        there = [available(run) for run in runs]
        found = [what for what in WHATS if all(what in whats for whats in there)]
        if not found:
            _ = [run.tables for run in runs]  # says what is missing
            raise SettingError("these runs have nothing in common that could be drawn; plot one")
        return found
    whats = [part.strip() for part in text.split(",")]
    for what in [one for one in whats if one not in WHATS]:
        raise SettingError(
            f"--what {what!r}: allowed of a run: {', '.join(WHATS)}, several with commas "
            f"between{did_you_mean(what, WHATS)}"
        )
    return whats


def _panels(what: str, runs: Sequence[Shown]) -> Iterator[Panel]:
    """Yield the panels of one thing to be drawn: curves show all runs in one panel."""
    labels = names_of(runs)
    if what == "length":
        yield Panel(*LONE_CURVE, partial(_draw_curve, runs, labels, what))
    elif what == "curves":
        for name in CURVES:
            yield Panel(*CURVE, partial(_draw_curve, runs, labels, name))
    else:
        panels = {"policy": _policy, "asks": _asks, "sparsity": _sparsity, "percepts": _percepts}
        for shown, label in zip(runs, labels, strict=True):
            yield from panels[what](shown, label)


def _lines(panels: Iterable[Panel]) -> Iterator[list[Panel]]:
    """Break panels into lines."""
    line: list[Panel] = []
    for panel in panels:
        if line and sum(one.width for one in line) + panel.width > LINE_WIDTH:
            yield line
            line = []
        line.append(panel)
    yield line


# Maps.


def _map_panel(
    shown: Shown, longest: float, draw: Callable[[Axes], None], below: float = 0.0
) -> Panel:
    rows, columns = shown.config.scenario.map.shape
    cell = max(SMALLEST_CELL, longest / max(rows, columns))
    return Panel(max(2.8, columns * cell + 0.3), rows * cell + 0.6 + below, draw)


def _names(shown: Shown) -> list[str]:
    return [literal(robot.name) for robot in shown.config.scenario.robots]


def _policy(shown: Shown, label: str) -> Iterator[Panel]:
    names = _names(shown)
    groups = {name: range(k, k + 1) for k, name in enumerate(names)}
    if len(names) <= 2:
        groups = {f"{label}: greedy moves": range(len(names))}
    for title, robots in groups.items():
        last = robots.stop == len(names)
        draw = partial(_draw_policy, shown, robots, title, key=last)
        yield _map_panel(shown, POLICY_MAP, draw, 0.5 if last else 0.0)


def _draw_policy(
    shown: Shown, robots: Sequence[int], title: str, axes: Axes, *, key: bool = True
) -> None:
    """Draw robots' greedy moves as arrows and where they ask as rings.

    What lies where a robot never gets to in greedy episodes is pale. The arrows of every second
    robot are hollow and its rings dashed: in greyscale its colour may be another one's, pale.
    """
    scenario = shown.config.scenario
    draw_map(axes, scenario, label_height=0.14)
    rows, columns = np.array(scenario.map.cells).T
    south, east = np.array(DIRECTIONS).T
    for place, k in enumerate(robots):
        policy = policy_of(shown.tables[k], scenario.robots[k].goal)
        side = place - (len(robots) - 1) / 2
        x, y = columns + 0.5 + 0.4 * side, rows + 0.6 + 0.2 * side
        colour, alpha = robot_colour(k), np.ones(len(scenario.map.cells))
        if shown.played is not None:
            alpha[shown.played.stays[k] == 0] = 0.3
        cells, moves = np.nonzero(policy.moves)
        if len(cells):
            axes.quiver(
                *(x[cells] - 0.2 * east[moves], y[cells] - 0.2 * south[moves]),
                *(0.4 * east[moves], 0.4 * south[moves]),
                facecolor="white" if place % 2 else colour,
                edgecolor=colour,
                alpha=alpha[cells],
                **ARROW,
            )
        for cell in np.flatnonzero(policy.asks).tolist():
            ring = Circle((x[cell], y[cell]), 0.25, fill=False, linewidth=1.8, zorder=4)
            ring.set(edgecolor=colour, linestyle=LINES[place % 2], alpha=alpha[cell])
            axes.add_patch(ring)
    axes.set_title(title, fontsize=10)
    if key:
        _policy_key(shown, robots if len(robots) > 1 else (), axes)


def _policy_key(shown: Shown, robots: Sequence[int], axes: Axes) -> None:
    handles: list[Artist] = []
    for place, k in enumerate(robots):
        face = "white" if place % 2 else robot_colour(k)
        handles.append(Patch(facecolor=face, edgecolor=robot_colour(k), label=_names(shown)[k]))
    if shown.asks:
        ring: dict[str, Any] = {"marker": "o", "markersize": 9, "markerfacecolor": "none"}
        handles.append(Line2D([], [], color="0.3", ls="none", label="asks here first", **ring))
    if shown.played is not None:
        pale = Line2D([], [], color="0.3", alpha=0.3, linewidth=2.2, label="never gets here")
        handles.append(pale)
    axes.legend(handles=handles, ncols=2, loc="upper center", bbox_to_anchor=(0.5, 0))


def _shaded(
    shown: Shown, label: str, values: np.ndarray, titles: Sequence[str], scale: str
) -> Iterator[Panel]:
    """Yield a map for each row of values, shape (maps, cells), that shade its cells.

    All have one scale, which stands beside the last of them.
    """
    norm = Normalize(0, float(values.max()) or 1.0)
    for own, title in zip(values, titles, strict=True):
        bar = scale if title == titles[-1] else ""
        draw = partial(_draw_shades, shown, f"{label}: {title}", np.asarray(norm(own)), norm, bar)
        yield _map_panel(shown, SHADED_MAP, draw)


def _draw_shades(
    shown: Shown, title: str, dark: np.ndarray, norm: Normalize, bar: str, axes: Axes
) -> None:
    draw_map(axes, shown.config.scenario, dark, label_height=0.2)
    axes.set_title(title, fontsize=9)
    if bar:
        beside = axes.inset_axes((1.03, 0.0, 0.035, 1.0))
        axes.figure.colorbar(ScalarMappable(norm, COLOUR_MAP), cax=beside, label=bar)


def _asks(shown: Shown, label: str) -> Iterator[Panel]:
    asked, names = shown.trials.asked / PLAYED_EPISODES, _names(shown)
    titles = [f"{name} asks {asked[k].sum():.2f} times" for k, name in enumerate(names)]
    if len(names) > 2:
        asked = asked.sum(axis=0, keepdims=True)
        titles = [f"{len(names)} robots ask {asked.sum():.2f} times"]
    return _shaded(shown, label, asked, titles, "COORDINATE in a greedy episode")


def _sparsity(shown: Shown, label: str) -> Iterator[Panel]:
    rule = shown.config.known_rule or learner_of(acting_on(shown.tables[0]))
    scenario = shown.config.scenario
    found = [sparsity_of(one, rule.tables(scenario, k)) for k, one in enumerate(shown.tables)]
    named = zip(_names(shown), found, strict=True)
    titles = [f"$Q^C$ of {name}, {one.share:.2%} learned" for name, one in named]
    counts = np.array([one.by_cell for one in found], dtype=np.float64)
    if len(found) > 2:
        counts = counts.mean(axis=0, keepdims=True)
        share = sum(one.share for one in found) / len(found)
        titles = [f"$Q^C$, {share:.2%} learned, mean of {len(found)} robots"]
    factored = shown.tables[0].factors is not None
    scale = "corrections that are not 0" if factored else "joint states learned"
    return _shaded(shown, label, counts, titles, scale)


# Curves.


def _draw_curve(runs: Sequence[Shown], labels: Sequence[str], name: str, axes: Axes) -> None:
    """Draw a learning curve: each episode as a dot (of a single run), and running means.

    Of a single run reward and asks have a line a robot.
    """
    lines: list[tuple[Shown, int | None]] = [(shown, None) for shown in runs]
    if len(runs) == 1:
        if name in ("reward", "asks") and len(_names(runs[0])) > 1:
            labels = _names(runs[0])
            lines = [(runs[0], k) for k in range(1, len(labels) + 1)]
        else:
            labels = [f"mean of {_window(runs[0])}"]
            points = _thinned(*runs[0].history.curve(name))
            axes.plot(*points, ".", color="0.72", markersize=3, label="one episode")
    for number, (shown, robot) in enumerate(lines):
        points = _thinned(*shown.history.curve(name, _window(shown), robot=robot))
        style, colour = LINES[number % len(LINES)], robot_colour(number)
        axes.plot(*points, color=colour, linestyle=style, linewidth=1.6, label=labels[number])
    axes.set(yscale="log" if name == "length" else "linear", xlabel="time step")
    axes.set_ylabel(CURVES[name])
    axes.grid(alpha=0.3)
    axes.legend(fontsize=6, ncols=2 if len(lines) > 4 else 1)


def _window(shown: Shown) -> int:
    """Return the episodes of a running mean."""
    return max(1, min(50, shown.history.episodes // 10))


def _thinned(steps: np.ndarray, values: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    count = min(len(steps), MOST_POINTS)
    kept = np.linspace(0, len(steps) - 1, count).astype(np.int64)
    return steps[kept], values[kept]


def _percepts(shown: Shown, label: str) -> Iterator[Panel]:
    yield Panel(*LONE_CURVE, partial(_draw_percepts, shown.log, label))


def _draw_percepts(log: RunLog, label: str, axes: Axes) -> None:
    """Draw how often was asked over time, and how it ended: stacked bars."""
    first, last = log.step[[0, -1]] if len(log.step) else (0, 1)
    ends = np.linspace(first, last, 25)
    acted = np.histogram(np.repeat(log.step, (log.move >= 0).sum(axis=1)), ends)[0]
    below = np.zeros(len(ends) - 1)
    for name, found in ended(log).items():
        if not found.any():
            continue
        asked = np.histogram(np.repeat(log.step, found.sum(axis=1)), ends)[0]
        share = 100 * asked / np.maximum(acted, 1)
        said = f"{name} ({int(found.sum())})"
        for bar in axes.bar(ends[:-1], share, np.diff(ends), below, align="edge", label=said):
            bar.set(color=OUTCOME_COLOURS[name], hatch=HATCHES[name], ec="white", lw=0.4)
        below += share
    axes.set(xlabel="time step", ylabel="COORDINATE [% of actions]")
    axes.set_title(f"{label}: how percepts ended", fontsize=10)
    axes.legend(fontsize=7)


def in_html(head: str, shown: Shown) -> str:
    """Return a line, and below it the pictures of a run, side by side: those that it has."""
    parts = [f"<p>{html.escape(head)}</p>", '<div style="display: flex; align-items: flex-start">']
    if shown.has("tables"):
        parts.append(embedded(runs_figure([shown], ["policy"]), "policy"))
    if shown.has("history") and shown.history.episodes:
        parts.append(embedded(runs_figure([shown], ["length"]), "learning curve"))
    return "\n".join([*parts, "</div>"])
