# Copyright 2026 The sparse_coord_ros authors
# SPDX-License-Identifier: Apache-2.0
"""How a team begins, and begins again, as state machines without ROS.

All nodes know one thing: "begin at checkpoint s". The world orders it at the run's start, where s
is 0, and whenever a process has come in place of another one: s is the newest checkpoint that all
nodes have. Who gets an order forgets all that came after that checkpoint.

So a robot that dies between its action and the reward loses nothing if it comes again: that step
is made with its action, the world leaves it out of the next ones (`WorldSide.expire`), and then
all make them again, with the same draws.
"""

import math
import uuid
from collections.abc import Callable, Sequence

from sparse_coord_ros.base.errors import RunError
from sparse_coord_ros.core.learners.agent import Agent
from sparse_coord_ros.protocol.lockstep.node_checkpoints import (
    BEGINNING,
    CheckpointStore,
)
from sparse_coord_ros.protocol.lockstep.robot_side import RobotSide
from sparse_coord_ros.protocol.lockstep.world_side import WorldSide
from sparse_coord_ros.protocol.wire import RECORDER, TABLES_DEPTH
from sparse_coord_ros.protocol.wire.status import LEFT, NO_ATTEMPT, Order, Progress

MOST_BEHIND = 2000
"""The world waits for a recorder that has written so many time steps less than it has made."""

CHECKPOINTS_BEHIND = TABLES_DEPTH // 2
"""It also waits for one that is so many checkpoints behind: publishers keep twice as many."""

KEPT_COMMON = 3
"""Number of the newest common checkpoints that all nodes keep."""


class WorldAttempts:
    """The world's part.

    Args:
        side: the world's side of the lock step.
        store: its checkpoints.
        nodes: the nodes that begin together: the robots and, if it is awaited, the recorder.
        checkpoint: time steps between two checkpoints; 0: there are none.

    Attributes:
        order: the last order.
        reports: the last message of each node that has sent one.
        limit: the time step at which the world waits for the recorder.
    """

    def __init__(
        self,
        side: WorldSide,
        store: CheckpointStore,
        nodes: Sequence[str],
        checkpoint: int = 0,
    ) -> None:
        self.order = Order()
        self.reports: dict[str, Progress] = {}
        self.limit = math.inf
        self._side = side
        self._store = store
        self._nodes = nodes
        self._checkpoint = checkpoint

    @property
    def silent(self) -> list[str]:
        """The nodes that have said nothing so far."""
        return [node for node in self._nodes if node not in self.reports]

    @property
    def waiting(self) -> list[str]:
        """The nodes that have not begun the last attempt."""
        attempt = self.order.attempt
        return [
            node
            for node in self._nodes
            if node not in self.reports or self.reports[node].attempt != attempt
        ]

    def hear(self, node: str, progress: Progress) -> None:
        """Note a node's report."""
        self.reports[node] = progress
        if node == RECORDER and progress.attempt == self.order.attempt:
            self.limit = math.inf
            if progress.written != LEFT:
                self.limit = progress.written + self._most_behind

    @property
    def _most_behind(self) -> int:
        """The number of time steps that a recorder may be behind."""
        by_tables = CHECKPOINTS_BEHIND * self._checkpoint
        return min(MOST_BEHIND, by_tables) if by_tables else MOST_BEHIND

    def do_without_recorder(self) -> None:
        """Wait no more for the recorder, until it reports again."""
        self.limit = math.inf

    def common(self) -> list[int]:
        """Return the steps of the newest common checkpoints of world and robots, the newest first.

        There are `KEPT_COMMON` at most, and one at least; more if a recorder is behind: they go
        back to the newest checkpoint that its bag has, unless the world has gone on without it.
        """
        steps = {BEGINNING, *self._store.steps()}
        for node, progress in self.reports.items():
            if node != RECORDER and progress.checkpoints:
                steps &= {BEGINNING, *progress.checkpoints}
        newest = max(steps)
        recorder = self.reports.get(RECORDER, Progress())
        reach = newest - self._most_behind - self._checkpoint
        recorded = [step for step in recorder.checkpoints if step in steps]
        last = max(recorded, default=newest)
        if last < reach:
            last = newest
        common = sorted(steps, reverse=True)
        return [
            step
            for number, step in enumerate(common)
            if number < KEPT_COMMON or step >= last
        ]

    @property
    def oldest(self) -> int:
        """The oldest checkpoint to which the team may go back, as far as all have said theirs."""
        return BEGINNING if self.silent else self.common()[-1]

    def begin(self) -> None:
        """Order the team to begin, and go to the checkpoint.

        It is the newest common one of world and robots that the recorder has, too. A recorder
        that has none of them leaves a gap in its bag.

        Raises:
            RunError: a robot has none of the run's checkpoints, or the world's is of another run.
        """
        self._check_robots()
        common = self.common()
        recorder = self.reports.get(RECORDER, Progress())
        recorded = [step for step in common if step in recorder.checkpoints]
        step = max(recorded, default=common[0])
        if step != BEGINNING or self.order.attempt != NO_ATTEMPT:
            self._side.go_on_from(self._store.load(step))
            self._store.forget_after(step)
        self.order = Order(uuid.uuid4().hex, step)
        self.limit = math.inf

    def _check_robots(self) -> None:
        """Refuse to throw away what a team has learned, for a robot without checkpoints.

        Where the world has two, such a robot lacks even the older one.
        """
        saved = [step for step in self._store.steps() if step != BEGINNING]
        for node, progress in self.reports.items():
            none = node != RECORDER and progress.checkpoints == (BEGINNING,)
            if none and len(saved) > 1:
                raise RunError(
                    f"{node} has no checkpoint of this run; all is saved: start {node} with the "
                    "'out' that it had, or begin a new run"
                )


class RobotAttempts:
    """A robot's part.

    Args:
        side: the robot's side of the lock step.
        store: its checkpoints.
        fresh: makes an agent in its initial state.
        known: the attempt of the team when the robot came: it is for others. The next one is the
            answer to the robot's first report.

    Attributes:
        attempt: the attempt that the robot has begun.
    """

    def __init__(
        self,
        side: RobotSide,
        store: CheckpointStore,
        fresh: Callable[[], Agent],
        known: str,
    ) -> None:
        self.attempt = NO_ATTEMPT
        self._side = side
        self._store = store
        self._fresh = fresh
        self._known = known

    def obey(self, order: Order) -> bool:
        """Begin as the world orders; return whether to subscribe anew, then publish `_progress`.

        Messages in flight from before the order must not count as new: their steps have the same
        numbers. An order to begin at a checkpoint that the robot lacks was given before the world
        heard the robot's report; another one follows.

        Args:
            order: the world's last order.

        Raises:
            RunError: the checkpoint is of another run.
        """
        if order.attempt in (NO_ATTEMPT, self._known):
            return False
        if order.checkpoint not in self._store.steps():
            return False
        self._side.go_on_from(self._fresh(), self._store.load(order.checkpoint))
        self._store.forget_after(order.checkpoint)
        self._known = self.attempt = order.attempt
        return True

    def progress(self) -> Progress:
        """Return the robot's report to the world."""
        return Progress(tuple(self._store.steps()), self.attempt)
