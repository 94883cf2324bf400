# Copyright 2026 The sparse_coord_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Buildings that lie askew: in their image, or with a yaw in the robots' frame."""

import dataclasses
import math
from pathlib import Path

import numpy as np
import pytest
from floor_plans import FREE, PIXEL, UNKNOWN, drawn, matched, scanned
from PIL import Image
from scipy import ndimage

from sparse_coord_ros.core.game.grid import parse_map
from sparse_coord_ros.core.game.pose import Pose, Squares
from sparse_coord_ros.core.runs.run_config import make_run
from sparse_coord_ros.lab.driving.metric_map import MetricMap
from sparse_coord_ros.lab.maps.floor_plan import FloorPlan, turned
from sparse_coord_ros.lab.maps.image import read_floor_plan, under
from sparse_coord_ros.lab.maps.plan import import_map, scenario_of
from sparse_coord_ros.protocol.wire.messages import Messages
from sparse_coord_ros.show.paths import floor_figure


def office(degrees):
    """Return the plan of an office whose image is turned, and its doorways in metres."""
    drawing = drawn("office")
    pixels = ndimage.rotate(drawing.pixels, degrees, order=0, cval=UNKNOWN)
    plan = FloorPlan(Path("office"), pixels == FREE, pixels == 0, PIXEL, Pose(0.0, 0.0))
    middle = Pose(
        pixels.shape[1] * PIXEL / 2, pixels.shape[0] * PIXEL / 2, math.radians(degrees)
    )
    doors = [
        middle.absolute(x - drawing.width / 2, y - drawing.height / 2)
        for x, y in drawing.doors
    ]
    return plan, doors


@pytest.mark.parametrize("yaw", [0.0, 0.35, -1.0, math.pi / 2, math.pi])
def test_a_place_goes_there_and_back(yaw):
    corner = Pose(500_123.25, -7.5, yaw)
    ahead, left = corner.relative(*corner.absolute(2.5, -1.25))
    assert (ahead, left) == pytest.approx((2.5, -1.25), abs=1e-6)
    squares = Squares(corner, 0.4, 30)
    for row, column in ((0, 0), (29, 3), (7, 40)):
        assert squares.at(*squares.centre(row, column)) == (row, column)


@pytest.mark.parametrize("degrees", [-40, -20, -5, 0, 12, 20, 33])
def test_the_main_direction_of_walls_is_found(degrees):
    plan, _ = office(degrees)
    assert math.degrees(plan.wall_direction) == pytest.approx(degrees, abs=0.3)


def test_a_round_room_has_no_main_direction():
    rows, columns = np.indices((400, 400)) - 200
    free = rows**2 + columns**2 < 190**2
    plan = FloorPlan(Path("round"), free, ~free, 0.05, Pose(0.0, 0.0))
    assert plan.wall_direction is None


@pytest.mark.parametrize("degrees", [20, -33])
def test_a_turned_grid_finds_every_doorway_in_the_frame_of_the_robots(degrees):
    plan, doors = office(degrees)
    askew = import_map(plan, cell=0.5, radius=0.2)
    assert matched(doors, askew.grid)[0] < len(doors)
    assert any("the walls lie at" in note for note in askew.notes)
    done = import_map(turned(plan, plan.wall_direction), cell=0.5, radius=0.2)
    assert matched(doors, done.grid) == (len(doors), 0)
    assert not any("degrees" in note for note in done.notes)
    assert math.degrees(done.grid.origin.yaw) == pytest.approx(degrees, abs=0.3)


def test_a_turned_grid_is_not_askew_where_unknown_space_is_free():
    """The edges of the old image lie askew in the turned one, and are no walls."""
    plan, _ = office(20)
    free = plan.free | ~plan.occupied
    open_plan = dataclasses.replace(plan, free=free)
    yaw = open_plan.wall_direction
    done = import_map(turned(open_plan, yaw), cell=0.5, radius=0.2)
    assert not any("degrees" in note for note in done.notes)
    half = import_map(turned(open_plan, yaw / 2), cell=0.5, radius=0.2)
    assert any("the walls lie at 10." in note for note in half.notes)


def test_a_turned_scan_finds_every_doorway():
    drawing = scanned(drawn("office"), 20.0, 1)
    pixels = drawing.pixels
    plan = FloorPlan(Path("scan"), pixels == FREE, pixels == 0, PIXEL, Pose(0.0, 0.0))
    done = import_map(turned(plan, plan.wall_direction), cell=0.5, radius=0.2)
    assert matched(drawing.doors, done.grid)[0] == len(drawing.doors)


