# Copyright 2026 The sparse_coord_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The world's view of the robots' bodies: it sends them `goals`, and receives `reached`."""

import functools
import time
from collections.abc import Callable
from typing import Any

from sparse_coord_ros.core.runs.run_config import RunConfig
from sparse_coord_ros.protocol.lockstep.bodies import (
    BodiesSide,
    BodyWorld,
    GoalReport,
    Goals,
)
from sparse_coord_ros.protocol.lockstep.timeouts import Reminder
from sparse_coord_ros.ros.nodes import ros_topics
from sparse_coord_ros.ros.nodes.body_messages import goals_message, read_reached
from sparse_coord_ros.ros.nodes.parameters import ParameterNode
from sparse_coord_ros.ros.nodes.ros_messages import messages_of


class WorldBodies:
    """Sends goals to bodies and receives their reports.

    Args:
        node: the world's node.
        run: the run.
        there: called when all awaited bodies have arrived, or are given up.

    Attributes:
        game: the bodies' game.
        side: sends their goals.
    """

    def __init__(
        self,
        node: ParameterNode,
        run: RunConfig,
        there: Callable[[], None],
    ) -> None:
        self._node = node
        self._there = there
        self._messages = messages_of(run)
        self._names = self._messages.names
        self.game = BodyWorld(run.scenario, run.seed, slips=run.slips)
        self.side = BodiesSide(self.game, self.send)
        self._heard = 0.0
        self._reminder = Reminder()
        self._publisher = node.announce(ros_topics.BODY_GOALS)
        self._subscriptions = []
        for k, name in enumerate(self._names):
            read = functools.partial(read_reached, self._messages, k)
            heard = node.subscriber.listen(
                ros_topics.REACHED, self._on_reached, name, read=read
            )
            self._subscriptions.append(heard)

    def send(self, goals: Goals) -> None:
        """Send the bodies their goals."""
        self._heard = time.monotonic()
        self._reminder.over()  # their waiting time begins anew
        self._publisher.publish(goals_message(self._messages, goals))

    def missing(self) -> list[str]:
        """Return the commands that start the missing drivers."""
        pairs = zip(self._names, self._subscriptions, strict=True)
        silent = [name for name, heard in pairs if heard.get_publisher_count() == 0]
        return [f"driver --ros-args -p robot:={name}" for name in silent]

    def look(self, now: float, *, held: bool) -> None:
        """Log the awaited bodies; a late body counts as not moved.

        Args:
            now: the time.
            held: whether the team is paused: then no body is late.
        """
        side = self.side
        if held:
            self._heard = now
        if held or not side.waiting:
            self._reminder.over()
            return
        names = ", ".join(self._names[k] for k in side.waiting)
        centres = (self._messages.centres[self.game.cells[k]] for k in side.waiting)
        cells = ", ".join(f"({x:g}, {y:g})" for x, y in centres)
        where = f" to be at {cells}" if side.placing else ""
        self._node.remind(self._reminder, f"the bodies of {names}{where}")
        limit = self._node.values["body_timeout"]
        if side.placing or not 0 < limit <= now - self._heard:
            return
        self._heard = now
        side.give_up()
        self._node.get_logger().warning(
            f"step {self.game.transitions}: no report from the driver of {names} for {limit:g} s "
            "(body_timeout): counted as not moved",
            throttle_duration_sec=5.0,
        )
        self._there()

    def summary(self) -> dict[str, Any]:
        """Return counts of events as plain data."""
        failed = self.side.failed
        lost = self.side.lost
        seconds = round(self.side.seconds, 3)
        return {"moves_failed": failed, "bodies_lost": lost, "body_seconds": seconds}

    def _on_reached(self, reached: GoalReport) -> None:
        self._heard = time.monotonic()
        if self.side.reached(reached):
            self._there()
