# Copyright 2026 The sparse_coord_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Frames of REP 105: their names, and their publication.

All robots share the frame `map`. A robot's frames are `odom` and `base_link` below its name, with
the team's namespace, or the parameter `frame_prefix`, in front.

Transforms go to `tf` in the team's namespace, as in Nav2's launch files, not to /tf. A team in a
namespace has a clock of its own there, and transforms of several clocks in one topic are useless.
Outside any namespace `tf` and /tf are the same.
"""

import math
import time
from collections.abc import Sequence
from contextlib import suppress
from typing import Any

from geometry_msgs.msg import Point, Quaternion, Transform, TransformStamped, Vector3
from geometry_msgs.msg import Pose as PoseMessage
from rclpy.node import Node
from rclpy.qos import QoSProfile
from std_msgs.msg import Header

from sparse_coord_ros.core.game.pose import Pose
from sparse_coord_ros.lab.driving.transform_tree import Tree, yaw_of
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
    """Return the pose of a child frame in a header's frame, as a transform."""
    there = Transform(
        translation=Vector3(x=pose.x, y=pose.y), rotation=turned(pose.yaw)
    )
    return TransformStamped(header=header, child_frame_id=child, transform=there)


def seconds_of(header: Any) -> float:
    """Return a header's time in seconds; the steady clock's if it has none."""
    stamp = header.stamp
    if stamp.sec == 0 and stamp.nanosec == 0:
        return time.monotonic()
    return float(stamp.sec) + stamp.nanosec * 1e-9


class HeardTransforms:
    """Computes from transforms the pose of a frame in another one.

    Args:
        parent: the frame in which poses are wanted.
        child: the frame whose poses are wanted.
    """

    def __init__(self, parent: str, child: str) -> None:
        self._parent = parent
        self._child = child
        self._tree = Tree()

    def read(self, message: Any, *, static: bool) -> tuple[float, Pose] | None:
        """Read a TFMessage; return the time and the child's pose in the parent.

        None: the message has no transform between them, or other transforms are still missing.
        """
        for transform in message.transforms:
            shift = transform.transform.translation
            turn = transform.transform.rotation
            pose = Pose(shift.x, shift.y, yaw_of(turn.x, turn.y, turn.z, turn.w))
            seconds = None if static else seconds_of(transform.header)
            self._tree.hear(
                transform.header.frame_id, transform.child_frame_id, pose, seconds
            )
        seen = self._tree.find(self._parent, self._child)
        heard = {
            transform.child_frame_id.lstrip("/") for transform in message.transforms
        }
        return seen if heard.intersection(self._tree.way) else None


class TransformPublisher:
    """Publishes transforms, if tf2_msgs is installed.

    Args:
        node: the publisher's node.
        topic: the topic.
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
