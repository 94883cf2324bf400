# Copyright 2026 The sparse_coord_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Calls of a function in processes, which never outlive their parent process.

The processes of `concurrent.futures` would finish their call after a Ctrl-C, and go on for ever
where the parent is killed. Here each holds one end of a pipe, and leaves when the other is gone.
"""

import multiprocessing
import os
import signal
import sys
import threading
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import Future, ProcessPoolExecutor
from concurrent.futures.process import BrokenProcessPool
from multiprocessing import get_context, resource_tracker
from multiprocessing.connection import Connection
from multiprocessing.synchronize import Event
from typing import Any

from sparse_coord_ros.base.errors import RunError
from sparse_coord_ros.base.signals import held_back

SAFE_PATH = "PYTHONSAFEPATH"
"""With this, as with its option -P, Python begins with no module of the current directory, which
may be called as one of its own."""


def in_processes(
    function: Callable[..., Any], work: Sequence[tuple[Any, ...]], jobs: int
) -> Iterator[Any]:
    """Call a function once for each tuple of arguments; yield the results in that order.

    Args:
        function: importable by name.
        work: the arguments of each call.
        jobs: processes at most.

    Raises:
        RunError: a process was killed, for example because memory ran out; or it cannot import
            the script that asks, such as one that would compute as it is imported.
        Exception: whatever the function raised; its cause is the traceback there.
    """
    if not work:
        return
    if getattr(multiprocessing.current_process(), "_inheriting", False):
        # it is a process of ours that imports the script: that one says so
        raise SystemExit(1)
    # started afresh, they inherit no lock of this process
    context = get_context("spawn")
    lifeline, mine = context.Pipe(duplex=False)
    before = os.environ.get(SAFE_PATH, "")
    os.environ[SAFE_PATH] = "1"
    ready = context.Event()  # the first one starts a process, too
    pool = ProcessPoolExecutor(
        min(jobs, len(work)),
        context,
        initializer=_begin,
        initargs=(lifeline, os.getcwd(), ready),
    )
    try:
        futures = _submitted(pool, function, work)
        os.environ[SAFE_PATH] = before
        futures.reverse()
        while futures:  # a result can be large: keep none that was handed out
            yield futures.pop().result()
    except BrokenProcessPool:
        script = getattr(sys.modules["__main__"], "__file__", None)
        if not ready.is_set() and script is not None:
            raise RunError(
                f"script {script}: processes that compute runs cannot import it; put what it "
                'computes below a line: if __name__ == "__main__":'
            ) from None
        raise RunError(
            "a process that computed runs was killed (is the memory used up?); finished runs "
            "are saved: call again, perhaps with fewer --jobs"
        ) from None
    finally:
        mine.close()
        pool.shutdown(cancel_futures=True)
        lifeline.close()


def _submitted(
    pool: ProcessPoolExecutor,
    function: Callable[..., Any],
    work: Sequence[tuple[Any, ...]],
) -> list[Future[Any]]:
    """Hand the calls to the pool, which starts its processes as it takes them."""
    resource_tracker.ensure_running()  # it would let signals through again where it starts later
    with held_back(signal.SIGINT):  # a Ctrl-C at the terminal is for this process alone
        return [pool.submit(function, *arguments) for arguments in work]


def _begin(lifeline: Connection, folder: str, ready: Event) -> None:
    """Make a process ready: where modules of the user's own may lie, and when to leave."""
    ready.set()
    if folder not in sys.path:
        sys.path.append(folder)
    threading.Thread(target=_leave_after, args=(lifeline,), daemon=True).start()


def _leave_after(lifeline: Connection) -> None:
    # no data come: this returns when the other end is closed
    lifeline.poll(None)
    os._exit(1)
