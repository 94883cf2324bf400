# Copyright 2026 The sparse_coord_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Step sizes and exploration as tables.

Both are looked up, never computed while learning: NumPy's and Python's powers differ in the last
bit, and every way of running must give the same bits.
"""

import functools

import numpy as np

from sparse_coord_ros.core.specs import Number, Spec, SpecFamily

STEP_SIZE = SpecFamily(
    "step_size",
    {
        "constant": (Number("alpha", 0.0, 1.0),),
        "power": (Number("exponent", 0.0, 1.0),),
    },
)
"""`constant:ALPHA`, or `power:EXPONENT`: n^-exponent at the n-th update of a table entry."""

EPSILON = SpecFamily(
    "epsilon",
    {
        "constant": (Number("epsilon", 0.0, 1.0),),
        "linear": (
            Number("first", 0.0, 1.0),
            Number("last", 0.0, 1.0),
            Number("fraction", 0.0, 1.0),
        ),
    },
)
"""`constant:EPSILON`, or `linear:FIRST:LAST:FRACTION`: falls over that fraction of the budget."""


@functools.lru_cache(maxsize=8)
def step_sizes(schedule: Spec, updates: int) -> np.ndarray:
    """Return the step size alpha of QLUpdate for each update of one table entry.

    Args:
        schedule: one of the kinds of `STEP_SIZE`.
        updates: the largest number of updates that an entry can see.

    Returns:
        Shape (updates + 1,), float64: entry n is the step size of the n-th update; entry 0 unused.
    """
    if schedule.kind == "constant":
        return np.full(updates + 1, schedule.numbers[0])
    exponent = -schedule.numbers[0]
    # Python's power, not NumPy's: the last bit of NumPy's depends on the processor (AVX-512).
    powers = (float(max(n, 1)) ** exponent for n in range(updates + 1))
    return np.fromiter(powers, dtype=np.float64, count=updates + 1)


@functools.lru_cache(maxsize=8)
def exploration(schedule: Spec, steps: int) -> np.ndarray:
    """Return epsilon of the learning policy pi_epsilon (Algorithm 1, line 4) for each time step.

    Args:
        schedule: one of the kinds of `EPSILON`.
        steps: the step budget of the run.

    Returns:
        Shape (steps + 1,), float64: entry t is epsilon at time step t; after the end of the
        table its last entry holds.
    """
    if schedule.kind == "constant":
        return np.full(steps + 1, schedule.numbers[0])
    first, last, fraction = schedule.numbers
    span = max(1.0, fraction * steps)
    done = np.minimum(np.arange(steps + 1, dtype=np.float64) / span, 1.0)
    return first + (last - first) * done
