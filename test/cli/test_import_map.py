# Copyright 2026 The sparse_coord_ros authors
# SPDX-License-Identifier: Apache-2.0
"""`sparse_coord import-map`: files, notes, and bad input."""

import json

import numpy as np
import pytest
from floor_plans import write_grid
from PIL import Image

from sparse_coord_ros.base.share import share_file
from sparse_coord_ros.core.game.grid import load_map, parse_map
from sparse_coord_ros.core.game.scenario import load_scenario
from sparse_coord_ros.studies.benchmark import benchmark

ENV1 = ("--cell", "1", "--radius", "0.1", "--start", "0.5,4.5", "4.5,4.5")
GOALS = ("--goal", "4.5,0.5", "0.5,0.5")


@pytest.fixture
def plan(folder):
    """Write env1 as a map of map_server."""
    return write_grid(load_map("env1"), folder / "e")


@pytest.mark.parametrize("name", ["env1", "suny"])
def test_walls_stay_walls(sparse_coord, folder, name):
    write_grid(load_map(name), folder)
    size = ("--cell", "1", "--radius", "0.05")
    code, out, err = sparse_coord("import-map", f"{name}.yaml", *size, "--out", "i")
    assert (code, err) == (0, "")
    back = load_map(str(folder / "i" / f"{name}.txt"))
    walls = [["#" == sign for sign in row] for row in load_map(name).rows]
    rows = np.array([["#" == sign for sign in row] for row in back.rows])
    assert rows.tolist() == [row[: rows.shape[1]] for row in walls[: rows.shape[0]]]
    assert back.resolution == 1.0


def test_a_scenario_that_learns_as_the_original(sparse_coord, folder, plan):
    code, out, _ = sparse_coord("import-map", plan, *ENV1, *GOALS, "--out", "i")
    assert code == 0
    assert "1 doorway; lower left corner at 0,0" in out
    assert "\nCoordination will pay: a robot alone in the world earns 126.45; " in out
    made = load_scenario(folder / "i" / "env1.yaml")
    original = load_scenario("env1")
    assert made.map.doorways == original.map.doorways
    assert [(r.start, r.goal) for r in made.robots] == [
        (r.start, r.goal) for r in original.robots
    ]
    assert min(Image.open(folder / "i" / "env1.png").size) > 600
    assert sparse_coord("maps", "i/env1.yaml")[1].splitlines()[4:6] == [
        "1 m a cell, lower left corner at 0,0 m",
        "",
    ]


def test_it_counts_the_doorways_that_maps_counts(sparse_coord, folder):
    """A doorway through a thick wall has several cells."""
    text = "---\n1.##.2\n..DD..\n..##..\n..##..\n..##..\n"
    write_grid(parse_map(text, name="thick", where="thick.txt"), folder)
    thick = ("thick.yaml", "--cell", "1", "--radius", "0.4")
    code, out, _ = sparse_coord("import-map", *thick, "--out", "i")
    assert code == 0 and " cells of 1 m, 1 doorway (2 cells); " in out
    assert " cells, 1 doorway (2 cells)\n" in sparse_coord("maps", "i/thick.txt")[1]
    told = [
        json.loads(sparse_coord(*words, "--json")[1])
        for words in (("import-map", *thick, "--out", "j"), ("maps", "j/thick.txt"))
    ]
    assert told[0]["doorways"] == told[1][0]["doorways"] == 1


def test_places_west_and_south_of_the_origin(sparse_coord, folder, plan):
    text = plan.read_text().replace("- 0.0\n- 0.0\n- 0.0", "- -10.0\n- -20.0\n- 0.0")
    plan.write_text(text)
    robots = ("--start", "-9.5,-15.5", "--goal", "-5.5,-19.5")
    code, out, err = sparse_coord("import-map", plan, *ENV1[:4], *robots, "--out", "i")
    assert (code, err) == (0, "")
    assert "lower left corner at -10,-20" in out
    assert load_map(str(folder / "i" / "env1.txt")).origin == (-10.0, -20.0, 0.0)


def test_nothing_is_overwritten_unasked(sparse_coord, folder, plan, refused):
    assert sparse_coord("import-map", plan, *ENV1, *GOALS, "--out", "i")[0] == 0
    assert "i/env1.txt" in refused("import-map", plan, *ENV1, *GOALS, "--out", "i")
    here = refused("import-map", plan, *ENV1, *GOALS, "--out", "e", "--replace")
    assert "e/env1" in here
    again = (*ENV1, *GOALS, "--no-doorway", "2.5,2.5", "--out", "i", "--replace")
    code, out, _ = sparse_coord("import-map", plan, *again)
    assert code == 0
    assert "note: no doorway found" in out


