# Copyright 2026 The sparse_coord_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Frames as REP 105 has them: how they are called, and how they are published.

The frame `map` is everybody's. Those of a robot are `odom` and `base_link` below its name, and
begin with the team's namespace, or with what the parameter `frame_prefix` says.
"""

import math
from collections.abc import Sequence
from typing import Any

from geometry_msgs.msg import TransformStamped
from rclpy.node import Node
from rclpy.qos import QoSProfile
from std_msgs.msg import Header

from sparse_coord_ros.driving.ground import Pose
from sparse_coord_ros.nodes.parameters import ParameterNode

ODOM, BASE = "odom", "base_link"


def robot_frame(node: ParameterNode, robot: str, frame: str) -> str:
    """Return what a frame of a robot is called, in the team of a node."""
    prefix = node.values["frame_prefix"] or f"{node.get_namespace()}/"
    return f"{prefix.lstrip('/')}{robot}/{frame}"


def transform(header: Header, child: str, pose: Pose) -> TransformStamped:
    """Return where a frame is in that of a header."""
    one = TransformStamped(header=header, child_frame_id=child)
    one.transform.translation.x, one.transform.translation.y = pose.x, pose.y
    one.transform.rotation.z = math.sin(pose.yaw / 2)
    one.transform.rotation.w = math.cos(pose.yaw / 2)
    return one


class TransformPublisher:
    """Publishes on /tf, where tf2_msgs is installed.

    Args:
        node: whose publisher it is.
    """

    def __init__(self, node: Node) -> None:
        self._publisher: Any = None
        try:
            from tf2_msgs.msg import TFMessage
        except ImportError:
            return
        self._message = TFMessage
        self._publisher = node.create_publisher(TFMessage, "/tf", QoSProfile(depth=100))

    def publish(self, transforms: Sequence[TransformStamped]) -> None:
        """Publish transforms."""
        if self._publisher is not None:
            self._publisher.publish(self._message(transforms=list(transforms)))
