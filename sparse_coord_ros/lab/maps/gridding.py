# Copyright 2026 The sparse_coord_ros authors
# SPDX-License-Identifier: Apache-2.0
"""A floor plan's pixels as cells: space for a robot's centre, and the place of the grid.

A cell is free where its centre is; averaging over a cell's pixels would erase walls or close
doors. Where the grid lies decides whether a door keeps a row of free centres, so its offset is
searched. A robot drives straight from centre to centre: the space between two free centres is
also checked.
"""

import math
from collections.abc import Iterator
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from scipy import ndimage

from sparse_coord_ros.lab.maps.floor_plan import FloorPlan

SPECK = 0.12
"""Metres: what is no larger both ways is a spot."""

CHANCE = 0.05
"""Fewer groups of spots than this by chance, and a group is none of dust."""

OFFSETS = 10
"""Most offsets that are tried along each axis."""

LOOKS = 4_000_000
"""Cells that are looked at in the search, of all offsets together."""

DOOR_CELLS = 10
"""As how many free cells a doorway counts where two offsets keep equally much connected."""

TOUCHING = np.ones((3, 3), dtype=bool)
"""Pixels that touch at a corner belong together."""

CRUMB = 4
"""Fewer connected cells are no part of a map, and nothing that a doorway leads to."""


class Gridding(NamedTuple):
    """The place of a grid, and the kinds of its cells.

    Attributes:
        top, left: where its upper left corner lies, in pixels; may be outside the image.
        free: free cells, shape (rows, columns), bool.
        slips: pairs of adjacent free cells that a wall of a cell's length or more would lie
            between; such a grid is of no use.
        cut: parts of free space that it cuts off.
        kept: how much it keeps: free cells, and doorways at `DOOR_CELLS` each.
    """

    top: float
    left: float
    free: np.ndarray
    slips: int
    cut: int
    kept: int


@dataclass(frozen=True)
class Space:
    """The space for a robot's centre.

    Attributes:
        walls: occupied pixels, without dust.
        dust: pixels that are not free, and count as free: spots by themselves.
        blocked: pixels too near to a wall or to unknown space.
        parts: number of the connected part of each pixel that is not blocked; 0: blocked.
        past_blocked, past_walls: number of such pixels before each, along rows and columns.
    """

    walls: np.ndarray
    dust: np.ndarray
    blocked: np.ndarray
    parts: np.ndarray
    past_blocked: tuple[np.ndarray, np.ndarray]
    past_walls: tuple[np.ndarray, np.ndarray]

    @property
    def dust_spots(self) -> int:
        """The number of spots that count as free."""
        return int(ndimage.label(self.dust, structure=TOUCHING)[1])


def space_of(plan: FloorPlan, radius: float) -> Space:
    """Return the space for the centre of a robot; dust counts as free.

    Args:
        plan: the floor plan.
        radius: the robot's, in metres.
    """
    return _space(plan, dust_of(plan, radius), radius)


def _space(plan: FloorPlan, dust: np.ndarray, radius: float) -> Space:
    walls = plan.occupied & ~dust
    blocked = grown(~plan.free & ~dust, radius / plan.resolution)
    parts = ndimage.label(~blocked, output=np.int32)[0]
    return Space(walls, dust, blocked, parts, _past(blocked), _past(walls))


def dust_of(plan: FloorPlan, radius: float) -> np.ndarray:
    """Return the pixels of dust: spots of at most `SPECK` that stand in no row.

    Spots that stand nearer together than a robot is wide are a row, unless dust alone would make
    such rows.
    """
    spots = specks(~plan.free, int(round(SPECK / plan.resolution)))
    return spots & ~rows_of(spots, 2 * radius / plan.resolution)


def specks(pixels: np.ndarray, size: int) -> np.ndarray:
    """Return the spots of a picture that are at most `size` pixels high and wide.

    Args:
        pixels: the picture, shape (rows, columns), bool; as the one returned.
        size: in pixels.
    """
    labels, count = ndimage.label(pixels, structure=TOUCHING, output=np.int32)
    small = np.zeros(count + 1, dtype=bool)
    for number, (rows, columns) in enumerate(ndimage.find_objects(labels), start=1):
        longest = max(rows.stop - rows.start, columns.stop - columns.start)
        small[number] = longest <= size
    return np.asarray(small[labels])


