# Copyright 2026 The sparse_coord_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Generated scenarios, each named by its numbers: the same name, the same building, everywhere.

`building-3x2x4-16r-0` has two rows of three rooms, of 4 x 4 cells each, a corridor between the
rows, and 16 robots; its seed is 0. `core.game.unseen` has others.
"""

import random
import re
from typing import Any, NamedTuple

from sparse_coord_ros.base.errors import ScenarioError
from sparse_coord_ros.core.game.grid import DOORWAY, FREE, WALL, GridMap
from sparse_coord_ros.core.game.unseen import Cell, generated, unseen

CORRIDOR = 2
"""Rows of a corridor: wide enough to pass one another."""

DOORWAY_BESIDE = 0.5
"""Probability of a doorway between two rooms side by side."""

TRIAL = 5
"""A trial lasts at least so many times as long as the longest of the shortest paths."""

MOST = 53, 20
"""Robots of a building; rooms in a row, rows, and cells along the side of a room."""


class _Building(NamedTuple):
    """Rooms in a row, rows of rooms, cells along the side of a room, robots, and the seed."""

    rooms: int
    rows: int
    size: int
    robots: int
    seed: int


def building(name: str) -> dict[str, Any] | None:
    """Return the generated building of that name as a scenario file has it, parsed.

    None if it is no name of a generated building.

    Raises:
        ScenarioError: no building has these numbers.
    """
    match = re.fullmatch(
        "building-{0}x{0}x{0}-{0}r-{0}".format("(0|[1-9][0-9]{,8})"), name
    )
    if match is None:
        return unseen(name)
    b = _Building(*map(int, match.groups()))
    robots, sizes = MOST
    rooms = b.rooms * b.rows
    fits = (
        max(b[:3]) <= sizes and 1 <= b.robots <= robots and b.size >= 2 and rooms >= 2
    )
    if not fits or 2 * b.robots > rooms * b.size**2:
        what = f"scenario {name!r}: allowed: building-ROOMSxROWSxSIZE-ROBOTSr-SEED"
        remedy = "at least 2 rooms of 2 x 2 cells, and two cells of them for each robot"
        raise ScenarioError(
            f"{what}, numbers up to {sizes}, robots up to {robots}; {remedy}"
        )
    return _made(b)


def _made(b: _Building) -> dict[str, Any]:
    """Return a building as a scenario file has it, parsed.

    Each row of rooms has a corridor to the next; every room has a doorway to each corridor beside
    it, and to the room on its right with probability one half, or always if there is no corridor.
    Every robot starts in a room and has its goal in another; no two share a start or a goal.
    """
    draw = random.Random(f"building {b.rooms} {b.rows} {b.size} {b.robots} {b.seed}")
    grid, rooms = _plan(b, draw)
    pairs = _starts_and_goals(b, rooms, draw)
    description = f"rooms {b.rooms}, rows {b.rows}, size {b.size}"
    description += f", robots {b.robots}, seed {b.seed}"
    name = f"building-{b.rooms}x{b.rows}x{b.size}-{b.seed}"
    steps = TRIAL * _longest_path(grid, pairs)
    longer = {"horizon": steps, "max_steps": steps} if steps > 100 else {}
    return generated(name, description, grid, pairs, **longer)


def _plan(b: _Building, draw: random.Random) -> tuple[list[str], list[list[Cell]]]:
    """Return the lines of the map, and the cells of each room."""
    grid: list[str] = []
    rooms: list[list[Cell]] = []
    for row in range(b.rows):
        if row:
            grid += _corridor(b, draw)
        top = len(grid)
        grid += _row_of_rooms(b, draw)
        for room in range(b.rooms):
            left = room * (b.size + 1)
            cells = [(top + i, left + j) for i in range(b.size) for j in range(b.size)]
            rooms.append(cells)
    return grid, rooms


def _corridor(b: _Building, draw: random.Random) -> list[str]:
    """Return the lines of a corridor between two rows of rooms, with both walls."""
    width = b.rooms * (b.size + 1) - 1
    above = _wall(b, draw)
    below = _wall(b, draw)
    return [above, *[FREE * width] * CORRIDOR, below]


def _row_of_rooms(b: _Building, draw: random.Random) -> list[str]:
    """Return the lines of a row of rooms, with the doorways between them."""
    doors = [_beside(b, draw) for _ in range(b.rooms - 1)]
    lines = []
    for line in range(b.size):
        between = [DOORWAY if line == door else WALL for door in doors]
        lines.append("".join(FREE * b.size + end for end in [*between, ""]))
    return lines


def _longest_path(grid: list[str], pairs: list[tuple[Cell, Cell]]) -> int:
    """Return the length of the longest of the robots' shortest paths."""
    plan = GridMap("", tuple(grid))
    lengths = []
    for start, goal in pairs:
        moves = plan.distances_to(plan.number[goal])
        lengths.append(int(moves[plan.number[start]]))
    return max(lengths)


def _wall(building: _Building, draw: random.Random) -> str:
    """Return the wall between rooms and a corridor, with a doorway for each room."""
    parts = []
    for _ in range(building.rooms):
        door = draw.randrange(building.size)
        parts.append(WALL * door + DOORWAY + WALL * (building.size - 1 - door))
    return WALL.join(parts)


def _beside(building: _Building, draw: random.Random) -> int:
    """Return the line of the doorway between two rooms side by side; -1: no doorway."""
    wanted = draw.random() < DOORWAY_BESIDE or building.rows == 1
    line = draw.randrange(building.size)
    return line if wanted else -1


def _starts_and_goals(
    building: _Building, rooms: list[list[Cell]], draw: random.Random
) -> list[tuple[Cell, Cell]]:
    """Return a start, and a goal in another room, for each robot; all differ."""
    free = {room: list(places) for room, places in enumerate(rooms)}
    for places in free.values():
        draw.shuffle(places)
    pairs = []
    for _ in range(building.robots):
        # The fullest rooms first, so that two different rooms have free places until the end.
        order = sorted(free, key=lambda room: (-len(free[room]), draw.random()))
        first = order[0]
        other = order[1 + draw.randrange(len(order) - 1)]
        other = other if free[other] else order[1]
        start, goal = (first, other) if draw.random() < 0.5 else (other, first)
        pairs.append((free[start].pop(), free[goal].pop()))
    return pairs
