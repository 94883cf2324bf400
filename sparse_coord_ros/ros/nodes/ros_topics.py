# Copyright 2026 The sparse_coord_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The topics of `wire` for rclpy: bound to message classes and QoS profiles.

Names are relative (except /diagnostics and the topics that ROS itself makes absolute), so a whole
team moves into a namespace together. A robot's topics lie under its name.
"""

import functools
import importlib
from dataclasses import dataclass
from typing import Any

from rclpy.qos import DurabilityPolicy, QoSProfile

from sparse_coord_ros.protocol import wire
from sparse_coord_ros.protocol.wire import Delivery, services

RECORDED_DEPTH = 4_000
"""For publishers and readers of each time step. The world waits for a recorder that is more than
half as many time steps behind. It does not wait for a robot that has arrived; one that lags still
learns from its last move."""

QOS_PROFILES = {
    Delivery.STEP: QoSProfile(depth=RECORDED_DEPTH),
    Delivery.EVENT: QoSProfile(depth=10),
    Delivery.LATCHED: QoSProfile(depth=1, durability=DurabilityPolicy.TRANSIENT_LOCAL),
    Delivery.TABLES: QoSProfile(
        depth=wire.TABLES_DEPTH, durability=DurabilityPolicy.TRANSIENT_LOCAL
    ),
}
"""QoS of the publishers, always reliable (rclpy's default)."""
LATCHED_QOS = QOS_PROFILES[Delivery.LATCHED]


def message_class(type_name: str) -> Any:
    """Return the class of a type such as `std_msgs/msg/String`, or of a service or its events."""
    package, kind, name = type_name.split("/")
    base, _, part = name.partition("_")
    plain = getattr(importlib.import_module(f"{package}.{kind}"), base)
    return getattr(plain, part) if part else plain


@dataclass(frozen=True, kw_only=True)
class RosTopic(wire.Topic):
    """A topic of the vocabulary for rclpy.

    Attributes:
        type: message class.
        qos: the publisher's profile.
    """

    type: Any
    qos: QoSProfile


@functools.cache
def bind(topic: wire.Topic) -> RosTopic:
    """Return a topic of the vocabulary with its message class and QoS profile."""
    kind = message_class(topic.type_name)
    qos = QOS_PROFILES[topic.delivery]
    return RosTopic(**vars(topic), type=kind, qos=qos)


def __getattr__(name: str) -> RosTopic:
    """Return a topic of `wire`, bound: `ros_topics.RUN` is `wire.RUN` for rclpy."""
    topic = getattr(wire, name, None)
    if not isinstance(topic, wire.Topic):
        raise AttributeError(
            f"{__name__} has no {name}, and the vocabulary no such topic"
        )
    return bind(topic)


def recorded(owner: wire.Owner) -> tuple[RosTopic, ...]:
    """Return the topics of an owner that a recorder records."""
    return tuple(
        bind(topic) for topic in wire.TOPICS if topic.recorded and topic.owner == owner
    )


def recorder_qos(topic: RosTopic) -> QoSProfile:
    """Return the QoS profile of a recorder, which may lag."""
    return QoSProfile(depth=RECORDED_DEPTH, durability=topic.qos.durability)


def kept_qos(topic: RosTopic) -> QoSProfile:
    """Return the QoS profile of a topic for a recorder in another process.

    A process that stands still is forgotten after 5 s (`config/fastdds.xml`). So that a recorder
    misses nothing then, publishers keep the messages of time steps.
    """
    if topic.delivery != Delivery.STEP:
        return topic.qos
    return QoSProfile(depth=RECORDED_DEPTH, durability=DurabilityPolicy.TRANSIENT_LOCAL)


ACTIVE_PERCEPTION_TYPE = message_class(services.ACTIVE_PERCEPTION.type_name)
