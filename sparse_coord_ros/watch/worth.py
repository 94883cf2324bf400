# Copyright 2026 The sparse_coord_ros authors
# SPDX-License-Identifier: Apache-2.0
"""What a team's tables are worth, beside the class bound and the exact joint optimum."""

from collections.abc import Sequence
from typing import Any

from sparse_coord_ros.core.agent import Tables
from sparse_coord_ros.core.class_bound import shipped_class_bound
from sparse_coord_ros.core.evaluation import Evaluation, evaluate
from sparse_coord_ros.core.optimum import joint_optimum
from sparse_coord_ros.core.run_config import RunConfig
from sparse_coord_ros.engine.exact import MOST_ROBOTS, ExactEvaluation, evaluate_exact
from sparse_coord_ros.errors import SettingError
from sparse_coord_ros.watch.frames import Message

TRIALS = 300
"""Trials of a team that cannot be evaluated exactly."""


def evaluation_message(run: RunConfig, tables: Sequence[Tables], step: int | None) -> Message:
    """Return the evaluation of tables: exact for one or two robots, else by `TRIALS` trials.

    Args:
        run: the run.
        tables: of every robot.
        step: of which time step they are; None: of the run's end.

    Raises:
        TablesError: the tables do not fit the run.
    """
    result: Evaluation | ExactEvaluation
    scenario = run.scenario
    how = "exact"
    try:
        if len(scenario.robots) > MOST_ROBOTS:
            raise SettingError("too many robots")
        result = evaluate_exact(scenario, tables, learner=run.rule)
        arrived = result.all_arrived
    except SettingError:  # more robots, or a learner that acts by a rule of its own
        result = evaluate(scenario, tables, trials=TRIALS, seed=0, learner=run.rule)
        how, arrived = f"{TRIALS} trials", 1.0 - result.not_arrived / TRIALS
    bound = shipped_class_bound(scenario)
    optimum = joint_optimum(scenario)
    said: dict[str, Any] = {
        name: {"mean": round(measure.mean, 4), "spread": round(measure.spread, 4)}
        for name, measure in (
            ("reward", result.reward),
            ("time_to_goal", result.time_to_goal),
            ("miscoordinations", result.miscoordinations),
            ("asks", result.asks),
        )
    }
    return {
        "type": "evaluation",
        "how": how,
        "step": step,
        "learner": run.rule.title or run.learner,
        **said,
        "all_arrived": round(arrived, 6),
        "class_bound": None if bound is None else round(bound.value, 4),
        "optimum": round(optimum.value, 4),
        "optimum_exact": optimum.exact,
    }
