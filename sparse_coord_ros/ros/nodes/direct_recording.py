# Copyright 2026 The sparse_coord_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Direct hand-over of messages from publishers to a recorder in the same process.

A subscription of the recorder costs about a tenth of a time step for each message, and a time step
has seven messages. Where world, robots and recorder share a process, the messages of every time
step go to the recorder as bytes, beside being published.
"""

from collections.abc import Callable
from typing import Any

from rclpy.publisher import Publisher


class DirectTopic:
    """Hands the messages of one topic to the recorder.

    Attributes:
        write: takes each message's bytes; None while no recorder listens.
    """

    __slots__ = ("write",)

    def __init__(self) -> None:
        self.write: Callable[[bytes], None] | None = None


class DirectRecording:
    """The topics of one process that are recorded directly.

    Attributes:
        closed: the recorder has failed; the other nodes no longer wait for it.
    """

    def __init__(self) -> None:
        self.closed = False
        self._topics: dict[str, DirectTopic] = {}

    def topic(self, name: str) -> DirectTopic:
        """Return the topic of a full name; publisher and recorder may ask in any order."""
        return self._topics.setdefault(name, DirectTopic())

    def close(self) -> None:
        """Disconnect the recorder from all topics."""
        self.closed = True
        for topic in self._topics.values():
            topic.write = None


class PackedPublisher(Publisher):
    """A publisher of serialised messages, which hands them to a recorder too.

    rclpy's own `publish` checks the type of each message and locks the publisher against its
    destruction by another thread. Without a subscriber these checks are half of its cost.

    Attributes:
        direct: hands the messages to a recorder.
        send: rclpy's `publish_raw`.
    """

    direct: DirectTopic
    send: Callable[[bytes], None]

    def publish(self, msg: Any) -> None:
        """Publish a message's bytes."""
        self.send(msg)
        if self.direct.write is not None:
            self.direct.write(msg)
