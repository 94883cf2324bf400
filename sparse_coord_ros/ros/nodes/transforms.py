# Copyright 2026 The sparse_coord_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Frames as REP 105 has them: how they are called, and how they are published.

The frame `map` is everybody's. Those of a robot are `odom` and `base_link` below its name, and
begin with the team's namespace, or with what the parameter `frame_prefix` says.

Transforms go to `tf` in the team's namespace, as Nav2's launch files have it, not to /tf: a team
in a namespace has a clock of its own there, and transforms of several clocks in one topic are of
of no use. Outside any namespace the two are the same.
"""

import math
from collections.abc import Sequence
from contextlib import suppress
from typing import Any

from geometry_msgs.msg import Point, Quaternion, Transform, TransformStamped, Vector3
from geometry_msgs.msg import Pose as PoseMessage
from rclpy.node import Node
from rclpy.qos import QoSProfile
from std_msgs.msg import Header

from sparse_coord_ros.lab.driving.metric_map import Pose
from sparse_coord_ros.ros.nodes.parameters import ParameterNode

ODOM = "odom"
BASE = "base_link"

TF = "tf"
TF_STATIC = "tf_static"
"""The topics of transforms, relative to a namespace."""


def robot_frame(node: ParameterNode, robot: str, frame: str) -> str:
    """Return the name of a robot's frame, in the team of a node."""
    prefix = node.values["frame_prefix"] or f"{node.get_namespace()}/"
    return f"{prefix.lstrip('/')}{robot}/{frame}"


def turned(yaw: float) -> Quaternion:
    """Return a yaw in radians as a quaternion."""
    return Quaternion(z=math.sin(yaw / 2), w=math.cos(yaw / 2))


def pose_message(pose: Pose) -> PoseMessage:
    """Return a pose as a message."""
    return PoseMessage(position=Point(x=pose.x, y=pose.y), orientation=turned(pose.yaw))


def transform(header: Header, child: str, pose: Pose) -> TransformStamped:
    """Return the pose of a frame in that of a header."""
    there = Transform(
        translation=Vector3(x=pose.x, y=pose.y), rotation=turned(pose.yaw)
    )
    return TransformStamped(header=header, child_frame_id=child, transform=there)


class TransformPublisher:
    """Publishes transforms, where tf2_msgs is installed.

    Args:
        node: whose publisher it is.
        topic: where.
    """

    def __init__(self, node: Node, topic: str = TF) -> None:
        self._publisher: Any = None
        with suppress(ImportError):
            from tf2_msgs.msg import TFMessage

            self._message = TFMessage
            self._publisher = node.create_publisher(
                TFMessage, topic, QoSProfile(depth=100)
            )

    def publish(self, transforms: Sequence[TransformStamped]) -> None:
        """Publish transforms."""
        if self._publisher is not None:
            self._publisher.publish(self._message(transforms=list(transforms)))
