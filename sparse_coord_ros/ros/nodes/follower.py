# Copyright 2026 The sparse_coord_ros authors
# SPDX-License-Identifier: Apache-2.0
"""A node that follows a run: it begins when a world announces one, and ends with it."""

import time
from typing import Any, Unpack

from sparse_coord_ros.base.errors import RunError, message_of
from sparse_coord_ros.core.game.settings import SettingTable
from sparse_coord_ros.core.runs.run_config import RunConfig
from sparse_coord_ros.protocol.lockstep.timeouts import (
    SILENT_SECONDS,
    Reminder,
    WorldPresence,
)
from sparse_coord_ros.protocol.wire.status import Order, RunStatus, read_status
from sparse_coord_ros.ros.nodes import ros_topics
from sparse_coord_ros.ros.nodes.environment import ros_domain
from sparse_coord_ros.ros.nodes.outputs import check_place
from sparse_coord_ros.ros.nodes.parameters import NodePlace, ParameterNode
from sparse_coord_ros.ros.nodes.ros_messages import read_run, run_announced

TICK_SECONDS = 0.02
REPORT_SECONDS = 1.0
START_A_WORLD = (
    "start one: ros2 run sparse_coord_ros world_simulator --ros-args -p scenario:=env1"
)
ALONE_SECONDS = 2.5
"""After so long without a run a node says so: a world that has just started listens first."""

STOP_SECONDS = 1.0
"""How long a node that gets a signal waits for the world's last status: both may get it."""


