# Copyright 2026 The sparse_coord_ros authors
# SPDX-License-Identifier: Apache-2.0
"""From floor plans whose doorways are known to maps: doors open, walls closed, robots in place."""

import dataclasses
import functools
import math
import re
from pathlib import Path

import numpy as np
import pytest
import yaml
from floor_plans import FREE, PIXEL, Drawing, drawn, matched, write
from matplotlib.backends.backend_agg import FigureCanvasAgg
from PIL import Image, ImageDraw

from sparse_coord_ros.base.errors import MapError, ScenarioError
from sparse_coord_ros.core.game.grid import parse_map
from sparse_coord_ros.core.game.pose import Pose
from sparse_coord_ros.core.game.scenario import load_scenario, scenario_from_dict
from sparse_coord_ros.core.runs.run_config import make_run, run_from_yaml
from sparse_coord_ros.lab.maps import gridding
from sparse_coord_ros.lab.maps import plan as plans
from sparse_coord_ros.lab.maps.floor_plan import FloorPlan
from sparse_coord_ros.lab.maps.gridding import across, grown, specks
from sparse_coord_ros.lab.maps.image import read_floor_plan, under
from sparse_coord_ros.lab.maps.meeting import prospect_of
from sparse_coord_ros.lab.maps.passages import narrow_corridors
from sparse_coord_ros.lab.maps.plan import import_map, scenario_of
from sparse_coord_ros.protocol.wire.messages import Messages
from sparse_coord_ros.show.paths import floor_figure

CORNERS = (-9.0, -6.0), (9.0, 6.0)


def plan_of(drawing, origin=(0.0, 0.0)):
    """Return a drawing as it would be read."""
    pixels = drawing.pixels
    return FloorPlan(Path("drawn"), pixels > 250, pixels < 100, 0.05, Pose(*origin))


def rooms(thick=0.2, wide=0.9):
    """Return two rooms with a doorway between them."""
    drawing = Drawing(6.0, 4.0, thick=thick)
    drawing.outline()
    drawing.wall(3.0, 0, 3.0, 4.0)
    drawing.door(3.0, 1.7, wide=wide, north=False)
    return drawing


@pytest.fixture(scope="module")
def imported(tmp_path_factory):
    """Return a function that imports a drawn plan once: its true doorways, the plan, the map."""

    @functools.cache
    def read(name):
        folder = tmp_path_factory.mktemp(name)
        true = write(name, folder)
        plan = read_floor_plan(folder / f"{name}.yaml")
        return true, plan, import_map(plan, cell=0.5, radius=0.2)

    return read


def test_the_clinic_s_corridors_cross():
    plan = drawn("clinic")
    for y in (8.4, 18.4):
        row = round((plan.height - y) / PIXEL)
        assert plan.pixels[row, round(19.0 / PIXEL)] == FREE


@pytest.mark.parametrize(
    ("name", "cells", "odd"),
    [
        ("office", 937, 0),
        ("warehouse", 2527, 0),
        ("slam_office", 855, 0),
        ("slam_flat", 298, 2),
    ],
)
def test_every_doorway_is_found(imported, name, cells, odd):
    """Of the flat's two more, one lies between a table and a chair, one beside a door."""
    true, _, done = imported(name)
    found, false = matched(true, done.grid)
    assert (found, false) == (len(true), odd)
    assert abs(len(done.grid.cells) - cells) <= 5
    assert done.parts == (len(done.grid.cells),)
    scanned = name.startswith("slam")
    assert any("dropped as dust" in note for note in done.notes) == scanned


@pytest.mark.long
@pytest.mark.parametrize(
    ("name", "found", "odd"), [("slam_clinic", 26, 6), ("slam_school", 8, 3)]
)
def test_maps_that_no_tuning_has_seen(tmp_path, name, found, odd):
    """All that is missed is two cells wide, and named; all that is odd lies beside furniture."""
    true = write(name, tmp_path)
    done = import_map(read_floor_plan(tmp_path / f"{name}.yaml"), cell=0.5, radius=0.2)
    assert matched(true, done.grid) == (found, odd)
    assert "passages are two cells wide" in done.notes[0]


