# Copyright 2026 The sparse_coord_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The value of a team's tables, beside what is known to be possible."""

from collections.abc import Sequence

from sparse_coord_ros.learn.agent import Tables
from sparse_coord_ros.learn.evaluation import MEASURES
from sparse_coord_ros.learn.run_config import RunConfig
from sparse_coord_ros.look.page.board import Message
from sparse_coord_ros.solve.exact import evaluate_best
from sparse_coord_ros.solve.shipped import yardsticks

TRIALS = 300
"""Trials of a team that cannot be evaluated exactly."""


def evaluation_fields(run: RunConfig, tables: Sequence[Tables], step: int | None) -> Message:
    """Return the evaluation of tables: exact for one or two robots, else by `TRIALS` trials.

    Args:
        run: the run.
        tables: of every robot.
        step: of which time step they are; None: of the run's end.

    Raises:
        TablesError: the tables do not fit the run.
    """
    result = evaluate_best(run.scenario, tables, trials=TRIALS, learner=run.rule)
    measures = {name: getattr(result, name) for name in MEASURES}
    return {
        "how": result.how,
        "step": step,
        "learner": run.rule.title or run.learner,
        **{name: {"mean": one.mean, "spread": one.spread} for name, one in measures.items()},
        "all_arrived": result.all_arrived,
        "yardsticks": yardsticks(run.scenario),
    }
