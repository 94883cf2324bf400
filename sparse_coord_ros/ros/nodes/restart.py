# Copyright 2026 The sparse_coord_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The world's orders to begin: at the run's start, and when a process has come again."""

import functools
import time
from collections.abc import Callable

from sparse_coord_ros.core.runs.run_config import RunConfig
from sparse_coord_ros.protocol.lockstep.attempts import WorldAttempts
from sparse_coord_ros.protocol.lockstep.node_checkpoints import BEGINNING
from sparse_coord_ros.protocol.lockstep.world_side import WorldSide
from sparse_coord_ros.protocol.wire import RECORDER
from sparse_coord_ros.protocol.wire.status import NO_ATTEMPT, Progress, read_progress
from sparse_coord_ros.ros.nodes import ros_topics
from sparse_coord_ros.ros.nodes.outputs import Output


class Restart(WorldAttempts):
    """Receives the nodes' reports on their checkpoints, and orders the team to begin.

    Args:
        run: the run.
        side: the world's side of the lock step.
        output: saves the world's files.
        changed: called after an order, and when the team goes on again.
    """

    def __init__(
        self,
        run: RunConfig,
        side: WorldSide,
        output: Output,
        changed: Callable[[], None],
    ) -> None:
        nodes = [*run.scenario.names, *[RECORDER] * run.recorded]
        super().__init__(side, output.store, nodes, run.checkpoint)
        self._output = output
        self._run = run
        self._changed = changed
        self._logger = output.node.get_logger()
        self._since = 0.0
        for name in nodes:
            then = functools.partial(self._on_progress, name)
            output.node.subscriber.listen(
                ros_topics.PROGRESS, then, name, read=read_progress
            )

    def begin_when_complete(self) -> list[str]:
        """Order the run to begin when all have come; return who has not come, or not begun it."""
        if self.order.attempt != NO_ATTEMPT:
            return self.waiting
        if self.silent:
            return self.silent
        self._begin()
        if self.order.checkpoint != BEGINNING:
            step = self._side.world.transitions
            self._logger.info(f"continuing from the checkpoint of step {step}")
        return self.waiting

    def look(self, now: float, *, all_listen: Callable[[], bool]) -> None:
        """Go on when all have begun again; who has not in time joins later."""
        waiting = self.waiting
        late = now - self._since >= self._run.step_timeout
        if not late and (waiting or not all_listen()):
            return
        if waiting:
            names = ", ".join(waiting)
            self._logger.warning(f"{names} did not begin again; continuing without")
        self._side.start()
        self._changed()

    def _on_progress(self, name: str, progress: Progress) -> None:
        """Read a node's report; a new process under way needs an order."""
        self.hear(name, progress)
        under_way = self.order.attempt != NO_ATTEMPT and not self._side.finished
        if under_way and progress.attempt == NO_ATTEMPT:
            self._came_back(name)
        self._output.store.forget_before(self.oldest)

    def _came_back(self, name: str) -> None:
        came = f"{name} came back at step {self._side.world.transitions}"
        self._begin()
        step = self._side.world.transitions
        where = f"all nodes return to the checkpoint of step {step}"
        if self.order.checkpoint == BEGINNING:
            where = "the run begins anew, as there is no later checkpoint of all nodes"
        self._logger.warning(f"{came}: {where}")

    def _begin(self) -> None:
        """Order the team to begin."""
        self.begin()
        self._since = time.monotonic()
        self._changed()
