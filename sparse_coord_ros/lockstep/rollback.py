# Copyright 2026 The sparse_coord_ros authors
# SPDX-License-Identifier: Apache-2.0
"""How a team goes back to its last common checkpoint, as state machines without ROS.

Every robot says which checkpoints it has. The world chooses the newest that all have, itself
included, goes back to it and orders everybody to do so. It goes on when all have obeyed, or when a
deadline has passed. An order stands until all have obeyed: a robot that was deaf obeys when it
hears again, and joins the team where it then is.
"""

from collections.abc import Callable, Sequence
from typing import Protocol

from sparse_coord_ros.game.world import EPISODE_GAP
from sparse_coord_ros.learn.agent import Agent
from sparse_coord_ros.lockstep.robot_side import RobotSide, RobotState
from sparse_coord_ros.lockstep.world_side import WorldSide, WorldState
from sparse_coord_ros.wire.status import NO_ORDER, ROLL_CALL, Order, Progress


class Store(Protocol):
    """Where a node's checkpoints are; `checkpoints.Checkpoints` is one."""

    def steps(self) -> list[int]:
        """Return the steps that it can go on from, the newest first."""

    def load_world(self, step: int) -> WorldState | None:
        """Return where the world was; None: at the beginning."""

    def load_robot(self, step: int) -> RobotState | None:
        """Return where the robot was; None: at the beginning."""


class WorldRollback:
    """The world's part.

    Args:
        side: the world's side of the lock step.
        store: its checkpoints; None: it keeps none.
        robots: number of robots.

    Attributes:
        order: the order that stands.
        replaced: how often a robot came back as another process.
        taken_back: how often the team went back.
        lost: transitions that a world which came back knows nothing of.
    """

    def __init__(self, side: WorldSide, store: Store | None, robots: int) -> None:
        self.order = Order()
        self.replaced = self.taken_back = self.lost = 0
        self._side, self._store = side, store
        self._said: list[Progress | None] = [None] * robots
        self._waiting: set[int] = set()

    def heard(self, robot: int, said: Progress) -> bool:
        """Take in what a robot says; return whether it is a new process in an old one's place."""
        before, self._said[robot] = self._said[robot], said
        new = before is not None and before.life != said.life
        self.replaced += new
        able = self.order.step in (ROLL_CALL, *said.checkpoints)
        if said.obeyed == self.order.name or not able:
            self._waiting.discard(robot)
        elif new:
            self._waiting.add(robot)
        if not self._waiting and not self._side.held:
            self.order = Order()
        return new

    @property
    def silent(self) -> list[int]:
        """The robots that have said nothing yet."""
        return [k for k, said in enumerate(self._said) if said is None]

    @property
    def waiting(self) -> list[int]:
        """The robots that have yet to obey."""
        return sorted(self._waiting)

    def said(self, robot: int) -> Progress | None:
        """Return what a robot said last."""
        return self._said[robot]

    def take_back(self, name: str) -> Order | None:
        """Go back to the last common checkpoint, and let an order stand; then tell everybody.

        Args:
            name: a new one.

        Returns:
            The order; None where there is no checkpoint that everybody has.

        Raises:
            RunError: the world's checkpoint is of another run.
        """
        of_each: list[Sequence[int]] = [] if self._store is None else [self._store.steps()]
        of_each += [() if said is None else said.checkpoints for said in self._said]
        common = set(of_each[0]).intersection(*of_each[1:])
        if self._store is None or not common:
            return None
        step = max(common)
        self._side.go_on_from(self._store.load_world(step))
        self._waiting = set(range(len(self._said)))
        self.order = Order(name, step, self._side.world.step)
        self.taken_back += 1
        return self.order

    def call(self, name: str) -> Order:
        """Go on from the newest checkpoint of the world's own, the robots as they are.

        They say where they are first. A new episode begins after all that any of them has seen.
        What was done since the checkpoint counts as done, but is no part of the world's history:
        `lost` then says how many transitions these are.

        Args:
            name: as of `take_back`.

        Raises:
            RunError: the world's checkpoint is of another run.
        """
        assert self._store is not None
        self._side.go_on_from(self._store.load_world(self._store.steps()[0]))
        self._waiting = set(range(len(self._said)))
        self.order = Order(name, ROLL_CALL, self._side.world.step)
        return self.order

    def go_on(self, *, anyway: bool = False) -> bool:
        """Go on where the team is held and all have obeyed; return whether it does.

        Args:
            anyway: do not wait any longer for those that have not obeyed.
        """
        if not self._side.held or (self._waiting and not anyway):
            return False
        if self.order.step == ROLL_CALL:
            said = [one for one in self._said if one is not None]
            step = max(one.step for one in said) + 1 + EPISODE_GAP
            self.lost += self._side.begin_at(step, max(one.transitions for one in said))
        if not self._waiting or self.order.step == ROLL_CALL:
            self.order = Order()
        self._side.start()
        return True


class RobotRollback:
    """A robot's part.

    Args:
        side: the robot's side of the lock step.
        store: its checkpoints; None: it keeps none.
        fresh: makes an agent as it is at the run's beginning.
        life: names this process.
        resumed: as of `Progress`.
    """

    def __init__(
        self,
        side: RobotSide,
        store: Store | None,
        fresh: Callable[[], Agent],
        life: str,
        *,
        resumed: bool = False,
    ) -> None:
        self._side, self._store, self._fresh = side, store, fresh
        self._life, self._resumed = life, resumed
        self._obeyed = NO_ORDER

    def begin(self) -> int:
        """Go on from the newest checkpoint of one's own; return its step, 0 without any.

        Raises:
            RunError: it is of another run.
        """
        step = 0 if self._store is None else self._store.steps()[0]
        if step and self._store is not None:
            self._side.go_on_from(self._fresh(), self._store.load_robot(step))
        return step

    def obey(self, order: Order) -> bool:
        """Go back as the world orders; return whether to listen anew, and then say `progress`.

        What is under way from the time that is taken back must not be taken for new: of steps
        with the same numbers no robot can tell.

        Args:
            order: the order.

        Raises:
            RunError: the checkpoint is of another run.
        """
        if order.name in (NO_ORDER, self._obeyed):
            return False
        if order.step == ROLL_CALL:
            self._obeyed = order.name
            return True
        if order.step not in self._checkpoints():
            return False
        assert self._store is not None
        self._obeyed = order.name
        self._side.go_on_from(self._fresh(), self._store.load_robot(order.step))
        return True

    def progress(self) -> Progress:
        """Return what to say to the world: on joining, after saving, after `obey`."""
        return Progress(
            self._life,
            self._side.handled,
            self._side.transitions,
            tuple(self._checkpoints()),
            self._obeyed,
            self._resumed,
        )

    def _checkpoints(self) -> list[int]:
        return [] if self._store is None else self._store.steps()
