# Copyright 2026 The sparse_coord_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The loops of `kernels`, compiled by numba where it is installed."""

import functools
from collections.abc import Callable, Sequence
from typing import Any, NamedTuple

from sparse_coord_ros import kept
from sparse_coord_ros.compiling import accepted, numba
from sparse_coord_ros.engine import generator, kernels
from sparse_coord_ros.game import miscoordination, perception
from sparse_coord_ros.learn import algorithm, factors

CALLED = (
    miscoordination.together,
    perception.drawn_peer,
    perception.succeeds,
    algorithm.greedy,
    algorithm.greatest,
    algorithm.step_size,
    algorithm.updated,
    algorithm.weighed,
    factors.counted,
    factors.key_of,
    factors.unseen_key,
    factors.toward,
    factors.refresh,
    factors.learn_move,
    factors.learn_correction,
    factors.learn_asking,
    factors.replay,
    kernels.find_row,
    kernels.row_to_learn,
    kernels.perceived_row,
    kernels.begin_block,
    kernels.drawn,
    kernels.go_on,
    kernels.percept_draw,
    kernels.greedy_action,
    kernels.has_room,
    kernels.has_rows,
    kernels.place,
    kernels.add_row,
    kernels.correct,
    kernels.coordinate,
    kernels.choose,
    kernels.move,
    kernels.find_partners,
    kernels.learn_tables,
    kernels.learn_row,
    kernels.learn_factors,
    kernels.learn_block,
    kernels.play_block,
)
"""Functions that the loops call; they stay plain Python for everyone else."""

INLINED = (
    kernels.place,
    kernels.find_partners,
    kernels.drawn,
    kernels.percept_draw,
    kernels.greedy_action,
    kernels.choose,
    kernels.coordinate,
    kernels.move,
    kernels.learn_tables,
    kernels.row_to_learn,
    factors.refresh,
    factors.learn_move,
    factors.learn_asking,
    factors.replay,
    kernels.add_row,
    kernels.correct,
    kernels.learn_row,
    kernels.learn_factors,
)
"""Those of them whose many arrays take longer to pass than the work does. Inlining all functions
would take numba half as long again to compile."""


class Loops(NamedTuple):
    """The loops, ready to be called."""

    learn: Callable[..., None]
    play: Callable[..., None]
    rehash: Callable[..., None]


PLAIN = Loops(kernels.learn, kernels.play, kernels.rehash)
"""The loops as plain Python: slow, for tests."""


@functools.cache
def compiled() -> Loops:
    """Return the loops compiled by numba (they compile when first called)."""
    return Loops(*jitted(PLAIN))


def jitted(
    loops: Sequence[Callable[..., Any]], called: Sequence[Callable[..., Any]] = ()
) -> list[Callable[..., Any]]:
    """Return loops compiled by numba when they are first called.

    No fast-math: the same bits as plain Python. What was compiled is kept on disk (`kept`).

    Args:
        loops: the loops.
        called: functions that they call beside those of `CALLED`.
    """
    options = accepted("_nrt", False)
    generator.let_call(**options)
    for function in (*CALLED, *called):
        _let_call(function)
    return kept.jit(loops, **options)


@functools.cache
def _let_call(function: Callable[..., Any]) -> None:
    """Let compiled loops call a function."""
    options = accepted("_nrt", False)
    inlined = accepted("forceinline", True) if function in INLINED else {}
    numba().extending.register_jitable(**options, **inlined)(function)
