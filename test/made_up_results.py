# Copyright 2026 The sparse_coord_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Results of real conditions with numbers that are made up."""

from dataclasses import replace

import numpy as np

from sparse_coord_ros.core.runs.measures import MEASURES, RUN, TRIALS, Measures
from sparse_coord_ros.core.solve.shipped import known_optimum
from sparse_coord_ros.studies.condition_result import ConditionResult
from sparse_coord_ros.studies.conditions import make_condition
from sparse_coord_ros.studies.store import Plan

PLAN = Plan(seed=5, runs=4, trials=50)


def measures_of(scenario, values, draw):
    """Return measures by run, in trials.

    Args:
        scenario: the problem.
        values: the mean of each measure in each run. Of the returns robot k gets k less than robot
            0, else all robots have the same.
        draw: random numbers, for the cells where robots ask.
    """
    robots = len(scenario.robots)
    shape = (robots, len(scenario.map.cells))
    arrays = {name: np.array(own, dtype=float) for name, own in values.items()}
    runs = len(arrays["returns"])
    for name in ("returns", "time_to_goal", "asks"):
        arrays[name] = np.repeat(arrays[name][:, None], robots, axis=1)
    arrays["returns"] += (robots - 1) / 2 - np.arange(robots)
    asked = np.zeros(shape)
    asked[:, draw.integers(shape[1], size=4)] = 0.2
    variances = {name: np.ones(runs) for name in MEASURES}
    fixed = {"asked": asked, "stays": np.full(shape, 0.5), "variances": variances}
    return Measures(TRIALS, RUN, PLAN.trials, **arrays, **fixed)


def made_up(condition, **changes):
    """Return a result of a condition with random numbers that depend on its id only.

    Its optimum and its shortest paths are those of the scenario, as a file's are. Changes are the
    values of measures in each run, or attributes of the result.
    """
    draw = np.random.default_rng(list(condition.id.encode()))
    scenario = condition.scenario
    optimum = known_optimum(scenario)
    centre = {
        "returns": optimum.value - 2,
        "time_to_goal": 12,
        "asks": 0.5,
        "miscoordinations": 0.3,
    }
    values = {
        name: mean + draw.normal(0, 0.1, PLAN.runs) for name, mean in centre.items()
    }
    values["arrived"] = np.ones(PLAN.runs)
    values |= {name: changes.pop(name) for name in MEASURES if name in changes}
    result = ConditionResult(
        condition=condition,
        seed=PLAN.seed,
        measures=measures_of(scenario, values, draw),
        visited=[100.0] * len(values["returns"]),
        optimum=optimum.value,
        optimum_exact=optimum.exact,
    )
    return replace(result, **changes)


def result_of(name, learner="coop", settings=None, **changes):
    return made_up(
        make_condition(name, learner, settings or {"penalty": -20}), **changes
    )
