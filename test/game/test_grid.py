# Copyright 2026 The sparse_coord_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Maps: the shipped ones are those of the study; cells, moves, distances, regions."""

import hashlib
import time

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from sparse_coord_ros.base.errors import MapError
from sparse_coord_ros.core.game.actions import EAST, NORTH, SOUTH, WEST
from sparse_coord_ros.core.game.grid import (
    UNREACHABLE,
    GridMap,
    load_map,
    map_names,
    parse_map,
)

# name: cells, doorways, starts, digest of the rows (a difference means that the map changed).
MAPS = {
    "env1": "23b4a2f6aa5db123",
    "env2": "3f61e7619d8b4260",
    "isr": "76786d4d40601941",
    "pentagon": "6d241537b19fc0d6",
    "mit": "7811241549ff7efd",
    "cit": "775cb92ecbf4ffcd",
    "suny": "3d84912815ab0999",
    "cmu": "ea76c91e89e5dbee",
    "crowd": "4df2d3c171bae37a",
    "aisle": "e749f90ad712d9d9",
    "floor": "1dff405d66492c21",
    "lane": "a7982b106951ac4b",
}
"""The shipped maps, with the digest of their rows."""


def test_every_shipped_map_is_in_the_list():
    assert map_names() == sorted(MAPS)


@pytest.mark.parametrize("name", MAPS)
def test_shipped_map(name):
    grid = load_map(name)
    assert grid.name == name
    assert hashlib.sha256("\n".join(grid.rows).encode()).hexdigest()[:16] == MAPS[name]
    assert grid.title
    assert grid.source
    assert "[source]" in grid.provenance or "[chosen]" in grid.provenance


@pytest.mark.parametrize("name", MAPS)
def test_map_round_trip(name):
    grid = load_map(name)
    assert parse_map(grid.to_text(), name=name, where="text") == grid


def test_cells_are_numbered_row_by_row():
    grid = parse_map("---\n#1.\nD#.\n", name="m", where="m.txt")
    assert grid.shape == (2, 3)
    assert grid.cells == ((0, 1), (0, 2), (1, 0), (1, 2))
    assert [grid.number[position] for position in grid.cells] == [0, 1, 2, 3]
    assert grid.doorways == {2}
    assert grid.starts == {1: 0}


@pytest.mark.parametrize(
    ("text", "count", "words"),
    [
        ("1.#.2\n..#..\n", 0, "0 doorways"),
        ("1.#.2\n..D..\n", 1, "1 doorway"),
        ("1.##.2\n..DD..\n..##..\n", 1, "1 doorway (2 cells)"),  # through a thick wall
        ("1.#.2\n..D..\n..D..\n", 1, "1 doorway (2 cells)"),  # two cells wide
        ("1D#.2\n.#D..\n..#..\n", 2, "2 doorways"),  # at a corner nobody passes
        ("1.#.2\n..DD.\n#D###\n", 2, "2 doorways (3 cells)"),
    ],
)
def test_doorway_cells_beside_each_other_are_one_doorway(text, count, words):
    grid = parse_map(f"---\n{text}", name="m", where="m.txt")
    assert (grid.doorway_count, grid.doorways_in_words) == (count, words)
    assert len(grid.doorways) == text.count("D")


def test_moves_are_north_south_east_west_and_walls_and_borders_stop_them():
    grid = parse_map("---\n..#\n...\n", name="m", where="m.txt")
    # Cells: 0 (0,0), 1 (0,1), 2 (1,0), 3 (1,1), 4 (1,2).
    expected = [[0, 2, 1, 0], [1, 3, 1, 0], [0, 2, 3, 2], [1, 3, 4, 2], [4, 4, 4, 3]]
    assert grid.next_cell.tolist() == expected


def test_distances():
    grid = parse_map("---\n...#.\n.#.#.\n", name="m", where="m.txt")
    # Cells: 0 1 2 . 3 / 4 . 5 . 6; the right column is cut off.
    assert grid.distances_to(5).tolist() == [3, 2, 1, UNREACHABLE, 4, 0, UNREACHABLE]
    assert grid.distances_to(5).dtype == np.int64


def test_header_is_optional_and_line_ends_do_not_matter():
    assert parse_map("---\r\n1.\r\n..\r\n\r\n", name="m", where="m.txt").rows == (
        "1.",
        "..",
    )


def test_unknown_map_names_the_nearest():
    with pytest.raises(MapError, match="'pentagone'.*'pentagon'"):
        load_map("pentagone")


def test_map_beside_the_scenario_comes_first(tmp_path, monkeypatch):
    (tmp_path / "here").mkdir()
    (tmp_path / "beside").mkdir()
    (tmp_path / "here" / "m.txt").write_text("---\n.\n")
    (tmp_path / "beside" / "m.txt").write_text("---\n..\n")
    monkeypatch.chdir(tmp_path / "here")
    assert load_map("m.txt").rows == (".",)
    assert load_map("m.txt", beside=tmp_path / "beside").rows == ("..",)


def test_map_that_is_not_text(tmp_path):
    path = tmp_path / "m.txt"
    path.write_bytes(b"title: \xe9\n---\n..\n")
    with pytest.raises(MapError, match="m.txt"):
        load_map(str(path))


ROWS = (
    st.integers(1, 9)
    .flatmap(
        lambda width: st.lists(
            st.text("..#D", min_size=width, max_size=width), min_size=1, max_size=9
        )
    )
    .filter(lambda rows: "." in "".join(rows))
)


@given(ROWS)
def test_any_map(rows):
    """It is written and read; moves are reversible; regions are what has a way between."""
    grid = GridMap("drawn", tuple(rows))
    assert parse_map(grid.to_text(), name="drawn", where="text").rows == grid.rows
    back = [SOUTH, NORTH, WEST, EAST]
    for x in range(len(grid.cells)):
        for move, y in enumerate(grid.next_cell[x]):
            assert y == x or grid.next_cell[y, back[move]] == x
        reached = grid.distances_to(x) != UNREACHABLE
        assert (reached == (grid.region == grid.region[x])).all()


def test_regions_of_a_long_way_are_found_soon():
    rows = tuple(
        "." * 500 if r % 2 == 0 else ("#" * 499 + ".")[:: 2 - r % 4] for r in range(500)
    )
    before = time.process_time()
    assert set(GridMap("winding", rows).region.tolist()) == {0}
    assert time.process_time() - before < 2.0
