# Copyright 2026 The sparse_coord_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Between the source and the pages: the newest message of each type, and nothing else.

A source puts messages there from any thread and never waits. Each page takes what is newer than
what it has had: a slow page misses messages and delays no other.
"""

import json
import threading
from collections.abc import Callable
from typing import Any

from sparse_coord_ros.show.page.controls import Controlled

Message = dict[str, Any]


class MessageBoard:
    """The newest message of each type.

    Attributes:
        pages: number of open pages; costly messages are not made while it is 0.
        source: carries out what the pages ask for; None: no controls.
        look: returns the message for a cell and a peer's cell that a page points at; None:
            nothing is known so far.
    """

    def __init__(self) -> None:
        self._lock = threading.Lock()
        self._messages: dict[str, tuple[int, Message]] = {}
        self._version = 0
        self.pages = 0
        self.source: Controlled | None = None
        self.look: Callable[[int, int], Message] | None = None

    def put(self, kind: str, **fields: Any) -> None:
        """Put a message in place of the one before of its type."""
        with self._lock:
            self._version += 1
            self._messages[kind] = (self._version, {"type": kind, **fields})

    def put_new(self, kind: str, **fields: Any) -> None:
        """Put a message, if anything differs from the one before of its type."""
        if self.get(kind) != {"type": kind, **fields}:
            self.put(kind, **fields)

    def clear(self) -> None:
        """Take all messages away, as another run begins."""
        with self._lock:
            self._messages.clear()
        self.look = None

    def get(self, kind: str) -> Message | None:
        """Return the newest message of a type."""
        entry = self._messages.get(kind)
        return None if entry is None else entry[1]

    def newer(self, seen: int) -> list[tuple[int, str]]:
        """Return version and text of the messages that are newer than a version, oldest first."""
        with self._lock:
            due = sorted(entry for entry in self._messages.values() if entry[0] > seen)
        return [
            (version, json.dumps(message, allow_nan=False, separators=(",", ":")))
            for version, message in due
        ]
