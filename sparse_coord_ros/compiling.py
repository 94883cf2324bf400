# Copyright 2026 The sparse_coord_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Whether numba is there, and compiling by it: in the background, once a machine."""

import atexit
import functools
import os
import sys
import threading
from collections.abc import Callable
from concurrent.futures import Future, wait
from importlib import import_module
from types import ModuleType
from typing import Any

import numpy as np

from sparse_coord_ros import kept
from sparse_coord_ros.errors import SparseCoordError

WAIT_SECONDS = 0.2
"""How long an interrupt may go unnoticed where the system does not wake up the waiting thread."""

INTERRUPTED = 130
"""Exit code of a process that was interrupted."""


def has_numba() -> bool:
    """Whether numba is installed, and fits this NumPy."""
    if "numba" in sys.modules:  # nothing to wait for
        return _imports()
    return bool(in_background("numba", _imports))


def _imports() -> bool:
    try:
        numba()
    except ImportError:
        return False
    return True


def numba() -> ModuleType:
    """Import numba where it is first needed: that takes as long as all the rest."""
    return import_module("numba")


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
def accepted(name: str, value: bool) -> dict[str, bool]:
    """Return an option of numba's that makes the loops faster, where this numba has it.

    `_nrt` off spares them counting references to arrays: they make none and keep none, and a step
    of env1 takes 27 ns instead of 250. `forceinline`: see `engine.compiled.INLINED`. Neither is
    documented.
    """
    options = {name: value}
    try:
        numba().njit(**options)(lambda values: values[0])(np.zeros(1))
    except Exception:  # whatever a numba without the option raises: slower, the same results
        return {}
    return options
