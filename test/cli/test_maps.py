# Copyright 2026 The sparse_coord_ros authors
# SPDX-License-Identifier: Apache-2.0
"""`sparse_coord maps`: the list, one map, JSON, and bad input."""

import json
import re

import pytest

from sparse_coord_ros.game.buildings import generated_building
from sparse_coord_ros.game.grid import load_map, map_names
from sparse_coord_ros.game.scenario import load_scenario


def test_list(sparse_coord):
    code, out, err = sparse_coord("maps")
    assert (code, err) == (0, "")
    rows = {line.split()[0]: line.split()[1:4] for line in out.splitlines()[2:]}
    assert list(rows) == map_names()
    assert rows["env1"] == ["21", "1", "2"]
    assert rows["cmu"] == ["133", "2", "2"]


def test_one_map(sparse_coord):
    code, out, err = sparse_coord("maps", "env1")
    assert (code, err) == (0, "")
    assert "\n".join(load_map("env1").rows) in out
    words = ("env1: Two rooms", "source: Melo", "provenance: ", "5 x 5, 21 cells, 1 doorways")
    assert [one for one in words if one not in out] == []


def test_the_map_of_a_scenario_file(sparse_coord, folder):
    (folder / "mine.yaml").write_text("map: env1\nrobots: {x: {start: 1, goal: 2}}\n")
    assert sparse_coord("maps", "mine.yaml") == sparse_coord("maps", "env1")


def test_json(sparse_coord):
    (env1,) = json.loads(sparse_coord("maps", "env1", "--json")[1])
    assert (env1["cells"], env1["doorways"]) == (21, [[2, 2]])
    assert env1["starts"] == {"1": [0, 0], "2": [0, 4]}
    assert tuple(env1["rows"]) == load_map("env1").rows
    assert [m["name"] for m in json.loads(sparse_coord("maps", "--json")[1])] == map_names()


def test_a_generated_building(sparse_coord, folder):
    numbers = ("--rooms", "2", "--size", "3", "--robots", "5", "--seed", "4")
    code, out, err = sparse_coord("maps", "--generate", "b.yaml", *numbers)
    assert (code, err) == (0, "")
    made = generated_building(rooms=2, size=3, robots=5, seed=4)
    assert out.splitlines()[2:] == list(made.map.rows)
    assert load_scenario("b.yaml").computation() == made.computation()
    before = (folder / "b.yaml").read_text()
    code, out, err = sparse_coord("maps", "--generate", "b.yaml")
    assert (code, out) == (2, "") and "b.yaml: exists already" in err
    assert (folder / "b.yaml").read_text() == before
    code, out, _ = sparse_coord("maps", "--generate", "c.yaml", *numbers, "--json")
    assert code == 0 and json.loads(out)["rows"] == list(made.map.rows)


@pytest.mark.parametrize(
    ("options", "words"),
    [
        (("--rooms", "2"), "option --rooms: only with --generate FILE"),
        (("env1", "--generate", "x.yaml"), "map 'env1': is not needed with --generate"),
        (("--generate", "no/x.yaml"), "no/x.yaml: No such file or directory; give another path"),
        (("--generate", "x.yaml", "--rooms", "21"), "rooms: value is '21', allowed: .* 1 to 20"),
        (("--generate", "x.yaml", "--rooms", "1", "--rows", "1"), "building: has 1 room"),
        (("--generate", "x.yaml", "--robots", "49"), "49 robots need as many starts"),
    ],
)
def test_bad_numbers_of_a_building(sparse_coord, folder, options, words):
    code, out, err = sparse_coord("maps", *options)
    assert (code, out) == (2, "")
    assert re.search(words, err) and err.count("\n") == 1
    assert not list(folder.glob("*.yaml"))