@pytest.mark.long
def test_a_large_map(tmp_path):
    true = write("tower", tmp_path)
    done = import_map(read_floor_plan(tmp_path / "tower.yaml"), cell=0.5, radius=0.2)
    assert len(done.grid.cells) == 153_776
    assert matched(true, done.grid) == (len(true), 0) == (112, 0)


@pytest.mark.parametrize("north", [False, True])
def test_a_passage_of_two_cells_is_no_doorway_but_named(north):
    drawing = rooms(wide=1.5)
    plan = plan_of(drawing)
    if north:
        plan = FloorPlan(
            Path("drawn"),
            plan.free.T.copy(),
            plan.occupied.T.copy(),
            0.05,
            Pose(0.0, 0.0),
        )
    done = import_map(plan, cell=0.5, radius=0.2)
    (note,) = [note for note in done.notes if "two cells wide" in note]
    x, y = map(float, note.partition(" at ")[2].partition(";")[0].split(","))
    assert done.grid.doorway_count == 0
    assert math.dist((x, y), (2.3, 3.0) if north else (3.0, 1.7)) < 1.0
    both = [(x, y), (x + 0.5, y) if north else (x, y - 0.5)]
    again = import_map(plan, cell=0.5, radius=0.2, doorway=both)
    assert len(again.grid.doorways) == 2


def test_cells_lie_where_the_pixels_are_free(imported, monkeypatch):
    """Every cell's centre, and the way to each neighbour, keeps the radius from every wall."""
    _, plan, _ = imported("slam_flat")
    monkeypatch.setattr(gridding, "SPECK", 0.0)
    grid = import_map(plan, cell=0.5, radius=0.2).grid
    taken = grown(~plan.free, 4.0)
    rows = plan.free.shape[0]
    for row, column in grid.cells:
        x = (grid.origin[0] - plan.origin[0] + (column + 0.5) * 0.5) / 0.05
        y = (
            rows
            - (grid.origin[1] - plan.origin[1] + (grid.shape[0] - row - 0.5) * 0.5)
            / 0.05
        )
        i = math.floor(y + 1e-3)
        j = math.floor(x + 1e-3)
        assert not taken[i, j]
        if (row, column + 1) in grid.number:
            assert not taken[i, j : j + 10].any()
        if (row + 1, column) in grid.number:
            assert not taken[i : i + 10, j].any()


def test_large_cells_are_refused():
    drawing = rooms(thick=0.1)
    drawing.wall(1.9, 0, 1.9, 4.0)  # no grid of such cells has a centre in both walls
    with pytest.raises(MapError, match="cells of 0.8 m"):
        import_map(plan_of(drawing), cell=0.8, radius=0.05)
    assert import_map(plan_of(drawing), cell=0.4, radius=0.05).grid


@pytest.mark.parametrize("cell", [0.25, 0.3, 0.37, 0.5])
def test_walls_stay_closed_and_doors_open(cell):
    done = import_map(plan_of(rooms()), cell=cell, radius=0.2)
    assert len(done.parts) == 1  # the door is open
    shut = rooms()
    shut.wall(3.0, 0, 3.0, 4.0)
    done = import_map(plan_of(shut), cell=cell, radius=0.2)
    assert len(done.parts) == 2  # the wall is closed
    assert "2 parts of the map do not connect" in done.notes[0]


def test_corridors_and_pockets_are_no_doorways():
    drawing = Drawing(8.0, 4.0)
    drawing.outline()
    drawing.fill(2.5, 0, 5.5, 1.6)
    drawing.fill(2.5, 2.5, 5.5, 4.0)  # between them a way of 3 m, one cell wide
    drawing.fill(7.0, 0.9, 8.0, 3.0)
    drawing.fill(7.0, 0, 7.2, 0.9)
    assert import_map(plan_of(drawing), cell=0.5, radius=0.2).grid.doorway_count == 0


