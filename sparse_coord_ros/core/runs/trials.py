# Copyright 2026 The sparse_coord_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The results of greedy trials."""

from dataclasses import dataclass

import numpy as np


@dataclass(frozen=True)
class Trials:
    """Greedy trials from the scenario's starts.

    Attributes:
        returns: total discounted reward, shape (trials, robots).
        time_to_goal: steps until arrival; the horizon for a robot that does not arrive; same
            shape.
        asks: how often COORDINATE was chosen; same shape.
        arrived: whether the robot arrived; same shape.
        miscoordinations: steps that end in a miscoordination, shape (trials,).
        asked: how often COORDINATE was chosen in each cell in all trials, shape (robots, cells).
        stays: how often the robot acted in each cell in all trials, same shape: the steps until
            it has arrived.
    """

    returns: np.ndarray
    time_to_goal: np.ndarray
    asks: np.ndarray
    arrived: np.ndarray
    miscoordinations: np.ndarray
    asked: np.ndarray
    stays: np.ndarray

    def __repr__(self) -> str:
        """Return a one-line description."""
        return "<Trials: {} of {} robots>".format(*self.returns.shape)
