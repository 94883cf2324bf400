# Copyright 2026 The sparse_coord_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Hysteretic Q-learning (Matignon, Laurent & Le Fort-Piat, IROS 2007): slow to learn bad news.

Each robot learns for itself, over its own cell, and never asks. With the error
delta = r + gamma max_b Q(y, b) - Q(x, a) it learns

    Q(x, a) += alpha delta   if delta >= 0
    Q(x, a) += beta delta    otherwise, with beta < alpha,

so that a mistake of a peer that still explores does not spoil a good move. Here beta is a share of
alpha, and alpha is the step size of every learner.
"""

from typing import Any

from sparse_coord_ros.base.compiling import of_learner
from sparse_coord_ros.core.learners.baselines import NonCoop
from sparse_coord_ros.core.learners.rules import (
    Task,
    Transition,
    expected,
    reward_of,
    step_size,
)


class Hysteretic(NonCoop):
    """Hysteretic Q-learning."""

    name = "hysteretic"
    title = "Hysteretic Q"
    summary = (
        "hysteretic Q-learning; values fall at a smaller rate (Matignon et al., 2007)"
    )

    @staticmethod
    def share_of_alpha(mind: Any, task: Task) -> float:
        """Return beta / alpha."""
        return 0.5

    @staticmethod
    def learn(mind: Any, task: Task, now: Transition) -> None:
        """Update Q*."""
        values = mind.q_star[now.cell]
        updates = mind.updates[now.cell]
        count = updates[now.action] + 1
        updates[now.action] = count
        target = reward_of(now) + task.discount * expected(mind, task, now)
        error = target - values[now.action]
        alpha = step_size(task, count, now.floor)
        if error < 0.0:
            alpha *= share_of_alpha(mind, task)
        values[now.action] += alpha * error


@of_learner
def share_of_alpha(mind: Any, task: Task) -> float:
    """As `Hysteretic.share_of_alpha`."""
    raise NotImplementedError
