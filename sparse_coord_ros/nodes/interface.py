# Copyright 2026 The sparse_coord_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The vocabulary of `wire`, bound to message classes and QoS profiles.

Names are relative (except /clock, /diagnostics and what ROS itself makes absolute), so a whole
team moves into a namespace together. A robot's topics lie under its name.
"""

import functools
import importlib
from dataclasses import dataclass, fields
from typing import Any

from rclpy.qos import DurabilityPolicy, HistoryPolicy, QoSProfile, ReliabilityPolicy

from sparse_coord_ros import wire

STEP_DEPTH = 10_000
RECORDER_DEPTH = 10_000


def _qos(depth: int, durability: DurabilityPolicy = DurabilityPolicy.VOLATILE) -> QoSProfile:
    return QoSProfile(
        reliability=ReliabilityPolicy.RELIABLE,
        durability=durability,
        history=HistoryPolicy.KEEP_LAST,
        depth=depth,
    )


STEP_QOS = _qos(STEP_DEPTH)
"""Reliable, volatile. The lock step needs a depth of 2; the rest is for a recorder that lags."""

EVENT_QOS = _qos(10)
"""Reliable, volatile, for what comes seldom."""

LATCHED_QOS = _qos(1, DurabilityPolicy.TRANSIENT_LOCAL)
"""Reliable, transient local: a late subscriber gets the last message."""

TABLES_QOS = _qos(wire.TABLES_DEPTH, DurabilityPolicy.TRANSIENT_LOCAL)
"""As `LATCHED_QOS`, with those before, for a recorder that is to get all of them."""

RECORDER_QOS = _qos(RECORDER_DEPTH)
RECORDER_LATCHED_QOS = _qos(RECORDER_DEPTH, DurabilityPolicy.TRANSIENT_LOCAL)
"""What the recorder asks for: on its side nothing is overwritten before it is written down."""

PROFILES = {
    wire.STEP: STEP_QOS,
    wire.EVENT: EVENT_QOS,
    wire.LATCHED: LATCHED_QOS,
    wire.TABLES_KEPT: TABLES_QOS,
}


def message_class(type_name: str) -> Any:
    """Return the class of a type such as `std_msgs/msg/String`, or of a service or its events."""
    package, kind, name = type_name.split("/")
    base, _, part = name.partition("_")
    found = getattr(importlib.import_module(f"{package}.{kind}"), base)
    return getattr(found, part) if part else found


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
    said = {field.name: getattr(topic, field.name) for field in fields(wire.Topic)}
    return RosTopic(**said, type=message_class(topic.type_name), qos=PROFILES[topic.delivery])


RUN = bind(wire.RUN)
STATUS = bind(wire.STATUS)
CLOCK = bind(wire.CLOCK)
MAP = bind(wire.MAP)
MARKERS = bind(wire.MARKERS)
SCENE = bind(wire.SCENE)
DIAGNOSTICS = bind(wire.DIAGNOSTICS)
LOCAL_STATE = bind(wire.LOCAL_STATE)
REWARD = bind(wire.REWARD)
ACTION = bind(wire.ACTION)
PERCEPT = bind(wire.PERCEPT)
COORDINATION_MAP = bind(wire.COORDINATION_MAP)
PROGRESS = bind(wire.PROGRESS)
TABLES = bind(wire.TABLES)
CLAIM = bind(wire.CLAIM)
RECORDING = bind(wire.RECORDING)
SERVICE_EVENTS = bind(wire.SERVICE_EVENTS)
BODY_GOALS = bind(wire.BODY_GOALS)
REACHED = bind(wire.REACHED)
POSE = bind(wire.POSE)
ODOMETRY = bind(wire.ODOMETRY)
CMD_VEL = bind(wire.CMD_VEL)
ROSOUT = bind(wire.ROSOUT)
PARAMETER_EVENTS = bind(wire.PARAMETER_EVENTS)

TEAM_TOPICS = tuple(map(bind, wire.TEAM_TOPICS))
ROBOT_TOPICS = tuple(map(bind, wire.ROBOT_TOPICS))

CLAIMS_QOS = _qos(100, DurabilityPolicy.TRANSIENT_LOCAL)
"""For reading claims: with a depth of 1, one's own would push out that of another node."""

ACTIVE_PERCEPTION_TYPE = message_class(wire.ACTIVE_PERCEPTION_TYPE)
