# Copyright 2026 The sparse_coord_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The nav2_driver node: a robot's moves as goals of Nav2's action NavigateToPose.

The action must have one server: goals go to all servers, and two would steer one base. Discovery
finds one server before the other. So before its first goal the node waits until it has seen a
single server for a while. A server that appears later is reported: to stop halfway would not
help. (rclpy's EventsExecutor ends the process with a
segmentation fault when several servers answer; its SingleThreadedExecutor does not.)
"""

import functools
import time
from typing import Any

from action_msgs.msg import GoalStatus
from action_msgs.srv import CancelGoal
from rclpy.action import ActionClient
from rclpy.action.client import ClientGoalHandle
from rclpy.executors import SingleThreadedExecutor
from rclpy.task import Future

from sparse_coord_ros.base.errors import needed
from sparse_coord_ros.core.game.pose import Pose
from sparse_coord_ros.lab.driving.metric_map import MetricMap
from sparse_coord_ros.lab.driving.nav2_driver import ANSWER_SECONDS, Nav2Driver
from sparse_coord_ros.ros.driving.driver_node import DriverNode
from sparse_coord_ros.ros.nodes.spin import run_node
from sparse_coord_ros.ros.nodes.transforms import pose_message

ENDINGS = {
    GoalStatus.STATUS_ABORTED: "aborted",
    GoalStatus.STATUS_CANCELED: "cancelled by others",
}
"""The counter of each status of a failed goal; any other status is of a server that came back."""

SINGLE_SECONDS = 2.0
"""How long a server must have been the only one: discovery may find a second one later."""

UNKNOWN_NODE = "NODE_NAME_UNKNOWN"
"""Part of the name that rcl gives a node that it has only half discovered."""

WARNING_SECONDS = 10.0
"""Between two warnings of a second server that appeared later."""


class Nav2DriverNode(DriverNode):
    """Sends the body of one robot from cell to cell by Nav2; the port of `Nav2Driver`.

    Raises:
        SparseCoordError: as of `DriverNode`; nav2_msgs is not installed.
    """

    KIND = "nav2_driver"
    driver: Nav2Driver

    def set_up(self) -> None:
        """Also import Nav2's messages, and create the client of its action."""
        super().set_up()
        remedy = (
            "sudo apt install ros-jazzy-nav2-msgs, or start the node driver instead"
        )
        with needed(f"node {self.get_name()} needs the package nav2_msgs", remedy):
            from nav2_msgs.action import NavigateToPose
        self._type: Any = NavigateToPose
        action = self.values["action"] or f"{self.robot}/navigate_to_pose"
        self._client = ActionClient(self, self._type, action)
        self._cancelling = self.create_client(
            CancelGoal, f"{action}/_action/cancel_goal"
        )
        self._name = self.resolve_service_name(action)
        self._handles: dict[int, ClientGoalHandle] = {}
        self._single_since: float | None = None
        self._cleared: tuple[float, Future] | None = None
        self._ending: tuple[float, Future] | None = None

    def make(self, metric_map: MetricMap, number: int) -> Nav2Driver:
        """Return a driver whose goals this node sends."""
        near = self.values["near"] * metric_map.side
        return Nav2Driver(metric_map, near, self.values["step_seconds"], number, self)

    def report(self) -> None:
        """Also warn if Nav2's action has a second server by now."""
        super().report()
        servers = self._servers()
        if self.on_duty and len(servers) > 1:
            text = self._several(servers)
            self.get_logger().warning(text, throttle_duration_sec=WARNING_SECONDS)

    def _servers(self) -> list[str]:
        """Return the names of the servers of Nav2's action: each publishes its status.

        As long as one of them is only half discovered, the list is empty.
        """
        infos = self.get_publishers_info_by_topic(f"{self._name}/_action/status")
        if any(UNKNOWN_NODE in info.node_name for info in infos):
            return []
        return sorted(
            f"{info.node_namespace.rstrip('/')}/{info.node_name}" for info in infos
        )

    def _several(self, servers: list[str]) -> str:
        return (
            f"Nav2's action {self._name} has {len(servers)} servers, {', '.join(servers)}; it "
            "should have one: stop the others (a node that was killed is forgotten after 20 s)"
        )

    def missing(self) -> str:
        """Return a text if Nav2 is missing, runs twice, or may still drive for another client."""
        servers = self._servers()
        now = time.monotonic()
        if len(servers) != 1 or not self._client.server_is_ready():
            self._single_since = self._cleared = None
        if len(servers) > 1:
            return f"a single server: {self._several(servers)}"
        if not servers or not self._client.server_is_ready():
            return f"Nav2's action {self._name}"
        self._single_since = self._single_since or now
        if now - self._single_since < SINGLE_SECONDS:
            return f"a second server of Nav2's action {self._name} to show, if any"
        if self._cleared is None:
            self._cleared = now, self.cancel_all()
        since, answer = self._cleared
        waits = not answer.done() and now - since < ANSWER_SECONDS
        return "Nav2 to end earlier goals" if waits else ""

    def settled(self) -> bool:
        """Cancel Nav2's goals; return whether it has confirmed the end, or time is up."""
        super().settled()
        if self.driver is None:
            return True
        if self._ending is None:
            self._ending = time.monotonic(), self.cancel_all()
        since, answer = self._ending
        answered = self.driver.stands and answer.done()
        return answered or time.monotonic() - since >= ANSWER_SECONDS

    def finish(self, *, interrupted: bool) -> None:
        """Log the counts of the moves, and whether the body may still drive."""
        self.settled()
        if self.driver is not None:
            if not self.driver.stands:
                self.say(
                    "Nav2 did not confirm the end of its last goal: the body may still drive"
                )
            counts = sorted(self.driver.counts.items())
            moves = ", ".join(f"{kind} {number}" for kind, number in counts)
            self.get_logger().info(f"moves: {moves or 'none'}")

    # The port.

    def send(self, ticket: int, target: Pose) -> bool:
        """Send a goal."""
        if not self._client.server_is_ready():
            self.get_logger().warning(
                f"no server of {self._name}", throttle_duration_sec=5.0
            )
            return False
        goal = self._type.Goal()
        goal.pose.header.frame_id = self.values["map_frame"]
        goal.pose.pose = pose_message(target)
        heard = self.guarded(functools.partial(self._on_feedback, ticket))
        answer = self._client.send_goal_async(goal, feedback_callback=heard)
        answer.add_done_callback(
            self.guarded(functools.partial(self._on_answer, ticket))
        )
        return True

    def cancel(self, ticket: int) -> None:
        """Ask for the end of one goal."""
        if ticket in self._handles:
            self._handles[ticket].cancel_goal_async()

    def cancel_all(self) -> Future:
        """Ask for the end of all goals, also those of other clients; return the answer."""
        return self._cancelling.call_async(CancelGoal.Request())

    def say(self, text: str) -> None:
        """Log a text."""
        self.get_logger().warning(f"{self.robot}: {text}")

    def _on_answer(self, ticket: int, answer: Future) -> None:
        handle = answer.result()
        if handle.accepted:
            self._handles[ticket] = handle
            ended = self.guarded(functools.partial(self._on_result, ticket))
            handle.get_result_async().add_done_callback(ended)
            self.driver.accepted(ticket, self.now())
        else:
            self.driver.rejected(ticket, self.now())
        self.drive()

    def _on_feedback(self, ticket: int, message: Any) -> None:
        self.driver.feedback(ticket, message.feedback.distance_remaining, self.now())

    def _on_result(self, ticket: int, answer: Future) -> None:
        outcome = answer.result()
        self._handles.pop(ticket, None)
        kind = why = ""
        if outcome.status != GoalStatus.STATUS_SUCCEEDED:
            kind = ENDINGS.get(outcome.status, "forgotten")
            text = f" {outcome.result.error_msg}" if outcome.result.error_msg else ""
            why = f"Nav2's goal: {kind}, error code {outcome.result.error_code}{text}"
        self.driver.ended(ticket, self.now(), kind, why)
        self.drive()


def main() -> int:
    """Run the node `nav2_driver`."""
    return run_node(
        lambda context: Nav2DriverNode(context=context),
        executor=lambda context: SingleThreadedExecutor(context=context),
    )
