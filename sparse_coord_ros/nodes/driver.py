# Copyright 2026 The sparse_coord_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The driver node: takes a robot's moves to its body, and says which cell the body is in."""

import functools
import time
from dataclasses import replace
from typing import Any, Unpack

from geometry_msgs.msg import PoseStamped, PoseWithCovarianceStamped, Twist
from nav_msgs.msg import Odometry
from rclpy.qos import DurabilityPolicy, QoSProfile, ReliabilityPolicy

from sparse_coord_ros.driving.driver import Driver
from sparse_coord_ros.driving.ground import Ground, Pose
from sparse_coord_ros.driving.steering import STOP, Command
from sparse_coord_ros.driving.transforms import Tree, yaw_of
from sparse_coord_ros.driving.trials import limits_of
from sparse_coord_ros.errors import RunError, SettingError
from sparse_coord_ros.learn.run_config import RunConfig
from sparse_coord_ros.lockstep.bodies import Goals
from sparse_coord_ros.nodes import interface
from sparse_coord_ros.nodes.follower import Follower
from sparse_coord_ros.nodes.messages import (
    Converter,
    reached_message,
    read_goals,
    robot_number,
)
from sparse_coord_ros.nodes.parameters import PARAMETERS, TF, Place
from sparse_coord_ros.nodes.spin import run_node, wait_for_readers

POSES_QOS = QoSProfile(depth=10, reliability=ReliabilityPolicy.BEST_EFFORT)
"""Of poses and odometry of real robots: hears publishers of any reliability."""

TF_QOS = QoSProfile(depth=100, reliability=ReliabilityPolicy.BEST_EFFORT)
STATIC_QOS = QoSProfile(depth=100, durability=DurabilityPolicy.TRANSIENT_LOCAL)

TYPES: dict[str, tuple[Any, Any]] = {
    "pose": (PoseStamped, lambda message: message.pose),
    "pose_with_covariance": (PoseWithCovarianceStamped, lambda message: message.pose.pose),
    "odometry": (Odometry, lambda message: message.pose.pose),
}
"""Message classes that hold a pose, and where."""

HEAP_SECONDS = 0.2
"""Poses of the same time that come closer together were published long ago."""


