# Copyright 2026 The sparse_coord_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Grid maps: free cells, walls, doorways and starts, read from text files.

A map file is a YAML header (`title`, `source`, `provenance`, and of a map of a real place
`resolution`, `origin` and `radius`), a line `---`, then the grid: one line a row, `#` wall, `.`
free, `D` doorway (free), a digit 1 to 9 a start (free). Maps of MovingAI are read, too.
Free cells are numbered row by row from the top left; that number is a robot's local state.
"""

import math
import os
from contextlib import suppress
from dataclasses import dataclass, field
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np

from sparse_coord_ros.base.errors import MapError, did_you_mean, in_short
from sparse_coord_ros.base.files import read_text
from sparse_coord_ros.base.share import share_file, share_names
from sparse_coord_ros.base.yaml_text import to_yaml, yaml_value
from sparse_coord_ros.core.game.actions import DIRECTIONS
from sparse_coord_ros.core.game.pose import Pose, Squares

WALL = "#"
FREE = "."
DOORWAY = "D"
SYMBOLS = "'#' wall, '.' free, 'D' doorway, '1' to '9' start"
UNREACHABLE = -1

OCTILE_GRID = "map"
"""The line before the grid in a map of MovingAI."""

OCTILE_SIGNS = {
    ".": FREE,
    "G": FREE,
    "S": FREE,
    "@": WALL,
    "O": WALL,
    "T": WALL,
    "W": WALL,
}
"""Symbols of MovingAI's format, and their kinds here."""

CLEAR = 0.07
"""Cells between a body and a wall beside its lane, where there is room."""

HEADER_TEXTS = ("title", "source", "provenance")
RESOLUTIONS = (1e-3, 1000.0)
"""Least and most metres a cell."""

FURTHEST = 1e7
"""Most metres from the frame's origin to the grid's corner."""

LEVEL = 1e-6
"""Largest yaw that counts as none, in radians."""


