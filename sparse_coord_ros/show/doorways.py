# Copyright 2026 The sparse_coord_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Doorways, rooms and shortest paths of a map, to describe robots' positions.

Here a doorway is a largest connected set of doorway cells. A room is a largest set of other cells
that ways without doorways connect.
"""

from functools import lru_cache

import numpy as np

from sparse_coord_ros.core.game.grid import GridMap, moves_to, regions

NO_WAY = 2**29
"""Number of moves without a way. The sum of two such numbers is still an int32."""

KEPT_BYTES = 20_000_000
"""Memory for distances between cells that are kept for later calls."""


class Doorways:
    """Doorways, rooms and shortest paths of a map.

    Args:
        grid: the map.

    Attributes:
        count: number of doorways.
        of: number of the doorway of each cell, from 0; -1 outside of doorways; shape (cells,).
        room: number of the room of each cell, from 0; -1 inside of doorways; shape (cells,).
        near: for each doorway the cells at most one move away, its own included, ascending.
    """

    def __init__(self, grid: GridMap) -> None:
        self._grid = grid
        cells = np.arange(len(grid.cells))
        self._inside = np.isin(cells, sorted(grid.doorways))
        self.of = self._parts(self._inside)
        self.room = self._parts(~self._inside)
        self._cells = np.flatnonzero(self._inside)
        self._part_of = self.of[self._cells]
        self.count = int(self.of.max(initial=-1)) + 1
        self.cells_of = [np.flatnonzero(self.of == n) for n in range(self.count)]
        beside = [np.unique(grid.next_cell[of]) for of in self.cells_of]
        self._exits = [one[~self._inside[one]] for one in beside]
        self._rooms = [frozenset(self.room[one].tolist()) for one in self._exits]
        self.near = [
            np.union1d(*both) for both in zip(self.cells_of, beside, strict=True)
        ]
        kept = max(8, KEPT_BYTES // (8 * len(cells)))
        self.moves_to = lru_cache(kept)(self._moves_to)
        self._around = lru_cache(kept)(self._moves_around)

    def _parts(self, of: np.ndarray) -> np.ndarray:
        """Return the number of the connected part of a set around each cell; -1 outside of it."""
        lead = self._grid.next_cell
        stays = ~of[lead] | ~of[:, None]
        own = np.arange(len(lead))[:, None]
        region = regions(np.where(stays, own, lead))
        parts = np.full(len(lead), -1, dtype=np.int64)
        parts[of] = np.unique(region[of], return_inverse=True)[1]
        return parts

    def _moves_to(self, cell: int) -> np.ndarray:
        """Return the moves between a cell and each cell, or `NO_WAY`: shape (cells,)."""
        moves = self._grid.distances_to(cell)
        return np.where(moves < 0, NO_WAY, moves).astype(np.int32)

    def away(self, cell: int) -> np.ndarray:
        """Return the moves from a cell to each doorway, or `NO_WAY`: shape (doorways,), int64."""
        found = np.full(self.count, NO_WAY, dtype=np.int64)
        np.minimum.at(found, self._part_of, self.moves_to(cell)[self._cells])
        return found

    def _moves_around(self, door: int, cell: int) -> np.ndarray:
        """Return the moves from a cell to each cell, with one doorway closed; -1: no way."""
        closed = self.cells_of[door].tolist()
        return moves_to(self._grid.next_cell, cell, closed).astype(np.int32)

    def is_between(self, door: int, cell: int, moves: np.ndarray) -> bool:
        """True if a doorway is on a shortest path.

        Args:
            door: the doorway.
            cell: the beginning of the way.
            moves: from each cell to its end, as from `moves_to`.
        """
        there = self._part_of == door
        passed = self.moves_to(cell)[self._cells[there]] + moves[self._cells[there]]
        return bool(passed.min() == moves[cell] < NO_WAY)

    def on_the_way(self, cell: int, moves: np.ndarray) -> np.ndarray:
        """Return the moves from a cell to each doorway on a shortest way; `NO_WAY` for the others.

        Args:
            cell: the beginning of the ways.
            moves: from each cell to their end, as from `moves_to`.
        """
        to = self.moves_to(cell)[self._cells]
        passed = (to + moves[self._cells] == moves[cell]) & (moves[cell] < NO_WAY)
        found = np.full(self.count, NO_WAY, dtype=np.int64)
        np.minimum.at(found, self._part_of[passed], to[passed])
        return found

    def _through(self, cell: int, other: int) -> np.ndarray:
        """Return the moves between two cells through each doorway cell, shape (doorway cells,)."""
        own = self.moves_to(cell)[self._cells]
        return np.asarray(own + self.moves_to(other)[self._cells])

    def side(self, door: int, cell: int, other: int) -> str:
        """Return another cell's side of a doorway; empty if it is not clear.

        Args:
            door: the doorway.
            cell: the observer's cell, outside of that doorway.
            other: the other cell, outside of that doorway.
        """
        rooms = self.room[cell], self.room[other]
        passed = self._through(cell, other)
        moves = self.moves_to(cell)[other]
        inside = self.of[other] >= 0
        if passed[self._part_of == door].min() > moves:
            same = rooms[0] == rooms[1] and passed.min() > moves
            return "on this side" if same and not inside else ""
        # Two rooms that a doorway joins are on two sides of it, even if other doorways join them
        # too.
        joined = (
            not inside and rooms[0] != rooms[1] and self._rooms[door].issuperset(rooms)
        )
        if not joined:
            around = self._around(door, cell)[other]
            if 0 <= around <= moves:
                return ""
        sides = len(self._rooms[door])
        return "on another side" if sides > 2 else "on the other side"

    def behind_another(self, door: int, cell: int, other: int) -> bool:
        """True if a cell is on the other side of another doorway of the same room."""
        rooms = self.room[cell], self.room[other]
        moves = self.moves_to(cell)[other]
        passed = self._through(cell, other) == moves
        others = set(self._part_of[passed].tolist()) - {door}
        return rooms[0] != rooms[1] and any(
            self._rooms[n].issuperset(rooms) for n in others
        )

    def leaves_by(self, door: int, cell: int, other: int) -> frozenset[int]:
        """Return the cells by which shortest paths leave a doorway from `cell` to `other`."""
        moves = self.moves_to(cell)
        ways = {one: self.moves_to(one)[other] for one in self._exits[door].tolist()}
        return frozenset(
            one for one, way in ways.items() if moves[one] + way == moves[other]
        )
