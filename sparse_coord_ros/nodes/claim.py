# Copyright 2026 The sparse_coord_ros authors
# SPDX-License-Identifier: Apache-2.0
"""One holder a name: a starting node finds out whether its name is taken.

Names are claimed by publishing on a topic that only the holder publishes on, and held by
offering a service. A starter that sees the service loses; two starters who see each other's
publishers compare endpoint identifiers. Nobody who holds a name ever gives way.
"""

from rclpy.node import Node

from sparse_coord_ros.errors import RunError


class Claim:
    """A claim to a name.

    Create it before the publisher on `topic`; call `check` when the claim window has passed and
    before creating `service`.

    Args:
        node: the claiming node.
        topic: the topic that only the holder publishes on.
        service: the service that the holder offers.
        what: what an error message calls the name.
    """

    def __init__(self, node: Node, topic: str, service: str, what: str) -> None:
        self._node, self._what = node, what
        self._topic = node.resolve_topic_name(topic)
        self._service = node.resolve_service_name(service)
        self._before = self._publishers()
        self._mine: set[tuple] = set()

    def published(self) -> None:
        """Note one's own publisher; call it right after creating it."""
        self._mine = self._publishers() - self._before

    def check(self) -> None:
        """Raise `RunError` where the name is taken."""
        others = self._publishers() - self._mine
        held = self._node.count_services(self._service) > 0
        if held or (others and min(others) < min(self._mine)):
            raise RunError(
                f"{self._what} is taken: another node publishes on {self._topic}; stop that node, "
                "or start this one under another name or namespace"
            )

    def _publishers(self) -> set[tuple]:
        infos = self._node.get_publishers_info_by_topic(self._topic)
        return {tuple(info.endpoint_gid) for info in infos}
