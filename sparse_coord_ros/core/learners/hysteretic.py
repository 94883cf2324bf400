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

from sparse_coord_ros.core.learners.baselines import NonCoop
from sparse_coord_ros.core.learners.rules import (
    Task,
    Transition,
    reward_of,
    step_size,
)

SHARE_OF_ALPHA = 0.5
"""beta / alpha."""


class Hysteretic(NonCoop):
    """Hysteretic Q-learning."""

    name = "hysteretic"
    summary = (
        "hysteretic Q-learning; values fall at a smaller rate (Matignon et al., 2007)"
    )

    @staticmethod
    def learn(mind: Any, task: Task, k: int, now: Transition, after: float) -> None:
        """Update Q*."""
        values = mind.q_star[k, now.cell]
        updates = mind.updates[k, now.cell]
        count = int(updates[now.action]) + 1
        updates[now.action] = count
        target = reward_of(task, now) + task.discount * after
        error = target - float(values[now.action])
        alpha = step_size(task, count, now.step)
        if error < 0.0:
            alpha *= SHARE_OF_ALPHA
        values[now.action] += alpha * error
