# Copyright 2026 The sparse_coord_ros authors
# SPDX-License-Identifier: Apache-2.0
"""A node that goes along with a world's run: begins when it is announced, and ends with it."""

import time
from collections.abc import Mapping
from typing import Any

from rclpy.context import Context

from sparse_coord_ros.game.settings import SettingTable
from sparse_coord_ros.learn.run_config import RunConfig
from sparse_coord_ros.lockstep.waiting import WorldPresence
from sparse_coord_ros.nodes import interface
from sparse_coord_ros.nodes.intake import Intake
from sparse_coord_ros.nodes.messages import Announced, Said, read_run, read_status, typed
from sparse_coord_ros.nodes.parameters import ParameterNode

TICK_SECONDS = 0.02
REPORT_SECONDS = 1.0


class Follower(ParameterNode):
    """Hears a run and its world.

    Args:
        name: the node's name unless the command line remaps it.
        table: its parameters; `world_timeout` and `startup_timeout` are among them.
        context: the ROS context.
        namespace: the team's namespace.
        values: parameters given by the program; None: by the command line.

    Attributes:
        intake: its subscriptions.

    Raises:
        SparseCoordError: a bad parameter, no world simulator.
    """

    def __init__(
        self,
        name: str,
        table: SettingTable,
        *,
        context: Context,
        namespace: str = "",
        values: Mapping[str, Any] | None = None,
    ) -> None:
        super().__init__(name, table, context=context, namespace=namespace, values=values)
        self.intake = Intake(self)
        self._watch: WorldPresence | None = None
        self._announced: Announced | None = None
        self._status: Said | None = None
        self._reported = time.monotonic()
        self.intake.listen(interface.RUN, self._on_run, read=typed(interface.RUN, read_run))
        read = typed(interface.STATUS, read_status)
        self.intake.listen(interface.STATUS, self._on_status, read=read)
        self.create_timer(TICK_SECONDS, self._tick)

    def begin(self, run: RunConfig) -> None:
        """Begin with a run."""

    def go_on(self, now: float) -> None:
        """Do what is due at a time; called every `TICK_SECONDS`."""

    def report(self) -> None:
        """Say how it goes; called every `REPORT_SECONDS`."""

    def _on_run(self, announced: Announced) -> None:
        if self._watch is None:
            self._announced = announced
        elif self._announced is not None and announced.run.id != self._announced.run.id:
            self._watch.another_run()

    def _on_status(self, said: Said) -> None:
        if self._watch is None:
            self._status = said
            return
        try:
            self._watch.hear(*said[:4], time.monotonic())
        except ValueError as error:
            self.intake.drop(interface.STATUS.name, error)

    def _tick(self) -> None:
        now = time.monotonic()
        if self._announced is None:
            self.check_startup_time()
            return
        if self._watch is None:
            run = self._announced.run
            patience = self.values["world_timeout"]
            self._watch = WorldPresence(run.id, run.scenario.steps, patience, now)
            self.begin(run)
            if self._status is not None:
                self._on_status(self._status)
        self.go_on(now)
        if self._watch.end is not None:
            self.done = True
        if now - self._reported < REPORT_SECONDS:
            return
        self._reported = now
        self.report()
        missed = self._watch.to_say(now)
        if missed:
            self.get_logger().warning(missed)
        gone = self._watch.given_up(now)
        if gone:
            self.get_logger().warning(f"{gone}: this node ends")
            self.done = True
