# Copyright 2026 The sparse_coord_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Maps of MovingAI are read as maps."""

import pytest

from sparse_coord_ros.base.errors import MapError
from sparse_coord_ros.core.game.grid import load_map, parse_map

ROOMS = (
    "type octile\nheight 5\nwidth 9\nmap\n"
    "@@@@@@@@@\n@...O...@\n@GSS.GG.@\n@..TWT..@\n@@@@@@@@@\n"
)


def test_symbols_and_sizes(tmp_path):
    (tmp_path / "rooms.map").write_text(ROOMS)
    grid = load_map(str(tmp_path / "rooms.map"))
    assert grid.rows == (
        "#########",
        "#...#...#",
        "#.......#",
        "#..###..#",
        "#########",
    )
    assert grid.name == "rooms"
    assert grid.resolution is None


@pytest.mark.parametrize(
    ("old", "new", "says"),
    [
        ("height 5", "height 6", "height is 6, but the grid's is 5"),
        ("width 9\n", "", "width is missing, but the grid's is 9"),
        ("@...O", "@..xO", "line 6: unknown symbol 'x'; allowed: . G S @ O T W"),
    ],
)
def test_a_broken_map_is_one_line(old, new, says):
    with pytest.raises(MapError) as refused:
        parse_map(ROOMS.replace(old, new), name="r", where="r.map")
    assert says in str(refused.value)
