# Copyright 2026 The sparse_coord_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Between the source and the pages: the newest message of each type, and nothing else.

A source puts messages there from any thread and never waits. Each page takes what is newer than
what it has had: whoever is slow misses messages, and nobody waits for it.
"""

import json
import threading
from collections.abc import Mapping
from typing import Any

from sparse_coord_ros.look.page.messages import Message

ORDER = ("run", "notice", "frame", "tables", "asked", "curves", "dialogue", "evaluation")
"""The types of messages, in the order in which a page gets them."""


class Board:
    """The newest message of each type.

    Attributes:
        watched: whether a page is there; what is costly need not be made where none is.
    """

    def __init__(self) -> None:
        self._lock = threading.Lock()
        self._messages: dict[str, tuple[int, Message]] = {}
        self._texts: dict[str, tuple[int, str]] = {}
        self._version = 0
        self._pages = 0

    @property
    def watched(self) -> bool:
        """Whether a page is there."""
        return self._pages > 0

    def page_came(self) -> None:
        """Note that a page is there."""
        with self._lock:
            self._pages += 1

    def page_left(self) -> None:
        """Note that it is gone."""
        with self._lock:
            self._pages -= 1

    def put(self, message: Message) -> None:
        """Put a message in place of the one before of its type."""
        with self._lock:
            self._version += 1
            self._messages[message["type"]] = (self._version, message)

    def clear(self) -> None:
        """Take all messages away, as another run begins."""
        with self._lock:
            self._messages.clear()
            self._texts.clear()

    def get(self, kind: str) -> Message | None:
        """Return the newest message of a type."""
        found = self._messages.get(kind)
        return None if found is None else found[1]

    def newer(self, seen: Mapping[str, int]) -> list[tuple[str, int, str]]:
        """Return type, version and text of the messages that are newer than what was seen."""
        with self._lock:
            due = {k: m for k, m in self._messages.items() if m[0] > seen.get(k, 0)}
        found = []
        for kind in sorted(due, key=_place):
            version, message = due[kind]
            text = self._texts.get(kind)
            if text is None or text[0] != version:
                text = self._texts[kind] = (version, _json(message))
            found.append((kind, version, text[1]))
        return found


def _place(kind: str) -> int:
    return ORDER.index(kind) if kind in ORDER else len(ORDER)


def _json(message: Any) -> str:
    return json.dumps(message, allow_nan=False, separators=(",", ":"))
