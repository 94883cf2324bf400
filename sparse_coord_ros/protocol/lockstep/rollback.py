# Copyright 2026 The sparse_coord_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Rollback of a team to its last common checkpoint, as state machines without ROS.

Every robot announces its checkpoints. The world chooses the newest common one, its own included,
goes back to it and orders all robots back. It continues when all have obeyed, or when a deadline
has passed. An order stands until all have obeyed: a robot that was disconnected obeys when it
receives messages again, and joins the team at its current step.
"""

import uuid
from collections import Counter
from collections.abc import Callable

from sparse_coord_ros.core.game.rules import EPISODE_GAP
from sparse_coord_ros.core.learners.agent import Agent
from sparse_coord_ros.protocol.lockstep.node_checkpoints import CheckpointStore
from sparse_coord_ros.protocol.lockstep.robot_side import RobotSide
from sparse_coord_ros.protocol.lockstep.world_side import WorldSide
from sparse_coord_ros.protocol.wire.status import NO_ORDER, NO_ROLLBACK, Order, Progress


class WorldRollback:
    """The world's part.

    Args:
        side: the world's side of the lock step.
        store: its checkpoints.
        robots: number of robots.

    Attributes:
        order: the current order.
        events: counts that a rollback does not reset: `replaced_robots`, which began anew;
            `returned_robots`, which came back with their tables; `taken_back`, rollbacks of all.
        said: each robot's last message; None: no message yet.
        waiting: the robots that have not obeyed yet.
    """

    def __init__(self, side: WorldSide, store: CheckpointStore, robots: int) -> None:
        self.order = Order()
        self.events = Counter(store.counted())
        self._side = side
        self._store = store
        self.said: list[Progress | None] = [None] * robots
        self.waiting: set[int] = set()

    def heard(self, robot: int, said: Progress) -> bool:
        """Process a robot's report; return whether a new process has replaced the old one."""
        before = self.said[robot]
        self.said[robot] = said
        new = before is not None and before.life != said.life
        if new and self._side.world.transitions:
            self.events["returned_robots" if said.resumed else "replaced_robots"] += 1
        able = self.order.step in (NO_ROLLBACK, *said.checkpoints)
        if said.obeyed == self.order.name or not able:
            self.waiting.discard(robot)
        elif new:
            self.waiting.add(robot)
        if not self.waiting and not self._side.held:
            self.order = Order()
        return new

    def go_back(self, *, together: bool = True) -> bool:
        """Go back to a checkpoint, and order the team to do so.

        Args:
            together: all nodes go to the newest common one. Else only the world goes back, to its
                own newest: the robots keep their states and report their steps, and a new episode
                begins after the newest of them: `WorldSide.begin_at`.

        Returns:
            True if there is such a checkpoint.

        Raises:
            RunError: the world's checkpoint is of another run.
        """
        steps = set(self._store.steps())
        if together:
            steps.intersection_update(
                *(said.checkpoints if said else () for said in self.said)
            )
        if not steps:
            return False
        self._side.go_on_from(self._store.load(max(steps)))
        self.waiting = set(range(len(self.said)))
        step = max(steps) if together else NO_ROLLBACK
        self.order = Order(uuid.uuid4().hex, step, self._side.world.step)
        self.events["taken_back"] += together
        return True

    def go_on(self, *, anyway: bool = False) -> bool:
        """Continue if the team is held and all have obeyed; return whether it does.

        Args:
            anyway: do not wait for the robots that have not obeyed.
        """
        if not self._side.held or (self.waiting and not anyway):
            return False
        if self.order.step == NO_ROLLBACK:
            said = [one for one in self.said if one is not None]
            step = max(one.step for one in said) + 1 + EPISODE_GAP
            self._side.begin_at(step, max(one.transitions for one in said))
        if not self.waiting or self.order.step == NO_ROLLBACK:
            self.order = Order()
        self._side.start()
        return True


class RobotRollback:
    """A robot's part.

    Args:
        side: the robot's side of the lock step.
        store: its checkpoints.
        fresh: makes an agent in its initial state.
        life: the identity of this process.
        resumed: as of `Progress`.
    """

    def __init__(
        self,
        side: RobotSide,
        store: CheckpointStore,
        fresh: Callable[[], Agent],
        life: str,
        resumed: bool,
    ) -> None:
        self._side = side
        self._store = store
        self._fresh = fresh
        self._life = life
        self._resumed = resumed
        self._obeyed = NO_ORDER

    def begin(self) -> int:
        """Continue from the robot's own newest checkpoint; return its step, or 0 without one.

        Raises:
            RunError: the checkpoint is of another run.
        """
        step = max(self._store.steps(), default=0)
        if step:
            self._side.go_on_from(self._fresh(), self._store.load(step))
        return step

    def obey(self, order: Order) -> bool:
        """Go back as the world orders; return whether to subscribe anew, then publish `_progress`.

        Messages in flight from before the roll-back must not count as new: their steps have the
        same numbers.

        Args:
            order: the order.

        Raises:
            RunError: the checkpoint is of another run.
        """
        if order.name in (NO_ORDER, self._obeyed):
            return False
        if order.step != NO_ROLLBACK:
            if order.step not in self._store.steps():
                return False
            self._side.go_on_from(self._fresh(), self._store.load(order.step))
        self._obeyed = order.name
        return True

    def progress(self) -> Progress:
        """Return the robot's report to the world: on joining, after saving, after `obey`."""
        at = (self._side.handled, self._side.transitions)
        steps = tuple(self._store.steps())
        return Progress(self._life, *at, steps, self._obeyed, self._resumed)
