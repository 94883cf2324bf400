# Copyright 2026 The sparse_coord_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The computation of runs: options, notes on numba, and a line of progress."""

import argparse
import threading
import time
from contextlib import ExitStack
from pathlib import Path
from typing import TYPE_CHECKING, Any, Self

from sparse_coord_ros.base.progress import MovingLine
from sparse_coord_ros.cli.options import Option, note
from sparse_coord_ros.core.engine.batch import ENGINES, uses_numba
from sparse_coord_ros.core.engine.cluster import JOBS

if TYPE_CHECKING:
    from sparse_coord_ros.log.runlog import RunLog

COMPUTING = (
    Option(
        "--engine",
        ENGINES,
        "how to compute; all engines give identical results; auto: numba if installed",
    ),
    Option("--jobs", JOBS, f"{JOBS.help} (default: all cores)", {"default": None}),
    Option(
        "--scheduler ADDRESS",
        None,
        "address of a Dask cluster, e.g. tcp://10.0.0.1:8786 (default: compute on this machine)",
    ),
)
"""The options of the engine and the workers."""


def computing_of(options: argparse.Namespace) -> dict[str, Any]:
    """Return the options of a computation; say if numba is missing."""
    compiled = options.scheduler is not None or uses_numba(options.engine)
    if options.engine == "auto" and not compiled:
        note_without_numba()
    names = ("out", "runs", "trials", "seed", "engine", "jobs", "scheduler")
    return {name: getattr(options, name) for name in names}


def first_wait(options: argparse.Namespace) -> str:
    """Return the reason why a batch waits before its first steps."""
    if options.scheduler is not None:
        return "waiting for the first results of the cluster"
    return "computing the first runs"


def note_without_numba() -> None:
    """Print a note that numba would make the run faster."""
    note(
        "numba is not installed: computing in plain Python, about 100 times slower; "
        "pip install numba"
    )


FIRST_SECONDS = 1.5
LINE_SECONDS = 15.0
"""Seconds of work until the first line on it, and between two lines."""


def read_bag(path: Path, *, quiet: bool) -> "RunLog":
    """Read a run's log, with progress on stderr unless it is to be quiet; errors: `read_run`."""
    from sparse_coord_ros.log.runlog import read_run

    with Bar("kB", "reading the bag", quiet=quiet) as bar:
        return read_run(path, bar.show)


class Bar(ExitStack):
    """Progress on stderr: a line that moves at a terminal, else lines now and then.

    The moving line begins with the first number; before, lines name the work.

    Args:
        unit: the counted unit.
        doing: the work before the first count.
        quiet: show no progress.
    """

    def __init__(self, unit: str, doing: str, *, quiet: bool = False) -> None:
        super().__init__()
        self.doing = doing
        self._quiet = quiet
        self._line = MovingLine(unit)
        self._moves = False
        self._left = ""
        self._over = threading.Event()

    def __enter__(self) -> Self:
        """Begin."""
        if not self._quiet:
            self.callback(self._line.close)
            self.callback(self._over.set)
            threading.Thread(target=self._tell, daemon=True).start()
        return super().__enter__()

    def _tell(self) -> None:
        """Print the current work and its time so far, if there is no moving line."""
        begun = time.monotonic()
        seconds = FIRST_SECONDS
        while not self._over.wait(seconds):
            if not self._moves:
                passed = time.monotonic() - begun
                note(f"{self.doing}: {passed:.0f} s so far{self._left}")
            seconds = LINE_SECONDS

    def show(self, done: int, total: int, name: str = "") -> None:
        """Show the count out of the total."""
        self.doing, self._left = self._line.words(done, total, name)
        if not self._quiet:
            self._moves = self._line.watched
            self._line.show(self.doing + self._left)
