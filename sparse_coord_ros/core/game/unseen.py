# Copyright 2026 The sparse_coord_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Unseen buildings: families of generated scenarios, each named by its numbers.

`unseen1-door-2r-3` is version 1, kind `door`, two robots, seed 3: the same building everywhere,
and for ever. Of version 1 even seeds are for tuning, odd ones for validation. Version 2 is for the
final test. `core.solve.shipped` lists those in which robots are in one another's way, with their
reference values.
"""

import random
import re
from collections.abc import Callable, Iterable, Iterator, Mapping
from functools import partial
from typing import Any, NamedTuple

from sparse_coord_ros.core.game.grid import DOORWAY, FREE, WALL

VERSIONS = ("unseen1", "unseen2")
TEAMS = (2, 4, 8)
EXTRA_DOORWAY = 0.3
"""Probability of a doorway between two rooms that are connected already."""

Cell = tuple[int, int]


class Building(NamedTuple):
    """A building without robots.

    Attributes:
        grid: its symbols, [row][column].
        parts: the cells of each part; a robot's start and goal are in different parts.
    """

    grid: list[list[str]]
    parts: list[list[Cell]]


def generated(
    name: str,
    description: str,
    rows: Iterable[str],
    pairs: Iterable[tuple[Cell, Cell]],
    **settings: float | str,
) -> dict[str, Any]:
    """Return a building with its robots as a scenario file has them, parsed.

    Args:
        name: the map's name.
        description: the building's description, for its title.
        rows: its symbols, a text for each row.
        pairs: start and goal of each robot.
        settings: of the scenario.
    """
    header = f"title: a generated building ({description})\nsource: generated\n"
    text = header + "provenance: no building of the world\n---\n" + "\n".join(rows)
    robots = {
        f"robot_{k}": {"start": list(start), "goal": list(goal)}
        for k, (start, goal) in enumerate(pairs, start=1)
    }
    return {
        "map": {"name": name, "text": text},
        "robots": robots,
        "steps": 100_000,
        **settings,
    }


def unseen(name: str) -> dict[str, Any] | None:
    """Return the building of that name as `generated` does; None: unknown name."""
    kinds = "|".join(KINDS)
    teams = "|".join(map(str, TEAMS))
    versions = "|".join(VERSIONS)
    seed = "(0|[1-9][0-9]{0,8})"
    match = re.fullmatch(f"(?:{versions})-({kinds})-({teams})r-{seed}", name)
    if match is None:
        return None
    kind, team, _ = match.groups()
    robots = int(team)
    draw = random.Random(name)
    plan = KINDS[kind](draw, robots > 2)
    starts, goals = _places(plan, robots, draw)
    pairs = zip(starts, goals, strict=True)
    return generated(name, name, map("".join, plan.grid), pairs, penalty=-100)


SPLITS = ("tuning", "validation", "test")
"""What unseen buildings are for: to choose rules and numbers by, to look whether these hold
elsewhere, and for closing figures, once."""


def split_of(name: str) -> str:
    """Return the split of an unseen building, one of `SPLITS`, from its name."""
    if name.startswith(VERSIONS[1]):
        return "test"
    return "tuning" if int(name.rpartition("-")[2]) % 2 == 0 else "validation"


def team_of(name: str) -> int:
    """Return the number of robots of an unseen building, from its name."""
    return int(name.split("-")[2].removesuffix("r"))


def _places(
    plan: Building, robots: int, draw: random.Random
) -> tuple[list[Cell], list[Cell]]:
    """Return starts and goals, each robot's in two parts; no start or goal is used twice."""
    while True:
        starts: list[Cell] = []
        goals: list[Cell] = []
        for k in range(robots):
            # Every other robot goes the other way.
            if k % 2 == 0:
                first, second = draw.sample(range(len(plan.parts)), 2)
            else:
                first, second = second, first
            starts.append(draw.choice(plan.parts[first]))
            goals.append(draw.choice(plan.parts[second]))
        if len(set(starts)) == len(set(goals)) == robots:
            return starts, goals


def _blank(rows: int, columns: int) -> list[list[str]]:
    return [[WALL] * columns for _ in range(rows)]


def _carve(
    grid: list[list[str]], top: int, left: int, rows: int, columns: int
) -> list[Cell]:
    """Make cells free and return them."""
    cells = [(top + i, left + j) for i in range(rows) for j in range(columns)]
    for i, j in cells:
        grid[i][j] = FREE
    return cells


