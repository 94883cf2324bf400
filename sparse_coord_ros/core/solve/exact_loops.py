# Copyright 2026 The sparse_coord_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The loop behind exact evaluation: the moments of a trial, carried along a Markov chain.

Plain Python over NumPy arrays, compiled by numba where it is installed; the same bits.
"""

import functools
import sys
from collections.abc import Callable
from typing import Any, NamedTuple

import numpy as np

from sparse_coord_ros.base.compiling import has_numba, jit


class Chain(NamedTuple):
    """The Markov chain of a team that acts greedily, in S joint states.

    An outcome is a way in which a step from a joint state can end; those of a joint state stand
    together. A step changes Q quantities, each a sum over a trial.

    Attributes:
        first: the first outcome of each joint state, and the end of the last one's; (S + 1,).
        probability: of an outcome, given the joint state before the step; (outcomes,).
        after: the joint state after it; (outcomes,).
        change: mean change of each quantity in an outcome; (outcomes, Q).
        mean: mean change in a step from each joint state; (S, Q).
        square: mean square of the change in a step from each joint state; (S, Q).
        discounts: by which factor a step later the change of a quantity counts less; (Q,).
    """

    first: np.ndarray
    probability: np.ndarray
    after: np.ndarray
    change: np.ndarray
    mean: np.ndarray
    square: np.ndarray
    discounts: np.ndarray


class Moments(NamedTuple):
    """What `carry` adds up over a trial; initially 0 but for the probability of the start.

    Attributes:
        mean: mean of each quantity; (Q,).
        square: mean of its square; (Q,).
        visits: expected number of steps from each joint state; (S,).
        likely: probability of each joint state, before steps of even and of odd number; (2, S).
        so_far: mean of each quantity so far, times the probability of the joint state; (2, S, Q).
        factors: the factor of each change at the present step, initially 1; (Q,).
    """

    mean: np.ndarray
    square: np.ndarray
    visits: np.ndarray
    likely: np.ndarray
    so_far: np.ndarray
    factors: np.ndarray


def carry(chain: Chain, moments: Moments, horizon: int) -> None:
    """Add up the moments of a trial of so many steps.

    A step that changes X by c changes X^2 by 2 c X + c^2.
    """
    mean, square, visits, likely, so_far, factors = moments
    quantities = range(len(mean))
    for t in range(horizon):
        now = t % 2
        later = 1 - now
        for state in range(len(visits)):
            p = likely[now, state]
            if p == 0.0:
                continue
            visits[state] += p
            for n in quantities:
                change = factors[n] * chain.mean[state, n]
                mean[n] += p * change
                square[n] += 2.0 * change * so_far[now, state, n]
                square[n] += p * factors[n] ** 2 * chain.square[state, n]
            for i in range(chain.first[state], chain.first[state + 1]):
                share = chain.probability[i]
                after = chain.after[i]
                likely[later, after] += share * p
                for n in quantities:
                    change = p * factors[n] * chain.change[i, n]
                    so_far[later, after, n] += share * (so_far[now, state, n] + change)
            likely[now, state] = 0.0
            for n in quantities:
                so_far[now, state, n] = 0.0
        for n in quantities:
            factors[n] *= chain.discounts[n]


FEW_CHANGES = 1_000_000
"""Plain Python makes so many changes in the time that the import of numba takes."""


def loop_for(chain: Chain, horizon: int) -> Callable[..., Any]:
    """Return `carry`, compiled unless the import of numba would take longer than plain Python."""
    changes = horizon * len(chain.probability) * len(chain.discounts)
    few = changes <= FEW_CHANGES and "numba" not in sys.modules
    return carry if few else compiled()


@functools.cache
def compiled() -> Callable[..., Any]:
    """Return `carry`, compiled by numba where it is installed (when it is first called)."""
    return jit([carry])[0] if has_numba() else carry
