# Copyright 2026 The sparse_coord_ros authors
# SPDX-License-Identifier: Apache-2.0
"""From a floor plan to a map and a scenario: cells, doorways, robots, and settings that fit."""

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from scipy import ndimage

from sparse_coord_ros.base.errors import MapError, ScenarioError
from sparse_coord_ros.core.game.grid import CLEAR, DOORWAY, FREE, WALL, GridMap
from sparse_coord_ros.core.game.pose import Pose, Squares, metres
from sparse_coord_ros.core.game.scenario import SETTINGS, Scenario, scenario_from_dict
from sparse_coord_ros.lab.maps import gridding
from sparse_coord_ros.lab.maps.floor_plan import FloorPlan
from sparse_coord_ros.lab.maps.passages import narrow_corridors

Place = tuple[float, float]
"""(x, y) in metres, in the map's frame."""

WALL_THICKNESS = 0.3
"""Default thickness of a wall with a doorway, in metres."""

MOST_CELLS = 1_000_000
"""Most cells and walls of a grid."""

SHOWN = 6
"""Most places in a note."""

CELL_RADII = 2.5
"""A cell's side, in radii of the robot, where none is given: 0.5 m for 0.2 m."""

CELL_PIXELS = 10
"""The same in pixels, where the radius is 0."""

SIZE_STEP = 0.05
"""Metres between the sizes of cells that are tried."""

SIZE_FACTORS = (
    1.0,
    0.9,
    1.1,
    0.8,
    1.2,
    0.7,
    1.35,
    0.6,
    1.5,
    1.75,
    0.5,
    2.0,
    2.5,
    3.0,
    4.0,
)
"""The sizes that are tried, in times the preferred one."""

NEAR_SIZES = 5
"""So many of the first sizes are compared; of the others the first one that works is taken."""

ASKEW = 3.0
"""Degrees between walls and grid from which on doorways are lost."""

FURTHEST_SHARE = 0.3
"""The value of arriving at the furthest start, as a share of its value at the goal."""

LONG_WAYS = "floored:0.5:0.8:0.01"
"""Step sizes for budgets that are short for the ways: successful moves are always the same."""

SHORTEST_BUDGET = 20
"""With these step sizes a budget may be so many times too short: it sufficed with 17 (9,173 cells,
10 million steps), not with 23 (11,115 cells)."""

STEPS = 20_000
"""The least budget: enough on nav2's warehouse (4,826 cells) with a known map."""

FIRST_GUESS = 0.1
"""Q* at first, as a share of the goal's value: that of the default settings."""


@dataclass(frozen=True)
class Imported:
    """A floor plan as a map.

    Attributes:
        grid: the map.
        parts: number of cells of each part of the free space, largest first; if there are robots,
            parts without one are not in the map.
        corridors: (x, y) in each corridor that is one cell wide, in metres; longest first.
        narrow_cells: number of cells of these corridors.
        wide: (x, y) in each passage that is two cells wide, in metres.
        dusty: (x, y) of each cell that is free, or a doorway, only because spots were dropped.
        notes: warnings, one line each.
    """

    grid: GridMap
    parts: tuple[int, ...]
    corridors: tuple[Place, ...]
    narrow_cells: int
    wide: tuple[Place, ...]
    dusty: tuple[Place, ...]
    notes: tuple[str, ...]


