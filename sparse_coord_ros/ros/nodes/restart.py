# Copyright 2026 The sparse_coord_ros authors
# SPDX-License-Identifier: Apache-2.0
"""How a team continues: robots that come back, and runs that are resumed."""

import functools
import time
from collections.abc import Callable

from sparse_coord_ros.base.errors import RunError
from sparse_coord_ros.core.runs.run_config import RunConfig
from sparse_coord_ros.protocol.lockstep.rollback import WorldRollback
from sparse_coord_ros.protocol.lockstep.world_side import WorldSide
from sparse_coord_ros.protocol.wire import RECORDER
from sparse_coord_ros.protocol.wire.status import (
    NO_ORDER,
    NO_ROLLBACK,
    Progress,
    read_progress,
)
from sparse_coord_ros.ros.nodes import ros_topics
from sparse_coord_ros.ros.nodes.outputs import Output
from sparse_coord_ros.ros.nodes.parameters import ROLL_BACK


class Returning(WorldRollback):
    """Receives robots' reports on checkpoints, and rolls the team back if needed.

    Args:
        run: the run.
        side: the world's side of the lock step.
        output: saves the world's files; its node's `resume` and `returning` are used.
        changed: called after an order, and when the team continues.
    """

    def __init__(
        self,
        run: RunConfig,
        side: WorldSide,
        output: Output,
        changed: Callable[[], None],
    ) -> None:
        self._names = run.scenario.names
        super().__init__(side, output.store, len(self._names))
        self._output = output
        self._run = run
        self._changed = changed
        node = self._node = output.node
        self._warn = node.get_logger().warning
        self._under_way = False
        self._recorder_obeyed = NO_ORDER
        self._since = 0.0
        for robot, name in enumerate(self._names):
            then = functools.partial(self._on_progress, robot)
            node.subscriber.listen(ros_topics.PROGRESS, then, name, read=read_progress)
        if run.recorded:
            node.subscriber.listen(
                ros_topics.PROGRESS, self._on_recorder, RECORDER, read=read_progress
            )

    @property
    def calling(self) -> bool:
        """True if the team waits for the progress of all robots before it continues."""
        return self._side.held and self.order.step == NO_ROLLBACK

    def resume(self) -> list[str]:
        """If resuming, order the step to resume from; return robots with unknown checkpoints.

        Raises:
            RunError: a robot keeps no checkpoints, or the world's is of another run.
        """
        if not self._node.values["resume"] or self._side.held:
            return []
        silent = [self._names[k] for k, said in enumerate(self.said) if said is None]
        if not silent:
            if not self._order_back(
                together=self._node.values["returning"] == ROLL_BACK
            ):
                raise RunError(
                    "resume: a robot keeps no checkpoints; give every robot parameter 'out' and "
                    "resume:=true, or this world returning:=continue"
                )
            world = self._side.world
            self._node.get_logger().info(
                f"continuing from a checkpoint: transition {world.transitions}, step {world.step}"
            )
        return silent

    def look(self, now: float, *, all_listen: Callable[[], bool]) -> None:
        """End the hold after an order; a robot that does not obey in time joins later."""
        late = now - self._since >= self._run.step_timeout
        recorded = not self._run.recorded or self._recorder_obeyed == self.order.name
        if not late and not (recorded and all_listen()):
            return
        waiting = [self._names[k] for k in sorted(self.waiting)]
        lost = self._side.lost
        if not self.go_on(anyway=late):
            return
        if waiting:
            self._warn(f"{', '.join(waiting)} did not obey; continuing without them")
        if self._side.lost > lost:
            self._warn(f"{self._side.lost} transitions are lost in the history")
        self._changed()

    def begin(self, now: float) -> None:
        """The run begins now; until now a resumed team had time to obey."""
        self._under_way = True
        self._since = now

    def _on_progress(self, robot: int, said: Progress) -> None:
        """Read a robot's report on checkpoints; its return may roll back the team."""
        if self.heard(robot, said) and self._under_way and not self._side.finished:
            self._came_back(robot, said)
        self._output.count(self.events)

    def _came_back(self, robot: int, said: Progress) -> None:
        name = self._names[robot]
        step = self._side.world.step
        if not said.resumed:
            self._warn(
                f"{name} was replaced at step {step}: a new node has its name, with tables of its "
                "own"
            )
        elif self._node.values["returning"] == ROLL_BACK and self._order_back():
            self._warn(
                f"{name} came back at step {step}: all nodes return to the checkpoint of step "
                f"{self.order.step}"
            )
        else:
            lost = max(0, step - said.step)
            self.events["robot_steps_lost"] += lost
            self._warn(
                f"{name} came back at step {step} with its learning up to step "
                f"{said.step}: the team continues, {lost} time steps of {name} are lost"
            )

    def _on_recorder(self, said: Progress) -> None:
        self._recorder_obeyed = said.obeyed

    def _order_back(self, *, together: bool = True) -> bool:
        """Go back, as `go_back` does, and log it."""
        gone = self.go_back(together=together)
        if gone:
            self._since = time.monotonic()
            self._changed()
        return gone
