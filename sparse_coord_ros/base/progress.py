# Copyright 2026 The sparse_coord_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Progress of long calls: a bar with the time left, at a terminal and in notebooks."""

import math
import shutil
import sys
import time
from collections.abc import Callable

from sparse_coord_ros.base.errors import SettingError, in_short

SHOWN_AFTER = 2.0
"""Seconds of work before a bar appears."""

DRAWN_AFTER = 0.1
"""Seconds between two drawings of a moving line."""

Show = bool | Callable[..., None]
"""The argument `progress`: True: a bar; False: nothing; a function: called instead."""


class MovingLine:
    """A line on stderr that is drawn over itself, where someone watches.

    Args:
        unit: the counted unit.

    Attributes:
        watched: whether stderr is a terminal or a notebook; elsewhere nothing is drawn.
    """

    def __init__(self, unit: str) -> None:
        self.watched = sys.stderr.isatty() or "ipykernel" in sys.modules
        self._unit = unit
        self._first = (0, 0.0)
        self._done = math.inf
        self._drawn_at = 0.0
        self._length = 0

    def words(self, done: int, total: int, name: str = "") -> tuple[str, str]:
        """Return the count in words, and the time left at the pace since the first count.

        A count that falls is the first one of other work.
        """
        now = time.monotonic()
        if done < self._done:
            self._first = done, now
        self._done = done
        made = done - self._first[0]
        left = ""
        if made > 0:
            seconds = (now - self._first[1]) / made * (total - done)
            left = f", about {in_time(seconds)} left"
        return f"{name} {done:,} of {total:,} {self._unit}".lstrip(), left

    def show(self, text: str) -> None:
        """Draw the end of a text, as much as fits, if the one before has stood long enough."""
        if not self.watched or time.monotonic() - self._drawn_at < DRAWN_AFTER:
            return
        # A terminal would go on in a further line, which is not drawn over.
        self._write(text[1 - shutil.get_terminal_size().columns :])
        self._drawn_at = time.monotonic()

    def close(self) -> None:
        """Leave an empty line."""
        if self._length:
            self._write("")

    def _write(self, text: str) -> None:
        blank = " " * (self._length - len(text))
        end = "\r" if not text else ""
        print(f"\r{text}{blank}{end}", end="", file=sys.stderr, flush=True)
        self._length = len(text)


class ProgressBar:
    """A function that shows what is done, of all that there is to do; nothing of short work.

    Args:
        unit: the counted unit.
    """

    def __init__(self, unit: str) -> None:
        self._began = time.monotonic()
        self._line = MovingLine(unit)

    def __call__(self, done: int, total: int) -> None:
        """Show it, where someone watches."""
        count, left = self._line.words(done, total)
        if done >= total:
            self._line.close()
        elif time.monotonic() - self._began >= SHOWN_AFTER:
            self._line.show(count + left)


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
