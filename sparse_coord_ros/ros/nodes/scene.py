# Copyright 2026 The sparse_coord_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Display of a team in RViz and Foxglove.

The markers stand still: doorways and goals. The scene moves: robots with their names, questions,
robots in doorways, 30 times a second at most. If tf2_msgs is installed, transforms `map` to
`<robot>/base_link` come with it.
"""

import time
from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

from geometry_msgs.msg import Point
from geometry_msgs.msg import Pose as PoseMessage
from std_msgs.msg import ColorRGBA, Header
from visualization_msgs.msg import Marker, MarkerArray

from sparse_coord_ros.base.palette import (
    DOORWAY_COLOUR,
    FAILED,
    OUTCOME_COLOURS,
    rgb,
    robot_colour,
)
from sparse_coord_ros.core.game.pose import Pose
from sparse_coord_ros.core.game.scenario import Scenario
from sparse_coord_ros.core.game.world import Action
from sparse_coord_ros.protocol.wire import (
    DOORWAYS,
    GOALS,
    OCCUPANCY,
    QUESTIONS,
    ROBOT_NAMES,
    ROBOTS,
    WORDS,
    PerceptEnd,
    SelfReport,
)
from sparse_coord_ros.protocol.wire.messages import Messages
from sparse_coord_ros.ros.nodes import ros_topics
from sparse_coord_ros.ros.nodes.parameters import ParameterNode
from sparse_coord_ros.ros.nodes.ros_messages import map_header
from sparse_coord_ros.ros.nodes.transforms import (
    BASE,
    TransformPublisher,
    pose_message,
    robot_frame,
    transform,
)

MOST_OFTEN = 30.0
"""Scenes a second, by the wall clock."""

Acted = tuple[int, Action, SelfReport]
"""A robot's action: its time step, the action, and the robot's report on itself."""


@dataclass
class Scene:
    """The scene of one time step as messages.

    Attributes:
        messages: the messages of the run.
        step: the time step.
        cells: where the robots are then.
        header: of all markers.
    """

    messages: Messages
    step: int
    cells: Sequence[int]
    header: Header

    def markers(self, goals: Sequence[int]) -> MarkerArray:
        """Return markers of doorways and of the robots' goals.

        The map is dark where walls are; the scene's boxes stand on the doorways' plates.
        """
        plate = (0.9, 0.05)
        disc = (0.9, 0.04)
        shapes = []
        for number, cell in enumerate(sorted(self.messages.grid.doorways)):
            colour = (DOORWAY_COLOUR, 0.3)
            shapes.append(
                self._shape(DOORWAYS, number, Marker.CUBE, cell, plate, colour)
            )
        for k, goal in enumerate(goals):
            colour = (robot_colour(k), 0.8)
            shapes.append(self._shape(GOALS, k, Marker.CYLINDER, goal, disc, colour))
        return MarkerArray(markers=shapes)

    def scene(self, actions: Mapping[int, Acted]) -> MarkerArray:
        """Return markers of robots, names, questions in the actions, and robots in doorways.

        Args:
            actions: the newest action of each robot; only questions of the step before are shown.
        """
        shapes = []
        for k, name in enumerate(self.messages.names):
            ball = (0.5, 0.5)
            colour = (robot_colour(k), 0.8)
            shapes += [
                self._shape(ROBOTS, k, Marker.SPHERE, self.cells[k], ball, colour),
                self._text(ROBOT_NAMES, k, name, 0.38),
                *self._question(k, actions.get(k)),
            ]
        inside = Counter(self.cells)
        for number, cell in enumerate(sorted(self.messages.grid.doorways)):
            shapes.append(self._doorway(number, cell, inside[cell]))
        return MarkerArray(markers=shapes)

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

    def _shape(
        self,
        space: str,
        number: int,
        kind: int,
        cell: int,
        size: tuple[float, float],
        colour: tuple[str, float],
    ) -> Marker:
        """Return a marker in a cell; `size`: width and height, in cells."""
        marker = self._marker(space, number, kind, *colour)
        marker.pose = self._pose(cell)
        width, height = size
        marker.scale.x = marker.scale.y = width * self.messages.resolution
        marker.scale.z = height * self.messages.resolution
        return marker

    def _pose(self, cell: int) -> PoseMessage:
        """Return the pose of a cell, along the map's axes."""
        return pose_message(
            Pose(*self.messages.centres[cell], self.messages.origin.yaw)
        )

    def _text(self, space: str, k: int, text: str, north: float) -> Marker:
        """Return a text marker, `north` cells north of the centre of a robot's cell."""
        marker = self._marker(space, k, Marker.TEXT_VIEW_FACING)
        metres = self.messages.resolution
        (x, y) = self.messages.centres[self.cells[k]]
        marker.text = text
        marker.scale.z = 0.22 * metres
        marker.pose.position = Point(x=x, y=y + north * metres, z=0.7 * metres)
        return marker

    def _question(self, k: int, acted: Acted | None) -> list[Marker]:
        asked = None if acted is None else self._asked(*acted)
        if asked is None:
            spaces = (QUESTIONS, WORDS)
            return [
                Marker(header=self.header, ns=s, id=k, action=Marker.DELETE)
                for s in spaces
            ]
        peer, outcome = asked
        peers = [peer] if peer >= 0 else [j for j in range(len(self.cells)) if j != k]
        metres = self.messages.resolution
        line = self._marker(QUESTIONS, k, Marker.LINE_LIST, OUTCOME_COLOURS[outcome])
        line.scale.x = 0.1 * metres
        for end in (end for other in peers for end in (k, other)):
            x, y = self.messages.centres[self.cells[end]]
            line.points.append(Point(x=x, y=y, z=0.6 * metres))
        whom = self.messages.names[peer] if peer >= 0 else "all"
        return [line, self._text(WORDS, k, f"asks {whom}: {outcome}", -0.4)]

    def _asked(
        self, step: int, action: Action, report: SelfReport
    ) -> tuple[int, str] | None:
        """Return the asked peer (from 0, -1: all) and the percept's end; None: no question."""
        if not action.asked or step < self.step - 1:
            return None
        end = PerceptEnd.from_number(report.percept)
        if action.perceived:
            end = PerceptEnd.ANSWERED
        return action.peer, FAILED if end is None else end.outcome

    def _doorway(self, number: int, cell: int, robots: int) -> Marker:
        """Return a box that grows with the robots in a doorway, flat and pale if it is empty."""
        alpha = (0.15, 0.45, 0.8)[min(robots, 2)]
        box = self._marker(OCCUPANCY, number, Marker.CUBE, DOORWAY_COLOUR, alpha)
        metres = self.messages.resolution
        box.pose = self._pose(cell)
        box.scale.x = box.scale.y = 0.96 * metres
        box.scale.z = (0.02 + 0.15 * robots) * metres
        return box


