# Copyright 2026 The sparse_coord_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Spots: single ones are dust, rows of them are walls; passages that are two cells wide."""

from pathlib import Path

import numpy as np
import pytest

from sparse_coord_ros.core.game.pose import Pose
from sparse_coord_ros.lab.maps.floor_plan import FloorPlan
from sparse_coord_ros.lab.maps.gridding import two_wide
from sparse_coord_ros.lab.maps.plan import import_map


def two_rooms(gap=22):
    """Return the walls of two rooms of 4 x 4 m with a gap between them, in pixels of 0.05 m."""
    walls = np.zeros((82, 164), dtype=bool)
    walls[[0, 81]] = True
    walls[:, [0, 163]] = True
    walls[:, 81:83] = True
    walls[30 : 30 + gap, 81:83] = False
    return walls


def plan_of(walls, unknown=False):
    kind = np.zeros_like(walls) if unknown else walls
    return FloorPlan(Path("rooms"), ~walls, kind, 0.05, Pose(0.0, 0.0))


@pytest.mark.parametrize("unknown", [False, True])
@pytest.mark.parametrize(
    ("pitch", "size", "askew"), [(2, 1, 0), (4, 2, 0), (7, 1, 0), (5, 2, 1), (3, 1, 1)]
)
def test_a_dotted_wall_stays_closed(pitch, size, askew, unknown):
    walls = two_rooms()
    for number, row in enumerate(range(30, 52, pitch)):
        column = 81 + askew * number
        walls[row : row + size, column : column + size] = True
    for turned in (walls, walls.T):
        done = import_map(plan_of(turned, unknown), cell=0.5, radius=0.2)
        assert len(done.parts) == 2
        assert done.dusty == ()


def test_a_dotted_partition_is_a_wall():
    """It ends in the middle of the room; no way leads between its dots."""
    walls = two_rooms(gap=0)
    walls[10:70:5, 40] = True
    done = import_map(plan_of(walls), cell=0.5, radius=0.2)
    free = import_map(plan_of(two_rooms(gap=0)), cell=0.5, radius=0.2)
    assert len(done.grid.cells) < len(free.grid.cells)
    assert done.dusty == ()


def test_what_is_there_only_because_a_spot_was_dropped_is_named():
    walls = two_rooms(gap=16)
    doorway = import_map(plan_of(walls), cell=0.5, radius=0.2)
    assert doorway.grid.doorway_count == 1
    assert doorway.dusty == ()
    walls[38, 82] = True
    done = import_map(plan_of(walls), cell=0.5, radius=0.2)
    assert done.grid.doorway_count == 1
    assert len(done.dusty) >= 1
    (note,) = [note for note in done.notes if "dust" in note]
    x, y = done.dusty[0]
    assert note.startswith("1 spot of up to 0.12 m dropped as dust; only because of")
    assert abs(x - 4.1) < 0.6 and abs(y - 2.2) < 0.6


@pytest.mark.parametrize(
    ("rows", "found"),
    [
        ("....#.... ....#.... ......... ......... ....#....", [(2, 4)]),
        # a room of two by three cells between two doorways
        ("....#####.... ....#...#.... ........#.... ....#........ ....#####....", []),
        # a corridor of two cells with side doors
        ("........... ........... ##.###.##.# ........... ........... ...........", []),
        # an alcove
        ("....##### ....##### .......## .......## ....#####", []),
    ],
)
def test_a_room_that_is_two_cells_wide_is_no_passage(rows, found):
    free = np.array([[sign != "#" for sign in row] for row in rows.split()])
    assert two_wide(free) == found
    assert two_wide(free.T) == [(column, row) for row, column in found]


def test_corridors_need_no_dust():
    """Doorways that the user asks for have nothing to do with spots."""
    walls = two_rooms(gap=16)
    walls[30:46, 60:81] = False
    walls[:30, 60:81] = walls[46:, 60:81] = True
    done = import_map(plan_of(walls), cell=0.5, radius=0.2, corridors=True)
    assert len(done.grid.doorways) > 1
    assert done.dusty == ()
