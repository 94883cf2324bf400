# Copyright 2026 The sparse_coord_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The nav2_stand_in node: simulated bases, each with a server of Nav2's action NavigateToPose.

It replaces robots, localisation and Nav2: for a rehearsal of the procedure of docs/real_robots.md,
and for the tests. A base is a point that goes straight to its goal at a constant speed, through
walls too. As in Nav2 a new goal pre-empts the one before it.
"""

import math
from typing import Any, ClassVar, Unpack

from action_msgs.msg import GoalStatus
from geometry_msgs.msg import PoseStamped
from rclpy.action import ActionServer, CancelResponse, GoalResponse
from rclpy.action.server import ServerGoalHandle
from rclpy.task import Future
from std_msgs.msg import Header

from sparse_coord_ros.base.errors import SettingError, needed
from sparse_coord_ros.core.game.pose import Pose
from sparse_coord_ros.lab.driving.transform_tree import yaw_of
from sparse_coord_ros.protocol.wire import MAP_FRAME
from sparse_coord_ros.ros.nodes.parameters import PARAMETERS, NodePlace, ParameterNode
from sparse_coord_ros.ros.nodes.spin import run_node
from sparse_coord_ros.ros.nodes.transforms import (
    BASE,
    ODOM,
    TransformPublisher,
    pose_message,
    transform,
)

SIMULATION_SECONDS = 0.02


class Base:
    """One simulated base, and its server.

    Args:
        node: the node.
        name: its namespace.
        place: its first place (x, y), in metres.

    Attributes:
        pose: its pose.
        speed: metres a second.
        active: the goal in progress, or None.
    """

    def __init__(
        self, node: "Nav2StandIn", name: str, place: tuple[float, float]
    ) -> None:
        self.node = node
        self.pose = Pose(*place, 0.0)
        self.speed: float = node.values["speed"]
        self.active: ServerGoalHandle | None = None
        self._target = self.pose
        self._over: Future | None = None
        self._poses = node.create_publisher(PoseStamped, f"{name}/pose", 10)
        self._transforms = TransformPublisher(node, f"{name}/tf")
        self._server = ActionServer(
            node,
            node.action,
            f"{name}/navigate_to_pose",
            execute_callback=self.execute,
            goal_callback=self.answer,
            cancel_callback=lambda handle: CancelResponse.ACCEPT,
        )
        node.at_end.callback(self._server.destroy)

    async def answer(self, goal: Any) -> GoalResponse:
        """Accept a goal."""
        return GoalResponse.ACCEPT

    async def execute(self, handle: ServerGoalHandle) -> Any:
        """Drive to a goal; return its result."""
        if self._over is not None:
            self._over.set_result(GoalStatus.STATUS_ABORTED)  # pre-empted
        wanted = handle.request.pose.pose
        turn = wanted.orientation
        yaw = yaw_of(turn.x, turn.y, turn.z, turn.w)
        self._target = Pose(wanted.position.x, wanted.position.y, yaw)
        self.active = handle
        self._over = over = Future()
        how = await over
        if how == GoalStatus.STATUS_SUCCEEDED:
            handle.succeed()
        elif how == GoalStatus.STATUS_CANCELED:
            handle.canceled()
        else:
            handle.abort()
        if self.active is handle:
            self.active = self._over = None
        return self.node.action.Result()

    def end(self, how: int) -> None:
        """End the goal in progress; `how`: a `GoalStatus`."""
        if self._over is not None and not self._over.done():
            self._over.set_result(how)

    def tick(self) -> None:
        """Let a tick pass."""
        if self.active is not None and self._over is not None and not self._over.done():
            if self.active.is_cancel_requested:
                self.end(GoalStatus.STATUS_CANCELED)
            else:
                self.drive()
        self.say_where()

    @property
    def left(self) -> float:
        """The metres to the goal."""
        return math.dist(self.pose[:2], self._target[:2])

    def drive(self) -> None:
        """Say how far it is, and drive on."""
        self.say_left(self.left)
        step = self.speed * SIMULATION_SECONDS
        if self.left <= step:
            self.pose = self._target
            self.end(GoalStatus.STATUS_SUCCEEDED)
            return
        x, y, _ = self._target
        heading = math.atan2(y - self.pose.y, x - self.pose.x)
        ahead = step * math.cos(heading), step * math.sin(heading)
        self.pose = Pose(self.pose.x + ahead[0], self.pose.y + ahead[1], heading)

    def say_left(self, metres: float) -> None:
        """Publish the remaining distance of the goal in progress."""
        assert self.active is not None
        feedback = self.node.action.Feedback()
        feedback.distance_remaining = metres
        self.active.publish_feedback(feedback)

    def say_where(self) -> None:
        """Publish the base's pose and transforms, as a localisation does."""
        stamp = self.node.get_clock().now().to_msg()
        header = Header(stamp=stamp, frame_id=MAP_FRAME)
        self._poses.publish(PoseStamped(header=header, pose=pose_message(self.pose)))
        origin = transform(header, ODOM, Pose(0.0, 0.0, 0.0))
        way = transform(Header(stamp=stamp, frame_id=ODOM), BASE, self.pose)
        self._transforms.publish([origin, way])


class Nav2StandIn(ParameterNode):
    """Bases by name.

    Args:
        place: where the node is made, and with what: see `NodePlace`.

    Attributes:
        base: the class of its bases.
        action: the class of Nav2's action.
        bases: by name.

    Raises:
        SparseCoordError: a bad parameter; nav2_msgs is not installed.
    """

    base: ClassVar[type[Base]] = Base

    def __init__(self, **place: Unpack[NodePlace]) -> None:
        super().__init__("nav2_stand_in", PARAMETERS["nav2_stand_in"], **place)
        names = [name.strip("/") for name in self.values["bases"] if name]
        places = [read_place(text) for text in self.values["places"] if text]
        if not names:
            raise SettingError(
                "parameter bases: none is given; give the bases' namespaces"
            )
        if places and len(places) != len(names):
            allowed = f"{len(names)}, one for each of {', '.join(names)}"
            raise SettingError(
                f"parameter places: {len(places)} are given, allowed: {allowed}"
            )
        places = places or [(0.0, 0.0)] * len(names)
        pairs = zip(names, places, strict=True)
        self.bases = {name: self.base(self, name, where) for name, where in pairs}
        self.create_timer(SIMULATION_SECONDS, self._tick)
        self.get_logger().info(f"in place of Nav2: {', '.join(names)}")

    def set_up(self) -> None:
        """Import Nav2's messages."""
        remedy = "sudo apt install ros-jazzy-nav2-msgs"
        with needed(f"node {self.get_name()} needs the package nav2_msgs", remedy):
            from nav2_msgs.action import NavigateToPose
        self.action: Any = NavigateToPose

    def _tick(self) -> None:
        for base in self.bases.values():
            base.tick()


def read_place(text: str) -> tuple[float, float]:
    """Return (x, y) in metres of a text such as `0.5,2`.

    Raises:
        SettingError: the text is no place.
    """
    try:
        x, y = map(float, text.split(","))
    except ValueError:
        x = y = math.nan
    if not (math.isfinite(x) and math.isfinite(y)):
        raise SettingError(
            f"parameter places: {text!r} is none, allowed: X,Y in metres"
        )
    return x, y


def main() -> int:
    """Run the node `nav2_stand_in`."""
    return run_node(lambda context: Nav2StandIn(context=context))