@dataclass(frozen=True)
class GridMap:
    """A map: its rows of symbols, and facts computed from them.

    Attributes:
        name: the map's name (the file's stem).
        rows: the grid, one string a row, all of the same length, top row first.
        title: what the map shows.
        source: where the map comes from; for a map of a floor plan its YAML file.
        provenance: which parts are found, derived or chosen.
        resolution: metres per cell; None if the map shows no real place.
        origin: the pose of the grid's lower left corner in that place's frame; its rows lie along
            the yaw.
        radius: radius of the robots that the map was made for, in metres; 0: unknown.
    """

    name: str
    rows: tuple[str, ...]
    title: str = ""
    source: str = ""
    provenance: str = field(default="", compare=False)
    resolution: float | None = None
    origin: Pose = Pose(0.0, 0.0)
    radius: float = 0.0

    @property
    def shape(self) -> tuple[int, int]:
        """(rows, columns) of the grid, walls included."""
        return len(self.rows), len(self.rows[0])

    @property
    def squares(self) -> Squares:
        """The squares of the grid in its place; of a map without a place they are 1 m wide."""
        return Squares(self.origin, self.resolution or 1.0, len(self.rows))

    @cached_property
    def cells(self) -> tuple[tuple[int, int], ...]:
        """(row, column) of each free cell; the index is the cell's number."""
        return tuple(map(tuple, self.places.tolist()))

    @cached_property
    def places(self) -> np.ndarray:
        """Shape (cells, 2), int64: the row and the column of each free cell."""
        signs = np.frombuffer("".join(self.rows).encode(), dtype=np.uint8).reshape(
            self.shape
        )
        return np.argwhere(signs != ord(WALL))

    @cached_property
    def free(self) -> np.ndarray:
        """Shape (rows, columns), bool: whether a square of the grid is no wall."""
        free = np.zeros(self.shape, dtype=np.bool_)
        free[tuple(self.places.T)] = True
        return free

    @cached_property
    def number(self) -> dict[tuple[int, int], int]:
        """The cell number of each free (row, column)."""
        return {position: cell for cell, position in enumerate(self.cells)}

    def cell_at(self, x: float, y: float) -> int | None:
        """Return the free cell at a place in metres, or None."""
        square = self.squares.at(x, y)
        return None if square is None else self.number.get(square)

    @cached_property
    def doorways(self) -> frozenset[int]:
        """The cells that are doorways, by their numbers; a doorway may have several cells."""
        return frozenset(
            x for x, (r, c) in enumerate(self.cells) if self.rows[r][c] == DOORWAY
        )

    @property
    def doorway_count(self) -> int:
        """The number of doorways: adjacent doorway cells are one doorway."""
        left = set(self.doorways)
        count = 0
        while left:
            count += 1
            reached = [left.pop()]
            while reached:
                beside = left.intersection(self.next_cell[reached.pop()].tolist())
                reached += beside
                left -= beside
        return count

    @property
    def doorway_facts(self) -> dict[str, Any]:
        """The number of doorways, and the row and column of each of their cells."""
        cells = [self.cells[x] for x in sorted(self.doorways)]
        return {"doorways": self.doorway_count, "doorway_cells": cells}

    @property
    def doorways_in_words(self) -> str:
        """The number of doorways in words, and of their cells if these are more."""
        doorways = self.doorway_count
        cells = len(self.doorways)
        more = f" ({cells} cells)" if cells > doorways else ""
        return f"{doorways} doorway{'s' * (doorways != 1)}{more}"

    @cached_property
    def starts(self) -> dict[int, int]:
        """Cell number of each start digit of the map."""
        return {
            int(self.rows[r][c]): x
            for x, (r, c) in enumerate(self.cells)
            if self.rows[r][c].isdigit()
        }

    @cached_property
    def next_cell(self) -> np.ndarray:
        """Shape (cells, moves), int64: where a successful move leads; a wall: the cell itself."""
        rows, columns = self.shape
        # walls around
        number = np.full((rows + 2, columns + 2), UNREACHABLE, dtype=np.int64)
        r, c = (coordinate + 1 for coordinate in self.places.T)
        number[r, c] = np.arange(len(r))
        after = np.stack([number[r + dr, c + dc] for dr, dc in DIRECTIONS], axis=1)
        return np.where(after == UNREACHABLE, np.arange(len(r))[:, None], after)

    @cached_property
    def region(self) -> np.ndarray:
        """Shape (cells,), int64: the region of each cell; a way connects cells of one region."""
        return regions(self.next_cell)

    def distances_to(self, goal: int) -> np.ndarray:
        """Shape (cells,): moves on a shortest path to `goal`; -1 without a way."""
        return moves_to(self.next_cell, goal)

    def leading_to(self, goal: int) -> np.ndarray:
        """Return the cells with a way to `goal`, without the goal: shape (n,), ascending."""
        return np.flatnonzero(self.distances_to(goal) > 0)

    def to_text(self) -> str:
        """Return the map as the text of a map file; `parse_map` reads it back."""
        texts = {name: getattr(self, name) for name in HEADER_TEXTS}
        fields: dict[str, Any] = {name: text for name, text in texts.items() if text}
        if self.resolution is not None:
            fields |= {"resolution": self.resolution, "origin": list(self.origin)}
        if self.radius:
            fields["radius"] = self.radius
        header = to_yaml(fields) if fields else ""
        return header + "---\n" + "\n".join(self.rows) + "\n"


def moves_to(lead: np.ndarray, goal: int) -> np.ndarray:
    """Return the moves from each cell to a goal; -1: there is no way.

    Args:
        lead: where a successful move leads, shape (cells, moves).
        goal: the cell to go to.

    Returns:
        Shape (cells,), int64.
    """
    origins: list[list[int]] = [[] for _ in lead]
    for x, row in enumerate(lead.tolist()):
        for y in row:
            origins[y].append(x)
    far = [UNREACHABLE] * len(lead)
    far[goal] = 0
    reached = [goal]
    for y in reached:  # it grows
        for x in origins[y]:
            if far[x] == UNREACHABLE:
                far[x] = far[y] + 1
                reached.append(x)
    return np.array(far, dtype=np.int64)