def test_a_map_is_called_as_its_file(plan, refused):
    other = plan.rename(plan.with_name("an office.yaml"))
    assert "'an office'" in refused("import-map", other, *ENV1, *GOALS)


def test_maps_of_map_server_point_to_import_map(plan, refused, folder):
    (folder / "mine.yaml").write_text(
        "map: e/env1.pgm\nrobots: {a: {start: 1, goal: 2}}\n"
    )
    assert "sparse_coord import-map" in refused("train", "mine.yaml")


@pytest.mark.parametrize(
    "options", [(), ("--cell", "1", "--radius", "0.1"), ("--page",)]
)
def test_a_scenario_is_recognised(sparse_coord, folder, options):
    file = share_file("config", "env1.yaml")
    code, _, err = sparse_coord("import-map", file, *options)
    assert code == 2
    assert (
        f"{file}: is a scenario already, not the map of a building; let a team learn"
        in err
    )
    assert list(folder.iterdir()) == []


def test_a_map_of_this_package_is_recognised(refused):
    file = share_file("maps", "env1.txt")
    said = refused("import-map", file, "--radius", "0.1")
    assert "is a map of this package already; write a scenario file with 'map: " in said


def test_a_bad_setting_is_refused_before_the_page_is_served(sparse_coord, plan):
    command = ("import-map", plan, "--page", "--set", "interactions=foo")
    code, out, err = sparse_coord(*command)
    assert (code, out) == (2, "")
    assert "unknown value 'foo'" in err and err.count("\n") == 1


ROOMS = (
    "type octile\nheight 5\nwidth 9\nmap\n"
    "@@@@@@@@@\n@...O...@\n@.......@\n@...@...@\n@@@@@@@@@\n"
)


def test_a_map_of_movingai_is_imported_and_judged(sparse_coord, folder):
    (folder / "rooms.map").write_text(ROOMS)
    robots = ("--start", "1.5,2.5", "7.5,2.5", "--goal", "7.5,2.5", "1.5,2.5")
    code, out, _ = sparse_coord(
        "import-map", "rooms.map", "--radius", "0.3", *robots, "--out", "r"
    )
    assert code == 0
    assert "cells of 1 m, 1 doorway; lower left corner at 0,0 m" in out
    (row,) = benchmark("voi", lists=["r/rooms.yaml"], runs=2, steps=2000)
    assert (row["list"], row["teams"]) == ("r/rooms.yaml", 2)
    assert row["share"] < 1.0


def test_a_turned_building(sparse_coord, folder):
    """The grid lies along the walls, and places stay those of the robots' map."""
    from scipy import ndimage

    pixels = np.full((120, 200), 254, np.uint8)
    pixels[[0, 1, 118, 119]] = pixels[:, [0, 1, 198, 199]] = 0
    pixels[:, 99:102] = 0
    pixels[50:68, 99:102] = 254
    pixels = ndimage.rotate(pixels, 20, order=0, cval=205)
    Image.fromarray(pixels).save(folder / "askew.png")
    (folder / "askew.yaml").write_text(
        "image: askew.png\nresolution: 0.05\norigin: [500123.25, 10, 0]\n"
        "free_thresh: 0.196\noccupied_thresh: 0.65\n"
    )
    command = ("import-map", "askew.yaml", "--radius", "0.2", "--json")
    said = json.loads(sparse_coord(*command, "--out", "a")[1])
    assert any("the walls lie at" in note for note in said["notes"])
    code, out, _ = sparse_coord(*command, "--turn", "auto", "--out", "b")
    assert code == 0
    said = json.loads(out)
    assert said["doorways"] == 1
    assert said["resolution"] == 0.5
    assert said["origin"][2] == pytest.approx(np.radians(20), abs=0.01)
    grid = load_map(str(folder / "b" / "askew.txt"))
    x, y = grid.squares.centre(*said["doorway_cells"][0])
    high, wide = pixels.shape
    assert x == pytest.approx(500123.25 + wide * 0.025, abs=0.5)
    assert y == pytest.approx(10 + high * 0.025, abs=0.5)
    code, out, _ = sparse_coord("maps", "b/askew.txt")
    assert "turned by " in out and "lower left corner at 500" in out
    _, _, err = sparse_coord(*command, "--turn", "left", "--out", "c")
    assert "'left' is no angle, allowed: auto, or degrees counterclockwise" in err
