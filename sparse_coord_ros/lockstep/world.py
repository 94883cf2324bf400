# Copyright 2026 The sparse_coord_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The world's side of the lock step, as a state machine without ROS.

A time step is a barrier: the world advances when every robot has acted or its deadline passed.
"""

from typing import Protocol

from sparse_coord_ros.core.game import Game
from sparse_coord_ros.core.history import HistoryRecorder
from sparse_coord_ros.core.run_config import RunConfig
from sparse_coord_ros.core.wire import ARRIVED, NOBODY_LEFT, RESET, START, STEPS
from sparse_coord_ros.core.world import Action, Reward, World


class WorldPort(Protocol):
    """What the world can do to the outside."""

    def state(self, robot: int, step: int, cell: int) -> None:
        """Publish a robot's local state."""

    def reward(self, robot: int, step: int, reward: Reward) -> None:
        """Publish the reward of a robot's action at a time step."""

    def episode(self, step: int) -> None:
        """An episode begins at a time step, whose states follow."""


class WorldSide:
    """Drives one `World` by messages.

    Args:
        run: the run.
        port: what the world can do.
        game: what is played; the Markov game of the run's scenario where None.

    Attributes:
        world: the game.
        timeouts: how often a robot's deadline passed.
        left_out: number of (robot, step) pairs: transitions made without the robot's action though
            it had not arrived.
        began: why the episode began: one of the reasons of `core.wire`.
        stale: actions that came too late, or twice.
        absent: robots that missed a deadline and have not acted since; nobody waits for them.
        history: gathers the episodes.
    """

    def __init__(self, run: RunConfig, port: WorldPort, game: Game | None = None) -> None:
        self.world: Game = World(run.scenario, run.seed) if game is None else game
        self.timeouts = 0
        self.left_out = 0
        self.began = START
        self.stale = 0
        self.absent: set[int] = set()
        self.history = HistoryRecorder(len(run.scenario.robots))
        self._port = port
        self._budget = run.scenario.steps
        self._robots = range(len(run.scenario.robots))
        self._actions: list[Action | None] = [None] * len(self._robots)
        self._rewards: list[tuple[int, Reward] | None] = [None] * len(self._robots)

    @property
    def finished(self) -> bool:
        """Whether the step budget is used up."""
        return self.world.transitions >= self._budget

    @property
    def complete(self) -> bool:
        """Whether the barrier is open: all robots that are waited for have acted."""
        return not self.missing() and any(action is not None for action in self._actions)

    def missing(self) -> list[int]:
        """Return the robots whose actions the world waits for."""
        return [
            k
            for k in self._robots
            if self._actions[k] is None and not self.world.arrived[k] and k not in self.absent
        ]

    def start(self) -> None:
        """Publish the first joint state."""
        self._port.episode(self.world.step)
        self._publish_states()

    def action(self, robot: int, step: int, action: Action) -> bool:
        """Take in a robot's action; return whether the barrier is now open."""
        self.absent.discard(robot)
        if (
            step != self.world.step
            or self._actions[robot] is not None
            or self.world.arrived[robot]
            or self.finished
        ):
            self.stale += 1
            return False
        self._actions[robot] = action
        return self.complete

    def advance(self) -> None:
        """Make the time step and publish what came of it."""
        step = self.world.step
        acted = [k for k in self._robots if self._actions[k] is not None]
        self.left_out += sum(not self.world.arrived[k] for k in self._robots) - len(acted)
        outcome = self.world.advance(self._actions)
        self.history.add(self.world.episode, step, self._actions, outcome)
        self._actions = [None] * len(self._robots)
        self._rewards = [None] * len(self._robots)
        for k in acted:
            self._rewards[k] = (step, outcome.rewards[k])
            self._port.reward(k, step, outcome.rewards[k])
        self._publish_states()
        if self.finished:
            return
        if outcome.episode_over:
            self.new_episode(ARRIVED if all(self.world.arrived) else STEPS)
        elif all(self.world.arrived[k] or k in self.absent for k in self._robots):
            self.new_episode(NOBODY_LEFT)

    def new_episode(self, began: str = RESET) -> None:
        """Start an episode, for a reason; actions that wait at the barrier are forgotten."""
        self.began = began
        self._actions = [None] * len(self._robots)
        self._rewards = [None] * len(self._robots)
        self.world.begin_episode()
        self._port.episode(self.world.step)
        self._publish_states()

    def expire(self) -> list[int]:
        """The deadline has passed: leave the missing robots out and return them.

        The others go on: with the next step, or with a new episode where all of them have
        arrived. Without any other, the world goes on waiting.
        """
        missing = self.missing()
        if missing and len(self.absent.union(missing)) < len(self._robots):
            self.timeouts += len(missing)
            self.absent.update(missing)
            if self.complete:
                self.advance()
            else:
                self.new_episode(NOBODY_LEFT)
        return missing

    def repeat(self) -> None:
        """Publish again what the missing robots may have lost; a robot that has it ignores it."""
        for k in [*self.missing(), *self.absent]:
            reward = self._rewards[k]
            if reward is not None:
                self._port.reward(k, *reward)
            self._port.state(k, self.world.step, self.world.cells[k])

    def _publish_states(self) -> None:
        for k in self._robots:
            self._port.state(k, self.world.step, self.world.cells[k])
