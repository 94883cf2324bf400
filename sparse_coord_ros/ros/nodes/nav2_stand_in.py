# Copyright 2026 The sparse_coord_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The nav2_stand_in node: simulated bases, each with a server of Nav2's action NavigateToPose.

It replaces robots, localisation and Nav2: for a rehearsal of the procedure of docs/real_robots.md,
and for the tests. A base is a point that goes straight to its goal at a constant speed, through
walls too. As in Nav2 a new goal pre-empts the one before it. The parameter `fault` reproduces
failures of Nav2.
"""

import math
import time
from typing import Any, Unpack

from action_msgs.msg import GoalStatus
from geometry_msgs.msg import PoseStamped
from rclpy.action import ActionServer, CancelResponse, GoalResponse
from rclpy.action.server import ServerGoalHandle
from rclpy.task import Future
from std_msgs.msg import Header

from sparse_coord_ros.base.errors import SettingError, needed
from sparse_coord_ros.lab.driving.metric_map import Pose
from sparse_coord_ros.lab.driving.transforms import yaw_of
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

LATE_SECONDS = 3.0
"""Delay after which a goal is accepted too late: a nav2_driver has given it up by then."""

NEVER_SECONDS = 3600.0
"""Delay after which a server that does not answer accepts a goal."""

DETOUR_METRES = 50.0

NO_PROGRESS = 105
"""Nav2's error code of an aborted goal whose robot made no progress."""

NONE = "none"
ABORT = "abort"
REJECT = "reject"
LATE = "late"
DEAF = "deaf"
SILENT = "silent"
DETOUR = "detour"
LIE = "lie"
TAKE_AWAY = "take_away"
STUCK = "stuck"
"""The outcome of a goal. The base gets there; the goal is aborted at once; rejected; accepted much
too late; never answered; accepted without feedback; its feedback says that 50 m are left; it
succeeds although the base is not there; it ends as if another client had cancelled it; the base
does not move."""


