# Copyright 2026 The sparse_coord_ros authors
# SPDX-License-Identifier: Apache-2.0
"""`sparse_coord drive`."""

import json
import re

import pytest
from floor_plans import write_grid
from PIL import Image

from sparse_coord_ros.cli.main import main
from sparse_coord_ros.core.game.grid import load_map


@pytest.fixture(scope="module")
def run(tmp_path_factory):
    out = tmp_path_factory.mktemp("drive") / "run"
    assert (
        main(["train", "env1", "--steps", "3000", "--seed", "1", "--out", str(out)])
        == 0
    )
    return str(out)


def test_the_table_and_the_picture(run, tmp_path, capsys):
    picture = tmp_path / "paths.png"
    assert main(["drive", run, "--episodes", "5", "--out", str(picture)]) == 0
    said = capsys.readouterr().out
    assert "all arrived" in said and "bodies that touched in a doorway" in said
    with Image.open(picture) as image:
        assert min(image.size) > 600


def test_json_beside_the_grid_and_with_other_bodies(run, capsys):
    assert main(["drive", run, "--episodes", "4", "--json", "--seed", "3"]) == 0
    facts = json.loads(capsys.readouterr().out)
    for name in ("arrived", "time_to_goal", "asks", "miscoordinations"):
        assert facts[name] == facts[f"{name}_in_grid"]
    assert (
        facts["seconds"] > facts["seconds_in_grid"] and facts["seconds_a_cell"] == 2.0
    )
    quick = ["--set", "speed=2", "--set", "turn=6"]
    assert main(["drive", run, "--episodes", "4", "--json", "--seed", "3", *quick]) == 0
    assert json.loads(capsys.readouterr().out)["seconds"] < facts["seconds"]


def test_on_the_building_s_own_map(tmp_path, capsys):
    plan = write_grid(load_map("env1"), tmp_path / "door")
    places = ["--start", "0.5,4.5", "4.5,4.5", "--goal", "4.5,0.5", "0.5,0.5"]
    more = [
        "--cell",
        "1",
        "--radius",
        "0.1",
        "--set",
        "steps=2000",
        "--out",
        str(tmp_path / "m"),
    ]
    assert main(["import-map", str(plan), *places, *more]) == 0
    out = str(tmp_path / "run")
    assert main(["train", str(tmp_path / "m" / "env1.yaml"), "--out", out]) == 0
    picture = tmp_path / "paths.svg"
    drawn = []
    for there in (True, False):
        if not there:
            plan.unlink()
        assert main(["drive", out, "--episodes", "2", "--out", str(picture)]) == 0
        drawn.append(re.search(r"<image[^>]*", picture.read_text())[0])
    assert drawn[0] != drawn[1]  # the building's map, and the cells' walls
