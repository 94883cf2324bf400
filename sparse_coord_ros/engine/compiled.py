# Copyright 2026 The sparse_coord_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The loops of `kernels`, compiled by numba where it is installed."""

import functools
from collections.abc import Callable
from typing import NamedTuple

from sparse_coord_ros.core import algorithm
from sparse_coord_ros.engine import kernels

try:
    import numba
except ImportError:
    numba = None

CALLED = (
    algorithm.greedy,
    algorithm.epsilon_greedy,
    algorithm.greatest,
    algorithm.step_size,
    algorithm.updated,
    kernels.place,
    kernels.find_row,
    kernels.perceived_row,
    kernels.choose,
    kernels.move,
)
"""Functions that the loops call; they stay plain Python for everyone else."""


class Loops(NamedTuple):
    """The two loops, ready to be called."""

    learn_block: Callable[..., None]
    try_block: Callable[..., None]


PLAIN = Loops(kernels.learn_block, kernels.try_block)
"""The loops as plain Python: slow, for tests."""


def has_numba() -> bool:
    """Whether numba is installed."""
    return numba is not None


@functools.cache
def compiled() -> Loops:
    """Return the loops compiled by numba (they compile when first called).

    No fast-math: the same bits as plain Python. Not cached on disk: numba's cache does not see
    changes of the functions that a loop calls.
    """
    for function in CALLED:
        numba.extending.register_jitable(function)
    jit = numba.njit(nogil=True)
    return Loops(jit(kernels.learn_block), jit(kernels.try_block))
