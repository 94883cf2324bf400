# Copyright 2026 The sparse_coord_ros authors
# SPDX-License-Identifier: Apache-2.0
"""One publisher a topic: a second one is noticed and named.

rclpy does not say who sent a message, so what a second publisher says cannot be told apart; the
graph says that there is one.
"""

from collections.abc import Iterable

from rclpy.node import Node

AT_ONCE = 5
"""Topics that one look takes in; with each look the next ones."""


UNKNOWN = "NODE_NAME_UNKNOWN"
"""Part of what rcl calls a node that it has only half discovered."""


class Owners:
    """Watches topics that one node each should publish.

    Args:
        node: looks at the graph, and warns.
        topics: the topics' full names.

    Attributes:
        doubled: those that a second node was seen to publish.
    """

    def __init__(self, node: Node, topics: Iterable[str]) -> None:
        self._node = node
        self._topics = list(topics)
        self._next = 0
        self.doubled: set[str] = set()

    def look(self) -> None:
        """Look at some of the topics, and warn once of each that has a second publisher."""
        for _ in range(min(AT_ONCE, len(self._topics))):
            topic = self._topics[self._next]
            self._next = (self._next + 1) % len(self._topics)
            infos = self._node.get_publishers_info_by_topic(topic)
            known = not any(UNKNOWN in info.node_name for info in infos)
            if len(infos) > 1 and known and topic not in self.doubled:
                self.doubled.add(topic)
                names = sorted(f"{i.node_namespace.rstrip('/')}/{i.node_name}" for i in infos)
                self._node.get_logger().warning(
                    f"{topic} has {len(infos)} publishers, {', '.join(names)}; one should publish "
                    "it: stop the others (a node that was killed is forgotten after 20 s)"
                )