def rows_of(spots: np.ndarray, gap: float) -> np.ndarray:
    """Return the spots that stand in rows: groups in which each is near another one.

    Dust makes groups, too, by chance. Their number falls by a constant factor from each size to
    the next. The numbers of single spots and of pairs tell this factor, and so the number of
    groups of any size that chance makes. A group is a row if that is less than `CHANCE`.

    Args:
        spots: the spots, shape (rows, columns), bool; as the ones returned.
        gap: the distance in pixels from which on two spots are not near each other.
    """
    if not spots.any():
        return spots
    near, _ = ndimage.label(
        ndimage.distance_transform_edt(~spots) < gap / 2, structure=TOUCHING
    )
    near = np.where(spots, near, 0)
    numbers, count = ndimage.label(spots, structure=TOUCHING)
    group_of = np.zeros(count + 1, dtype=np.int64)
    group_of[numbers[spots]] = near[spots]
    sizes = np.bincount(group_of[1:], minlength=near.max() + 1)
    alone = int((sizes == 1).sum())
    pairs = int((sizes == 2).sum())
    factor = pairs / max(1, alone + pairs)
    by_chance = alone * factor ** np.maximum(sizes - 1.0, 0.0)
    row = (sizes > 1) & (by_chance < CHANCE)
    return np.asarray(row[near])


def grown(pixels: np.ndarray, radius: float) -> np.ndarray:
    """Return the pixels within a radius (in pixels) of a set one: a dilation by a disc.

    Both pictures have the shape (rows, columns), bool.
    """
    if not pixels.any():  # no pixels, no distances
        return pixels
    return np.asarray(ndimage.distance_transform_edt(~pixels) <= radius)


