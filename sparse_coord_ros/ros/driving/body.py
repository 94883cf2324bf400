# Copyright 2026 The sparse_coord_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The body node: a kinematic simulator of all the robots' bodies of a run."""

import functools
import time
from collections import Counter
from typing import Any, Unpack

from builtin_interfaces.msg import Time
from geometry_msgs.msg import PoseStamped, Twist
from nav_msgs.msg import Odometry
from rclpy.publisher import Publisher
from std_msgs.msg import Header

from sparse_coord_ros.core.runs.run_config import NO_CLOCK, RunConfig
from sparse_coord_ros.lab.driving.body_simulator import (
    ELSEWHERE,
    IN_DOORWAY,
    PERIOD,
    BodySimulator,
)
from sparse_coord_ros.lab.driving.metric_map import MetricMap
from sparse_coord_ros.lab.driving.steering import Command
from sparse_coord_ros.lab.driving.transform_tree import parent_of
from sparse_coord_ros.protocol.lockstep.bodies import BEGIN, GoalReport, Goals
from sparse_coord_ros.protocol.wire import MAP_FRAME
from sparse_coord_ros.protocol.wire.messages import CLOCK_FORM, SECOND
from sparse_coord_ros.ros.nodes import ros_topics, transforms
from sparse_coord_ros.ros.nodes.body_messages import read_goals, read_reached
from sparse_coord_ros.ros.nodes.follower import Follower
from sparse_coord_ros.ros.nodes.parameters import PARAMETERS, NodePlace
from sparse_coord_ros.ros.nodes.ros_messages import messages_of
from sparse_coord_ros.ros.nodes.spin import run_node

REPEAT_POSES_SECONDS = 0.5
"""After this silence poses are published again: a driver that has just started has none."""

FASTEST = 1000.0
"""Speed limit, in metres or radians a second: larger commands are ignored."""


