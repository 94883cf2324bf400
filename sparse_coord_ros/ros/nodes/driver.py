# Copyright 2026 The sparse_coord_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The driver node: steers a robot's body to its cells, and reports the body's cell."""

from typing import Any

from geometry_msgs.msg import TwistStamped

from sparse_coord_ros.lab.driving.driver import Driver
from sparse_coord_ros.lab.driving.metric_map import MetricMap
from sparse_coord_ros.lab.driving.steering import STOP, Command
from sparse_coord_ros.lab.driving.trials import limits_of
from sparse_coord_ros.ros.nodes import ros_topics
from sparse_coord_ros.ros.nodes.mover import MoverNode
from sparse_coord_ros.ros.nodes.spin import run_node, wait_for_readers


class DriverNode(MoverNode):
    """Steers the body of one robot by Twist, or by TwistStamped if `stamped` is set.

    Attributes:
        driver: steers the body, once a run has begun.
    """

    KIND = "driver"
    driver: Driver

    def set_up(self) -> None:
        """Also create the publisher of commands."""
        super().set_up()
        topic = ros_topics.CMD_VEL
        self._type: Any = TwistStamped if self.values["stamped"] else topic.type
        self._cmd_vel = self.create_publisher(
            self._type, topic.of(self.robot), topic.qos
        )

    def make(self, metric_map: MetricMap, number: int) -> Driver:
        """Return the state machine that steers the body."""
        self.driver = Driver(
            metric_map, limits_of(self.values, metric_map.side), number
        )
        return self.driver

    def drive(self) -> None:
        """Send the command that is due, and report when the goal is over."""
        command, reached = self.driver.next()
        if command is not None:
            self._command(command)
        if reached is not None:
            self.report_reached(reached)

    def _command(self, command: Command) -> None:
        message = twist = self._type()
        if self.values["stamped"]:
            message.header.stamp = self.get_clock().now().to_msg()
            message.header.frame_id = self.base_frame
            twist = message.twist
        twist.linear.x, twist.angular.z = command
        self._cmd_vel.publish(message)

    def missing(self) -> str:
        """Return the text of a missing subscriber of the commands, else an empty text."""
        heard = self._cmd_vel.get_subscription_count() > 0
        return "" if heard else f"a body that hears {self._cmd_vel.topic_name}"

    def stop(self, why: str = "") -> None:
        """Stop the body."""
        self._command(STOP)
        if why:
            self.get_logger().warning(why, throttle_duration_sec=5.0)

    def stands(self) -> bool:
        """Return True: the command to stop has been sent."""
        return True

    def finish(self, *, interrupted: bool) -> None:
        """Stop the body."""
        super().finish(interrupted=interrupted)
        wait_for_readers([self._cmd_vel])


def main() -> int:
    """Run the node `driver`."""
    return run_node(lambda context: DriverNode(context=context))
