# Copyright 2026 The sparse_coord_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The signals that end a process, and protection of the start of a child process from them."""

import signal
from collections.abc import Iterator
from contextlib import contextmanager

STOPPING = (signal.SIGINT, signal.SIGTERM, signal.SIGHUP)
"""Signals for an orderly end: Ctrl-C, `kill`, and a closed terminal (`nohup` ignores it)."""


@contextmanager
def held_back(*numbers: signal.Signals) -> Iterator[None]:
    """Hold signals back in this thread, and in every child process that is started here.

    The child inherits the mask: no signal reaches it before it can handle one. It keeps the mask
    until it lets the signals through itself. Here they arrive afterwards.

    Args:
        numbers: the signals; empty: all of `STOPPING`.
    """
    before = signal.pthread_sigmask(signal.SIG_BLOCK, numbers or STOPPING)
    try:
        yield
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, before)
