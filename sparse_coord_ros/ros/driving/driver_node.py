# Copyright 2026 The sparse_coord_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Base of both drivers' nodes: goals and poses in, reports out, a lifecycle, a timeout of poses.

A body moves only while the world's `status` lets it: while the team is paused, or goes back to a
checkpoint, its driver stops it, whatever its goals are. The driver's diagnostics say so.
"""

import functools
import time
from dataclasses import replace
from typing import Any, ClassVar, Unpack

from geometry_msgs.msg import PoseStamped, PoseWithCovarianceStamped
from nav_msgs.msg import Odometry
from rclpy.lifecycle import LifecycleNodeMixin, LifecycleState
from rclpy.lifecycle.node import TransitionCallbackReturn
from rclpy.qos import DurabilityPolicy, QoSProfile, ReliabilityPolicy

from sparse_coord_ros.base.errors import SettingError, needed
from sparse_coord_ros.core.game.pose import Pose
from sparse_coord_ros.core.runs.run_config import RunConfig
from sparse_coord_ros.lab.driving.driver import Driver
from sparse_coord_ros.lab.driving.metric_map import MetricMap
from sparse_coord_ros.lab.driving.transform_tree import yaw_of
from sparse_coord_ros.protocol.lockstep.bodies import Goals
from sparse_coord_ros.protocol.wire import OVER, WORLD, RunState
from sparse_coord_ros.protocol.wire.status import RunStatus
from sparse_coord_ros.ros.nodes import ros_topics
from sparse_coord_ros.ros.nodes.body_messages import reached_message, read_goals
from sparse_coord_ros.ros.nodes.follower import Follower
from sparse_coord_ros.ros.nodes.parameters import FROM_TF, PARAMETERS, NodePlace
from sparse_coord_ros.ros.nodes.ros_messages import messages_of, robot_number
from sparse_coord_ros.ros.nodes.transforms import (
    BASE,
    TF,
    TF_STATIC,
    HeardTransforms,
    robot_frame,
    seconds_of,
)

POSES_QOS = QoSProfile(depth=1, reliability=ReliabilityPolicy.BEST_EFFORT)
"""Only the newest pose counts; it receives from publishers of any reliability."""

TF_QOS = QoSProfile(depth=100, reliability=ReliabilityPolicy.BEST_EFFORT)
STATIC_QOS = QoSProfile(depth=100, durability=DurabilityPolicy.TRANSIENT_LOCAL)

TYPES: dict[str, tuple[Any, Any]] = {
    "pose": (PoseStamped, lambda message: message.pose),
    "pose_with_covariance": (
        PoseWithCovarianceStamped,
        lambda message: message.pose.pose,
    ),
    "odometry": (Odometry, lambda message: message.pose.pose),
}
"""Message classes that hold a pose, and its place in the message."""

STAND_SECONDS = 0.1
"""Between two commands to stop while the team is paused: a base may miss one."""

STANDING = (RunState.PAUSED, RunState.RESUMING, *OVER)
"""The states of a run in which bodies stand."""

DONE = TransitionCallbackReturn.SUCCESS


class DriverNode(Follower, LifecycleNodeMixin):
    """Lets a `Driver` drive the body of one robot, while the world and the lifecycle allow it.

    A subclass defines how the driver reaches the base.

    Args:
        name: the node's name unless the command line remaps it; empty: its `KIND`.
        place: where the node is made, and with what: see `NodePlace`.

    Attributes:
        KIND: the executable, which names its table of parameters.
        robot: the robot's name.
        driver: decides what the body does; None: no run has begun.
        on_duty: whether the node has all its inputs, and the world receives its reports.
        active: whether the lifecycle allows it to move the body.
        held: whether the world lets no body move; before its first status, too.

    Raises:
        SparseCoordError: a bad parameter, a robot that the run does not have, a body that does
            not fit its cells, no tf2_msgs although tf is requested.
    """

    KIND: ClassVar[str]

    def __init__(self, *, name: str = "", **place: Unpack[NodePlace]) -> None:
        Follower.__init__(self, name or self.KIND, PARAMETERS[self.KIND], **place)
        LifecycleNodeMixin.__init__(self)
        change = self._service_change_state
        change.callback = self.guarded(change.callback, "change_state")
        self.active = self.on_duty = False
        self.held = True
        self._stood = 0.0
        self.driver: Driver | None = None
        self._step = 0
        self._seen = 0.0
        self._stopped = self._leaving = False
        self._reached_publisher: Any = None
        self._report = self.reporter("driving")
        self.trigger_configure()
        self.trigger_activate()

    def make(self, metric_map: MetricMap, number: int) -> Driver:
        """Return the driver of a robot's body."""
        raise NotImplementedError

    def missing(self) -> str:
        """Return a text about a missing input of the node, other than poses, or an empty text."""
        raise NotImplementedError

    def drive(self) -> None:
        """Let the driver do the work that is due, and report the end of its goal."""
        if self.driver is None:
            return
        self.driver.held = not self.may_drive
        reached = self.driver.next(self.now())
        if reached is not None:
            message = reached_message(self._messages, self._step, reached)
            self._reached_publisher.publish(message)

    def stop(self) -> None:
        """Stop the body."""
        if self.driver is not None:
            self.driver.stop(self.now())

    def now(self) -> float:
        """Return the time in seconds: simulated if the node follows /clock, else steady."""
        if self.get_parameter("use_sim_time").value:
            return self.get_clock().now().nanoseconds * 1e-9
        return time.monotonic()

    def settled(self) -> bool:
        """Stop the body for good; return whether all confirmations of it have come."""
        self.active = False
        self.stop()
        return True

    @property
    def may_drive(self) -> bool:
        """True if the body may move; not before the world receives the reports on its goals."""
        return self.active and self.on_duty and not self.held

    def set_up(self) -> None:
        """Find the robot of the body."""
        self.robot = self.values["robot"]
        if not self.robot:
            raise SettingError(
                "parameter robot: none is given; start the node with --ros-args -p "
                "robot:=NAME, a robot of the scenario"
            )

    def begin(self, run: RunConfig) -> None:
        """Begin with a run: subscribe to goals and poses."""
        number = robot_number(run, self.robot, "give parameter robot one of them")
        self.driver = self.make(MetricMap(run, self.values["radius"]), number)
        self._messages = messages_of(run)
        self.subscriber.listen(
            ros_topics.BODY_GOALS,
            self._on_goals,
            read=functools.partial(read_goals, self._messages),
        )
        pose_type = self.values["pose_type"]
        if pose_type == FROM_TF:
            self._hear_transforms()
        else:
            kind, inside = TYPES[pose_type]
            topic = replace(ros_topics.POSE, type=kind)
            read = functools.partial(self._read_pose, inside)
            self.subscriber.listen(
                topic, self._see, self.robot, read=read, qos=POSES_QOS
            )

    def _hear_transforms(self) -> None:
        remedy = "install it, or take a topic of poses"
        with needed("parameter pose_type: tf needs the package tf2_msgs", remedy):
            from tf2_msgs.msg import TFMessage
        topic = replace(ros_topics.POSE, type=TFMessage)
        heard = HeardTransforms(self.values["map_frame"], self.base_frame)
        for name, qos in ((TF, TF_QOS), (TF_STATIC, STATIC_QOS)):
            read = functools.partial(heard.read, static=qos is STATIC_QOS)
            self.subscriber.listen(topic, self._see, name=name, read=read, qos=qos)

    @property
    def base_frame(self) -> str:
        """The frame of the body."""
        return self.values["base_frame"] or robot_frame(self, self.robot, BASE)

    def _read_pose(self, inside: Any, message: Any) -> tuple[float, Pose]:
        """Return the time and the pose of the body; ValueError: another frame, or no pose."""
        wanted = self.values["map_frame"]
        frame = message.header.frame_id
        if frame.lstrip("/") != wanted:
            raise ValueError(
                f"frame_id is {frame!r}, not {wanted!r} (parameter map_frame)"
            )
        pose = inside(message)
        turn = pose.orientation
        yaw = yaw_of(turn.x, turn.y, turn.z, turn.w)
        return seconds_of(message.header), Pose(pose.position.x, pose.position.y, yaw)

    def _see(self, seen: tuple[float, Pose] | None) -> None:
        if seen is None or self.driver is None:
            return
        self._seen = time.monotonic()
        self._stopped = False
        self.driver.sees(*seen)
        self.drive()

    def _on_goals(self, goals: Goals) -> None:
        self._step = goals.step
        if self.driver is not None:
            self.driver.take(goals)
            self.drive()

    def go_on(self, now: float) -> None:
        """Report for duty when all inputs are there; stop a body whose poses do not come."""
        if self._leaving:
            self.done = self.settled()
        if self.held and now - self._stood >= STAND_SECONDS:
            self._stood = now
            self.stop()
        if self.active and self.driver is not None:
            if self.on_duty:
                self._look_for_poses(self.driver, now)
            else:
                self._report_for_duty(self.driver)
        self.drive()

    def _look_for_poses(self, driver: Driver, now: float) -> None:
        """Stop a body under way whose poses do not come."""
        limit = self.values["pose_timeout"]
        if driver.busy and 0 < limit < now - self._seen and not self._stopped:
            self._stopped = True
            driver.lose_sight(self.now())
            self.get_logger().warning(
                f"no pose of {self.robot} for {limit:g} s (pose_timeout): it is stopped"
            )

    def _report_for_duty(self, driver: Driver) -> None:
        """Offer reports when all inputs are there, and drive when the world subscribes to them.

        The goal may be older than this node, and the body may be there already: a report without
        a subscriber would be lost, and the world would wait for it.
        """
        missing = f"poses of {self.robot}" if driver.pose is None else self.missing()
        if missing:
            self.remind(self.reminder, missing)
            return
        if self._reached_publisher is None:  # the world waits for it
            self._reached_publisher = self.announce(ros_topics.REACHED, self.robot)
        self.on_duty = self.heard_by(self._reached_publisher, WORLD)
        if self.on_duty:
            self._begin_again()
        else:
            self.remind(self.reminder, "the world to hear its reports")

    def all_done(self, now: float) -> bool:
        """Return whether the body has stopped, after the run's end."""
        return self.settled()

    def lost(self, why: str) -> None:
        """The run's world is gone: stop the body, and end."""
        if not self._leaving:
            self.get_logger().warning(f"{why}: the body of {self.robot} is stopped")
        self._leaving = True

    def may_stop(self) -> bool:
        """Stop at once: the body is driving."""
        return self.settled()

    def finish(self, *, interrupted: bool) -> None:
        """Stop the body, whatever ends the node."""
        self.settled()

    # Pauses.

    def world_said(self, status: RunStatus) -> None:
        """Stop the body where the team is paused, and let it go on with the team."""
        held = status.state in STANDING
        if held == self.held:
            return
        self.held = held
        if held:
            self.stop()
        else:
            self._begin_again()
        self.report()

    @property
    def doing(self) -> str:
        """The body's activity, in words."""
        if not self.active:
            return "inactive"
        if self.held:
            stands = self.driver is None or self.driver.stands
            return "paused: stands" if stands else "paused: is being stopped"
        if not self.on_duty:
            return "waiting"
        busy = self.driver is not None and self.driver.busy
        return "driving" if busy else "standing"

    def report(self) -> None:
        """Publish what the body does as diagnostics."""
        self._report(self.doing, {"robot": self.robot})

    def _begin_again(self) -> None:
        """Drive if that is allowed again; the time limit of the move begins anew."""
        if self.driver is not None and self.may_drive:
            self.driver.begin_again()
            self.drive()

    # The lifecycle.

    def on_activate(self, state: LifecycleState) -> TransitionCallbackReturn:
        """Move the body from now on."""
        self.active = True
        self._begin_again()
        return DONE

    def on_deactivate(self, state: LifecycleState) -> TransitionCallbackReturn:
        """Stop the body until the node is activated again."""
        self.active = False
        self.stop()
        return DONE

    def on_shutdown(self, state: LifecycleState) -> TransitionCallbackReturn:
        """Stop the body, and end."""
        self.lost("shut down")
        return DONE
