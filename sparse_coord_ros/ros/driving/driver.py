# Copyright 2026 The sparse_coord_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The driver node: steers a robot's body by commands of velocity, on `<robot>/cmd_vel`."""

from typing import Any

from geometry_msgs.msg import TwistStamped

from sparse_coord_ros.lab.driving.cmd_vel_driver import CmdVelDriver
from sparse_coord_ros.lab.driving.metric_map import MetricMap
from sparse_coord_ros.lab.driving.steering import Command
from sparse_coord_ros.lab.driving.trials import limits_of
from sparse_coord_ros.ros.driving.driver_node import DriverNode
from sparse_coord_ros.ros.nodes import ros_topics
from sparse_coord_ros.ros.nodes.spin import run_node, wait_for_readers


class CmdVelDriverNode(DriverNode):
    """Steers the body of one robot by Twist, or by TwistStamped if `stamped` is set."""

    KIND = "driver"

    def set_up(self) -> None:
        """Also create the publisher of commands."""
        super().set_up()
        topic = ros_topics.CMD_VEL
        self._type: Any = TwistStamped if self.values["stamped"] else topic.type
        self._cmd_vel = self.create_publisher(
            self._type, topic.of(self.robot), topic.qos
        )

    def make(self, metric_map: MetricMap, number: int) -> CmdVelDriver:
        """Return a driver whose commands this node publishes."""
        limits = limits_of(self.values, metric_map.side)
        return CmdVelDriver(metric_map, limits, number, self._send)

    def _send(self, command: Command) -> None:
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

    def finish(self, *, interrupted: bool) -> None:
        """Stop the body."""
        super().finish(interrupted=interrupted)
        wait_for_readers([self._cmd_vel])


def main() -> int:
    """Run the node `driver`."""
    return run_node(lambda context: CmdVelDriverNode(context=context))
