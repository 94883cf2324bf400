# Copyright 2026 The sparse_coord_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The robot node: one agent of Algorithm 1, which knows of its peers only what they answer."""

import sys
import time
from collections.abc import Mapping
from typing import Any

from rclpy.context import Context

from sparse_coord_ros.lockstep.waiting import WorldPresence
from sparse_coord_ros.nodes import interface
from sparse_coord_ros.nodes.claim import Claim
from sparse_coord_ros.nodes.intake import Intake
from sparse_coord_ros.nodes.member import Member
from sparse_coord_ros.nodes.messages import Announced, Said, read_run, read_status, typed
from sparse_coord_ros.nodes.parameters import ROBOT_PARAMETERS, ParameterNode
from sparse_coord_ros.nodes.peers import Clients
from sparse_coord_ros.nodes.spin import run_node, wait_for_readers
from sparse_coord_ros.nodes.tap import Tap

TICK_SECONDS = 0.02
REPORT_SECONDS = 1.0
STOP_SECONDS = 1.0
"""How long a robot that gets a signal waits for the world's last status: both may get it."""
LAST_WORDS_SECONDS = 2.0
"""How long a robot waits for its last reward after the run's end."""


class RobotNode(ParameterNode):
    """Holds Q*_k and Q^C_k, acts and learns; the node's name is the robot's name.

    Args:
        context: the ROS context.
        name: the robot's name unless the command line remaps it.
        namespace: the team's namespace.
        values: parameters given by the program; None: by the command line.
        tap: the way to a recorder in the same process.
        clients: those of the robots of the same process; None: it is alone.

    Attributes:
        name: the robot's name.
        member: its part in the run, which says what it does by the publishers here; None: the run
            is not known yet.
        watch: whether the world of its run is there; None: likewise.
        intake: its subscriptions.
        claim: its claim to its name.

    Raises:
        SparseCoordError: a bad parameter, a name that is taken or that the scenario does not have,
            no world simulator.
    """

    member: Member | None = None

    def __init__(
        self,
        *,
        context: Context,
        name: str = "robot",
        namespace: str = "",
        values: Mapping[str, Any] | None = None,
        tap: Tap | None = None,
        clients: Clients | None = None,
    ) -> None:
        super().__init__(
            name, ROBOT_PARAMETERS, context=context, namespace=namespace, values=values, tap=tap
        )
        self.name = self.get_name()
        self._shared_clients = Clients() if clients is None else clients
        self.watch: WorldPresence | None = None
        self.intake = Intake(self)
        self.claim = Claim(self, self.intake)
        self._announced: Announced | None = None
        self._status: Said | None = None
        self._stopping: float | None = None
        self._reported = time.monotonic()
        self.action_publisher = self.announce(interface.ACTION, self.name)
        self.percept_publisher = self.announce(interface.PERCEPT, self.name)
        self.map_publisher = self.announce(interface.COORDINATION_MAP, self.name)
        self.tables_publisher = self.announce(interface.TABLES, self.name)
        self.progress_publisher = self.announce(interface.PROGRESS, self.name)
        self.diagnostics_publisher = self.announce(interface.DIAGNOSTICS)
        self.intake.listen(interface.RUN, self._on_run, read=typed(interface.RUN, read_run))
        read = typed(interface.STATUS, read_status)
        self.intake.listen(interface.STATUS, self._on_status, read=read)
        self.create_timer(TICK_SECONDS, self._tick)

    def _on_run(self, announced: Announced) -> None:
        before = self._announced
        if self.watch is None:
            self._announced = announced
        elif before is not None and announced.run.id != before.run.id:
            self.watch.another_run()
            self.get_logger().warning(
                "another world simulator has begun a run; this robot stays with the run that it "
                "is in, and ends when the world of that is gone"
            )

    def _on_status(self, said: Said) -> None:
        if self.watch is None or self.member is None:
            self._status = said  # perhaps the world's last word
            return
        try:
            self.watch.hear(*said[:4], time.monotonic())
        except ValueError as error:
            self.intake.drop(interface.STATUS.name, error)
            return
        self.member.obey(said.order)
        self.member.world_said(said.step)

    def _tick(self) -> None:
        now = time.monotonic()
        if now - self.born < self.values["claim_window"]:
            return
        self.claim.hold()
        if self._announced is None:
            self.check_startup_time()
            return
        if self.member is None or self.watch is None:
            run, patience = self._announced.run, self.values["world_timeout"]
            self.watch = WorldPresence(run.id, run.scenario.steps, patience, now)
            self.member = Member(self, run, self._announced.text, self._shared_clients)
            if self._status is not None:
                self._on_status(self._status)
        self._go_on(self.member, self.watch, now)

    def _go_on(self, member: Member, watch: WorldPresence, now: float) -> None:
        if not member.joined:
            member.join_when_ready(now)
        elif watch.end is None:
            member.watch_the_deadline(now)
        elif member.has_learned(watch.end) or now - watch.ended > LAST_WORDS_SECONDS:
            self.done = True
        if now - self._reported >= REPORT_SECONDS:
            self._reported = now
            member.report()
            missed = watch.to_say(now)
            if missed:
                self.get_logger().warning(missed)
            gone = watch.given_up(now)
            if gone:
                self.get_logger().warning(f"{gone}: this robot saves and ends")
                self.done = True

    def may_stop(self) -> bool:
        """Whether all is learned up to the step at which the world stopped, or it does not.

        World and robots often get the same signal: then all save what is of one time step.
        """
        now = time.monotonic()
        self._stopping = self._stopping or now
        if self.member is None or self.watch is None or self.done or not self.member.joined:
            return True
        if self.watch.end is not None and self.member.has_learned(self.watch.end):
            return True
        return now - self._stopping > STOP_SECONDS

    def destroy_node(self) -> None:
        """As `Node`'s; others may have its checkpoints then."""
        if self.member is not None:
            self.member.close()
        super().destroy_node()

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