def _two_rooms(
    draw: random.Random, large: bool, *, doors: int, length: int
) -> Building:
    """Return two rooms side by side, and passages of doorways between them."""
    more = 1 if large else 0
    rows = draw.randint(max(2, 2 * doors) + more, max(4, 2 * doors + 1) + more)
    left, right = (draw.randint(2 + more, 3 + more) for _ in range(2))
    grid = _blank(rows, left + length + right)
    parts = [
        _carve(grid, 0, 0, rows, left),
        _carve(grid, 0, left + length, rows, right),
    ]
    for row in draw.sample(range(rows), doors):
        grid[row][left : left + length] = [DOORWAY] * length
    return Building(grid, parts)


def _corridor(draw: random.Random, large: bool) -> Building:
    return _two_rooms(draw, large, doors=1, length=draw.randint(2, 3))


def _rooms(draw: random.Random, large: bool) -> Building:
    """Return rooms in a grid, connected by a random tree of doorways and some more."""
    high = 2
    wide = draw.randint(2, 3)
    heights = [draw.randint(2, 3 + large) for _ in range(high)]
    widths = [draw.randint(2, 3 + large) for _ in range(wide)]
    grid = _blank(sum(heights) + high - 1, sum(widths) + wide - 1)
    tops = [sum(heights[:i]) + i for i in range(high)]
    lefts = [sum(widths[:j]) + j for j in range(wide)]
    parts = []
    for i in range(high):
        for j in range(wide):
            parts.append(_carve(grid, tops[i], lefts[j], heights[i], widths[j]))
    for room, other, along in _joined_rooms(draw, high, wide):
        i, j = divmod(room, wide)
        if other == room + 1:
            grid[tops[i] + along % heights[i]][lefts[j] + widths[j]] = DOORWAY
        else:
            grid[tops[i] + heights[i]][lefts[j] + along % widths[j]] = DOORWAY
    return Building(grid, parts)


def _joined_rooms(
    draw: random.Random, high: int, wide: int
) -> Iterator[tuple[int, int, int]]:
    """Yield the neighbouring rooms with a doorway, and the doorway's place along their wall.

    The rooms are numbered row by row. A wall between rooms that are not connected yet gets a
    doorway, any other one with probability `EXTRA_DOORWAY`.
    """
    rooms = range(high * wide)
    walls = [(room, room + 1) for room in rooms if (room + 1) % wide]
    walls += [(room, room + wide) for room in range((high - 1) * wide)]
    draw.shuffle(walls)
    connected = list(rooms)  # rooms of the same number are connected
    for room, other in walls:
        extra = draw.random() < EXTRA_DOORWAY
        along = draw.randrange(1000)
        new = connected[room]
        old = connected[other]
        if new == old and not extra:
            continue
        connected = [new if number == old else number for number in connected]
        yield room, other, along


def _loop(draw: random.Random, large: bool) -> Building:
    """Return a corridor round a block, with a room at either end and doorways in both ways."""
    rows = draw.randint(3, 4)
    length = draw.randint(3, 5)
    room = 2 + large
    grid = _blank(rows, length + 2 * room)
    parts = [_carve(grid, 0, 0, rows, room), _carve(grid, 0, room + length, rows, room)]
    upper = 0
    lower = rows - 1
    for row in (upper, lower):
        _carve(grid, row, room, 1, length)
        grid[row][room + draw.randrange(length)] = DOORWAY
    return Building(grid, parts)


def _crossing(draw: random.Random, large: bool) -> Building:
    """Return four arms that meet in one doorway, or in two side by side."""
    up, down, left, right = (draw.randint(2 + large, 4 + large) for _ in range(4))
    width = draw.randint(1, 2)
    grid = _blank(up + 1 + down, left + width + right)
    parts = [_carve(grid, 0, left, up, width), _carve(grid, up + 1, left, down, width)]
    parts += [_carve(grid, up, 0, 1, left), _carve(grid, up, left + width, 1, right)]
    grid[up][left : left + width] = [DOORWAY] * width
    return Building(grid, parts)


KINDS: Mapping[str, Callable[[random.Random, bool], Building]] = {
    "door": partial(_two_rooms, doors=1, length=1),
    "doors": partial(_two_rooms, doors=2, length=1),
    "corridor": _corridor,
    "rooms": _rooms,
    "loop": _loop,
    "crossing": _crossing,
}
"""The kinds of buildings: each draws one, a larger one for more than two robots."""