class Base:
    """One simulated base, and its server.

    Args:
        node: the node.
        name: its namespace.
        place: its first place (x, y), in metres.

    Attributes:
        pose: its pose.
        speed: metres a second.
        faults: the faults of its next goals; later ones have that of the parameter `fault`.
        goals: number of goals received.
        active: the goal in progress, or None.
        fault: its fault.
        ended: the ends of the goals, in order.
        lost: whether its pose is not published.
    """

    def __init__(
        self, node: "Nav2StandIn", name: str, place: tuple[float, float]
    ) -> None:
        self._node = node
        self.pose = Pose(*place, 0.0)
        self.speed: float = node.values["speed"]
        self.faults: list[str] = []
        self.goals = 0
        self.active: ServerGoalHandle | None = None
        self.fault = NONE
        self.ended: list[str] = []
        self.lost = False
        self._target = self.pose
        self._over: Future | None = None
        self._waiting: list[tuple[float, Future]] = []
        self._accepted: list[str] = []
        self._poses = node.create_publisher(PoseStamped, f"{name}/pose", 10)
        self._transforms = TransformPublisher(node, f"{name}/tf")
        self._server = ActionServer(
            node,
            node.action,
            f"{name}/navigate_to_pose",
            execute_callback=self._execute,
            goal_callback=self._answer,
            cancel_callback=lambda handle: CancelResponse.ACCEPT,
        )
        node.at_end.callback(self._server.destroy)

    async def _answer(self, goal: Any) -> GoalResponse:
        """Accept or reject a goal; maybe much later."""
        self.goals += 1
        fault = self.faults.pop(0) if self.faults else self._node.values["fault"]
        if fault in (LATE, DEAF):
            seconds = LATE_SECONDS if fault == LATE else NEVER_SECONDS
            answer = Future()
            self._waiting.append((time.monotonic() + seconds, answer))
            await answer
        if fault == REJECT:
            return GoalResponse.REJECT
        self._accepted.append(fault)
        return GoalResponse.ACCEPT

    async def _execute(self, handle: ServerGoalHandle) -> Any:
        """Drive to a goal; return its result."""
        if self._over is not None:
            self._over.set_result(GoalStatus.STATUS_ABORTED)  # pre-empted
        wanted = handle.request.pose.pose
        turn = wanted.orientation
        yaw = yaw_of(turn.x, turn.y, turn.z, turn.w)
        self._target = Pose(wanted.position.x, wanted.position.y, yaw)
        self.active = handle
        self.fault = self._accepted.pop(0)
        self._over = over = Future()
        at_once = {
            ABORT: GoalStatus.STATUS_ABORTED,
            TAKE_AWAY: GoalStatus.STATUS_ABORTED,
            LIE: GoalStatus.STATUS_SUCCEEDED,
        }
        if self.fault in at_once:
            over.set_result(at_once[self.fault])
        result = self._node.action.Result()
        if self.fault == ABORT:
            result.error_code = NO_PROGRESS
            result.error_msg = "no progress"
        how = await over
        if how == GoalStatus.STATUS_SUCCEEDED:
            handle.succeed()
            self.ended.append("succeeded")
        elif how == GoalStatus.STATUS_CANCELED:
            handle.canceled()
            self.ended.append("canceled")
        else:
            handle.abort()
            self.ended.append("aborted")
        if self.active is handle:
            self.active = self._over = None
        return result

    def tick(self, now: float) -> None:
        """Let a tick pass; `now`: by `time.monotonic`."""
        for one in list(self._waiting):
            due, answer = one
            if now >= due:
                self._waiting.remove(one)
                answer.set_result(None)
        if self.active is not None and self._over is not None and not self._over.done():
            self._drive(self.active, self._over)
        if not self.lost:
            self._say_where()

    def _drive(self, handle: ServerGoalHandle, over: Future) -> None:
        """Drive on towards the goal, and publish the remaining distance."""
        if handle.is_cancel_requested:
            over.set_result(GoalStatus.STATUS_CANCELED)
            return
        if self.fault == SILENT:
            return
        x, y, yaw = self._target
        left = math.dist(self.pose[:2], (x, y))
        feedback = self._node.action.Feedback()
        feedback.distance_remaining = DETOUR_METRES if self.fault == DETOUR else left
        handle.publish_feedback(feedback)
        if self.fault in (DETOUR, STUCK):
            return
        step = self.speed * SIMULATION_SECONDS
        if left > step:
            heading = math.atan2(y - self.pose.y, x - self.pose.x)
            ahead = step * math.cos(heading), step * math.sin(heading)
            self.pose = Pose(self.pose.x + ahead[0], self.pose.y + ahead[1], heading)
        else:
            self.pose = Pose(x, y, yaw)
            over.set_result(GoalStatus.STATUS_SUCCEEDED)

    def _say_where(self) -> None:
        """Publish the base's pose and transforms, as a localisation does."""
        stamp = self._node.get_clock().now().to_msg()
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
        action: the class of Nav2's action.
        bases: by name.

    Raises:
        SparseCoordError: a bad parameter; nav2_msgs is not installed.
    """

    changeable = ("fault",)

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
        self.bases = {name: Base(self, name, where) for name, where in pairs}
        self.create_timer(SIMULATION_SECONDS, self._tick)
        self.get_logger().info(f"in place of Nav2: {', '.join(names)}")

    def set_up(self) -> None:
        """Import Nav2's messages."""
        remedy = "sudo apt install ros-jazzy-nav2-msgs"
        with needed(f"node {self.get_name()} needs the package nav2_msgs", remedy):
            from nav2_msgs.action import NavigateToPose
        self.action: Any = NavigateToPose

    def _tick(self) -> None:
        now = time.monotonic()
        for base in self.bases.values():
            base.tick(now)

    @property
    def driving(self) -> list[str]:
        """The bases that have a goal."""
        return [name for name, base in self.bases.items() if base.active is not None]


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