def import_map(
    plan: FloorPlan,
    *,
    cell: float | None = None,
    radius: float,
    robots: Sequence[tuple[Place, Place]] = (),
    doorway: Sequence[Place] = (),
    no_doorway: Sequence[Place] = (),
    corridors: bool = False,
) -> Imported:
    """Make a map of a floor plan.

    A free passage that is longer than the robot's diameter, a wall of `WALL_THICKNESS` and a cell
    is a corridor, no doorway.

    Args:
        plan: the floor plan.
        cell: the side of a cell, in metres; None: it is chosen.
        radius: the robot's, in metres.
        robots: start and goal of each; parts of the map without any of them become walls.
        doorway: places in cells that become doorways.
        no_doorway: places of doorways that become plain cells.
        corridors: whether the cells of corridors that are one cell wide are doorways too.

    Raises:
        MapError: the cells are smaller than pixels, or so large that a wall lies between two
            centres; the map has no free cell; or a place is in no free cell.
    """
    space = gridding.space_of(plan, radius)
    if space.blocked.all():
        raise MapError(
            f"map {plan.name}: a robot of radius {radius:g} m finds no room: no place is wide "
            f"enough for it; choose a radius of less than {_widest(plan):g} m"
        )
    if cell is None:
        cell, layout = _chosen_layout(plan, space, radius)
    else:
        layout = _layout_of(plan, space, cell)
    free = layout.free.copy()
    squares = _squares_of(plan, layout, cell)
    frame = _Frame(free, squares, plan.name)
    labels, _ = ndimage.label(free)
    sizes = np.bincount(labels.ravel())[1:]
    if robots:
        used = {
            int(labels[cell]) for pair in _robot_cells(frame, robots) for cell in pair
        }
        free &= np.isin(labels, sorted(used))
    else:
        free &= np.isin(
            labels,
            1 + np.flatnonzero((sizes >= gridding.CRUMB) | (sizes == sizes.max())),
        )
    longest = 2 * radius + WALL_THICKNESS + cell
    run = max(1, math.floor(longest / cell + 1e-9))
    across = gridding.across(free, run)
    narrow = narrow_corridors(free)
    doors = across
    if corridors:
        doors = np.where(narrow > 0, across.max() + narrow, across)
    doors = _doorways(frame, doors, doorway, no_doorway)
    grid = _grid_of(plan, squares, free, doors, radius)
    parts = tuple(
        sorted((int(size) for size in sizes if size >= gridding.CRUMB), reverse=True)
    )
    wide = [
        frame.centre(passage)
        for passage in gridding.two_wide(free, run)
        if not doors[passage]
    ]
    bare = gridding.layout_with_dust(
        plan, space, layout, cell / plan.resolution, radius
    )
    only_free = free & ~bare
    only_doors = (across > 0) & (gridding.across(bare & free, run) == 0)
    dusty = [frame.centre(tuple(cell)) for cell in np.argwhere(only_free | only_doors)]
    notes = [
        *plan.remarks,  # first: they may explain the others
        *_notes(layout.cut, grid.doorway_count, parts, bool(robots), wide),
        *_dust_notes(space, frame, only_free, only_doors),
        *_size_notes(cell, radius),
        *_direction_notes(plan),
    ]
    return Imported(
        grid,
        parts,
        corridors=_middles(frame, narrow),
        narrow_cells=int((narrow > 0).sum()),
        wide=tuple(wide),
        dusty=tuple(dusty),
        notes=tuple(notes),
    )


def _squares_of(plan: FloorPlan, layout: gridding.Gridding, cell: float) -> Squares:
    """Return the squares of a grid on a floor plan."""
    rows = len(layout.free)
    height = plan.free.shape[0]
    corner = plan.origin.absolute(
        layout.left * plan.resolution,
        (height - layout.top) * plan.resolution - rows * cell,
    )
    return Squares(Pose(*corner, plan.origin.yaw), cell, rows)


def _grid_of(
    plan: FloorPlan,
    squares: Squares,
    free: np.ndarray,
    doors: np.ndarray,
    radius: float,
) -> GridMap:
    """Return free cells and doorways as a map, without what is walls alone around them."""
    symbols = np.where(doors > 0, DOORWAY, np.where(free, FREE, WALL))
    # Nothing but walls around the map is of use: a border of one cell stays.
    rows, columns = (np.flatnonzero(free.any(axis=axis)) for axis in (1, 0))
    top = max(0, rows[0] - 1)
    bottom = min(free.shape[0], rows[-1] + 2)
    left = max(0, columns[0] - 1)
    right = min(free.shape[1], columns[-1] + 2)
    cell = squares.side
    x, y = squares.corner.absolute(left * cell, (free.shape[0] - bottom) * cell)
    return GridMap(
        name=plan.name,
        rows=tuple("".join(row) for row in symbols[top:bottom, left:right]),
        title=f"{plan.name}: a floor plan in cells of {cell:g} m",
        source=str(plan.path.resolve()),
        provenance=f"made by import-map for robots of radius {radius:g} m",
        resolution=cell,
        origin=Pose(round(float(x), 6), round(float(y), 6), squares.corner.yaw),
        radius=radius,
    )


