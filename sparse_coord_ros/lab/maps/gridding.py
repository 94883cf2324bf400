# Copyright 2026 The sparse_coord_ros authors
# SPDX-License-Identifier: Apache-2.0
"""A floor plan's pixels as cells: space for a robot's centre, and the place of the grid.

A cell is free where its centre is; averaging over a cell's pixels would erase walls or close
doors. Where the grid lies decides whether a door keeps a row of free centres, so its offset is
searched. A robot drives straight from centre to centre: the space between two free centres is
also checked.
"""

import math
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from scipy import ndimage

from sparse_coord_ros.lab.maps.image import FloorPlan

SPECK = 0.12
"""Metres: what is smaller both ways is noise."""

OFFSETS = 10
"""Most offsets that are tried along each axis."""

LOOKS = 4_000_000
"""Cells that are looked at in the search, of all offsets together."""

DOOR_CELLS = 10
"""As how many free cells a doorway counts where two offsets keep equally much connected."""

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
        walls: occupied pixels, without specks.
        blocked: pixels too near to a wall or to unknown space.
        parts: number of the connected part of each pixel that is not blocked; 0: blocked.
        past_blocked, past_walls: number of such pixels before each, along rows and columns.
    """

    walls: np.ndarray
    blocked: np.ndarray
    parts: np.ndarray
    past_blocked: tuple[np.ndarray, np.ndarray]
    past_walls: tuple[np.ndarray, np.ndarray]


def space_of(plan: FloorPlan, radius: float) -> Space:
    """Return the space for the centre of a robot; spots smaller than `SPECK` count as free.

    Args:
        plan: the floor plan.
        radius: the robot's, in metres.
    """
    pixels = int(round(SPECK / plan.resolution))
    walls = without_specks(plan.occupied, pixels)
    # Pixels that are neither free nor wall are unknown: specks of noise are filled, rooms never.
    unfree = without_specks(~(plan.free | (plan.occupied & ~walls)) | walls, pixels)
    blocked = grown(unfree, radius / plan.resolution)
    parts = ndimage.label(~blocked, output=np.int32)[0]
    return Space(walls, blocked, parts, _past(blocked), _past(walls))


def without_specks(pixels: np.ndarray, size: int) -> np.ndarray:
    """Return a picture without the spots that are at most `size` pixels high and wide.

    Args:
        pixels: the picture, shape (rows, columns), bool; as the one returned.
        size: in pixels.
    """
    if size < 1:
        return pixels
    labels, count = ndimage.label(
        pixels, structure=np.ones((3, 3), dtype=bool), output=np.int32
    )
    keep = np.zeros(count + 1, dtype=bool)
    for places in np.nonzero(pixels):
        first = np.full(count + 1, max(pixels.shape))
        last = np.full(count + 1, -1)
        np.minimum.at(first, labels[pixels], places)
        np.maximum.at(last, labels[pixels], places)
        keep |= last - first >= size
    return keep[labels]


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
    shifts = [pixels * k / tries for k in range(tries)]
    found = [_layout(space, pixels, south, east) for south in shifts for east in shifts]
    return max(found, key=lambda one: (-one.slips, -one.cut, one.kept))


def _layout(space: Space, pixels: float, down: float, right: float) -> Gridding:
    height, width = space.blocked.shape
    half = pixels / 2
    # the first centre is the first in the image
    top = down if down < half else down - pixels
    left = right if right < half else right - pixels
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
        one, beside = _neighbours(_apart(free, past[at], axis), 1 - axis)
        slips += int((one & beside).sum())
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
    corridors.
    """
    doors = np.zeros(free.shape, dtype=np.int64)
    number = 0
    for turned in (False, True):
        view, target = (free.T, doors.T) if turned else (free, doors)
        wall = np.pad(~view, 1, constant_values=True)
        # walls north and south: passed east
        between = view & wall[:-2, 1:-1] & wall[2:, 1:-1]
        edges = np.diff(np.pad(between, ((0, 0), (1, 1))).astype(np.int8), axis=1)
        begins = np.argwhere(edges == 1)
        ends = np.argwhere(edges == -1)
        columns = view.shape[1]
        for (row, begin), (_, end) in zip(begins.tolist(), ends.tolist(), strict=True):
            if end - begin > longest or begin == 0 or end == columns:
                continue
            if all(
                _leads_on(view, row, column, (begin, end))
                for column in (begin - 1, end)
            ):
                number += 1
                target[row, begin:end] = number
    return doors


def two_wide(free: np.ndarray, longest: int = 2) -> list[tuple[int, int]]:
    """Return a cell of each passage that would be a doorway if it were not two cells wide.

    Arguments as in `across`.
    """
    padded = np.pad(free, 2)
    inner = padded[2:-2, 2:-2]
    before = across(free, longest)
    found = []
    for north_south in (True, False):
        grid = padded if north_south else padded.T
        middle = slice(2, -2)
        pair = (
            grid[middle, middle]
            & grid[1:-3, middle]
            & ~grid[:-4, middle]
            & ~grid[3:-1, middle]
        )
        narrow = inner & ~(pair if north_south else pair.T)
        doors = across(narrow, longest)
        for number in range(1, int(doors.max(initial=0)) + 1):
            cells = np.argwhere(doors == number)
            beside = cells + ((1, 0) if north_south else (0, 1))
            row, column = cells[0].tolist()
            inside = (beside < free.shape).all()
            if not before[row, column] and inside and free[tuple(beside.T)].all():
                found.append((row, column))
    return sorted(found)


def _leads_on(free: np.ndarray, row: int, column: int, run: tuple[int, int]) -> bool:
    """Return whether `CRUMB` cells can be reached from the end of a run without going through it.

    Args:
        free: the grid's free cells, shape (rows, columns), bool.
        row: the run's row.
        column: the column beside the run.
        run: its first column, and the one behind it.
    """
    top = max(0, row - CRUMB)
    left = max(0, column - CRUMB)
    near = free[top : row + CRUMB + 1, left : column + CRUMB + 1].copy()
    near[row - top, max(0, run[0] - left) : max(0, run[1] - left)] = False
    labels, _ = ndimage.label(near)
    own = labels[row - top, column - left]
    return bool(own and (labels == own).sum() >= CRUMB)
