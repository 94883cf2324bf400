# Copyright 2026 The sparse_coord_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The short way from a publisher to a recorder in the same process.

A subscription of the recorder costs about a tenth of a time step for each message, and a time step
has seven. So where world, robots and recorder share a process, what they publish at every
time step is handed to the recorder as bytes, beside being published.
"""

from collections.abc import Callable
from typing import Any

from rclpy.publisher import Publisher


class Line:
    """From the publisher of one topic to the recorder.

    Attributes:
        write: takes each message's bytes; None: no recorder listens.
    """

    __slots__ = ("write",)

    def __init__(self) -> None:
        self.write: Callable[[bytes], None] | None = None


class Tap:
    """The lines of one process, by the topics' full names.

    Attributes:
        closed: the recorder has failed; nobody waits for it any more.
    """

    def __init__(self) -> None:
        self.closed = False
        self._lines: dict[str, Line] = {}

    def line(self, topic: str) -> Line:
        """Return the line of a topic; publisher and recorder may ask in any order."""
        return self._lines.setdefault(topic, Line())

    def close(self) -> None:
        """Let nobody listen any more."""
        self.closed = True
        for line in self._lines.values():
            line.write = None


class PackedPublisher(Publisher):
    """A publisher of serialised messages, which hands them to a recorder too.

    rclpy's own `publish` asks each time what kind of message it is given, and keeps other threads
    from destroying the publisher meanwhile: half of what it costs where nobody listens.

    Attributes:
        line: its line.
        send: rclpy's `publish_raw`.
    """

    line: Line
    send: Callable[[bytes], None]

    def publish(self, msg: Any) -> None:
        """Publish a message's bytes."""
        self.send(msg)
        if self.line.write is not None:
            self.line.write(msg)
