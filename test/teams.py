# Copyright 2026 The sparse_coord_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Scenarios on small maps that a test draws, and teams that walk straight to their goals."""

import numpy as np

from sparse_coord_ros.game.scenario import scenario_from_dict
from sparse_coord_ros.learn.agent import Tables

PROTOCOL = {
    "starts": "random",
    "step_size": "power:0.6",
    "epsilon": "linear:1:0.05:0.8",
    "q_star_init": 30,
    "q_coord_init": 200,
    "goal_value": 200,
    "max_steps": 1000,
}
"""All that the learning protocol leaves open, so that new defaults change no expectation."""


def drawn(grid="1..D..2", robots=None, **settings):
    """Return a scenario from the rows of a map, robots as {name: (start, goal)}."""
    robots = robots or {"robot_1": (1, 2), "robot_2": (2, 1)}
    data = {
        "map": {"name": "drawn", "text": f"title: drawn\n---\n{grid}\n"},
        "robots": {name: {"start": s, "goal": g} for name, (s, g) in robots.items()},
        **settings,
    }
    return scenario_from_dict(data, where="drawn.yaml", name="drawn")


def walking(scenario, coordinate=np.nan):
    """Return tables of robots on shortest paths; `coordinate` is the value of asking.

    Q^C leads along shortest paths too.
    """
    tables = []
    for robot in scenario.robots:
        value = -scenario.map.distances_to(robot.goal)[scenario.map.next_cell].astype(float)
        q_star = np.column_stack([value, np.full(len(value), coordinate)])
        tables.append(Tables(q_star, np.repeat(value[:, None, :], len(value), axis=1)))
    return tables
