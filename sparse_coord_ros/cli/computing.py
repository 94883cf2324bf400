# Copyright 2026 The sparse_coord_ros authors
# SPDX-License-Identifier: Apache-2.0
"""What computes runs and where: options, notes on numba, and a line of progress."""

import argparse
import sys
from contextlib import ExitStack
from typing import Any

from tqdm import tqdm

from sparse_coord_ros.cli.options import Option, note
from sparse_coord_ros.engine.batch import ENGINES, uses_numba
from sparse_coord_ros.engine.cluster import JOBS

COMPUTING = (
    Option("--engine", ENGINES, "the results are the same; auto: numba where it is installed"),
    Option("--jobs", JOBS.parse, f"{JOBS.help} (default: all cores)"),
    Option(
        "--scheduler ADDRESS",
        None,
        "of a Dask cluster to compute on, e.g. tcp://10.0.0.1:8786 (default: this machine)",
    ),
)
"""What computes, and where."""


def computing_of(options: argparse.Namespace) -> dict[str, Any]:
    """Return what the options say of engine, jobs and scheduler; say so where numba is missing."""
    compiled = options.scheduler is not None or uses_numba(options.engine)
    if options.engine == "auto" and not compiled:
        note_without_numba()
    return {name: getattr(options, name) for name in ("engine", "jobs", "scheduler")}


def note_without_numba() -> None:
    """Say what numba would bring."""
    note("numba is not installed: plain Python, about 100 times slower; pip install numba")


class Bar(ExitStack):
    """A line of progress on stderr, at a terminal only, whose clock starts where work begins.

    Args:
        unit: what is counted.
        quiet: whether to show nothing.
    """

    def __init__(self, unit: str, *, quiet: bool = False) -> None:
        super().__init__()
        self._unit, self._quiet = unit, quiet
        self._bar: tqdm | None = None

    def show(self, done: int, total: int, name: str = "") -> None:
        """Show what is done of all that there is."""
        if self._bar is None:
            bar = tqdm(
                total=total,
                initial=done,
                unit=f" {self._unit}",
                unit_scale=True,
                leave=False,
                disable=True if self._quiet else None,
                file=sys.stderr,
                smoothing=0.05,
            )
            self._bar = self.enter_context(bar)
        self._bar.set_description(name)
        self._bar.update(done - self._bar.n)