@pytest.mark.parametrize("degrees", [10.0, 45.0, 90.0, 180.0, -90.0, -30.0])
def test_thin_walls_stay_closed_when_they_are_turned(degrees):
    free = np.ones((80, 120), dtype=bool)
    free[[0, -1]] = free[:, [0, -1]] = free[:, 60] = False
    plan = FloorPlan(Path("thin"), free, ~free, 0.05, Pose(3.0, 4.0))
    seen = turned(plan, math.radians(degrees))
    _, parts = ndimage.label(seen.free)
    assert parts == 2
    assert abs(int(seen.free.sum()) - int(free.sum())) < 0.07 * free.sum()
    # A place of the old image has the same kind in the new one.
    middle = plan.origin.absolute(1.5, 2.0)
    ahead, left = seen.origin.relative(*middle)
    row = len(seen.free) - 1 - int(left / 0.05)
    assert seen.free[row, int(ahead / 0.05)]


def saved(folder, yaw):
    """Write an L-shaped room of 6 x 4 m that lies at x 0 to 6, y 0 to 4, for half a turn too."""
    pixels = np.zeros((80, 120), np.uint8)
    pixels[2:78, 2:118] = 254
    pixels[2:30, 60:118] = 0
    half = abs(yaw) > 3
    Image.fromarray(pixels[::-1, ::-1] if half else pixels).save(folder / "l.png")
    origin = [6.0, 4.0, yaw] if half else [0.0, 0.0, yaw]
    (folder / "l.yaml").write_text(
        f"image: l.png\nresolution: 0.05\norigin: {origin}\n"
    )
    return read_floor_plan(folder / "l.yaml")


@pytest.mark.parametrize("yaw", [math.pi, -3.14159265])
def test_half_a_turn_in_the_yaml_file_is_the_same_room(tmp_path, yaw):
    (tmp_path / "a").mkdir()
    (tmp_path / "b").mkdir()
    grids = [
        import_map(saved(folder, turn), cell=0.5, radius=0.2).grid
        for folder, turn in ((tmp_path / "a", 0.0), (tmp_path / "b", yaw))
    ]
    straight, half = (
        sorted(grid.squares.centre(*cell) for cell in grid.cells) for grid in grids
    )
    assert len(straight) == len(half)
    assert grids[1].squares.at(1.0, 1.0) in grids[1].number
    assert grids[1].squares.at(5.0, 3.5) not in grids[1].number  # where the room ends


def test_all_know_the_angle(tmp_path):
    """The map's text, the frame of messages, bodies and pictures lie as the grid."""
    plan, doors = office(20)
    plan = turned(plan, math.radians(20))
    done = import_map(plan, cell=0.5, radius=0.2)
    grid = parse_map(done.grid.to_text(), name="office", where="office")
    assert grid.origin == done.grid.origin
    start, goal = (grid.squares.centre(*grid.cells[cell]) for cell in (5, 600))
    scenario, *_ = scenario_of(done, [(start, goal)], {})
    run = make_run(scenario, {})
    frame = Messages(run)
    floor = MetricMap(run)
    for cell, place in enumerate(frame.centres):
        assert frame.cell(*place) == cell
        assert floor.inside(cell, *floor.place(0, cell))
        assert not floor.blocked(*place)
    figure = floor_figure(grid, scenario.robots, plan, cells=True)
    disc, ring = figure.axes[0].patches
    assert disc.center == pytest.approx(start)
    assert ring.center == pytest.approx(goal)


def test_the_picture_under_a_turned_map_is_turned(tmp_path):
    """Each free cell's middle is a free pixel of the picture that a page shows under it."""
    saved(tmp_path, 0.0)
    plan = read_floor_plan(tmp_path / "l.yaml")
    done = import_map(turned(plan, math.radians(30)), cell=0.5, radius=0.2)
    picture = under(done.grid)
    seen = turned(plan, math.radians(30))
    high, wide = seen.free.shape
    places = np.array(done.grid.cells) + 0.5
    rows = (places[:, 0] - picture["y"]) / picture["height"] * high
    columns = (places[:, 1] - picture["x"]) / picture["width"] * wide
    assert seen.free[rows.astype(int), columns.astype(int)].all()
