# Copyright 2026 The sparse_coord_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The topics of a bag that are played, and their publishers: recorded names, types and QoS."""

from collections.abc import Sequence
from pathlib import Path

from rclpy.exceptions import InvalidTopicNameException
from rclpy.node import Node
from rclpy.publisher import Publisher
from rclpy.qos import DurabilityPolicy, HistoryPolicy, QoSProfile, ReliabilityPolicy

from sparse_coord_ros.base.errors import BagError, message_of
from sparse_coord_ros.log.bags import Bag, BagTopic, Message, QoS, open_bag, type_hash
from sparse_coord_ros.log.bags.topics import latched
from sparse_coord_ros.protocol import wire
from sparse_coord_ros.protocol.wire.messages import CLOCK_FORM, SECOND
from sparse_coord_ros.ros.nodes import ros_topics

ROS_OWN = (wire.ROSOUT.name, wire.PARAMETER_EVENTS.name)
"""Topics that every node has itself."""


class PlayedTopics:
    """The publishers of a bag's topics, and of a clock if the bag has none.

    Warns of topics that cannot be played.

    Args:
        node: the node that publishes.
        path: the bag.

    Attributes:
        bag: the bag.
        publishers: by topic.
        clock_name: the topic of the clock.
        clock: its publisher; None if the bag's own clock is played.

    Raises:
        SparseCoordError: no bag, or no topic that can be played.
    """

    def __init__(self, node: Node, path: Path) -> None:
        bag = self.bag = open_bag(path)
        names = chosen_topics(bag)
        warn = node.get_logger().warning
        early = bag.ends_early(f"message {bag.message_count}")
        if early is not None:
            warn(f"{bag.path}: {early}")
        self.publishers: dict[str, Publisher] = {}
        skipped = []
        for name in names:
            topic = bag.topics[name]
            try:
                kind = class_of(topic)
                qos = offered_qos(topic.qos)
                self.publishers[name] = node.create_publisher(kind, name, qos)
            except (
                ImportError,
                AttributeError,
                ValueError,
                InvalidTopicNameException,
            ) as error:
                skipped.append(f"{name} ({message_of(error)})")
        if not self.publishers:
            why = ", ".join(skipped) or "it has none"
            raise BagError(f"bag {bag.path}: no topic can be played: {why}")
        if skipped:
            warn(f"not played: {', '.join(skipped)}")
        self._send = {
            name: publisher.publish for name, publisher in self.publishers.items()
        }
        recorded_clock = bag.clock
        clock = ros_topics.CLOCK
        self.clock_name = (
            node.resolve_topic_name(clock.name)
            if recorded_clock is None
            else recorded_clock
        )
        self.clock: Publisher | None = None
        if recorded_clock not in self.publishers or not bag.counts[recorded_clock]:
            self.clock = node.create_publisher(clock.type, clock.name, clock.qos)
        self._told_ns: int | None = None

    @property
    def kept(self) -> list[str]:
        """Topics whose last message stays valid until the next: the clock, latched ones."""
        topics = self.bag.topics
        return [
            n for n in self.publishers if n == self.clock_name or latched(topics[n].qos)
        ]

    def publish(self, message: Message) -> None:
        """Publish a message of the bag."""
        self._send[message.topic](message.data)

    def tell(self, time_ns: int) -> None:
        """Publish the time if the bag itself has no clock."""
        if self.clock is not None and time_ns != self._told_ns:
            self._told_ns = time_ns
            seconds, nanosec = divmod(time_ns, SECOND)
            self.clock.publish(CLOCK_FORM.layout.pack(min(seconds, 2**31 - 1), nanosec))


def chosen_topics(bag: Bag) -> list[str]:
    """Return the topics to play: all but `ROS_OWN`, which would disturb live nodes."""
    return sorted(set(bag.topics) - set(ROS_OWN))


def class_of(topic: BagTopic) -> type:
    """Return the class of a topic's messages, the one that wrote the recorded bytes.

    Raises:
        ValueError: the type is not installed, or another version of it is.
    """
    name = topic.type_name
    if topic.encoding != "cdr":
        raise ValueError(f"its messages are {topic.encoding}, not cdr")
    try:
        message_type: type = ros_topics.message_class(name)
    except (ImportError, AttributeError, ValueError):
        raise ValueError(f"type {name} is not installed") from None
    if topic.type_hash and type_hash(name) not in ("", topic.type_hash):
        raise ValueError(f"type {name} is installed in another version")
    return message_type


def offered_qos(profiles: Sequence[QoS]) -> QoSProfile:
    """Return a profile that offers at least as much as each of the recorded publishers."""
    profiles = profiles or (QoS(),)
    reliable = any(qos.reliability == "reliable" for qos in profiles)
    offered = QoSProfile(depth=max(1, *(qos.depth for qos in profiles)))
    if not reliable:
        offered.reliability = ReliabilityPolicy.BEST_EFFORT
    if latched(profiles):
        offered.durability = DurabilityPolicy.TRANSIENT_LOCAL
    if any(qos.history == "keep_all" for qos in profiles):
        offered.history = HistoryPolicy.KEEP_ALL
    return offered