@pytest.mark.parametrize(("corner", "doors"), [("#", 0), (".", 1)])
def test_a_doorway_leads_to_four_cells_at_both_ends(corner, doors):
    rows = ("#######", "#..D..#", f"#..#.{corner}#", "#######")
    free = np.array([[sign != "#" for sign in row] for row in rows])
    assert across(free, 1).max() == across(free.T, 1).max() == doors


def test_doorways_by_hand():
    plan = plan_of(rooms(), (10.0, -5.0))
    none = import_map(plan, cell=0.5, radius=0.2, no_doorway=[(13.0, -3.3)])
    assert none.grid.doorway_count == 0
    assert any("no doorway found" in note for note in none.notes)
    two = import_map(plan, cell=0.5, radius=0.2, doorway=[(11.5, -3.3)])
    assert two.grid.doorway_count == 2
    with pytest.raises(MapError, match="no doorway at 11.5,-3.3"):
        import_map(plan, cell=0.5, radius=0.2, no_doorway=[(11.5, -3.3)])
    with pytest.raises(MapError, match="doorway at 0,0"):
        import_map(plan, cell=0.5, radius=0.2, doorway=[(0.0, 0.0)])


def test_parts_without_a_robot_are_left_out():
    drawing = rooms()
    drawing.wall(3.0, 0, 3.0, 4.0)
    both = import_map(plan_of(drawing), cell=0.5, radius=0.2)
    left = import_map(
        plan_of(drawing), cell=0.5, radius=0.2, robots=[((1.0, 1.0), (2.0, 3.0))]
    )
    assert len(left.grid.cells) == both.parts[0]
    assert "parts without a robot became walls" in left.notes[0]
    apart = import_map(
        plan_of(drawing), cell=0.5, radius=0.2, robots=[((1.0, 1.0), (5.0, 3.0))]
    )
    with pytest.raises(ScenarioError, match="robot_1: its goal"):
        scenario_of(apart, [((1.0, 1.0), (5.0, 3.0))], {})


@pytest.mark.parametrize(
    ("pixels", "values", "words"),
    [
        (np.full((40, 40), 0, np.uint8), {}, "finds no room"),
        (np.full((40, 40), 254, np.uint8), {"radius": 50.0}, None),
        (
            np.full((40, 40), 254, np.uint8),
            {"cell": 0.01},
            "cells of 0.01 m are smaller than a pixel of the map, 0.05 m; cells of 0.05 m",
        ),
        (np.full((40, 40), 254, np.uint8), {"cell": 50.0}, None),
        (np.full((1, 1), 254, np.uint8), {}, None),
    ],
)
def test_odd_maps(pixels, values, words):
    drawing = Drawing(1.0, 1.0)
    drawing.pixels = pixels
    values = {"cell": 0.5, "radius": 0.2, **values}
    # no wall anywhere, however large the robot: whatever grid there is, is free
    if words is None:
        assert import_map(plan_of(drawing), **values).grid.cells
        return
    with pytest.raises(MapError, match=words):
        import_map(plan_of(drawing), **values)


def site():
    """Return a plan whose pixels are large, with fences that are thin and lie askew."""
    image = Image.new("L", (330, 330), FREE)
    for k in range(0, 660, 60):
        ImageDraw.Draw(image).line([(k, 0), (k - 225, 330)], fill=0)
    pixels = np.asarray(image)
    return FloorPlan(Path("site"), pixels > 0, pixels == 0, 0.25, Pose(0.0, 0.0))


def test_a_size_that_does_not_work_names_one_that_does(monkeypatch):
    monkeypatch.setattr(plans, "MOST_CELLS", 60_000)
    for cell, problem in ((0.4, "a wall disappears"), (0.3, "make 75,625 squares")):
        with pytest.raises(MapError, match=problem) as refused:
            import_map(site(), cell=cell, radius=0.2)
        works = re.search(r"; cells of ([\d.]+) m work", str(refused.value))
        grid = import_map(site(), cell=float(works[1]), radius=0.2).grid
        assert grid.resolution == float(works[1])
    assert import_map(site(), radius=0.2).grid.cells
    monkeypatch.setattr(plans, "MOST_CELLS", 4_000)
    with pytest.raises(MapError, match="none works, so cut the map"):
        import_map(site(), radius=0.2)