class DriverNode(Follower):
    """Drives the body of one robot.

    Args:
        name: the node's name unless the command line remaps it.
        place: where the node is made, and with what: see `Place`.

    Attributes:
        driver: what drives the body, once a run has begun.

    Raises:
        SparseCoordError: a bad parameter, a robot that the run does not have, a body that does
            not fit its cells, no tf2_msgs where tf is asked for.
    """

    driver: Driver

    def __init__(self, *, name: str = "driver", **place: Unpack[Place]) -> None:
        super().__init__(name, PARAMETERS["driver"], **place)
        self._step = 0
        self._seen = 0.0
        self._pose_time: float | None = None
        self._stopped = False
        self._reached_publisher: Any = None
        self._tree = Tree()
        topic = interface.CMD_VEL
        self._cmd_vel = self.create_publisher(topic.type, topic.of(self._robot), topic.qos)

    def set_up(self) -> None:
        """Look whose body it is."""
        self._robot = self.values["robot"]
        if not self._robot:
            raise SettingError(
                "parameter robot: none is given; start the node with --ros-args -p robot:=NAME, "
                "a robot of the scenario"
            )

    def begin(self, run: RunConfig) -> None:
        """Begin with a run: hear goals and poses."""
        names = [robot.name for robot in run.scenario.robots]
        number = robot_number(run, self._robot, "give parameter robot one of them")
        ground = Ground(run, self.values["radius"])
        self.driver = Driver(ground, limits_of(self.values, ground.side), number)
        self._convert = Converter(run)
        read = functools.partial(read_goals, self._convert, names)
        self.intake.listen(interface.BODY_GOALS, self._on_goals, read=read)
        pose_type = self.values["pose_type"]
        if pose_type == TF:
            self._hear_transforms()
        else:
            kind, inside = TYPES[pose_type]
            self.intake.listen(
                replace(interface.POSE, type=kind),
                self._see,
                self._robot,
                read=functools.partial(self._read_pose, inside),
                qos=interface.POSE.qos if pose_type == "pose" else POSES_QOS,
            )

    def _hear_transforms(self) -> None:
        try:
            from tf2_msgs.msg import TFMessage
        except ImportError as error:
            raise RunError(
                f"parameter pose_type: tf needs the package tf2_msgs ({error}); install it, or "
                "take a topic of poses"
            ) from None
        topic = replace(interface.POSE, type=TFMessage)
        for name, qos in (("/tf", TF_QOS), ("/tf_static", STATIC_QOS)):
            read = functools.partial(self._read_transforms, qos is STATIC_QOS)
            self.intake.listen(topic, self._see, name=name, read=read, qos=qos)

    def _read_transforms(self, static: bool, message: Any) -> tuple[float, Pose] | None:
        """Return when the body was where, as far as that is known; ValueError: no transforms."""
        for one in message.transforms:
            place, turn = one.transform.translation, one.transform.rotation
            pose = Pose(place.x, place.y, yaw_of(turn.x, turn.y, turn.z, turn.w))
            seconds = None if static else _seconds(one.header)
            self._tree.hear(one.header.frame_id, one.child_frame_id, pose, seconds)
        base = self.values["base_frame"] or f"{self._robot}/base_link"
        return self._tree.find(self.values["map_frame"], base)

    def _read_pose(self, inside: Any, message: Any) -> tuple[float, Pose]:
        """Return when the body was where; ValueError: in another frame, or no pose."""
        wanted = self.values["map_frame"]
        if message.header.frame_id.lstrip("/") != wanted:
            raise ValueError(
                f"frame_id is {message.header.frame_id!r}, not {wanted!r} (parameter map_frame)"
            )
        pose = inside(message)
        turn = pose.orientation
        yaw = yaw_of(turn.x, turn.y, turn.z, turn.w)
        return _seconds(message.header), Pose(pose.position.x, pose.position.y, yaw)

    def _see(self, seen: tuple[float, Pose] | None) -> None:
        if seen is None:
            return
        now, seconds = time.monotonic(), seen[0]
        if seconds == self._pose_time and now - self._seen < HEAP_SECONDS:
            return  # they came while this node slept: the body does not wait for an answer
        self._seen, self._stopped, self._pose_time = now, False, seconds
        self.driver.sees(*seen)
        self._drive()

    def _on_goals(self, goals: Goals) -> None:
        self._step = goals.step
        self.driver.take(goals)
        self._drive()

    def _drive(self) -> None:
        """Command what is to be done now, and report where the goal is over."""
        command, reached = self.driver.next()
        if command is not None:
            self._command(command)
        if reached is not None and self._reached_publisher is not None:
            message = reached_message(self._convert, self._step, reached)
            self._reached_publisher.publish(message)

    def _command(self, command: Command) -> None:
        message = Twist()
        message.linear.x, message.angular.z = command
        self._cmd_vel.publish(message)

    def go_on(self, now: float) -> None:
        """Report for duty when body and poses are there; stop a body whose poses do not come."""
        if self._reached_publisher is None:
            if self.driver.pose is None:
                self.remind(self.reminder, f"poses of {self._robot}")
            elif self._cmd_vel.get_subscription_count() == 0:
                self.remind(self.reminder, f"a body that hears {self._cmd_vel.topic_name}")
            else:  # the world waits for this publisher
                self._reached_publisher = self.announce(interface.REACHED, self._robot)
            return
        limit = self.values["pose_timeout"]
        if self.driver.busy and 0 < limit < now - self._seen and not self._stopped:
            self._stopped = True
            self._command(STOP)
            self.get_logger().warning(
                f"no pose of {self._robot} for {limit:g} s (pose_timeout): its body is stopped",
                throttle_duration_sec=5.0,
            )

    def may_stop(self) -> bool:
        """Stop at once: the body is driving."""
        return True

    def finish(self, *, interrupted: bool) -> None:
        """Stop the body."""
        self._command(STOP)
        wait_for_readers([self._cmd_vel])


def _seconds(header: Any) -> float:
    """Return a header's time; the steady clock's where it has none."""
    stamp = header.stamp
    if stamp.sec == 0 and stamp.nanosec == 0:
        return time.monotonic()
    return float(stamp.sec) + stamp.nanosec * 1e-9


def main(args: list[str] | None = None) -> int:
    """Run the node `driver`."""
    return run_node(lambda context: DriverNode(context=context), args)