def _widest(plan: FloorPlan) -> float:
    """Return the metres from the place that is furthest from walls to the nearest wall."""
    widest = float(ndimage.distance_transform_edt(plan.free).max()) * plan.resolution
    return math.floor(1000 * widest) / 1000


def _middles(frame: "_Frame", narrow: np.ndarray) -> tuple[Place, ...]:
    """Return the middle cell of each corridor, in metres; longest corridors first."""
    corridors = [
        np.argwhere(narrow == number) for number in range(1, int(narrow.max()) + 1)
    ]
    corridors.sort(key=len, reverse=True)
    middles = []
    for cells in corridors:
        row, column = cells[len(cells) // 2].tolist()
        middles.append(frame.centre((row, column)))
    return tuple(middles)


def _tried_layout(
    plan: FloorPlan, space: gridding.Space, cell: float
) -> tuple[gridding.Gridding | None, str]:
    """Return the best grid of cells of a size; None and why, if such cells are of no use."""
    if cell < plan.resolution:
        return None, f"are smaller than a pixel of the map, {plan.resolution:g} m"
    count = plan.free.size * (plan.resolution / cell) ** 2
    if count > MOST_CELLS:
        return None, f"make {count:,.0f} squares, allowed: up to {MOST_CELLS:,}"
    layout = gridding.best_layout(space, cell / plan.resolution)
    if layout.slips:
        return None, (
            "are so large that a wall disappears between two "
            f"({_count(layout.slips, 'time', 'times')}, wherever the grid lies)"
        )
    if not layout.free.any():
        return None, "have no free centre"
    return layout, ""


def _layout_of(
    plan: FloorPlan, space: gridding.Space, cell: float
) -> gridding.Gridding:
    """Return the best grid of cells of a size; MapError names another size if it is of no use."""
    layout, problem = _tried_layout(plan, space, cell)
    if layout is not None:
        return layout
    sizes = _sizes(plan, cell)
    works = next((size for size in sizes if _tried_layout(plan, space, size)[0]), None)
    remedy = f"cells of {works:g} m work" if works else _no_size(sizes)
    raise MapError(f"map {plan.name}: cells of {cell:g} m {problem}; {remedy}")


def _no_size(sizes: Sequence[float]) -> str:
    return (
        f"of {len(sizes)} sizes from {min(sizes):g} to {max(sizes):g} m none works, so cut the "
        "map to a part, or draw its walls thicker"
    )


def _chosen_layout(
    plan: FloorPlan, space: gridding.Space, radius: float
) -> tuple[float, gridding.Gridding]:
    """Return a size of cells that suits a robot, and the best grid of such cells."""
    preferred = CELL_RADII * radius or CELL_PIXELS * plan.resolution
    sizes = _sizes(plan, preferred)
    layouts: list[tuple[float, gridding.Gridding]] = []
    for number, size in enumerate(sizes):
        if layouts and number >= NEAR_SIZES:
            break
        layout, _ = _tried_layout(plan, space, size)
        if layout is not None:
            layouts.append((size, layout))
    if not layouts:
        raise MapError(f"map {plan.name}: {_no_size(sizes)}")
    return min(layouts, key=lambda candidate: candidate[1].cut)


def _sizes(plan: FloorPlan, preferred: float) -> list[float]:
    """Return the sizes of cells to try, nearest to a preferred one first.

    They are no smaller than a pixel, and make no more than `MOST_CELLS` squares.
    """
    step = SIZE_STEP if preferred >= 4 * SIZE_STEP else SIZE_STEP / 5
    most = math.sqrt(plan.free.size / MOST_CELLS)
    least = max(1.0, most) * plan.resolution
    sizes = []
    for factor in SIZE_FACTORS:
        steps = max(round(factor * preferred / step), math.ceil(least / step - 1e-9))
        size = round(steps * step, 6)
        if size not in sizes:
            sizes.append(size)
    return sizes


def _doorways(
    frame: "_Frame", doors: np.ndarray, add: Sequence[Place], remove: Sequence[Place]
) -> np.ndarray:
    """Return the doorways, shape (rows, columns), with the user's changes."""
    doors = doors.copy()
    for place in remove:
        number = doors[frame.cell(place, "no doorway")]
        if not number:
            remedy = "the picture shows them"
            raise MapError(f"no doorway at {metres(place)}: there is none; {remedy}")
        doors[doors == number] = 0
    for place in add:
        where = frame.cell(place, "doorway")
        doors[where] = doors[where] or doors.max() + 1
    return doors


def _size_notes(cell: float, radius: float) -> Iterator[str]:
    """Yield a warning if cells are small for a robot."""
    narrow = radius / (0.5 - CLEAR)
    if cell < narrow:
        yield (
            f"lanes touch walls: cells of {cell:g} m leave {max(0.0, cell / 2 - radius):.2g} m on "
            f"each side of a robot of radius {radius:g} m; choose cells of {narrow:.2g} m or more"
        )


def _direction_notes(plan: FloorPlan) -> Iterator[str]:
    """Yield a warning if the walls lie askew to the grid."""
    direction = plan.wall_direction
    if direction is not None and abs(math.degrees(direction)) >= ASKEW:
        yield (
            f"the walls lie at {math.degrees(direction):.1f} degrees to the grid, so doorways are "
            "lost: --turn auto lays the grid along them"
        )


def _dust_notes(
    space: gridding.Space,
    frame: "_Frame",
    only_free: np.ndarray,
    only_doors: np.ndarray,
) -> Iterator[str]:
    """Yield a note about spots that were dropped.

    Args:
        space: the space, with the number of spots.
        frame: the grid.
        only_free: cells that are free only because spots were dropped, shape (rows, columns).
        only_doors: doorways only because of that, shape (rows, columns).
    """
    if not (only_free.any() or only_doors.any()):
        return
    doors = [frame.centre(tuple(cell)) for cell in np.argwhere(only_doors)]
    others = [
        frame.centre(tuple(cell)) for cell in np.argwhere(only_free & ~only_doors)
    ]
    what = [_count(len(doors), "doorway cell", "doorway cells")] * bool(doors)
    what += [_count(len(others), "other cell", "other cells")] * bool(others)
    yield (
        f"{_count(space.dust_spots, 'spot', 'spots')} of up to {gridding.SPECK:g} m dropped as "
        f"dust; only because of that there {'is' if len(doors + others) == 1 else 'are'} "
        f"{' and '.join(what)}: at {places([*doors, *others])}; draw real things larger in the "
        "image"
    )


def places(listed: Sequence[Place]) -> str:
    """Return the first places of a list as text."""
    named = " ".join(metres(place) for place in listed[:SHOWN])
    return named + " ..." * (len(listed) > SHOWN)


def _notes(
    cut: int, doors: int, parts: tuple[int, ...], robots: bool, wide: list[Place]
) -> Iterator[str]:
    """Yield warnings about a map, one line each."""
    if cut:
        yield (
            f"{_count(cut, 'part is', 'parts are')} cut off although a robot would fit through: a "
            "smaller cell may keep the way open"
        )
    if len(parts) > 1:
        left = "parts without a robot became walls" if robots else "all are in the map"
        sizes = ", ".join(map(str, parts[:8])) + ", ..." * (len(parts) > 8)
        yield f"{len(parts)} parts of the map do not connect (cells: {sizes}); {left}"
    if not doors:
        yield (
            "no doorway found: doorways are one cell wide, so choose larger cells, or add a "
            "doorway"
        )
    if wide:
        yield (
            f"{_count(len(wide), 'passage is', 'passages are')} two cells wide, and no doorway, "
            f"as two robots pass there side by side: at {places(wide)}; where they would not, "
            "choose larger cells, or make both cells a doorway"
        )


def _count(number: int, singular: str, plural: str) -> str:
    return f"{number} {singular if number == 1 else plural}"


class _Frame:
    """Cells of a grid by their places in metres, and back."""

    def __init__(self, free: np.ndarray, squares: Squares, name: str) -> None:
        self._free = free.copy()
        self._squares = squares
        self._name = name

    def centre(self, cell: tuple[int, int]) -> Place:
        """Return (x, y) of the middle of a cell (row, column)."""
        return self._squares.centre(*cell)

    def cell(self, place: Place, what: str) -> tuple[int, int]:
        """Return (row, column) of the free cell at a place.

        Raises:
            MapError: no free cell is there.
        """
        height, width = self._free.shape
        row, column = self._squares.at(*place) or (-1, -1)
        inside = 0 <= row < height and 0 <= column < width
        if inside and self._free[row, column]:
            return row, column
        x, y = self._squares.centre(*np.nonzero(self._free))
        near = int(np.hypot(x - place[0], y - place[1]).argmin())
        problem = "is in no free cell" if inside else "is outside the map"
        remedy = f"the nearest free cell is at {metres((x[near], y[near]))}"
        raise MapError(f"{what} at {metres(place)} {problem} of {self._name}; {remedy}")


def centre_of(grid: GridMap, cell: int) -> Place:
    """Return (x, y) of the middle of a cell, by its number, in metres."""
    return grid.squares.centre(*grid.cells[cell])


def _robot_cells(
    frame: _Frame, robots: Sequence[tuple[Place, Place]]
) -> list[tuple[tuple[int, int], tuple[int, int]]]:
    """Return the cells of each robot's start and goal; MapError if one is not free."""
    return [
        (
            frame.cell(start, f"start of robot_{k}"),
            frame.cell(goal, f"goal of robot_{k}"),
        )
        for k, (start, goal) in enumerate(robots, start=1)
    ]


def suggested_settings(
    grid: GridMap, pairs: Sequence[tuple[int, int]], given: Mapping[str, Any]
) -> dict[str, Any]:
    """Return settings for a map's distances, if the defaults do not fit.

    A robot needs d / p steps for d cells, p being the probability that a move succeeds. The
    horizon lies four standard deviations above; episodes of learning are one and a half times the
    furthest start's way; the discount leaves `FURTHEST_SHARE` of the goal's value there. Robots
    begin with the values of robots alone on the map, unless `prior` says otherwise.

    Args:
        grid: the map.
        pairs: start and goal cell of each robot.
        given: the user's settings; they stay.
    """
    values = {**SETTINGS.defaults(), **SETTINGS.parse(dict(given))}
    p = values["move_success"]
    ways = [grid.distances_to(goal) for _, goal in pairs]
    longest = max(int(way[start]) for way, (start, _) in zip(ways, pairs, strict=True))
    furthest = max(int(way.max()) for way in ways)
    horizon = 1.1 * (longest / p + 4 * math.sqrt(longest * (1 - p)) / p)
    suggested: dict[str, Any] = {"horizon": max(100, _round_up(horizon, 50))}
    suggested["max_steps"] = max(100, _round_up(1.5 * furthest / p, 50))
    discount = math.ceil(1000 * FURTHEST_SHARE ** (p / furthest)) / 1000
    suggested["discount"] = min(0.999, max(values["discount"], discount))
    discount = given.get("discount", suggested["discount"])
    value = round(values["goal_reward"] / (1.0 - float(discount)), 3)
    suggested["goal_value"] = value
    if given.get("prior") == "none":
        suggested |= _learning_ways(value, max(steps_for(way, p) for way in ways))
    else:
        suggested["prior"] = "map"
        suggested["steps"] = STEPS
    default = SETTINGS.defaults()
    return {k: v for k, v in suggested.items() if k not in given and v != default[k]}


def _learning_ways(value: float, needed: float) -> dict[str, Any]:
    """Return settings by which robots learn the ways to their goals, too.

    Args:
        value: the goal's value.
        needed: steps of the robot that needs most. If they exceed the largest budget, larger step
            sizes bring values over the long way in time.
    """
    most = SETTINGS["steps"].high
    suggested: dict[str, Any] = {
        "q_coord_init": value,
        "q_star_init": round(FIRST_GUESS * value, 3),
        "steps": int(min(most, max(STEPS, _round_up(needed, 10_000)))),
    }
    if suggested["steps"] == most:
        suggested["step_size"] = LONG_WAYS
    return suggested


def steps_for(way: np.ndarray, p: float) -> float:
    """Return the steps in which each move of each cell on the way is tried several times.

    Args:
        way: moves from each cell to the goal, -1 without a way.
        p: the probability that a move succeeds.
    """
    cells = int((way >= 0).sum())
    return 12.0 * cells * math.sqrt(cells * int(way.max()) / p)


def _round_up(value: float, unit: int) -> int:
    return unit * math.ceil(value / unit)


def scenario_of(
    imported: Imported, robots: Sequence[tuple[Place, Place]], given: Mapping[str, Any]
) -> tuple[Scenario, dict[str, Any], list[str]]:
    """Return a scenario on an imported map.

    Args:
        imported: the map.
        robots: start and goal of each robot, in metres.
        given: the user's settings.

    Returns:
        The scenario; the suggested settings; warnings, one line each.

    Raises:
        MapError: a start or a goal is in no free cell.
        ScenarioError: a robot has no way to its goal.
        SettingError: a bad setting.
    """
    for key in given:
        if key in ("map", "robots", "name"):
            raise ScenarioError(
                f"--set {key}: is no setting; give it by an option of its own"
            )
    grid = imported.grid
    frame = _Frame(grid.free, grid.squares, grid.name)
    places_of_robots = {
        f"robot_{k}": {"start": list(start), "goal": list(goal)}
        for k, (start, goal) in enumerate(_robot_cells(frame, robots), start=1)
    }
    data = {
        "name": grid.name,
        "map": {"name": grid.name, "text": grid.to_text()},
        "robots": places_of_robots,
    }
    plain = scenario_from_dict({**data, **given}, where=grid.name, name=grid.name)
    pairs = [(robot.start, robot.goal) for robot in plain.robots]
    suggested = suggested_settings(grid, pairs, given)
    scenario = plain.with_settings(suggested)
    return scenario, suggested, list(_oddities(scenario))


def _oddities(scenario: Scenario) -> Iterator[str]:
    """Yield warnings about robots on a map."""
    grid = scenario.map
    robots = scenario.robots
    needed = 0.0
    if len({robot.start for robot in robots}) < len(robots):
        yield "two robots start in the same cell: that is no conflict, but hardly possible"
    if len({robot.goal for robot in robots}) < len(robots):
        yield "two robots have the same goal: they would end in the same place"
    for robot in robots:
        goal = f"the goal of {robot.name} is"
        if robot.goal in grid.doorways:
            yield f"{goal} in a doorway: it stays there and blocks the others"
        way = grid.distances_to(robot.goal)
        moves = int(way[robot.start])
        steps = moves / scenario.move_success
        if steps > scenario.horizon:
            yield (
                f"{goal} {moves} cells away, and takes {steps:.0f} steps on average: more than "
                f"the horizon of {scenario.horizon}"
            )
        needed = max(needed, steps_for(way, scenario.move_success))
    if scenario.prior == "none" and needed > SHORTEST_BUDGET * scenario.steps:
        yield (
            f"the step budget of {scenario.steps:,} is short for {len(grid.cells):,} cells: "
            "robots may not learn to arrive; choose larger cells, more steps, or prior=map"
        )