def regions(lead: np.ndarray) -> np.ndarray:
    """Return the region of each cell: a way connects cells of one region.

    Args:
        lead: where a successful move leads, shape (cells, moves); every move has its way back.

    Returns:
        Shape (cells,), int64.
    """
    region = np.arange(len(lead))
    while True:  # each region joins the one with the least number beside it
        joined = region.copy()
        np.minimum.at(joined, region, region[lead].min(axis=1))
        while (joined != joined[joined]).any():
            joined = joined[joined]
        if np.array_equal(joined, region):
            return region
        region = joined


def map_names() -> list[str]:
    """Return the names of the maps that the package ships, sorted."""
    return share_names("maps", ".txt")


def load_map(name: str, *, beside: Path | None = None) -> GridMap:
    """Read a map by the name of a shipped map or by path.

    Args:
        name: a shipped map's name, or the path of a map file.
        beside: a folder in which a relative path is looked up first (the scenario file's).

    Raises:
        MapError: there is no such map, or it is malformed.
    """
    folders = [beside, Path()] if beside else [Path()]
    for candidate in [folder / name for folder in folders] + [
        share_file("maps", f"{name}.txt")
    ]:
        if candidate is not None and os.path.isfile(candidate):
            remedy = "give a map file; an image becomes one by: sparse_coord import-map"
            text = read_text(candidate, MapError, remedy)
            return parse_map(text, name=candidate.stem, where=str(candidate))
    raise MapError(
        f"map {name!r}: no such map{did_you_mean(name, map_names())}; give the path of a map file "
        f"or one of: {', '.join(map_names())}"
    )


def parse_map(text: str, *, name: str, where: str) -> GridMap:
    """Read a map from the text of a map file.

    Args:
        text: the file's text.
        name: the map's name.
        where: what error messages call the file.

    Raises:
        MapError: malformed header, unequal rows, unknown symbol, start given twice, no free cell.
    """
    lines = text.splitlines()
    if OCTILE_GRID in lines and "---" not in lines:
        return _octile(lines, name, where)
    if "---" not in lines:
        remedy = (
            "a map is a header (title, source, provenance), a line '---', then the grid"
        )
        raise MapError(f"map {where}: no line '---'; {remedy}")
    first = lines.index("---") + 1
    rows = tuple(line.rstrip() for line in lines[first:])
    while rows and not rows[-1]:
        rows = rows[:-1]
    _check_rows(rows, first + 1, where)
    return GridMap(
        name=name, rows=rows, **_header("\n".join(lines[: first - 1]), where)
    )


def _octile(lines: list[str], name: str, where: str) -> GridMap:
    """Read a map of MovingAI: lines `height N` and `width N`, a line `map`, then the grid.

    `.`, `G` and `S` (swamp) are free; `@`, `O`, `T` (trees) and `W` (water) are walls. The map has
    no doorways.
    """
    first = lines.index(OCTILE_GRID) + 1
    sizes = dict(line.split(maxsplit=1) for line in lines[:first] if " " in line)
    rows = [line.rstrip() for line in lines[first:]]
    while rows and not rows[-1]:
        rows.pop()
    for number, row in enumerate(rows, start=first + 1):
        unknown = row.strip("".join(OCTILE_SIGNS))
        if unknown:
            what = f"map {where}, line {number}: unknown symbol {unknown[0]!r}"
            raise MapError(f"{what}; allowed: {' '.join(OCTILE_SIGNS)}")
    size = {"height": len(rows), "width": max(map(len, rows), default=0)}
    for key, count in size.items():
        given = sizes.get(key, "missing").strip()
        if given != str(count):
            raise MapError(
                f"map {where}: {key} is {given}, but the grid's is {count}; mend it"
            )
    signs = str.maketrans(OCTILE_SIGNS)
    grid = tuple(row.translate(signs) for row in rows)
    _check_rows(grid, first + 1, where)
    return GridMap(name, grid, f"{name}: a map of MovingAI", source=where)


