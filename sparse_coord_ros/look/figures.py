# Copyright 2026 The sparse_coord_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Pictures of runs: policies and ask maps, learning curves, what Q^C holds, how percepts ended."""

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from functools import partial

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


@dataclass(frozen=True)
class Panel:
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
    labels = names_of(runs)
    lines = list(_lines(WHATS[what](runs, labels) for what in whats))
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
    parts = {name: shown.has(name) for name in ("tables", "history")}
    needs = {"policy": "tables", "asks": "tables", "sparsity": "tables", "curves": "history"}
    found = [what for what, part in needs.items() if parts[part]]
    if "sparsity" in found and not shown.config.rule.asks:
        found.remove("sparsity")
        found.remove("asks")
    return found + (["percepts"] if shown.bag is not None and shown.log.asked.any() else [])


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


def _lines(groups: Iterable[list[Panel]]) -> Iterable[list[Panel]]:
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


def draw_policy(axes: Axes, shown: Shown, robots: Sequence[int], title: str) -> None:
    """Draw robots' greedy moves as arrows and where they ask as rings.

    What lies where a robot never gets to in greedy episodes is pale. The arrows of every second
    robot are hollow and its rings dashed: in greyscale its colour may be another one's, pale.
    """
    scenario, tables = shown.config.scenario, shown.tables
    stays = shown.trials.stays
    label_size = _label_size(cell_inches(shown, POLICY_MAP))
    draw_map(axes, scenario, label_size=label_size, label_height=0.14)
    alone = len(robots) == 1
    for place, k in enumerate(robots):
        policy = policy_of(tables[k], scenario.robots[k].goal)
        side = 0.0 if alone else place - (len(robots) - 1) / 2
        x, move = np.nonzero(policy.moves)
        rows, columns = np.array(scenario.map.cells).T
        south, east = np.array(DIRECTIONS).T
        centre = columns + 0.5 + 0.4 * side, rows + 0.6 + 0.2 * side
        reached = stays[k] > 0
        for there, alpha in ((True, 1.0), (False, 0.3)):
            mine = reached[x] == there
            cells, moves = x[mine], move[mine]
            axes.quiver(
                *(centre[0][cells] - 0.2 * east[moves], centre[1][cells] - 0.2 * south[moves]),
                *(0.4 * east[moves], 0.4 * south[moves]),
                facecolor="white" if place % 2 else robot_colour(k),
                edgecolor=robot_colour(k),
                linewidth=0.9,
                alpha=alpha,
                angles="xy",
                units="xy",
                scale_units="xy",
                scale=1,
                width=0.05,
                headwidth=4,
                headlength=3.4,
                headaxislength=3,
                zorder=3,
            )
            asks = np.flatnonzero(policy.asks & (reached == there))
            if len(asks):
                size = np.full(len(asks), 0.5)
                rings = EllipseCollection(
                    *(size, size, np.zeros(len(asks))),
                    units="xy",
                    offsets=np.column_stack([centre[0][asks], centre[1][asks]]),
                    offset_transform=axes.transData,
                    facecolors="none",
                    edgecolors=robot_colour(k),
                    linewidths=1.8,
                    linestyles=LINES[place % 2],
                    alpha=alpha,
                    zorder=4,
                )
                axes.add_collection(rings, autolim=False)
    axes.set_title(title, fontsize=10)


def _policy(runs: Sequence[Shown], labels: Sequence[str]) -> list[Panel]:
    panels = []
    for shown, label in zip(runs, labels, strict=True):
        scenario, _ = shown.config.scenario, shown.tables
        names = [literal(robot.name) for robot in scenario.robots]
        together = len(names) <= 2
        groups = [tuple(range(len(names)))] if together else [(k,) for k in range(len(names))]
        for group in groups:

            def draw(
                axes: Axes,
                shown: Shown = shown,
                group: Sequence[int] = group,
                title: str = f"{label}: greedy moves" if together else names[group[0]],
                names: Sequence[str] = names,
                key: bool = group == groups[-1],
            ) -> None:
                draw_policy(axes, shown, group, title)
                if key:
                    _policy_key(
                        axes, shown, {k: names[k] for k in group} if len(group) > 1 else {}
                    )

            below = 0.5 if group == groups[-1] else 0.0
            panels.append(_map_panel(shown, POLICY_MAP, draw, below))
    return panels


def _policy_key(axes: Axes, shown: Shown, robots: Mapping[int, str]) -> None:
    handles: list[Artist] = [
        Patch(facecolor="white" if place % 2 else robot_colour(k), edgecolor=robot_colour(k))
        for place, k in enumerate(robots)
    ]
    for handle, name in zip(handles, robots.values(), strict=True):
        handle.set_label(name)
    if shown.config.rule.asks:
        ring = Line2D([], [], color="0.3", marker="o", linestyle="none", label="asks here first")
        ring.set(markersize=9, markerfacecolor="none")
        handles.append(ring)
    handles.append(Line2D([], [], color="0.3", alpha=0.3, linewidth=2.2, label="never gets here"))
    axes.legend(
        handles=handles,
        loc="upper center",
        bbox_to_anchor=(0.5, -0.01),
        ncols=2,
        frameon=False,
        fontsize=8,
    )