def _past(pixels: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    return pixels.cumsum(axis=1, dtype=np.uint16), pixels.cumsum(
        axis=0, dtype=np.uint16
    )


def _neighbours(array: np.ndarray, axis: int) -> tuple[np.ndarray, np.ndarray]:
    """Return views of the first and of the second of all pairs of neighbours along an axis."""
    return (array[:-1], array[1:]) if axis == 0 else (array[:, :-1], array[:, 1:])


def _apart(free: np.ndarray, past: np.ndarray, axis: int) -> np.ndarray:
    """Return the pairs of free neighbours with an obstacle between them."""
    (first, second) = _neighbours(free, axis)
    (before, after) = _neighbours(past, axis)
    return np.asarray(first & second & (before != after))


def best_layout(space: Space, pixels: float) -> Gridding:
    """Return the grid, of all offsets that are tried, that keeps most of the space connected.

    Args:
        space: where a robot's centre may be.
        pixels: the side of a cell, in pixels.
    """
    height, width = space.blocked.shape
    cells = (height / pixels) * (width / pixels)
    tries = min(
        math.ceil(pixels), OFFSETS, max(2, int(math.sqrt(LOOKS / max(cells, 1.0))))
    )
    # The first centre is the first in the image.
    starts = [pixels * k / tries for k in range(tries)]
    starts = [start if start < pixels / 2 else start - pixels for start in starts]
    layouts = [_layout(space, pixels, top, left) for top in starts for left in starts]
    return max(layouts, key=lambda layout: (-layout.slips, -layout.cut, layout.kept))


def layout_with_dust(
    plan: FloorPlan, space: Space, layout: Gridding, pixels: float, radius: float
) -> np.ndarray:
    """Return the free cells of a grid if dust is not free, shape (rows, columns), bool.

    Args:
        plan: the floor plan.
        space: its space, without dust.
        layout: the grid.
        pixels: the side of a cell, in pixels.
        radius: the robot's, in metres.
    """
    if not space.dust.any():
        return layout.free
    dusty = _space(plan, np.zeros_like(space.dust), radius)
    return _layout(dusty, pixels, layout.top, layout.left).free


def _layout(space: Space, pixels: float, top: float, left: float) -> Gridding:
    height, width = space.blocked.shape
    half = pixels / 2
    rows = np.floor(np.arange(top + half, height, pixels)).astype(np.int64)
    columns = np.floor(np.arange(left + half, width, pixels)).astype(np.int64)
    if not len(rows) or not len(columns):
        return Gridding(
            top, left, np.zeros((len(rows), len(columns)), dtype=bool), 0, 0, 0
        )
    at = np.ix_(rows, columns)
    parts = space.parts[at]
    free = parts > 0
    slips = 0
    for past, axis in zip(space.past_walls, (1, 0), strict=True):
        # An obstacle between one pair may be a spot; one between two adjacent pairs is a wall.
        between, beside = _neighbours(_apart(free, past[at], axis), 1 - axis)
        slips += int((between & beside).sum())
    _close(free, [past[at] for past in space.past_blocked])
    labels, count = ndimage.label(free)
    sizes = np.bincount(labels[free], minlength=count + 1)
    # For each part of the space its largest part in the grid is kept; all others are cut off.
    kept = np.zeros(parts.max(initial=0) + 1, dtype=np.int64)
    which = np.zeros(count + 1, dtype=np.int64)
    which[labels[free]] = parts[free]
    np.maximum.at(kept, which, sizes)
    large = sizes >= CRUMB
    cut = int(large.sum() - (kept[1:] >= CRUMB).sum())
    doors = int(across(free).max(initial=0))
    return Gridding(
        top, left, free, slips, cut, int(kept[1:].sum()) + DOOR_CELLS * doors
    )


def _close(free: np.ndarray, past: list[np.ndarray]) -> None:
    """Of each pair of neighbours without a drivable way between, close the less useful cell.

    This is the cell with more such pairs, or else with fewer free neighbours.
    """
    while True:
        apart = [
            _apart(free, before, axis)
            for before, axis in zip(past, (1, 0), strict=True)
        ]
        if not any(pairs.any() for pairs in apart):
            return
        bad = np.zeros(free.shape, dtype=np.int64)
        for pairs, axis in zip(apart, (1, 0), strict=True):
            for side in _neighbours(bad, axis):
                side += pairs
        padded = np.pad(free, 1).astype(np.int8)
        near = (
            padded[:-2, 1:-1] + padded[2:, 1:-1] + padded[1:-1, :-2] + padded[1:-1, 2:]
        )
        cost = 8 * bad - near
        gone = np.zeros(free.shape, dtype=bool)
        for pairs, axis in zip(apart, (1, 0), strict=True):
            first, second = _neighbours(cost, axis)
            for side, chosen in zip(
                _neighbours(gone, axis), (first >= second, first < second), strict=True
            ):
                side |= pairs & chosen
        free &= ~gone


def across(free: np.ndarray, longest: int = 2) -> np.ndarray:
    """Return the doorways of a grid, numbered from 1; 0 elsewhere; shape (rows, columns), int64.

    A doorway is a run of at most `longest` free cells, one after the other, that each have walls
    on two opposite sides, and that lead to `CRUMB` cells or more at both ends. Longer runs are
    corridors. A gap beside a thing that stands free, around which the ends meet in the cells near
    the run, is no doorway.
    """
    doors = np.zeros(free.shape, dtype=np.int64)
    number = 0
    for turned in (False, True):
        view, target = (free.T, doors.T) if turned else (free, doors)
        wall = np.pad(~view, 1, constant_values=True)
        # walls north and south: passed east
        between = view & wall[:-2, 1:-1] & wall[2:, 1:-1]
        for row, begin, end in _short_runs(between, longest):
            if _parts(view, row, (begin, end)):
                number += 1
                target[row, begin:end] = number
    return doors


def _short_runs(cells: np.ndarray, longest: int) -> Iterator[tuple[int, int, int]]:
    """Yield row, first column, and the column behind it, of each run of cells along a row.

    Runs of more than `longest` cells, and those at the edge of the grid, are left out.
    """
    edges = np.diff(np.pad(cells, ((0, 0), (1, 1))).astype(np.int8), axis=1)
    begins = np.argwhere(edges == 1)
    ends = np.argwhere(edges == -1)
    for (row, begin), (_, end) in zip(begins.tolist(), ends.tolist(), strict=True):
        if end - begin <= longest and begin > 0 and end < cells.shape[1]:
            yield row, begin, end


def two_wide(free: np.ndarray, longest: int = 2) -> list[tuple[int, int]]:
    """Return a cell of each passage that would be a doorway if it were not two cells wide.

    It opens at one end at least into a space that is three cells wide: a room that is two cells
    wide is no passage, nor is a corridor between its side doors.

    Arguments as in `across`.
    """
    rooms = free & (across(free, longest) == 0)
    passages = _passed_east(rooms, longest)
    passages += [(row, column) for column, row in _passed_east(rooms.T, longest)]
    return sorted(passages)


def _passed_east(rooms: np.ndarray, longest: int) -> list[tuple[int, int]]:
    """Return (row, column) of the upper cell of each passage of two rows, as `two_wide` does.

    Args:
        rooms: free cells that are no doorways, shape (rows, columns), bool.
        longest: the most columns of a passage.
    """
    walled = np.pad(rooms, ((1, 2), (0, 0)))
    pair = walled[1:-2] & walled[2:-1] & ~walled[:-3] & ~walled[3:]
    spacious = ndimage.binary_opening(rooms, np.ones((3, 3)))
    passages = []
    for row, begin, end in _short_runs(pair, longest):
        both = slice(row, row + 2)
        beyond = (begin - 1, end)
        opens = all(rooms[both, column].all() for column in beyond)
        if opens and any(spacious[both, column].any() for column in beyond):
            passages.append((row, begin))
    return passages


def _parts(free: np.ndarray, row: int, run: tuple[int, int]) -> bool:
    """Return whether a run parts the cells near it into two sides of `CRUMB` cells or more.

    Near are cells at most `CRUMB` rows and columns away from it.

    Args:
        free: the grid's free cells, shape (rows, columns), bool.
        row: the run's row.
        run: its first column, and the one behind it.
    """
    begin, end = run
    top = max(0, row - CRUMB)
    left = max(0, begin - 1 - CRUMB)
    near = free[top : row + CRUMB + 1, left : end + CRUMB + 1].copy()
    near[row - top, begin - left : end - left] = False
    labels, _ = ndimage.label(near)
    sides = [labels[row - top, column - left] for column in (begin - 1, end)]
    large = all(side and (labels == side).sum() >= CRUMB for side in sides)
    return large and sides[0] != sides[1]
