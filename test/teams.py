# Copyright 2026 The sparse_coord_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Scenarios on small maps that a test draws, teams that walk to their goals, a stranger."""

import sys
from contextlib import contextmanager

import numpy as np

from sparse_coord_ros.engine.batch import CompiledLearning, CompiledTeam
from sparse_coord_ros.game.perception import MODELS
from sparse_coord_ros.game.scenario import scenario_from_dict
from sparse_coord_ros.learners.tables import Tables
from sparse_coord_ros.engine.checkpoint import Checkpoint
from sparse_coord_ros.engine.checkpoint import load_checkpoint
from sparse_coord_ros.learners.registry import LEARNERS
from sparse_coord_ros.engine.run import Learning

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


def whole(scenario, learner, seed):
    """Return what agents learn without a break."""
    learning = Learning(scenario, learner, seed)
    learning.advance(scenario.steps)
    return learning


def in_parts(scenario, rule, seed, parts, folder):
    """Return what is learned up to each of these steps by the other engine, through files."""
    team = CompiledTeam(scenario, rule)
    learning = CompiledLearning(team, seed)
    for part, until in enumerate(parts):
        learning.advance(until)
        path = folder / f"{part}.npz"
        Checkpoint(learning.state(), (), 0, 0).save(path, scenario, rule, seed)
        state = load_checkpoint(path, scenario, rule, seed).state
        learning = (
            CompiledLearning(team, seed, state)
            if part % 2
            else Learning(scenario, rule, seed, state)
        )
    return learning


THEIRS = """
import pathlib
import numpy as np
import sparse_coord_ros as sc

pathlib.Path(__file__).with_name("imported").touch()

class Team(sc.Learner):
    pass

@sc.perception_model
def fog(grid, p):
    return np.full((len(grid.cells),) * 2, p)
"""
"""A module `theirs` that somebody sent; the file `imported` beside it tells of its import."""


@contextmanager
def forgotten():
    """Forget afterwards the module `theirs`, and what is registered in between."""
    known = [(registry, registry.registered) for registry in (LEARNERS, MODELS)]
    try:
        yield
    finally:
        for registry, registered in known:
            registry._known = dict(registered)
        sys.modules.pop("theirs", None)
