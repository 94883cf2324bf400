# Copyright 2026 The sparse_coord_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The robot node: one agent of Algorithm 1, which knows of its peers only what they answer."""

import sys
import time
from collections.abc import Callable, Mapping
from typing import Any, NamedTuple

from diagnostic_msgs.msg import DiagnosticStatus
from rclpy.context import Context
from std_msgs.msg import String

from sparse_coord_ros.core import wire
from sparse_coord_ros.core.run_config import run_from_yaml
from sparse_coord_ros.nodes import interface
from sparse_coord_ros.nodes.claim import Claim
from sparse_coord_ros.nodes.member import Member
from sparse_coord_ros.nodes.messages import status_values
from sparse_coord_ros.nodes.parameters import ROBOT_PARAMETERS, ParameterNode, stops_on_bad_input
from sparse_coord_ros.nodes.spin import run_node, wait_for_readers
from sparse_coord_ros.nodes.tap import Tap

TICK_SECONDS = 0.02
REPORT_SECONDS = 1.0
LAST_WORDS_SECONDS = 2.0
"""How long a robot waits for its last reward after the run's end."""


class End(NamedTuple):
    """The world has said that the run is over: its last time step, and when it said so."""

    step: int
    heard: float


class RobotNode(ParameterNode):
    """Holds Q*_k and Q^C_k, acts and learns; the node's name is the robot's name.

    Args:
        context: the ROS context.
        name: the robot's name unless the command line remaps it.
        namespace: the team's namespace.
        values: parameters given by the program; None: by the command line.
        tap: the way to a recorder in the same process.

    Raises:
        SparseCoordError: a bad parameter, a name that is taken or that the scenario does not have,
            no world simulator.
    """

    def __init__(
        self,
        *,
        context: Context,
        name: str = "robot",
        namespace: str = "",
        values: Mapping[str, Any] | None = None,
        tap: Tap | None = None,
    ) -> None:
        super().__init__(
            name, ROBOT_PARAMETERS, context=context, namespace=namespace, values=values, tap=tap
        )
        self.name = self.get_name()
        self.member: Member | None = None
        self._announced: str | None = None
        self._end: End | None = None
        self._reported = time.monotonic()
        self._claim = Claim(self)
        self.action_publisher = self.announce(interface.ACTION, self.name)
        self.percept_publisher = self.announce(interface.PERCEPT, self.name)
        self.map_publisher = self.announce(interface.COORDINATION_MAP, self.name)
        self.tables_publisher = self.announce(interface.TABLES, self.name)
        self.diagnostics_publisher = self.announce(interface.DIAGNOSTICS)
        self.listen(interface.RUN, self._on_run)
        self.listen(interface.STATUS, self._on_status)
        self.create_timer(TICK_SECONDS, self._tick)

    def listen(
        self,
        topic: interface.RosTopic,
        callback: Callable[[Any], None],
        robot: str = "",
        *,
        raw: bool = False,
    ) -> None:
        """Subscribe to a topic of the team, or of a robot; `raw`: to the messages' bytes."""
        name = topic.of(robot) if robot else topic.name
        self.create_subscription(topic.type, name, callback, topic.qos, raw=raw)

    @stops_on_bad_input
    def _on_run(self, message: String) -> None:
        if self._announced is not None:  # a world announces its run once
            self.get_logger().warning(
                "another world simulator has started; this robot stays with the run that it is "
                "in, restart it to join the other"
            )
            return
        run_from_yaml(message.data, where=f"topic {interface.RUN.name}")
        self._announced = message.data

    def _on_status(self, message: DiagnosticStatus) -> None:
        if message.message not in (wire.FINISHED, wire.STOPPED):
            return
        try:
            step = int(status_values(message)["step"])
        except (KeyError, ValueError) as error:
            self.get_logger().warning(f"{interface.STATUS.name}: no step ({error}); ignored")
            return
        self._end = End(step, time.monotonic() if self._end is None else self._end.heard)

    @stops_on_bad_input
    def _tick(self) -> None:
        now = time.monotonic()
        if now - self.born < self.values["claim_window"]:
            return
        if self._announced is None:
            self.check_startup_time()
            return
        if self.member is None:
            text = self._announced
            run = run_from_yaml(text, where=f"topic {interface.RUN.name}")
            self.member = Member(self, run, text)
        self._go_on(self.member, now)

    def _go_on(self, member: Member, now: float) -> None:
        if not member.joined:
            member.join_when_ready(now)
        elif self._end is None:
            member.watch_the_deadline(now)
        elif member.has_learned(self._end.step) or now - self._end.heard > LAST_WORDS_SECONDS:
            self.done = True
        if now - self._reported >= REPORT_SECONDS:
            self._reported = now
            member.report()
            if self.world_is_gone():
                self.get_logger().warning("the world simulator is gone: this robot ends too")
                self.done = True

    def finish(self, *, interrupted: bool) -> None:
        """Publish the last coordination map and the tables, save them and let all arrive."""
        if self.member is None:
            return
        self.member.finish()
        wait_for_readers(
            (
                self.action_publisher,
                self.percept_publisher,
                self.map_publisher,
                self.tables_publisher,
            )
        )


def main(args: list[str] | None = None) -> int:
    """Run the node `robot`."""
    return run_node(lambda context: RobotNode(context=context), args)


if __name__ == "__main__":
    sys.exit(main())