def _header(text: str, where: str) -> dict[str, Any]:
    numbers = {"resolution": RESOLUTIONS, "radius": (0.0, RESOLUTIONS[1])}
    allowed = (*HEADER_TEXTS, *numbers, "origin")
    header = yaml_value(text, where=f"map {where}: header", error=MapError) or {}
    if not isinstance(header, dict):
        raise MapError(
            f"map {where}: the header must be 'key: value' lines of {allowed}"
        )
    for key in header:
        if key not in allowed:
            raise MapError(
                f"map {where}: unknown header key {key!r}{did_you_mean(str(key), allowed)}; "
                f"allowed: {', '.join(allowed)}"
            )
    fields: dict[str, Any] = {}
    for key, value in header.items():
        if key in numbers:
            fields[key] = number_of(
                value, *numbers[key], f"map {where}: header key {key!r}"
            )
        elif key == "origin":
            fields[key] = pose_of(value, f"map {where}: header key 'origin'")
        else:
            fields[key] = str(value or "").strip()
    if "origin" in fields and "resolution" not in fields:
        raise MapError(
            f"map {where}: has an origin and no resolution; give the metres a cell"
        )
    return fields


def pose_of(value: object, what: str) -> Pose:
    """Return a field of a map's file that is a pose: [x, y] or [x, y, yaw].

    Args:
        value: the field's value.
        what: file and field, for the error.

    Raises:
        MapError: it is no pose.
    """
    if not isinstance(value, list) or len(value) not in (2, 3):
        raise MapError(
            f"{what} is {in_short(value)}, allowed: [x, y, yaw] in metres, radians"
        )
    numbers = [number_of(number, -FURTHEST, FURTHEST, what) for number in value]
    yaw = math.remainder(numbers[2], math.tau) if len(numbers) == 3 else 0.0
    return Pose(numbers[0], numbers[1], yaw if abs(yaw) > LEVEL else 0.0)


def number_of(value: object, low: float, high: float, what: str) -> float:
    """Return a field of a map's file that is a number.

    Args:
        value: the field's value; None: missing.
        low: smallest number allowed.
        high: largest number allowed.
        what: file and field, for the error.

    Raises:
        MapError: it is no number, or out of range.
    """
    number = math.nan
    if isinstance(value, int | float | str) and not isinstance(value, bool):
        with suppress(ValueError, OverflowError):
            number = float(value)
    if not low <= number <= high:
        shown = "missing" if value is None else in_short(value)
        raise MapError(f"{what} is {shown}, allowed: a number from {low:g} to {high:g}")
    return number


def _check_rows(rows: tuple[str, ...], first_line: int, where: str) -> None:
    if not rows:
        remedy = f"add one line a row ({SYMBOLS})"
        raise MapError(f"map {where}: no grid after the line '---'; {remedy}")
    seen: dict[str, int] = {}
    for line, row in enumerate(rows, start=first_line):
        if len(row) != len(rows[0]):
            raise MapError(
                f"map {where}, line {line}: row has {len(row)} symbols, the first row has "
                f"{len(rows[0])}; all rows must be equally long (fill with '#')"
            )
        for column, symbol in enumerate(row if row.strip("#.D") else "", start=1):
            if symbol not in "#.D123456789":
                what = f"map {where}, line {line}, column {column}: unknown symbol {symbol!r}"
                raise MapError(f"{what}; allowed: {SYMBOLS}")
            if symbol.isdigit() and symbol in seen:
                raise MapError(
                    f"map {where}, line {line}: start {symbol} is there twice (first in line "
                    f"{seen[symbol]}); each digit marks one start, replace one by '.'"
                )
            if symbol.isdigit():
                seen[symbol] = line
    if all(symbol == WALL for row in rows for symbol in row):
        raise MapError(f"map {where}: no free cell; mark free cells with '.'")
