# Copyright 2026 The sparse_coord_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Display of a team in RViz and Foxglove beside the markers: names, questions, doorways.

It is published with the markers, but not at every episode's start, and 30 times a second at most.
If tf2_msgs is installed, it includes transforms `map` to `<robot>/base_link`.
"""

import time
from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

from geometry_msgs.msg import Point
from std_msgs.msg import ColorRGBA, Header
from visualization_msgs.msg import Marker, MarkerArray

from sparse_coord_ros.base.palette import DOORWAY_COLOUR, FAILED, OUTCOME_COLOURS, rgb
from sparse_coord_ros.core.game.pose import Pose
from sparse_coord_ros.protocol.wire import (
    OCCUPANCY,
    QUESTIONS,
    ROBOT_NAMES,
    WORDS,
    PerceptEnd,
)
from sparse_coord_ros.ros.nodes import ros_topics
from sparse_coord_ros.ros.nodes.messages import Converter, map_header
from sparse_coord_ros.ros.nodes.parameters import ParameterNode
from sparse_coord_ros.ros.nodes.transforms import (
    BASE,
    TransformPublisher,
    pose_message,
    robot_frame,
    transform,
)

MOST_OFTEN = 30.0
"""Scenes a second, by the wall clock."""


@dataclass
class Scene:
    """The scene of one time step as messages.

    Attributes:
        convert: conversions of the run.
        step: the time step.
        cells: where the robots are then.
        header: of all markers.
    """

    convert: Converter
    step: int
    cells: Sequence[int]
    header: Header

    def markers(self, actions: Mapping[int, bytes]) -> MarkerArray:
        """Return markers of names, of the questions in the actions, and of robots in doorways.

        Args:
            actions: the newest action of each robot, as bytes; only questions of the step before
                are shown.
        """
        found = []
        for k, name in enumerate(self.convert.names):
            found += [
                self._text(ROBOT_NAMES, k, name, 0.38),
                *self._question(k, actions.get(k)),
            ]
        inside = Counter(self.cells)
        for number, cell in enumerate(sorted(self.convert.grid.doorways)):
            found.append(self._doorway(number, cell, inside[cell]))
        return MarkerArray(markers=found)

    def _marker(
        self,
        space: str,
        number: int,
        kind: int,
        colour: str = "#000000",
        alpha: float = 1.0,
    ) -> Marker:
        marker = Marker(header=self.header, ns=space, id=number, type=kind)
        marker.pose.orientation.w = 1.0
        red, green, blue = rgb(colour)
        marker.color = ColorRGBA(r=red, g=green, b=blue, a=alpha)
        return marker

    def _text(self, space: str, k: int, text: str, north: float) -> Marker:
        """Return a text marker, `north` cells north of the centre of a robot's cell."""
        marker = self._marker(space, k, Marker.TEXT_VIEW_FACING)
        metres = self.convert.resolution
        (x, y) = self.convert.centres[self.cells[k]]
        marker.text = text
        marker.scale.z = 0.22 * metres
        marker.pose.position = Point(x=x, y=y + north * metres, z=0.7 * metres)
        return marker

    def _question(self, k: int, action: bytes | None) -> list[Marker]:
        asked = None if action is None else self._read(action)
        if asked is None:
            spaces = (QUESTIONS, WORDS)
            return [
                Marker(header=self.header, ns=s, id=k, action=Marker.DELETE)
                for s in spaces
            ]
        peer, outcome = asked
        peers = [peer] if peer >= 0 else [j for j in range(len(self.cells)) if j != k]
        metres = self.convert.resolution
        line = self._marker(QUESTIONS, k, Marker.LINE_LIST, OUTCOME_COLOURS[outcome])
        line.scale.x = 0.1 * metres
        for end in (end for other in peers for end in (k, other)):
            x, y = self.convert.centres[self.cells[end]]
            line.points.append(Point(x=x, y=y, z=0.6 * metres))
        whom = self.convert.names[peer] if peer >= 0 else "all"
        return [line, self._text(WORDS, k, f"asks {whom}: {outcome}", -0.4)]

    def _read(self, action: bytes) -> tuple[int, str] | None:
        """Return the asked peer (from 0, -1: all) and the percept's end; None: no question."""
        try:
            acted, said, report = self.convert.unpack_self_report(action)
        except ValueError:  # the world accepts an action without its report
            return None
        if not said.asked or acted < self.step - 1:
            return None
        end = PerceptEnd.ANSWERED if said.perceived else PerceptEnd.said(report.percept)
        return said.peer, FAILED if end is None else end.outcome

    def _doorway(self, number: int, cell: int, robots: int) -> Marker:
        """Return a box that grows with the robots in a doorway, flat and pale if it is empty."""
        alpha = (0.15, 0.45, 0.8)[min(robots, 2)]
        box = self._marker(OCCUPANCY, number, Marker.CUBE, DOORWAY_COLOUR, alpha)
        metres = self.convert.resolution
        box.pose = pose_message(
            Pose(*self.convert.centres[cell], self.convert.origin.yaw)
        )
        box.scale.x = box.scale.y = 0.96 * metres
        box.scale.z = (0.02 + 0.15 * robots) * metres
        return box


class ScenePublisher:
    """Publishes the scene of a world, not too often.

    Args:
        node: the world's node.
        convert: conversions of the run.
        frames: whether to publish transforms.

    Attributes:
        actions: the newest action of each robot, as bytes.
    """

    def __init__(
        self, node: ParameterNode, convert: Converter, *, frames: bool = True
    ) -> None:
        self._convert = convert
        self._publisher = node.announce(ros_topics.SCENE)
        self._last = float("-inf")
        self.actions: dict[int, bytes] = {}
        self._bases = [robot_frame(node, name, BASE) for name in convert.names]
        self._transforms = TransformPublisher(node) if frames else None

    def publish(
        self,
        step: int,
        cells: Sequence[int],
        stamp: tuple[int, int],
        *,
        always: bool = False,
    ) -> None:
        """Publish the scene, unless the last one is too young.

        Args:
            step: the time step.
            cells: the robots' cells then.
            stamp: the ROS time, (sec, nanosec).
            always: True: publish it even then.
        """
        now = time.monotonic()
        convert = self._convert
        if now - self._last < 1 / MOST_OFTEN and not always:
            return
        self._last = now
        header = map_header(stamp)
        self._publisher.publish(
            Scene(convert, step, cells, header).markers(self.actions)
        )
        if self._transforms is not None:
            poses = (Pose(*convert.centres[cell], 0.0) for cell in cells)
            pairs = zip(self._bases, poses, strict=True)
            self._transforms.publish(
                [transform(header, base, pose) for base, pose in pairs]
            )
