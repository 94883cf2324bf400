# Copyright 2026 The sparse_coord_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Perception models: constants, range, and line of sight against an independent definition."""

from collections import Counter

import numpy as np
import pytest

from sparse_coord_ros.base.errors import SettingError
from sparse_coord_ros.core.game.grid import load_map, map_names, parse_map
from sparse_coord_ros.core.game.perception import (
    PERCEPTION,
    asked_peers,
    register_perception,
    sight_of,
)
from sparse_coord_ros.core.game.scenario import scenario_from_dict
from sparse_coord_ros.core.game.sight import (
    probabilities_between,
    probability,
)
from sparse_coord_ros.core.runs.run_config import make_run
from sparse_coord_ros.core.solve.asking_search import find_asking_team


def matrix(spec, grid):
    sight = sight_of(PERCEPTION.parse(spec), grid)
    return probabilities_between(sight, np.arange(len(grid.cells)))


@pytest.mark.parametrize(
    ("spec", "value"), [("always", 1.0), ("never", 0.0), ("probability:0.7", 0.7)]
)
def test_constants(spec, value):
    probabilities = matrix(spec, load_map("env1"))
    assert probabilities.shape == (21, 21)
    assert probabilities.dtype == np.float64
    assert (probabilities == value).all()


def test_range_is_straight_through_walls_and_includes_its_limit():
    grid = parse_map("---\n.#.\n###\n..#\n", name="m", where="m.txt")
    # Cells: 0 (0,0), 1 (0,2), 2 (2,0), 3 (2,1).
    assert matrix("range:2", grid).tolist() == [
        [1, 1, 1, 0],
        [1, 1, 0, 0],
        [1, 0, 1, 1],
        [0, 0, 1, 1],
    ]


def test_line_of_sight_does_not_pass_between_two_walls_that_touch():
    grid = parse_map("---\n.#\n#.\n", name="m", where="m.txt")
    assert matrix("line_of_sight", grid).tolist() == [[1, 0], [0, 1]]


def crosses_a_wall(grid, one, other):
    """Whether a wall cell's inside is cut by the line, or two walls touch where it passes.

    By the signs of the cross products of a cell's corners, in exact integers (twice the scale).
    """
    (r0, c0) = one
    (r1, c1) = other
    free = grid.number
    for r in range(min(r0, r1), max(r0, r1) + 1):
        for c in range(min(c0, c1), max(c0, c1) + 1):
            sides = [
                (r1 - r0) * (2 * (c - c0) + dc) - (c1 - c0) * (2 * (r - r0) + dr)
                for dr in (-1, 1)
                for dc in (-1, 1)
            ]
            if min(sides) < 0 < max(sides) and (r, c) not in free:
                return True
            # The line passes the corner between this cell and the one right below or above it.
            for dr in (-1, 1):
                at_corner = (r1 - r0) * (2 * (c - c0) + 1) == (c1 - c0) * (
                    2 * (r - r0) + dr
                )
                inside = c + 1 <= max(c0, c1) and min(r0, r1) <= r + dr <= max(r0, r1)
                through = (r1 - r0) * dr * (
                    c1 - c0
                ) > 0  # leads from this cell to the diagonal
                beside = ((r + dr, c), (r, c + 1))
                if (
                    at_corner
                    and inside
                    and through
                    and not any(p in free for p in beside)
                ):
                    return True
    return False


@pytest.mark.parametrize("name", ["env1", "env2", "isr", "pentagon"])
def test_line_of_sight_for_all_pairs(name):
    grid = load_map(name)
    seen = matrix("line_of_sight", grid)
    expected = [
        [not crosses_a_wall(grid, one, other) for other in grid.cells]
        for one in grid.cells
    ]
    assert seen.astype(bool).tolist() == expected
    assert 0 < seen.mean() < 1


def apart(grid):
    """The distance of each pair of cells, as NumPy computes it."""
    centres = np.array(grid.cells, dtype=float)
    return np.hypot(*np.moveaxis(centres[:, None] - centres, -1, 0))


SPECS = (
    "always",
    "never",
    "probability:0.4",
    "range:0",
    "range:0.5",
    "range:1.4142135623730951",
    "range:1.7320508075688772",
    "range:2",
    "range:3.7",
    "range:1e9",
    "line_of_sight",
)


@pytest.mark.parametrize("spec", SPECS)
def test_each_pair_of_each_shipped_map(spec):
    """A pair's probability is the matrix's, in both orders."""
    for name in map_names():
        grid = load_map(name)
        if spec.startswith("range"):
            expected = (apart(grid) <= float(spec[6:])).astype(float)
        elif spec == "line_of_sight":
            expected = matrix(spec, grid)
        else:
            expected = np.full((len(grid.cells),) * 2, matrix(spec, grid)[0, 0])
        sight = sight_of(PERCEPTION.parse(spec), grid)
        own = range(len(grid.cells))
        found = [[probability(sight, x, z) for z in own] for x in own]
        assert found == expected.tolist() == matrix(spec, grid).tolist()


def test_each_pair_of_a_model_of_ones_own():
    grid = load_map("env1")
    table = np.linspace(0.0, 1.0, len(grid.cells) ** 2).reshape(len(grid.cells), -1)
    found = register_perception("slope_of_tests", lambda grid: table)
    assert found(grid) is table
    sight = sight_of(PERCEPTION.parse("slope_of_tests"), grid)
    assert probability(sight, 3, 5) == table[3, 5]
    assert (matrix("slope_of_tests", grid) == table).all()


def hall(rows, columns):
    """A scenario of two robots in a hall without walls."""
    text = "title: hall\n---\n" + "\n".join(
        ["1" + "." * (columns - 2) + "2", *["." * columns] * (rows - 1)]
    )
    data = {
        "map": {"name": "hall", "text": text},
        "robots": {"x": {"start": 1, "goal": 2}, "y": {"start": 2, "goal": 1}},
    }
    return scenario_from_dict(data, where="hall.yaml", name="hall")


def test_a_map_too_large_to_learn_is_refused_before_a_run():
    with pytest.raises(
        SettingError, match="map hall has 250,500 cells, allowed .* at most 250,000"
    ):
        make_run(hall(501, 500), {})


def test_a_table_of_all_pairs_is_refused_on_a_large_map():
    register_perception("table_of_tests", lambda grid: np.ones((1, 1)))
    scenario = hall(160, 160)
    with pytest.raises(SettingError, match="has 25600 cells, .* at most 23170"):
        sight_of(PERCEPTION.parse("table_of_tests"), scenario.map)
    with pytest.raises(SettingError, match="has 25600 cells, .* at most 2048"):
        find_asking_team(scenario)


def test_who_is_asked():
    """The draw picks one peer, each as often; or everybody is asked, or there is nobody."""
    draws = np.linspace(0, 1, 300, endpoint=False).tolist()
    for number in range(4):
        asked = Counter(asked_peers("one", number, 4, draw) for draw in draws)
        assert asked == {(peer,): 100 for peer in range(4) if peer != number}
    assert asked_peers("all", 2, 4, 0.9) == (0, 1, 3)
    assert asked_peers("one", 0, 1, 0.9) == asked_peers("all", 0, 1, 0.9) == ()
