# Copyright 2026 The sparse_coord_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The loops of `kernels`, compiled by numba where it is installed."""

import functools
from collections.abc import Callable
from types import ModuleType
from typing import NamedTuple

import numpy as np

from sparse_coord_ros.core import algorithm
from sparse_coord_ros.engine import kernels

CALLED = (
    algorithm.greedy,
    algorithm.epsilon_greedy,
    algorithm.greatest,
    algorithm.step_size,
    algorithm.updated,
    algorithm.weighed,
    kernels.find_row,
    kernels.perceived_row,
    kernels.draw,
    kernels.has_room,
    kernels.place,
    kernels.choose,
    kernels.move,
    kernels.learn_block,
    kernels.play_block,
)
"""Functions that the loops call; they stay plain Python for everyone else."""


class Loops(NamedTuple):
    """The loops, ready to be called."""

    learn: Callable[..., None]
    play: Callable[..., None]
    rehash: Callable[..., None]


PLAIN = Loops(kernels.learn, kernels.play, kernels.rehash)
"""The loops as plain Python: slow, for tests."""


def has_numba() -> bool:
    """Whether numba is installed, and fits this NumPy."""
    try:
        _numba()
    except ImportError:
        return False
    return True


def _numba() -> ModuleType:
    """Import numba where it is first needed: that takes as long as all the rest."""
    import numba

    return numba


@functools.cache
def compiled() -> Loops:
    """Return the loops compiled by numba (they compile when first called).

    No fast-math: the same bits as plain Python. Not cached on disk: numba's cache does not see
    changes of the functions that a loop calls.
    """
    numba = _numba()
    options = _without_reference_counts()
    for function in CALLED:
        numba.extending.register_jitable(**options)(function)
    return Loops(*(numba.njit(nogil=True, **options)(loop) for loop in PLAIN))


def _without_reference_counts() -> dict[str, bool]:
    """Return the option that spares the loops counting references to arrays, where numba has it.

    The loops make no arrays and keep none, so there is nothing to count. With the counts a step of
    env1 takes 250 ns instead of 27. The option is not part of numba's public interface.
    """
    options = {"_nrt": False}
    try:
        _numba().njit(**options)(lambda values: values[0])(np.zeros(1))
    except Exception:  # whatever a numba without the option raises: slower, the same results
        return {}
    return options
