# Copyright 2026 The sparse_coord_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Calls of a function in processes, which never outlive the process that asked for them.

Not `concurrent.futures`: its processes go on for a whole call after Ctrl-C, and for ever where
the parent is killed. These are started afresh, so they inherit no lock of the parent.
"""

import os
import signal
import sys
import threading
import traceback
from collections.abc import Callable, Iterator, Sequence
from contextlib import suppress
from multiprocessing import get_context, parent_process, resource_tracker
from multiprocessing.connection import Connection, wait
from multiprocessing.process import BaseProcess
from typing import Any, cast

from sparse_coord_ros.errors import RunError


def in_processes(
    function: Callable[..., Any], work: Sequence[tuple[Any, ...]], jobs: int
) -> Iterator[Any]:
    """Call a function once for each tuple of arguments; yield the results in that order.

    Args:
        function: importable by name.
        work: the arguments of each call.
        jobs: processes at most.

    Raises:
        RunError: a process was killed, for example because memory ran out.
        Exception: whatever the function raised.
    """
    waiting = iter(enumerate(work))
    calls: dict[Connection, int] = {}
    done: dict[int, Any] = {}
    processes: list[BaseProcess] = []
    try:
        for _ in range(min(jobs, len(work))):
            process, end = _start(function, processes)
            calls[end], arguments = next(waiting)
            _send(end, arguments)
        for number in range(len(work)):
            while number not in done:
                for ready in wait(list(calls)):
                    end = cast(Connection, ready)
                    done[calls.pop(end)] = _received(end)
                    following = next(waiting, None)
                    if following is not None:
                        calls[end] = following[0]
                        _send(end, following[1])
            yield done.pop(number)
    finally:
        for process in processes:
            process.kill()
        for process in processes:
            process.join()


def _start(function: Callable[..., Any], processes: list[BaseProcess]) -> tuple[Any, Connection]:
    """Start a process, note it in the list, and return it with the connection to it."""
    context = get_context("spawn")
    resource_tracker.ensure_running()  # it would let signals through again where it starts later
    mine, its = context.Pipe()
    # The process inherits the mask: a Ctrl-C at the terminal is for this process alone.
    before = signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT})
    try:
        process = context.Process(target=_serve, args=(function, its), daemon=True)
        process.start()
        processes.append(process)
    finally:
        its.close()
        signal.pthread_sigmask(signal.SIG_SETMASK, before)
    return process, mine


def _send(end: Connection, arguments: tuple[Any, ...]) -> None:
    with suppress(ConnectionError):  # it was killed: receiving from it says so
        end.send(arguments)


def _received(end: Connection) -> Any:
    try:
        result, error = end.recv()
    except (EOFError, ConnectionError):
        raise RunError(
            "a process that computed runs was killed (is the memory used up?); what was finished "
            "is saved: call again, perhaps with fewer --jobs"
        ) from None
    if error is not None:
        raise error
    return result


def _serve(function: Callable[..., Any], end: Connection) -> None:
    """Answer calls until killed."""
    if os.getcwd() not in sys.path:  # where modules of the user's own may lie
        sys.path.append(os.getcwd())
    threading.Thread(target=_end_with_parent, daemon=True).start()
    answer: tuple[Any, Exception | None]
    while True:
        try:
            answer = function(*end.recv()), None
        except EOFError:
            return
        except Exception as error:
            error.add_note(traceback.format_exc())  # what its cause was, too: it is not sent
            answer = None, error
        end.send(answer)


def _end_with_parent() -> None:
    parent = parent_process()
    if parent is not None:
        parent.join()
    os._exit(1)
