# Copyright 2026 The sparse_coord_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Subscriptions: bytes from the network become messages, or are dropped.

A message that cannot be decoded, or does not fit the run, is dropped and counted by its topic,
with one warning a topic; it never ends a node. An exception in a callback stops the node.
"""

from collections import Counter
from collections.abc import Callable
from typing import Any

from rclpy.node import Node
from rclpy.qos import QoSProfile
from rclpy.serialization import deserialize_message

from sparse_coord_ros.base.errors import SparseCoordError, failure_of, message_of
from sparse_coord_ros.ros.nodes.ros_topics import RosTopic


class Subscriber:
    """A node's subscriptions.

    Args:
        node: the node.
        fail: stops the node, because of an error.

    Attributes:
        dropped: number of dropped messages, by topic or service.
    """

    def __init__(self, node: Node, fail: Callable[[SparseCoordError], None]) -> None:
        self._node = node
        self._fail = fail
        self.dropped: Counter[str] = Counter()
        self._left: set[Callable[[bytes], None]] = set()

    def listen(
        self,
        topic: RosTopic,
        then: Callable[[Any], None],
        owner: str = "",
        *,
        name: str = "",
        read: Callable[[Any], Any] = lambda message: message,
        qos: QoSProfile | None = None,
    ) -> Any:
        """Subscribe to the messages of a team, a robot or a node; return the subscription.

        Args:
            topic: the topic.
            then: called with a message's content.
            owner: the topic's owner.
            name: the topic's name, if given.
            read: returns the content of a message object; any exception drops the message.
            qos: the subscription's profile; None: that of the topic.
        """

        def unpack(data: bytes) -> tuple[Any]:
            return (read(deserialize_message(data, topic.type)),)

        return self.listen_packed(topic, unpack, then, owner, name=name, qos=qos)

    def listen_packed(
        self,
        topic: RosTopic,
        unpack: Callable[[bytes], tuple[Any, ...]],
        then: Callable[..., None],
        owner: str = "",
        *,
        name: str = "",
        qos: QoSProfile | None = None,
    ) -> Any:
        """Subscribe to the bytes of messages; return the subscription.

        Args:
            topic: the topic.
            unpack: returns the arguments of `then` from a message's bytes; any exception drops
                the message.
            then: called with them.
            owner: the topic's owner.
            name: the topic's name, if given.
            qos: as of `listen`.
        """
        name = name or topic.of(owner)

        def take(data: bytes) -> None:
            if take in self._left:
                return
            try:
                content = unpack(data)
            except Exception as error:  # errors of rclpy, struct, Unicode and others
                self.drop(name, error)
                return
            try:
                then(*content)
            except Exception as error:
                self._fail(failure_of(error))

        profile = topic.qos if qos is None else qos
        return self._node.create_subscription(topic.type, name, take, profile, raw=True)

    def leave(self, subscription: Any) -> None:
        """Destroy a subscription; messages that the executor still has for it are dropped."""
        self._left.add(subscription.callback)
        self._node.destroy_subscription(subscription)

    def drop(self, name: str, why: object, done: str = "message dropped") -> None:
        """Count an invalid message of a topic or service, and log the first one.

        Args:
            name: of the topic or service.
            why: the message's error.
            done: its treatment, for the log.
        """
        self.dropped[name] += 1
        if self.dropped[name] == 1:
            self._node.get_logger().warning(
                f"{name}: {message_of(why)}; {done}; further ones are only "
                "counted (diagnostics)"
            )

    @property
    def total(self) -> int:
        """The number of dropped messages."""
        return self.dropped.total()
