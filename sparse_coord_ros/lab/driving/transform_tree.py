# Copyright 2026 The sparse_coord_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Transforms on the floor, from /tf and /tf_static: the pose of one frame in another."""

import math
from typing import NamedTuple

from sparse_coord_ros.core.game.pose import Pose

LONGEST_CHAIN = 100
"""Most frames between two; a longer chain is a circle."""


class Seen(NamedTuple):
    """A frame's pose in its parent, and the pose's time; a static one has no time."""

    parent: str
    pose: Pose
    seconds: float | None


def yaw_of(x: float, y: float, z: float, w: float) -> float:
    """Return the yaw of a quaternion of any length, in radians."""
    return math.atan2(2.0 * (w * z + x * y), w * w + x * x - y * y - z * z)


class Tree:
    """The newest transforms.

    Attributes:
        way: the frames on the way of the last call of `find`.
    """

    def __init__(self) -> None:
        self.way: list[str] = []
        self._frames: dict[str, Seen] = {}

    def hear(self, parent: str, child: str, pose: Pose, seconds: float | None) -> None:
        """Note a transform; `seconds` None: a static one. Names may begin with a slash."""
        self._frames[child.lstrip("/")] = Seen(parent.lstrip("/"), pose, seconds)

    def find(self, parent: str, child: str) -> tuple[float, Pose] | None:
        """Return (seconds, pose of `child` in `parent`) by the newest transforms.

        The time is the newest one on the way: that of the odometry, which is more frequent than
        the corrections of a localisation. None: no chain of transforms, or only a static one.
        """
        parent = parent.lstrip("/")
        frame = child.lstrip("/")
        self.way = []
        here = Pose(0.0, 0.0, 0.0)
        newest = None
        for _ in range(LONGEST_CHAIN):
            if frame == parent:
                return None if newest is None else (newest, here)
            self.way.append(frame)
            seen = self._frames.get(frame)
            if seen is None:
                return None
            here = _within(seen.pose, here)
            if seen.seconds is not None:
                newest = seen.seconds if newest is None else max(newest, seen.seconds)
            frame = seen.parent
        return None


def parent_of(pose: Pose, here: Pose) -> Pose:
    """Return the pose of the frame in which a body at `pose` is at `here`."""
    turn = math.remainder(pose.yaw - here.yaw, math.tau)
    x, y, _ = _within(Pose(0.0, 0.0, turn), here)
    return Pose(pose.x - x, pose.y - y, turn)


def _within(frame: Pose, pose: Pose) -> Pose:
    """Return a pose in a frame as a pose in the frame's parent."""
    x, y = frame.absolute(pose.x, pose.y)
    return Pose(x, y, math.remainder(frame.yaw + pose.yaw, math.tau))
