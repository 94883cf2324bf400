# Copyright 2026 The sparse_coord_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Small scenarios made on the spot."""

import pytest

from sparse_coord_ros.game.scenario import scenario_from_dict

CORRIDOR = "1..D..2"


@pytest.fixture
def make():
    """Return a maker of scenarios from the rows of a map, robots as {name: (start, goal)}."""

    def maker(grid=CORRIDOR, robots=None, **settings):
        robots = robots or {"robot_1": (1, 2), "robot_2": (2, 1)}
        data = {
            "map": {"name": "drawn", "text": f"title: drawn\n---\n{grid}\n"},
            "robots": {name: {"start": s, "goal": g} for name, (s, g) in robots.items()},
            **settings,
        }
        return scenario_from_dict(data, where="drawn.yaml", name="drawn")

    return maker
