# Copyright 2026 The sparse_coord_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The baselines of Section 4: Q-learning over the own cell, without COORDINATE."""

from typing import Any, NamedTuple

import numpy as np

from sparse_coord_ros.core.game.actions import ACTIONS, COORDINATE, PRIMITIVES
from sparse_coord_ros.core.game.scenario import Scenario
from sparse_coord_ros.core.learners.learner import Learner
from sparse_coord_ros.core.learners.rules import (
    Task,
    Transition,
    copy_moves,
    greatest,
    ql_update,
    reward_of,
)


class NonCoop(Learner):
    """Q-learning, all robots learn at once, each for itself (paper, Section 4)."""

    name = "noncoop"
    summary = "Q-learning, all robots learn at once"
    asks = False
    values = ("q_star",)

    class Mind(NamedTuple):
        """The learned tables of a robot.

        Attributes:
            q_star: Q*_k(x, a) [k, x, action]; NaN for COORDINATE.
            updates: how often each entry of it was updated.
        """

        q_star: Any
        updates: Any

    @staticmethod
    def initial(scenario: Scenario, robot: int) -> Any:
        """Return the table before learning."""
        q_star = np.full((len(scenario.map.cells), len(ACTIONS)), scenario.q_star_init)
        q_star[:, COORDINATE] = np.nan
        return NonCoop.Mind(q_star, np.zeros(q_star.shape, dtype=np.int64))

    @staticmethod
    def asking_values(
        mind: Any, task: Task, k: int, cell: int, seen: int, cells: Any, values: Any
    ) -> None:
        """Set the values of Q*, whatever is perceived."""
        copy_moves(mind.q_star[k, cell], values)

    @staticmethod
    def bootstrap(mind: Any, task: Task, k: int, cell: int, now: Transition) -> float:
        """Return the maximum of Q*(cell, .) over the moves."""
        return greatest(mind.q_star[k, cell], PRIMITIVES)

    @staticmethod
    def learn(mind: Any, task: Task, k: int, now: Transition, after: float) -> None:
        """Update Q* (equation 3)."""
        values = mind.q_star[k, now.cell]
        updates = mind.updates[k, now.cell]
        reward = reward_of(task, now)
        ql_update(values, updates, now.action, task, now.step, reward, after)


class Indiv(NonCoop):
    """Q-learning of one robot at a time, so that robots never meet (paper, Section 4)."""

    name = "indiv"
    summary = "Q-learning, one robot learns at a time"
    alone = True