def test_without_a_size_cells_suit_the_robot():
    for radius, cell in ((0.2, 0.5), (0.1, 0.25), (0.4, 1.0)):
        assert import_map(plan_of(rooms()), radius=radius).grid.resolution == cell


def test_starts_in_walls_and_no_places():
    done = import_map(plan_of(rooms()), cell=0.5, radius=0.2)
    with pytest.raises(MapError, match="start of robot_1 at 3,3"):
        scenario_of(done, [((3.0, 3.0), (5.0, 3.0))], {})
    *_, odd = scenario_of(done, [((1.0, 1.0), (3.0, 1.7))], {"horizon": "5"})
    assert (
        "the goal of robot_1 is in a doorway" in odd[0] and "the horizon of 5" in odd[1]
    )
    *_, odd = scenario_of(done, [((1.0, 1.0), (5.0, 3.0))] * 2, {})
    assert [line.partition(":")[0] for line in odd] == [
        "two robots start in the same cell",
        "two robots have the same goal",
    ]


@pytest.mark.parametrize(
    ("grey", "share", "cell", "said"),
    [
        (205, 0.25, 0.5, ["25 % of the free pixels have grey 205, which map_saver"]),
        (205, 0.196, 0.5, []),
        (206, 0.25, 0.5, []),
        (
            254,
            0.25,
            0.45,
            ["lanes touch walls: cells of 0.45 m leave 0.025 m on each side"],
        ),
    ],
)
def test_notes_of_pixels_and_sizes(tmp_path, grey, share, cell, said):
    pixels = np.full((100, 200), 254, dtype=np.uint8)
    pixels[:, :50] = grey
    Image.fromarray(pixels).save(tmp_path / "hall.pgm")
    header = {"image": "hall.pgm", "resolution": 0.05, "origin": [0, 0, 0]}
    (tmp_path / "hall.yaml").write_text(yaml.safe_dump(header | {"free_thresh": share}))
    done = import_map(read_floor_plan(tmp_path / "hall.yaml"), cell=cell, radius=0.2)
    odd = [note for note in done.notes if "no doorway" not in note]
    assert len(odd) == len(said)
    assert all(map(str.startswith, odd, said))
    assert (
        done.grid.radius
        == parse_map(done.grid.to_text(), name="a", where="a").radius
        == 0.2
    )


def test_robots_that_meet_at_no_doorway_have_nothing_to_coordinate():
    done = import_map(plan_of(rooms()), cell=0.5, radius=0.2)
    meet = [((1.0, 1.0), (5.0, 1.0)), ((5.0, 1.0), (1.0, 1.0))]
    apart = [meet[0], ((5.0, 3.0), (4.0, 3.0))]
    assert prospect_of(scenario_of(done, meet, {})[0]).note == ""
    scenario, _, odd = scenario_of(done, apart, {})
    assert odd == []
    assert prospect_of(scenario).note.startswith("nothing to coordinate")


def test_a_doorway_is_suggested_where_robots_meet():
    """Two robots come towards each other along the one row of a hall without doorways."""
    hall = parse_map("---\n.......\n.......\n.......\n", name="hall", where="hall")
    hall = dataclasses.replace(hall, resolution=0.5, origin=Pose(1.0, 2.0))

    def made(robots):
        data = {"map": {"name": "hall", "text": hall.to_text()}, "robots": robots}
        return scenario_from_dict(data, where="hall", name="hall")

    across = {"start": [1, 0], "goal": [1, 6]}, {"start": [1, 6], "goal": [1, 0]}
    apart = {"start": [0, 0], "goal": [0, 6]}, {"start": [2, 6], "goal": [2, 0]}
    for (first, second), expected in ((across, (2.75, 2.75)), (apart, None)):
        robots = {"a": first, "b": second}
        prospect = prospect_of(made(robots))
        assert prospect.doorway == expected
        assert prospect.note.startswith("nothing to coordinate")
        assert prospect.advice.kind == "will not pay"


