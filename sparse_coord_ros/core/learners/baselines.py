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
    expected,
    greatest,
    ql_update,
    reward_of,
)


class NonCoop(Learner):
    """Q-learning, all robots learn at once, each for itself (paper, Section 4)."""

    name = "noncoop"
    title = "Non-coop."
    summary = "Q-learning, all robots learn at once"
    asks = False
    values = ("q_star",)

    class Mind(NamedTuple):
        """The learned tables of a robot.

        Attributes:
            q_star: Q* [cell][action]; NaN for COORDINATE.
            updates: how often each entry of it was updated.
        """

        q_star: Any
        updates: Any

    @staticmethod
    def initial(scenario: Scenario, robot: int) -> Mind:
        """Return the table before learning."""
        q_star = np.full((len(scenario.map.cells), len(ACTIONS)), scenario.q_star_init)
        q_star[:, COORDINATE] = np.nan
        return NonCoop.Mind(q_star, np.zeros(q_star.shape, dtype=np.int32))

    @staticmethod
    def asking_values(
        mind: Mind, task: Task, cell: int, seen: int, cells: Any, values: Any
    ) -> None:
        """Set the values of Q*, whatever is perceived."""
        copy_moves(mind.q_star[cell], values)

    @staticmethod
    def bootstrap(mind: Mind, task: Task, cell: int, now: Transition) -> float:
        """Return the maximum of Q*(cell, .) over the moves."""
        return greatest(mind.q_star[cell], PRIMITIVES)

    @staticmethod
    def learn(mind: Mind, task: Task, now: Transition) -> None:
        """Update Q* (equation 3)."""
        after = expected(mind, task, now)
        values = mind.q_star[now.cell]
        updates = mind.updates[now.cell]
        ql_update(values, updates, now.action, task, now.floor, reward_of(now), after)


class Indiv(NonCoop):
    """Q-learning of one robot at a time, so that robots never meet (paper, Section 4)."""

    name = "indiv"
    title = "Indiv."
    summary = "Q-learning, one robot learns at a time"
    alone = True
