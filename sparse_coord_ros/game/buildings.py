# Copyright 2026 The sparse_coord_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Generated buildings: rooms on both sides of corridors, doorways between them, many robots.

The same numbers and seed give the same building, on every machine.
"""

import random
from dataclasses import dataclass

from sparse_coord_ros.errors import SettingError
from sparse_coord_ros.game.grid import DOORWAY, FREE, WALL, parse_map
from sparse_coord_ros.game.scenario import Scenario, scenario_from_dict
from sparse_coord_ros.game.settings import setting, settings_of
from sparse_coord_ros.limits import parse_yaml

CORRIDOR = 2
"""Rows of a corridor: wide enough to pass one another."""

BESIDE = 0.5
"""Probability of a doorway between two rooms side by side."""

TRIAL = 5
"""A trial lasts at least so many times as long as the longest of the shortest paths."""


@dataclass(frozen=True)
class Building:
    """What a building is made of.

    Raises:
        SettingError: a number out of its range, or too many robots for the rooms.
    """

    rooms: int = setting(3, "rooms in a row", low=1, high=20)
    rows: int = setting(2, "rows of rooms, a corridor between each two", low=1, high=20)
    size: int = setting(4, "cells along the side of a room", low=2, high=20)
    robots: int = setting(16, "robots", low=1, high=60)
    seed: int = setting(0, "seed of the building", low=0, high=2**63 - 1)

    def __post_init__(self) -> None:
        """Check the numbers."""
        for name, one in SIZES.items():
            object.__setattr__(self, name, one.parse(getattr(self, name)))
        places = self.rooms * self.rows * self.size**2
        if self.rooms * self.rows < 2:
            raise SettingError(
                "building: has 1 room, allowed: at least 2; give more rooms or rows"
            )
        if 2 * self.robots > places:
            raise SettingError(
                f"building: {self.robots} robots need as many starts and as many goals, and the "
                f"rooms have {places} cells; give more rooms, larger ones, or fewer robots"
            )


SIZES = settings_of(Building)
"""The numbers of a building."""


def building_text(building: Building) -> str:
    """Return a building as the text of a scenario file.

    Each row of rooms has a corridor to the next; every room has a doorway to each corridor beside
    it, and to the room on its right with probability one half; surely, where there is no corridor.
    Every robot starts in a room and has its goal in another; no two share a start or a goal.
    """
    b = building
    draw = random.Random(f"building {b.rooms} {b.rows} {b.size} {b.robots} {b.seed}")
    grid: list[str] = []
    rooms: list[list[tuple[int, int]]] = []  # the cells of each room
    for row in range(b.rows):
        if row:
            width = b.rooms * (b.size + 1) - 1
            grid.append(_wall(b, draw))
            grid += [FREE * width] * CORRIDOR
            grid.append(_wall(b, draw))
        top = len(grid)
        beside = [_beside(b, draw) for _ in range(b.rooms - 1)]
        for line in range(b.size):
            ends = [DOORWAY if line == door else WALL for door in beside] + [""]
            grid.append("".join(FREE * b.size + end for end in ends))
        for room in range(b.rooms):
            left = room * (b.size + 1)
            places = [(top + i, left + j) for i in range(b.size) for j in range(b.size)]
            rooms.append(places)
    pairs = _starts_and_goals(b, rooms, draw)
    longest = _longest(grid, pairs)
    said = f"rooms {b.rooms}, rows {b.rows}, size {b.size}, robots {b.robots}, seed {b.seed}"
    robots = [
        f"  robot_{k}: {{start: {list(start)}, goal: {list(goal)}}}"
        for k, (start, goal) in enumerate(pairs, start=1)
    ]
    return "\n".join(
        [
            f"# A generated building: {said}.",
            "map:",
            f"  name: building-{b.rooms}x{b.rows}x{b.size}-{b.seed}",
            "  text: |",
            f"    title: a generated building ({said})",
            "    source: generated",
            "    provenance: no building of the world",
            "    ---",
            *(f"    {line}" for line in grid),
            "robots:",
            *robots,
            "steps: 100000",
            *([f"horizon: {TRIAL * longest}", f"max_steps: {TRIAL * longest}"] * (longest > 20)),
            "",
        ]
    )


def generated_building(
    rooms: int = 3, rows: int = 2, size: int = 4, robots: int = 16, seed: int = 0
) -> Scenario:
    """Return a scenario on a generated building; the same numbers give the same one.

    Args:
        rooms: rooms in a row, 1 to 20.
        rows: rows of rooms, 1 to 20; a corridor lies between each two.
        size: cells along the side of a room, 2 to 20.
        robots: how many, 1 to 60.
        seed: of doorways, starts and goals.

    Raises:
        SettingError: a number out of its range, or too many robots for the rooms.
    """
    building = Building(rooms, rows, size, robots, seed)
    data = parse_yaml(building_text(building), where="building")
    name = f"building-{rooms}x{rows}x{size}-{robots}r-{seed}"
    return scenario_from_dict(data, where="building", name=name)


def _wall(building: Building, draw: random.Random) -> str:
    """Return the wall between rooms and a corridor, with a doorway for each room."""
    parts = []
    for _ in range(building.rooms):
        door = draw.randrange(building.size)
        parts.append(WALL * door + DOORWAY + WALL * (building.size - 1 - door))
    return WALL.join(parts)


def _beside(building: Building, draw: random.Random) -> int:
    """Return the line of the doorway between two rooms side by side, -1: there is none."""
    wanted = draw.random() < BESIDE or building.rows == 1
    line = draw.randrange(building.size)
    return line if wanted else -1


def _starts_and_goals(
    building: Building, rooms: list[list[tuple[int, int]]], draw: random.Random
) -> list[tuple[tuple[int, int], tuple[int, int]]]:
    """Return a start and a goal in another room for each robot, none of them twice."""
    free = {room: list(places) for room, places in enumerate(rooms)}
    for places in free.values():
        draw.shuffle(places)
    pairs = []
    for _ in range(building.robots):
        # The fullest rooms first, so that two different ones with places are left to the end.
        order = sorted(free, key=lambda room: (-len(free[room]), draw.random()))
        one, other = order[0], order[1 + draw.randrange(len(order) - 1)]
        other = other if free[other] else order[1]
        start, goal = (one, other) if draw.random() < 0.5 else (other, one)
        pairs.append((free[start].pop(), free[goal].pop()))
    return pairs


def _longest(grid: list[str], pairs: list[tuple[tuple[int, int], tuple[int, int]]]) -> int:
    """Return the most moves that any robot needs."""
    made = parse_map("---\n" + "\n".join(grid), name="building", where="building")
    number = made.number
    return max(int(made.distances_to(number[goal])[number[start]]) for start, goal in pairs)
