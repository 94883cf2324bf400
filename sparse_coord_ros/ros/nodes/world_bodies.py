# Copyright 2026 The sparse_coord_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The world's view of the robots' bodies: it sends them `goals`, and receives `reached`.

Halting: the order is a field of `goals`. They are latched, so a driver that starts later receives
it with its first goal. It is repeated until every driver has confirmed it on `halted`. A driver
that publishes `halted` by itself halts the team: a user asked it directly, or an earlier world
halted it, and this one has taken its place.
"""

import functools
import time
from collections.abc import Callable
from typing import Any

from std_msgs.msg import Bool

from sparse_coord_ros.core.runs.run_config import RunConfig
from sparse_coord_ros.protocol.lockstep.bodies import (
    NO_GOALS,
    BodiesSide,
    BodyWorld,
    GoalReport,
    Goals,
    HaltOrder,
)
from sparse_coord_ros.protocol.lockstep.timeouts import REPEAT_SECONDS, Reminder
from sparse_coord_ros.ros.nodes import ros_topics
from sparse_coord_ros.ros.nodes.messages import Converter
from sparse_coord_ros.ros.nodes.parameters import ParameterNode


class WorldBodies:
    """Sends goals to bodies and receives their reports.

    Args:
        node: the world's node.
        run: the run.
        there: called when all awaited bodies have arrived, or are given up.
        told_to_halt: called with the name of a robot whose driver has halted by itself.

    Attributes:
        game: the bodies' game.
        side: sends their goals.
        halt_word: the last order to all drivers on halting.
    """

    def __init__(
        self,
        node: ParameterNode,
        run: RunConfig,
        there: Callable[[], None],
        told_to_halt: Callable[[str], None],
    ) -> None:
        self._node = node
        self._there = there
        self._convert = Converter(run)
        self._told_to_halt = told_to_halt
        self._names = self._convert.names
        self.game = BodyWorld(run.scenario, run.seed, slips=run.slips)
        self.side = BodiesSide(self.game, self.send)
        self._heard = self._said = 0.0
        self._reminder = Reminder()
        self._publisher = node.announce(ros_topics.BODY_GOALS)
        self._goals = NO_GOALS
        self.halt_word = HaltOrder.NOTHING
        self._stands = dict.fromkeys(self._names, False)
        self._subscriptions = []
        for k, name in enumerate(self._names):
            read = functools.partial(self._convert.read_reached, k)
            heard = node.subscriber.listen(
                ros_topics.REACHED, self._on_reached, name, read=read
            )
            self._subscriptions.append(heard)
            on_halted = functools.partial(self._on_halted, name)
            node.subscriber.listen(ros_topics.HALTED, on_halted, name)

    def send(self, goals: Goals) -> None:
        """Send the bodies their goals."""
        self._heard = time.monotonic()
        self._goals = goals
        self._reminder.over()  # their waiting time begins anew
        self._say_goals()

    def _say_goals(self) -> None:
        """Publish the newest goals, with the order on halting."""
        self._said = time.monotonic()
        goals = self._goals._replace(halt=self.halt_word)
        self._publisher.publish(self._convert.goals_message(goals))

    # Halting.

    @property
    def halted(self) -> bool:
        """True if all bodies have the order to halt."""
        return self.halt_word == HaltOrder.HALT

    def halt(self, hold: bool) -> None:
        """Order all bodies to halt, or to continue."""
        self.halt_word = HaltOrder.HALT if hold else HaltOrder.GO_ON
        self._say_goals()

    def say_halt_again(self, now: float) -> None:
        """Repeat the order on halting if a driver has not confirmed it."""
        if now - self._said >= REPEAT_SECONDS and self.unconfirmed():
            self._say_goals()

    def unconfirmed(self) -> list[str]:
        """Return the robots whose drivers are there, and have not confirmed the order."""
        pairs = zip(self._names, self._subscriptions, strict=True)
        driven = [name for name, heard in pairs if heard.get_publisher_count() > 0]
        return [name for name in driven if self._stands[name] != self.halted]

    def _on_halted(self, robot: str, message: Bool) -> None:
        self._stands[robot] = message.data
        if message.data and not self.halted:
            self._told_to_halt(robot)

    def missing(self) -> list[str]:
        """Return the commands that start the missing drivers."""
        pairs = zip(self._names, self._subscriptions, strict=True)
        silent = [name for name, heard in pairs if heard.get_publisher_count() == 0]
        return [f"driver --ros-args -p robot:={name}" for name in silent]

    @property
    def own(self) -> list[str]:
        """The full names of the topics that must have one driver each as publisher."""
        return [heard.topic_name for heard in self._subscriptions]

    def look(self, now: float) -> None:
        """Log the awaited bodies; a late body counts as not moved."""
        side = self.side
        if self.halted:
            self._heard = now  # a halted body is not late
        if self.halted or not side.waiting:
            self._reminder.over()
            return
        names = ", ".join(self._names[k] for k in side.waiting)
        centres = (self._convert.centres[self.game.cells[k]] for k in side.waiting)
        cells = ", ".join(f"({x:g}, {y:g})" for x, y in centres)
        where = f" to be at {cells}" if side.placing else ""
        self._node.remind(self._reminder, f"the bodies of {names}{where}")
        limit = self._node.values["body_timeout"]
        if side.placing or not 0 < limit <= now - self._heard:
            return
        self._heard = now
        side.give_up()
        self._node.get_logger().warning(
            f"step {self.game.step}: no report from the driver of {names} for {limit:g} s "
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
