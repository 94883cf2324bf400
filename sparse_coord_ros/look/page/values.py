# Copyright 2026 The sparse_coord_ros authors
# SPDX-License-Identifier: Apache-2.0
"""What a team's tables are worth, beside the class bound and the exact joint optimum."""

from collections.abc import Sequence
from typing import Any

from sparse_coord_ros.learn.agent import Tables
from sparse_coord_ros.learn.run_config import RunConfig
from sparse_coord_ros.look.page.messages import Message
from sparse_coord_ros.solve.class_bound import shipped_class_bound
from sparse_coord_ros.solve.exact import evaluate_best
from sparse_coord_ros.solve.optimum import joint_optimum

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
    scenario = run.scenario
    result = evaluate_best(scenario, tables, trials=TRIALS, learner=run.rule)
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
        "how": result.how,
        "step": step,
        "learner": run.rule.title or run.learner,
        **said,
        "all_arrived": round(result.all_arrived, 6),
        "class_bound": None if bound is None else round(bound.value, 4),
        "optimum": round(optimum.value, 4),
        "optimum_exact": optimum.exact,
    }