class BodyNode(Follower):
    """Receives bodies' commands (Twist), and publishes their poses: PoseStamped, Odometry, tf.

    In a run whose world does not own the clock it publishes the simulated time there.

    Args:
        period: simulated seconds a tick.
        place: where the node is made, and with what: see `NodePlace`.

    Attributes:
        simulator: the bodies, once a run has begun.

    Raises:
        SparseCoordError: a bad parameter, a body that does not fit its cells.
    """

    simulator: BodySimulator

    def __init__(self, *, period: float = PERIOD, **place: Unpack[NodePlace]) -> None:
        super().__init__("body", PARAMETERS["body"], **place)
        self._period = period
        self._said = time.monotonic()
        self._time_publisher: Publisher | None = None

    def begin(self, run: RunConfig) -> None:
        """Put the bodies at the scenario's starts."""
        messages = messages_of(run)
        names = messages.names
        metric_map = MetricMap(run, self.values["radius"])
        self.simulator = BodySimulator(
            metric_map, len(names), run.seed, period=self._period
        )
        self.simulator.put(
            {k: robot.start for k, robot in enumerate(run.scenario.robots)}
        )
        if run.clock == NO_CLOCK:
            self._time_publisher = self.announce(ros_topics.CLOCK)
        self._report = self.reporter("bodies")
        self._pose_publishers = [self.announce(ros_topics.POSE, name) for name in names]
        self._odometry_publishers = [
            self.announce(ros_topics.ODOMETRY, name) for name in names
        ]
        frames = (transforms.ODOM, transforms.BASE)
        self._frames = [
            [transforms.robot_frame(self, name, f) for f in frames] for name in names
        ]
        self._transforms = transforms.TransformPublisher(self)
        self.subscriber.listen(
            ros_topics.BODY_GOALS,
            self._on_goals,
            read=functools.partial(read_goals, messages),
        )
        for k, name in enumerate(names):
            take = functools.partial(self._on_command, k)
            self.subscriber.listen(ros_topics.CMD_VEL, take, name, read=read_command)
            report = functools.partial(read_reached, messages, k)
            self.subscriber.listen(
                ros_topics.REACHED, self._on_reached, name, read=report
            )
        if self.values["body_rate"] > 0:
            self.create_timer(self._period / self.values["body_rate"], self._on_time)
        self._say(look=True)

    def _on_goals(self, goals: Goals) -> None:
        if self.values["body_rate"] == 0:
            if self.simulator.send(goals):
                self._say(look=True)
        elif goals.placing:
            self.simulator.put({goal.robot: goal.end for goal in goals.bodies})

    def _on_command(self, robot: int, command: Command) -> None:
        if self.values["body_rate"] > 0:
            self.simulator.bodies[robot].command = command
        elif self.simulator.told(robot, command):
            self._say(look=True)

    def _on_reached(self, reached: GoalReport) -> None:
        if self.values["body_rate"] == 0 and self.simulator.reached(
            reached.robot, reached.number
        ):
            self._say(look=True)

    def _on_time(self) -> None:
        self.simulator.tick()
        self._say(look=True)

    def _say(self, *, look: bool) -> None:
        """Publish the bodies' poses; `look`: the current ones, else those of the last call."""
        simulator = self.simulator
        self._said = time.monotonic()
        if look:
            self._looks = [body.seen() for body in simulator.bodies]
        sec, nanosec = divmod(round(simulator.seconds * SECOND), SECOND)
        stamp = Time(sec=sec, nanosec=nanosec)
        if self._time_publisher is not None:
            self._time_publisher.publish(CLOCK_FORM.layout.pack(sec, nanosec))
        for k, body in enumerate(simulator.bodies):
            if not look and k not in simulator.waits_for:
                continue  # its driver would think that the body did not hear it
            odom, base = self._frames[k]
            header, within = (
                Header(stamp=stamp, frame_id=frame) for frame in (MAP_FRAME, odom)
            )
            odometry = Odometry(header=within, child_frame_id=base)
            odometry.pose.pose = transforms.pose_message(body.odometry)
            drift = transforms.transform(
                header, odom, parent_of(self._looks[k], body.odometry)
            )
            way = transforms.transform(within, base, body.odometry)
            self._transforms.publish([drift, way])
            odometry.twist.twist.linear.x, odometry.twist.twist.angular.z = body.command
            self._odometry_publishers[k].publish(odometry)
            seen = PoseStamped(
                header=header, pose=transforms.pose_message(self._looks[k])
            )
            self._pose_publishers[k].publish(seen)

    def go_on(self, now: float) -> None:
        """Publish the bodies' poses again while no body drives."""
        if now - self._said >= REPEAT_POSES_SECONDS and self.values["body_rate"] == 0:
            self._say(look=False)

    def report(self) -> None:
        """Publish the number of collisions of bodies with each other and with walls."""
        self._report("driving", self.summary())

    def summary(self) -> dict[str, Any]:
        """Return counts of events as plain data."""
        simulator = self.simulator
        where = Counter(touch.where for touch in self.simulator.touches)
        return {
            "seconds": round(simulator.seconds - BEGIN, 3),
            "touches_in_doorways": where[IN_DOORWAY],
            "touches_elsewhere": where[ELSEWHERE],
            "bumps": simulator.bumps,
        }

    def finish(self, *, interrupted: bool) -> None:
        """Log the counts of events."""
        if self.presence is None:
            return
        counts = ", ".join(f"{name} {value}" for name, value in self.summary().items())
        self.get_logger().info(f"bodies: {counts}")


def read_command(message: Twist) -> Command:
    """Return the command for a body.

    Raises:
        ValueError: a speed is not a number, or larger than any body's.
    """
    command = Command(message.linear.x, message.angular.z)
    if not all(abs(speed) <= FASTEST for speed in command):
        most = f"allowed: numbers up to {FASTEST:g}"
        raise ValueError(
            f"linear.x is {command.ahead:g}, angular.z {command.turn:g}; {most}"
        )
    return command


def main() -> int:
    """Run the node `body`."""
    return run_node(lambda context: BodyNode(context=context))