@pytest.mark.parametrize(
    ("rows", "cells"),
    [
        ("..##\n..##\n....", 0),  # a dead end
        ("..#..\n..D..\n..#..", 0),  # a doorway of one cell
        ("..##..\n......\n..##..", 2),
        ("..###..\n.......\n..###..", 3),
        ("..####\n.....#\n..##.#\n####..\n####..", 4),  # around a corner
        ("..#..\n.....\n##.##\n#...#\n#...#", 2),  # a fork
        ("......\n......\n##..##\n......\n......", 0),  # two cells wide
        ("...\n.#.\n...", 8),  # all around
        ("......\n......\n......", 0),
    ],
)
def test_corridors_are_one_cell_wide_and_lead_through(rows, cells):
    free = np.array([[sign != "#" for sign in row] for row in rows.splitlines()])
    for turned in (free, free.T, free[::-1], free[:, ::-1]):
        assert (narrow_corridors(turned) > 0).sum() == cells


def test_a_narrow_building_suggests_interactions(imported):
    """Corridors become doorways where the user wants that, and only there."""
    _, plan, done = imported("office")
    assert done.corridors == () and done.narrow_cells == 0
    rows = "....###....", "....###....", "...........", "....###....", "....###...."
    free = np.array([[sign == "." for sign in row] for row in rows])
    free = np.pad(free, 1).repeat(10, axis=0).repeat(10, axis=1)
    drawing = FloorPlan(Path("drawn"), free, ~free, 0.05, Pose(-0.5, -0.5))
    done = import_map(drawing, cell=0.5, radius=0.2)
    assert done.corridors == ((2.75, 1.25),) and done.narrow_cells == 3
    assert done.grid.doorway_count == 0
    taken = import_map(drawing, cell=0.5, radius=0.2, corridors=True)
    assert len(taken.grid.doorways) == 3 and taken.grid.doorway_count == 1
    none = import_map(
        drawing, cell=0.5, radius=0.2, corridors=True, no_doorway=[(2.3, 1.3)]
    )
    assert none.grid.doorway_count == 0


def test_where_the_budget_is_too_small_for_the_ways_steps_are_larger(monkeypatch):
    done = import_map(plan_of(rooms()), cell=0.5, radius=0.2)
    pair = [((1.0, 1.0), (5.0, 1.0))]
    learning = {"prior": "none"}
    assert "step_size" not in scenario_of(done, pair, learning)[1]
    most = plans.SETTINGS["steps"].high
    for times, short in ((19, False), (21, True)):
        monkeypatch.setattr(
            plans, "steps_for", lambda way, p, times=times: times * most
        )
        _, suggested, odd = scenario_of(done, pair, learning)
        assert (suggested["steps"], suggested["step_size"]) == (most, plans.LONG_WAYS)
        assert any("is short for" in note for note in odd) == short
    chosen = {**learning, "step_size": "power:0.6"}
    assert "step_size" not in scenario_of(done, pair, chosen)[1]
    _, suggested, odd = scenario_of(done, pair, {})
    assert not {"step_size", "q_star_init", "q_coord_init"} & set(suggested)
    assert not any("is short for" in note for note in odd)


def test_suggestions_follow_the_distances(imported):
    _, _, done = imported("office")
    robots = [CORNERS, CORNERS[::-1]]
    scenario, suggested, _ = scenario_of(done, robots, {})
    assert suggested["discount"] == 0.986
    assert suggested["goal_value"] == pytest.approx(10 / 0.014, abs=1e-3)
    assert suggested["max_steps"] == 150
    assert (suggested["prior"], suggested["steps"]) == ("map", plans.STEPS)
    assert scenario.steps == suggested["steps"]
    assert "q_coord_init" not in suggested
    _, learning, _ = scenario_of(done, robots, {"prior": "none"})
    assert learning["q_coord_init"] == learning["goal_value"]
    assert learning["q_star_init"] < learning["goal_value"] / 5
    assert 2_000_000 < learning["steps"] < 5_000_000
    chosen, suggested, _ = scenario_of(
        done, robots, {"discount": "0.99", "steps": "1000"}
    )
    assert chosen.goal_value == pytest.approx(1000.0)
    assert chosen.steps == 1000
    assert "discount" not in suggested
    small = import_map(plan_of(rooms()), cell=0.5, radius=0.2)
    _, suggested, _ = scenario_of(small, [((1.0, 1.0), (5.0, 3.0))], {})
    assert set(suggested) == {"prior", "steps"}  # the defaults fit a small map


