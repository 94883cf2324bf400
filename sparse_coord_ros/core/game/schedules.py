# Copyright 2026 The sparse_coord_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Step sizes, exploration and exploring starts as tables.

All are looked up, never computed while learning: NumPy's and Python's powers differ in the last
bit, and every way of running must give the same bits.
"""

import functools
from typing import NamedTuple

import numpy as np

from sparse_coord_ros.core.game.specs import Form, Spec, SpecFamily, probability

FALL = (probability("first"), probability("last"), probability("fraction"))
"""Numbers of what falls linearly from first to last over a fraction of the budget, then stays."""

STEP_SIZE = SpecFamily(
    "step_size",
    Form("constant", "the same at each update", (probability("alpha"),)),
    Form(
        "power",
        "n^-exponent at the n-th update of a table entry",
        (probability("exponent"),),
    ),
    Form(
        "floored",
        "that power, but never less than a floor that falls linearly over the budget",
        (probability("exponent"), *FALL[:2]),
    ),
)
"""The step size alpha of an update. With a floor the first updates average, the later ones track
peers that still learn."""

EPSILON = SpecFamily(
    "epsilon",
    Form("constant", "the same at each time step", (probability("epsilon"),)),
    Form("linear", "falls from first to last over that fraction of the budget", FALL),
)
"""The probability of a random action."""

STARTS = SpecFamily(
    "starts",
    Form("fixed", "at the scenario's starts"),
    Form("random", "at exploring starts: any cell with a way to the goal"),
    Form(
        "mixed",
        "each robot with this probability at an exploring start",
        (probability("p_random"),),
    ),
    Form(
        "exploring",
        "the same; the probability falls over that fraction of the budget",
        FALL,
    ),
)
"""Where learning episodes begin."""


class StepSizes(NamedTuple):
    """Step sizes of one table's updates: alpha is the greater of the two (`step_size`).

    Attributes:
        by_count: shape (budget + 1,): entry n for the n-th update of an entry; entry 0 unused.
        by_step: shape (budget + 1,): entry t for time step t; after its end the last entry holds.
    """

    by_count: np.ndarray
    by_step: np.ndarray


@functools.lru_cache(maxsize=8)
def step_sizes(schedule: Spec, budget: int) -> StepSizes:
    """Return the step sizes alpha of QLUpdate.

    Args:
        schedule: one of the kinds of `STEP_SIZE`.
        budget: the step budget of the run; no entry can see more updates.
    """
    if schedule.kind == "constant":
        return StepSizes(np.zeros(budget + 1), np.full(budget + 1, schedule.numbers[0]))
    exponent = -schedule.numbers[0]
    # Python's power, not NumPy's: the last bit of NumPy's depends on the processor (AVX-512).
    powers = (float(max(n, 1)) ** exponent for n in range(budget + 1))
    by_count = np.fromiter(powers, dtype=np.float64, count=budget + 1)
    _, first, last = schedule.numbers if schedule.kind == "floored" else (0.0, 0.0, 0.0)
    return StepSizes(by_count, _linear((first, last, 1.0), budget))


@functools.lru_cache(maxsize=16)
def probabilities(schedule: Spec, budget: int) -> np.ndarray:
    """Return epsilon (Algorithm 1, line 4), or the probability of an exploring start.

    Args:
        schedule: one of the kinds of `EPSILON` or of `STARTS`.
        budget: the step budget of the run.

    Returns:
        Shape (budget + 1,), float64: entry t for time step t, or an episode that begins then;
        after the end of the table its last entry holds.
    """
    if schedule.kind in ("linear", "exploring"):
        return _linear(schedule.numbers, budget)
    share = {"fixed": 0.0, "random": 1.0}.get(schedule.kind, sum(schedule.numbers))
    return np.full(budget + 1, share)


def _linear(numbers: tuple[float, ...], budget: int) -> np.ndarray:
    """Return the numbers of a `FALL` by time step, shape (budget + 1,)."""
    first, last, fraction = numbers
    span = max(1.0, fraction * budget)
    done = np.minimum(np.arange(budget + 1, dtype=np.float64) / span, 1.0)
    return np.asarray(first + (last - first) * done)
