# Copyright 2026 The sparse_coord_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The loops of `kernels`, compiled by numba where it is installed."""

import atexit
import functools
import os
import sys
import threading
from collections.abc import Callable, Sequence
from concurrent.futures import Future, wait
from types import ModuleType
from typing import Any, NamedTuple

import numpy as np

from sparse_coord_ros import kept
from sparse_coord_ros.engine import generator, kernels
from sparse_coord_ros.errors import SparseCoordError
from sparse_coord_ros.learn import algorithm, factors

CALLED = (
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

WAIT_SECONDS = 0.2
"""How long an interrupt may go unnoticed where the system does not wake up the waiting thread."""

INTERRUPTED = 130
"""Exit code of a process that was interrupted."""


class Loops(NamedTuple):
    """The loops, ready to be called."""

    learn: Callable[..., None]
    play: Callable[..., None]
    rehash: Callable[..., None]


PLAIN = Loops(kernels.learn, kernels.play, kernels.rehash)
"""The loops as plain Python: slow, for tests."""


def has_numba() -> bool:
    """Whether numba is installed, and fits this NumPy."""
    if "numba" in sys.modules:  # nothing to wait for
        return _imports()
    return bool(in_background("numba", _imports))


def _imports() -> bool:
    try:
        _numba()
    except ImportError:
        return False
    return True


def _numba() -> ModuleType:
    """Import numba where it is first needed: that takes as long as all the rest."""
    import numba

    return numba


_background: dict[object, Future[Any]] = {}
_one_begins = threading.Lock()


def in_background(key: object, work: Callable[[], Any]) -> Any:
    """Do some work once a process and return its result, in a thread of its own.

    An interrupt that arrives inside numba can get lost: LLVM calls back into Python through
    ctypes, which swallows exceptions. Here it reaches the caller, who only waits, at once. The
    work goes on for whoever calls next; a process that ends before it does so without it.

    Args:
        key: names the work.
        work: what to do the first time.
    """
    with _one_begins:  # a cluster's worker computes in several threads
        future = _background.get(key)
        if future is None or (future.done() and future.exception() is not None):
            future = _background[key] = Future()
            thread = threading.Thread(target=_do, args=(work, future), name=f"{key}", daemon=True)
            thread.start()
    try:
        while not future.done():
            wait([future], timeout=WAIT_SECONDS)
    except KeyboardInterrupt:
        atexit.register(_end_without, future)
        raise
    return future.result()


def _do(work: Callable[[], Any], future: Future[Any]) -> None:
    try:
        future.set_result(work())
    except BaseException as error:
        future.set_exception(error)


def _end_without(future: Future[Any]) -> None:
    """End the process while LLVM still works in another thread: taking it down would crash."""
    if not future.done():
        sys.stdout.flush()
        sys.stderr.flush()
        os._exit(INTERRUPTED)


def compile_once(key: str, warm_up: Callable[[], None]) -> None:
    """Let numba compile, in the background; return when it has.

    Args:
        key: names the loops.
        warm_up: calls each of them.
    """

    def compile_or_take() -> None:
        try:
            warm_up()
        except Exception as error:  # whatever a spoiled file on disk makes numba raise
            if isinstance(error, SparseCoordError | MemoryError) or not kept.forget():
                raise
            warm_up()
        kept.keep(key)

    in_background(("compile", key), compile_or_take)


def is_compiled(key: str) -> bool:
    """Whether `compile_once` has compiled the loops of that name."""
    future = _background.get(("compile", key))
    return future is not None and future.done() and future.exception() is None


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
    options = _accepted("_nrt", False)
    generator.let_call(**options)
    for function in (*CALLED, *called):
        _let_call(function)
    return kept.jit(loops, **options)


@functools.cache
def _let_call(function: Callable[..., Any]) -> None:
    """Let compiled loops call a function."""
    options = _accepted("_nrt", False)
    inlined = _accepted("forceinline", True) if function in INLINED else {}
    _numba().extending.register_jitable(**options, **inlined)(function)


@functools.cache
def _accepted(name: str, value: bool) -> dict[str, bool]:
    """Return an option of numba's that makes the loops faster, where this numba has it.

    `_nrt` off spares them counting references to arrays: they make none and keep none, and a step
    of env1 takes 27 ns instead of 250. `forceinline`: see `INLINED`. Neither is documented.
    """
    options = {name: value}
    try:
        _numba().njit(**options)(lambda values: values[0])(np.zeros(1))
    except Exception:  # whatever a numba without the option raises: slower, the same results
        return {}
    return options
