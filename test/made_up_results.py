# Copyright 2026 The sparse_coord_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Results of real conditions with numbers that are made up."""

import numpy as np

from sparse_coord_ros.experiments.conditions import make_condition
from sparse_coord_ros.experiments.store import SUMS, ConditionResult, Plan

PLAN = Plan(seed=5, runs=4, trials=50)

OPTIMA = {
    "env1": 121.89,
    "env2-2r": 111.02,
    "env2-4r": 111.32,
    "cit": 111.21,
    "cmu": 28.36,
    "isr": 143.56,
    "mit": 66.87,
    "pentagon": 161.31,
    "suny": 111.32,
}
"""Exact joint optima at penalty -20; for env2-4r an upper bound."""

REFERENCES = {
    "env1": (119.68, 10.0, 0.4115),
    "env2-2r": (107.51, 12.5, 0.2461),
    "env2-4r": (94.45, 12.5, 1.1006),
}
"""Exact reward, time to goal and miscoordinations of shortest-path policies."""


def made_up(condition, **changes):
    """Return a result of a condition with random numbers that depend on its id only."""
    draw = np.random.default_rng(list(condition.id.encode()))
    scenario = condition.scenario
    robots, cells = len(scenario.robots), len(scenario.map.cells)
    optimum = OPTIMA.get(scenario.name, 110.0)
    reference = REFERENCES.get(scenario.name, (optimum - 1, 12.5, 0.2))
    centre = {"reward": optimum - 2, "time_to_goal": 12, "asks": 0.5, "miscoordinations": 0.3}
    asked = np.zeros((robots, cells))
    asked[:, draw.integers(cells, size=4)] = 0.2
    values = {
        "trials": PLAN.trials,
        "optimum": optimum,
        "optimum_exact": robots == 2,
        "reference": dict(
            zip(("reward", "time_to_goal", "miscoordinations"), reference, strict=True)
        ),
        "means": {name: list(centre[name] + draw.normal(0, 0.1, PLAN.runs)) for name in SUMS},
        "variances": {name: [1.0] * PLAN.runs for name in SUMS},
        "robot_means": {"reward": [optimum - k for k in range(robots)], "asks": [0.25] * robots},
        "not_arrived": [0] * PLAN.runs,
        "visited": [100.0] * PLAN.runs,
        "asked": asked.tolist(),
        "stays": np.full((robots, cells), 0.5).tolist(),
    }
    return ConditionResult(condition, **(values | changes))


def result_of(name, learner="coop", settings=None, **changes):
    return made_up(make_condition(name, learner, settings or {"penalty": -20}), **changes)
