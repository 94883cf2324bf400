# Copyright 2026 The sparse_coord_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Single keys from the terminal, whose settings are restored afterwards."""

import contextlib
import os
import re
import select
import termios
import tty

STDIN = 0
KEYS = {
    b" ": "pause",
    b"\x1b[C": "step",
    b"\x1b[D": "back",
    b"\x1b[5~": "back",
    b"\x1b[6~": "on",
    b"\x1b[A": "faster",
    b"\x1b[B": "slower",
    b"\x1b[H": "start",
    b"\x1b[1~": "start",  # tmux, screen, the Linux console
    b"\x1b[7~": "start",  # rxvt
    b"q": "quit",
}
"""What the keys mean: space, right, left, Page Up, Page Down, up, down, Home and q."""

_SEQUENCE = re.compile(rb"\x1b[\[O][0-9;]*[A-Za-z~]|.", re.DOTALL)


class Keyboard:
    """The keys typed at this process; none unless standard input is its terminal.

    A process in the background leaves the terminal alone: reading or setting it would stop it.

    Attributes:
        there: whether there is a terminal to type at.
    """

    def __init__(self, descriptor: int = STDIN) -> None:
        self._descriptor = descriptor
        self._before: list | None = None
        self.there = os.isatty(descriptor) and self._in_front()
        if self.there:
            self._before = termios.tcgetattr(descriptor)

    def read(self) -> list[str]:
        """Return the meanings of the keys typed since the last call, without waiting."""
        if not (self.there and self._in_front()):
            return []
        try:
            # Read keys without Enter or echo; set this again after the shell had the terminal.
            if termios.tcgetattr(self._descriptor)[tty.LFLAG] & termios.ICANON:
                tty.setcbreak(self._descriptor, termios.TCSADRAIN)
            waits = select.select([self._descriptor], [], [], 0)[0]
            typed = os.read(self._descriptor, 1024) if waits else b""
        except (OSError, termios.error):  # the terminal is gone
            self.there = False
            return []
        typed = typed.replace(b"\x1bO", b"\x1b[")
        return [KEYS[key] for key in _SEQUENCE.findall(typed) if key in KEYS]

    def close(self) -> None:
        """Restore the terminal's settings; a second call does nothing."""
        before = self._before
        self._before = None
        self.there = False
        if before is not None and self._in_front():
            with contextlib.suppress(termios.error):  # it is gone by now
                termios.tcsetattr(self._descriptor, termios.TCSADRAIN, before)

    def _in_front(self) -> bool:
        try:
            return os.tcgetpgrp(self._descriptor) == os.getpgrp()
        except OSError:
            return False
