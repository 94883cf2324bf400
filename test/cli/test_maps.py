# Copyright 2026 The sparse_coord_ros authors
# SPDX-License-Identifier: Apache-2.0
"""`sparse_coord maps`: the list, one map, JSON, and bad input."""

import json

from sparse_coord_ros.core.game.grid import load_map, map_names
from sparse_coord_ros.core.game.scenario import load_scenario


def test_list(sparse_coord):
    code, out, err = sparse_coord("maps")
    assert (code, err) == (0, "")
    table = out.partition("\n\n")[0].splitlines()[2:]
    rows = {line.split()[0]: line.split()[1:4] for line in table}
    assert list(rows) == map_names()
    assert rows["env1"] == ["21", "1", "2"]
    assert rows["cmu"] == ["133", "1", "2"]


def test_one_map(sparse_coord):
    code, out, err = sparse_coord("maps", "env1")
    assert (code, err) == (0, "")
    assert "\n".join(load_map("env1").rows) in out
    words = (
        "env1: Two rooms",
        "source: Melo",
        "provenance: ",
        "5 x 5, 21 cells, 1 doorway",
    )
    assert [one for one in words if one not in out] == []


def test_the_map_of_a_scenario_file(sparse_coord, folder):
    (folder / "mine.yaml").write_text("map: env1\nrobots: {x: {start: 1, goal: 2}}\n")
    out = sparse_coord("maps", "mine.yaml")[1]
    assert "\n".join(load_map("env1").rows) in out
    assert out.endswith("\nx: from [0, 0] to [0, 4]\n")


def test_the_scenarios_stand_beside_their_maps(sparse_coord):
    out = sparse_coord("maps")[1]
    (env2,) = (line for line in out.splitlines() if line.startswith("env2 "))
    assert "  env2-2r, env2-4r  " in env2


def test_a_scenario_s_name_shows_its_map_and_its_robots(sparse_coord):
    code, out, err = sparse_coord("maps", "env2-2r")
    assert (code, err) == (0, "")
    assert "\n".join(load_map("env2").rows) in out
    assert out.endswith(
        "\nrobot_1: from [0, 1] to [6, 5]\nrobot_2: from [0, 5] to [6, 1]\n"
    )


def test_json(sparse_coord):
    (env1,) = json.loads(sparse_coord("maps", "env1", "--json")[1])
    assert (env1["cells"], env1["doorways"], env1["doorway_cells"]) == (21, 1, [[2, 2]])
    assert env1["starts"] == {"1": [0, 0], "2": [0, 4]}
    assert tuple(env1["rows"]) == load_map("env1").rows
    assert [
        m["name"] for m in json.loads(sparse_coord("maps", "--json")[1])
    ] == map_names()


def test_a_generated_building(sparse_coord):
    for name in ("building-2x2x3-5r-4", "unseen1-rooms-4r-3"):
        code, out, err = sparse_coord("maps", name)
        assert (code, err) == (0, "")
        assert "\n".join(load_scenario(name).map.rows) in out