class ScenePublisher:
    """Publishes the display of a world, not too often.

    Args:
        node: the world's node.
        scenario: the run's scenario.
        messages: the messages of the run.
        frames: whether to publish transforms.

    Attributes:
        actions: the newest action of each robot.
    """

    def __init__(
        self,
        node: ParameterNode,
        scenario: Scenario,
        messages: Messages,
        *,
        frames: bool = True,
    ) -> None:
        self._messages = messages
        self._goals = [robot.goal for robot in scenario.robots]
        self._markers = node.announce(ros_topics.MARKERS)
        self._scene = node.announce(ros_topics.SCENE)
        self._last = float("-inf")
        self.actions: dict[int, Acted] = {}
        self._bases = [robot_frame(node, name, BASE) for name in messages.names]
        self._transforms = TransformPublisher(node) if frames else None

    def show_floor(self, stamp: tuple[int, int]) -> None:
        """Publish the markers; `stamp`: the ROS time, (sec, nanosec)."""
        shown = Scene(self._messages, 0, (), map_header(stamp))
        self._markers.publish(shown.markers(self._goals))

    def publish(
        self,
        step: int,
        cells: Sequence[int],
        stamp: tuple[int, int],
        *,
        always: bool = False,
    ) -> None:
        """Publish scene and transforms, unless the last ones are too young.

        Args:
            step: the time step.
            cells: the robots' cells then.
            stamp: the ROS time, (sec, nanosec).
            always: True: publish it even then.
        """
        now = time.monotonic()
        if now - self._last < 1 / MOST_OFTEN and not always:
            return
        self._last = now
        header = map_header(stamp)
        shown = Scene(self._messages, step, cells, header)
        self._scene.publish(shown.scene(self.actions))
        if self._transforms is not None:
            poses = (Pose(*self._messages.centres[cell], 0.0) for cell in cells)
            pairs = zip(self._bases, poses, strict=True)
            self._transforms.publish(
                [transform(header, base, pose) for base, pose in pairs]
            )