class Follower(ParameterNode):
    """Subscribes to the world's `run` and `status`, and calls methods that subclasses override.

    In this order: `may_begin` until it is true, `begin` once, then with every tick `go_on`, every
    second `report`, with every status of the run's world `world_said`. After the run's end the
    node is `done` as soon as `all_done` returns True. A world without a message for
    `world_timeout` is lost: `lost` ends the node.

    Args:
        name: the node's name unless the command line remaps it.
        table: its parameters.
        place: where the node is made, and with what: see `NodePlace`.

    Attributes:
        startup_timeout: the seconds that it waits for a run.
        world_timeout: the seconds without a message of the world until it is lost; 0: it never is.
        part: the object whose `go_on`, `report`, `world_said` and `all_done` are called: this
            node, or an object that `begin` sets.
        run: the run, once it is announced.
        status: the world's last status.
        presence: whether the run's world is present; None: the node has not begun.

    Raises:
        SparseCoordError: a bad parameter, no world simulator.
    """

    tick_seconds = TICK_SECONDS
    startup_timeout = 60.0
    world_timeout = 60.0

    def __init__(
        self, name: str, table: SettingTable, **place: Unpack[NodePlace]
    ) -> None:
        super().__init__(name, table, **place)
        self.part: Any = self
        self.run: RunConfig | None = None
        self.status: RunStatus | None = None
        self.presence: WorldPresence | None = None
        self._missing = Reminder()
        self._alone = False
        self._refused = ""
        self._reported = time.monotonic()
        self._stopping: float | None = None
        self.subscriber.listen_packed(
            ros_topics.RUN, lambda data: (self._read_run(data),), self._on_run
        )
        self.subscriber.listen(ros_topics.STATUS, self._on_status, read=read_status)
        self.create_timer(self.tick_seconds, self._tick)

    def set_up(self) -> None:
        """Refuse an impossible output directory before a run is announced."""
        check_place(self.values.get("out", ""))

    @property
    def knows_the_world(self) -> bool:
        """True if the world of the announced run has said how it stands."""
        run = self.run
        return run is not None and self.status is not None and self.status.run == run.id

    @property
    def order_before(self) -> Order:
        """The world's order so far; it is for those who were there before."""
        return Order() if self.status is None else self.status.order

    def may_begin(self, now: float) -> bool:
        """Return whether the node is ready for a run; called with every tick until it begins."""
        return True

    def wait(self) -> None:
        """Wait for the announcement of a run; called with every tick until it comes.

        Raises:
            RunError: no world simulator has announced one that the node can follow within
                `startup_timeout`.
        """
        topic = self.resolve_topic_name(ros_topics.RUN.name)
        limit = self.startup_timeout
        now = time.monotonic()
        if now - self.born >= ALONE_SECONDS and not self._alone:
            self._alone = True
            self.get_logger().info(
                f"no world simulator on {topic} in ROS domain {ros_domain()} so far; "
                f"{START_A_WORLD}"
            )
        which = "another" if self._refused else "a"
        self.remind(self.reminder, f"{which} world simulator on {topic}", START_A_WORLD)
        if limit < now - self.born:
            if self._refused:
                raise RunError(
                    f"node {self.get_name()} cannot follow the run on {topic}: "
                    f"{self._refused}"
                )
            raise RunError(
                f"node {self.get_name()} found no world simulator on {topic} "
                f"within {limit:g} s; {START_A_WORLD}"
            )

    def check(self, run: RunConfig) -> None:
        """Raise `SparseCoordError` if the node cannot follow a run; it waits for another."""

    def begin(self, run: RunConfig) -> None:
        """Begin with a run."""

    def world_said(self, status: RunStatus) -> None:
        """Read a status of the run's world, also the last one before the node began."""

    def go_on(self, now: float) -> None:
        """Do the work that is due; called with every tick."""

    def report(self) -> None:
        """Publish diagnostics; called every second."""

    def all_done(self, now: float) -> bool:
        """Return whether all work after the run's end is done."""
        return True

    def another_run(self, data: bytes) -> RunConfig | None:
        """Return the run of another world that is announced; None: the node stays with its own."""
        assert self.presence is not None
        self.presence.another_run()
        self.subscriber.drop(
            ros_topics.RUN.name,
            "another world simulator has begun a run",
            "this node stays in its run and ends when the world of that run is gone",
        )
        return None

    def lost(self, why: str) -> None:
        """The run's world is gone: save the state, and end."""
        self.get_logger().warning(f"{why}: this node saves its results and ends")
        self.done = True

    def may_stop(self) -> bool:
        """Return whether all work up to the world's last step is done, or the world continues."""
        now = time.monotonic()
        self._stopping = self._stopping or now
        if self.presence is None or self.done:
            return True
        if self.presence.end is not None:
            return self.part.all_done(now)
        return now - self._stopping > STOP_SECONDS

    def _read_run(self, data: bytes) -> RunConfig | None:
        """Return a run to follow; a node in a run ignores the announcements of other runs."""
        identity = run_announced(data)
        if self.run is not None and identity == self.run.id:
            return None
        if self.presence is None:
            try:
                run = read_run(data)
                self.check(run)
            except Exception as error:
                self._refused = message_of(error)
                raise
            return run
        if not identity:
            raise ValueError("names no run")
        return self.another_run(data)

    def _on_run(self, run: RunConfig | None) -> None:
        self.run = run or self.run

    def _on_status(self, status: RunStatus) -> None:
        self.status = status
        if self.presence is None:
            return
        try:
            self.presence.hear(*status[:3], time.monotonic())
        except ValueError as error:
            self.subscriber.drop(ros_topics.STATUS.name, error)
        else:
            self.part.world_said(status)

    def _tick(self) -> None:
        now = time.monotonic()
        if self.presence is None:
            ready = self.may_begin(now)
            if self.run is None:
                self.wait()
            elif ready:
                self._begin(self.run, now)
            return
        self.part.go_on(now)
        if now - self._reported >= REPORT_SECONDS:
            self._reported = now
            self.part.report()
        if self.presence.end is not None:
            self.done = self.done or self.part.all_done(now)
        else:
            self.look_for_the_world(now)

    def look_for_the_world(self, now: float) -> None:
        """Report that the run's world is silent; called with every tick before the run's end."""
        assert self.presence is not None
        if self.presence.silent(now) < SILENT_SECONDS:
            self._missing.over()
        else:
            self.remind(self._missing, "a message of the world")
        gone = self.presence.given_up(now)
        if gone:
            self.lost(gone)

    def _begin(self, run: RunConfig, now: float) -> None:
        self.reminder.over()
        self.presence = WorldPresence(run.id, self.world_timeout, now)
        self.begin(run)
        if self.status is not None:
            self._on_status(self.status)
