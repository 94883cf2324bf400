# Copyright 2026 The sparse_coord_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Results of real conditions with numbers that are made up."""

import numpy as np

from sparse_coord_ros.core.solve.reference import shortest_path_reference
from sparse_coord_ros.core.solve.shipped import known_optimum
from sparse_coord_ros.studies.condition_result import SUMS, ConditionResult
from sparse_coord_ros.studies.conditions import make_condition
from sparse_coord_ros.studies.store import Plan

PLAN = Plan(seed=5, runs=4, trials=50)


def made_up(condition, **changes):
    """Return a result of a condition with random numbers that depend on its id only.

    Its optimum and its shortest paths are those of the scenario, as a file's are.
    """
    draw = np.random.default_rng(list(condition.id.encode()))
    scenario = condition.scenario
    robots = len(scenario.robots)
    cells = len(scenario.map.cells)
    optimum = known_optimum(scenario)
    centre = {
        "returns": optimum.value - 2,
        "time_to_goal": 12,
        "asks": 0.5,
        "miscoordinations": 0.3,
    }
    asked = np.zeros((robots, cells))
    asked[:, draw.integers(cells, size=4)] = 0.2
    values = {
        "trials": PLAN.trials,
        "optimum": optimum.value,
        "optimum_exact": optimum.exact,
        "reference": {
            name: getattr(shortest_path_reference(scenario), name)
            for name in ("returns", "time_to_goal", "miscoordinations")
        },
        "means": {
            name: list(centre[name] + draw.normal(0, 0.1, PLAN.runs)) for name in SUMS
        },
        "variances": {name: [1.0] * PLAN.runs for name in SUMS},
        "robot_means": {
            "returns": [optimum.value - k for k in range(robots)],
            "asks": [0.25] * robots,
        },
        "not_arrived": [0] * PLAN.runs,
        "visited": [100.0] * PLAN.runs,
        "asked": asked.tolist(),
        "stays": np.full((robots, cells), 0.5).tolist(),
    }
    return ConditionResult(condition, **(values | changes))


def result_of(name, learner="coop", settings=None, **changes):
    return made_up(
        make_condition(name, learner, settings or {"penalty": -20}), **changes
    )
