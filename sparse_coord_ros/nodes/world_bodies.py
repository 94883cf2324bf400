# Copyright 2026 The sparse_coord_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The robots' bodies as the world knows them: it tells them `goals`, and hears `reached`."""

import functools
import time
from collections.abc import Callable
from typing import Any

from sparse_coord_ros.learn.run_config import RunConfig
from sparse_coord_ros.lockstep.bodies import BodiesSide, BodyWorld, Goals, Reached
from sparse_coord_ros.lockstep.waiting import Reminder
from sparse_coord_ros.nodes import interface
from sparse_coord_ros.nodes.messages import Converter
from sparse_coord_ros.nodes.parameters import ParameterNode


class WorldBodies:
    """Sends bodies and hears of them.

    Args:
        node: the world's node.
        run: the run.
        there: called when all bodies that were waited for are there, or given up.

    Attributes:
        game: what the bodies play.
        side: sends them.
    """

    def __init__(self, node: ParameterNode, run: RunConfig, there: Callable[[], None]) -> None:
        self._node, self._there, self._convert = node, there, Converter(run)
        self._names = self._convert.names
        self.game = BodyWorld(run.scenario, run.seed, slips=run.slips)
        self.side = BodiesSide(self.game, self.send)
        self._heard = 0.0
        self._reminder = Reminder()
        self._publisher = node.announce(interface.BODY_GOALS)
        listen, self._subscriptions = node.intake.listen, []
        for k, name in enumerate(self._names):
            read = functools.partial(self._convert.read_reached, k)
            heard = listen(interface.REACHED, self._on_reached, name, read=read)
            self._subscriptions.append(heard)

    def send(self, goals: Goals) -> None:
        """Tell the bodies where to go."""
        self._heard = time.monotonic()
        self._publisher.publish(self._convert.goals_message(goals))

    def missing(self) -> list[str]:
        """Return the commands that start the drivers that are not there yet."""
        pairs = zip(self._names, self._subscriptions, strict=True)
        silent = [name for name, heard in pairs if heard.get_publisher_count() == 0]
        return [f"driver --ros-args -p robot:={name}" for name in silent]

    @property
    def own(self) -> list[str]:
        """The full names of the topics that one driver each should publish."""
        return [heard.topic_name for heard in self._subscriptions]

    def look(self, now: float) -> None:
        """Say for whose bodies the step waits; what takes too long counts as not moved."""
        side = self.side
        if not side.waiting:
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
            "(body_timeout): taken for not moved",
            throttle_duration_sec=5.0,
        )
        self._there()

    def summary(self) -> dict[str, Any]:
        """Return what happened, as plain data."""
        failed, lost, seconds = self.side.failed, self.side.lost, round(self.side.seconds, 3)
        return {"moves_failed": failed, "bodies_lost": lost, "body_seconds": seconds}

    def _on_reached(self, reached: Reached) -> None:
        self._heard = time.monotonic()
        if self.side.reached(reached):
            self._there()