def test_a_map_lies_on_its_floor_plan_as_long_as_that_is_there(tmp_path):
    write("office", tmp_path)
    plan = read_floor_plan(tmp_path / "office.yaml")
    grid = parse_map(
        import_map(plan, cell=0.5, radius=0.2).grid.to_text(), name="o", where="o"
    )
    picture = under(grid)
    assert picture["href"].startswith("data:image/png;base64,")
    (high, wide) = plan.free.shape
    places = np.array(grid.cells) + 0.5
    rows = (places[:, 0] - picture["y"]) / picture["height"] * high
    columns = (places[:, 1] - picture["x"]) / picture["width"] * wide
    assert plan.free[rows.astype(int), columns.astype(int)].all()
    for damage in (lambda path: path.write_text("image: none"), Path.unlink):
        damage(tmp_path / "office.yaml")
        assert under(grid) is None
    assert under(load_scenario("env1").map) is None


def test_poses_lie_on_the_real_map(imported):
    """The frame of a run, its text and the map's text keep where the cells are."""
    _, _, done = imported("office")
    scenario, *_ = scenario_of(done, [CORNERS], {})
    run = run_from_yaml(make_run(scenario, {}).to_yaml(), where="text")
    assert run.resolution == 0.5
    frame = Messages(run)
    x, y = frame.centres[run.scenario.robots[0].start]
    assert math.dist((x, y), CORNERS[0]) <= math.hypot(0.25, 0.25)
    for cell, place in enumerate(frame.centres):
        assert (
            frame.cell(*place) == frame.cell(place[0] + 0.24, place[1] - 0.24) == cell
        )
    assert frame.cell(-100.0, 0.0) is None
    assert make_run(load_scenario("env1"), {}).resolution == 1.0


def test_specks():
    picture = np.zeros((9, 9), dtype=bool)
    picture[1, 1] = picture[1:3, 4:6] = picture[5:9, 5] = True
    assert [specks(picture, size).sum() for size in (0, 1, 2, 4)] == [0, 1, 5, 9]


@pytest.mark.parametrize("radius", [0.0, 0.9, 1.0, 2.5, 4.0, 30.0])
def test_growing_is_a_dilation_by_a_disc(radius):
    picture = np.random.default_rng(3).random((23, 17)) < 0.02
    rows, columns = np.indices(picture.shape)
    near = np.zeros_like(picture)
    for row, column in np.argwhere(picture):
        near |= (rows - row) ** 2 + (columns - column) ** 2 <= radius**2
    assert np.array_equal(grown(picture, radius), near)


def test_a_picture_of_the_floor():
    plan = plan_of(rooms())
    done = import_map(plan, cell=0.5, radius=0.2)
    scenario, *_ = scenario_of(done, [((1.0, 1.0), (5.0, 3.0))], {})
    figure = floor_figure(done.grid, scenario.robots, plan, cells=True)
    canvas = FigureCanvasAgg(figure)
    canvas.draw()
    picture = np.asarray(canvas.buffer_rgba())
    [start, goal] = figure.axes[0].patches

    def colour(x, y):
        """Return red, green and blue at a place in metres."""
        column, row = figure.axes[0].transData.transform((x, y))
        return picture[len(picture) - 1 - int(row), int(column), :3].tolist()

    assert (
        math.dist(start.center, (1.0, 1.0)) < 0.36
        and math.dist(goal.center, (5.0, 3.0)) < 0.36
    )
    assert colour(*start.center) == [0x00, 0x72, 0xB2]
    red, _, blue = colour(*goal.center)
    assert blue - red > 40  # a cell
    red, _, blue = colour(3.0, 1.7)
    assert red - blue > 100  # the doorway
    assert colour(3.0, 3.5) == [0, 0, 0]