def _shaded(
    shown: Shown,
    label: str,
    values: np.ndarray,
    titles: Sequence[str],
    scale: str,
    numbers: str,
) -> list[Panel]:
    """Return a map a robot, cells shaded by values, shape (robots, cells), all on one scale."""
    scenario = shown.config.scenario
    norm = Normalize(0, float(values.max()) or 1.0)
    cell = cell_inches(shown, SHADED_MAP)
    small = cell < 0.34
    panels = []
    for k, title in enumerate(titles):

        def draw(axes: Axes, k: int = k, title: str = title) -> None:
            shades = np.asarray(norm(values[k]))
            draw_map(
                *(axes, scenario, shades),
                label_size=_label_size(cell) - 0.5,
                label_height=0.2,
            )
            for x in [] if small else np.flatnonzero(values[k]).tolist():
                row, column = scenario.map.cells[x]
                text = numbers.format(values[k, x])
                ink = "white" if shades[x] > 0.6 else "black"
                place = (column + 0.5, row + 0.62)
                axes.text(*place, text, ha="center", va="center", fontsize=7, color=ink)
            axes.set_title(f"{label}: {title}", fontsize=9)
            if k == len(titles) - 1:
                beside = axes.inset_axes((1.03, 0.0, 0.035, 1.0))
                bar = axes.figure.colorbar(ScalarMappable(norm, COLOUR_MAP), cax=beside)
                bar.set_label(scale, fontsize=8)
                bar.ax.tick_params(labelsize=7)

        panels.append(_map_panel(shown, SHADED_MAP, draw))
    return panels


def _asks(runs: Sequence[Shown], labels: Sequence[str]) -> list[Panel]:
    panels = []
    for shown, label in zip(runs, labels, strict=True):
        asked = shown.trials.asked / TRIALS
        names = [literal(robot.name) for robot in shown.config.scenario.robots]
        titles = [f"{n} asks {asked[k].sum():.2f} times" for k, n in enumerate(names)]
        if len(names) > 2:
            asked = asked.sum(axis=0, keepdims=True)
            titles = [f"{len(names)} robots ask {asked.sum():.2f} times"]
        panels += _shaded(shown, label, asked, titles, "COORDINATE in a greedy episode", "{:.2g}")
    return panels


def _sparsity(runs: Sequence[Shown], labels: Sequence[str]) -> list[Panel]:
    panels = []
    for shown, label in zip(runs, labels, strict=True):
        scenario = shown.config.scenario
        found = [sparsity_of(tables, scenario) for tables in shown.tables]
        titles = [
            f"$Q^C$ of {literal(robot.name)}, {one.share:.2%} learned"
            for robot, one in zip(scenario.robots, found, strict=True)
        ]
        counts = np.array([one.by_cell for one in found], dtype=np.float64)
        if len(found) > 2:
            counts = counts.mean(axis=0, keepdims=True)
            share = sum(one.share for one in found) / len(found)
            titles = [f"$Q^C$, {share:.2%} learned, mean of {len(found)} robots"]
        factored = shown.tables[0].factors is not None
        scale = "corrections that are not 0" if factored else "joint states learned"
        panels += _shaded(shown, label, counts, titles, scale, "{:.0f}")
    return panels


# Curves.


def _curve_panels(
    size: tuple[float, float], *names: str
) -> Callable[[Sequence[Shown], Sequence[str]], list[Panel]]:
    def panels(runs: Sequence[Shown], labels: Sequence[str]) -> list[Panel]:
        for shown in runs:
            _ = shown.history  # says what is missing

        return [Panel(*size, partial(draw_curve, runs, labels, name)) for name in names]

    return panels


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
    if len(steps) <= MOST_POINTS:
        return steps, values
    kept = np.unique(np.linspace(0, len(steps) - 1, MOST_POINTS).astype(np.int64))
    return steps[kept], values[kept]


def _percepts(runs: Sequence[Shown], labels: Sequence[str]) -> list[Panel]:
    return [
        Panel(*LONE_CURVE, partial(draw_percepts, shown, label))
        for shown, label in zip(runs, labels, strict=True)
        if shown.log is not None
    ]


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


WHATS: Mapping[str, Callable[[Sequence[Shown], Sequence[str]], list[Panel]]] = {
    "policy": _policy,
    "asks": _asks,
    "sparsity": _sparsity,
    "curves": _curve_panels(CURVE, *CURVES),
    "percepts": _percepts,
    "length": _curve_panels(LONE_CURVE, "length"),
}
"""What can be drawn of a run, by name."""
