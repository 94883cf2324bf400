# Copyright 2026 The sparse_coord_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Progress of long calls: a bar with the time left, at a terminal and in notebooks."""

import sys
import time
from collections.abc import Callable
from typing import Any

from sparse_coord_ros.base.errors import SettingError, in_short

SHOWN_AFTER = 2.0
"""Seconds of work before a bar appears."""

Show = bool | Callable[..., None]
"""The argument `progress`: True: a bar; False: nothing; a function: called instead."""


class ProgressBar:
    """A function that shows what is done, of all that there is to do; nothing of short work.

    Args:
        unit: the counted unit.
    """

    def __init__(self, unit: str) -> None:
        self._unit = unit
        self._began = time.monotonic()
        self._bar: Any = None

    def __call__(self, done: int, total: int) -> None:
        """Show it, where someone watches."""
        if self._bar is None:
            if time.monotonic() - self._began < SHOWN_AFTER:
                return
            self._bar = _new_bar(done, total, self._unit)
        self._bar.update(done - self._bar.n)
        if done >= total:
            self._bar.close()


def _new_bar(done: int, total: int, unit: str) -> Any:
    from tqdm.auto import tqdm

    notebook = "ipykernel" in sys.modules
    return tqdm(
        total=total,
        initial=done,
        unit=f" {unit}",
        unit_scale=True,
        leave=False,
        disable=False if notebook else None,  # None: only at a terminal
    )


def shown(progress: Show, unit: str, *, named: bool = False) -> Callable[..., None]:
    """Return the function to call with what is done, and all that there is to do.

    Args:
        progress: the user's argument.
        unit: the counted unit.
        named: whether the function is also called with a name, before these.

    Raises:
        SettingError: it is neither a bool nor a function.
    """
    if progress is True:
        bar = ProgressBar(unit)
        return (lambda name, done, total: bar(done, total)) if named else bar
    if progress is False:
        return lambda *_: None
    if callable(progress):
        return progress
    allowed = "True (a bar), False (nothing) or a function"
    raise SettingError(f"progress: value is {in_short(progress)}, allowed: {allowed}")


def in_time(seconds: float) -> str:
    """Return a time in words: "40 s", "12 min", "3.5 h"."""
    if seconds < 100:
        return f"{seconds:.0f} s"
    if seconds < 6000:
        return f"{seconds / 60:.0f} min"
    return f"{seconds / 3600:.1f} h"
