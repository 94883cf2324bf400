# Copyright 2026 The sparse_coord_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Subscriptions: bytes from the network become messages, or are dropped.

Any node can publish anything on any topic. A message that cannot be decoded, or does not fit the
run, is dropped and counted by its topic, with one warning a topic; it never ends a node.
"""

from collections import Counter
from collections.abc import Callable
from typing import Any

from rclpy.node import Node
from rclpy.qos import QoSProfile
from rclpy.serialization import deserialize_message

from sparse_coord_ros.base.errors import message_of
from sparse_coord_ros.ros.nodes.ros_topics import RosTopic


class Subscriber:
    """A node's subscriptions.

    Args:
        node: the node; its callbacks are guarded (`parameters.ParameterNode`).

    Attributes:
        dropped: number of dropped messages, by topic or service.
    """

    def __init__(self, node: Node) -> None:
        self._node = node
        self.dropped: Counter[str] = Counter()

    def listen(
        self,
        topic: RosTopic,
        then: Callable[[Any], None],
        owner: str = "",
        *,
        name: str = "",
        read: Callable[[Any], Any] = lambda message: message,
        unpack: Callable[[bytes], Any] | None = None,
        qos: QoSProfile | None = None,
    ) -> Any:
        """Subscribe to a topic of the team, a robot or a node; return the subscription.

        Args:
            topic: the topic.
            then: called with a message's content.
            owner: the topic's owner.
            name: the topic's name, if given.
            read: returns the content of a message object; any exception drops the message.
            unpack: returns the content of a message's bytes; in place of `read`.
            qos: the subscription's profile; None: that of the topic.
        """
        name = name or topic.of(owner)

        def take(data: bytes) -> None:
            try:
                said = (
                    unpack(data)
                    if unpack
                    else read(deserialize_message(data, topic.type))
                )
            except Exception as error:  # errors of rclpy, struct, Unicode and others
                self.drop(name, error)
                return
            then(said)

        return self._node.create_subscription(
            topic.type, name, take, topic.qos if qos is None else qos, raw=True
        )

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
