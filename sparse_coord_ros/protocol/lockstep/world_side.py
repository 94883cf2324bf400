# Copyright 2026 The sparse_coord_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The world's side of the lock step, as a state machine without ROS.

A time step is a barrier: the world advances when every robot has acted or missed its deadline.
"""

from collections.abc import Callable
from typing import NamedTuple, Protocol

from sparse_coord_ros.core.game.world import Action, Position, Reward, World
from sparse_coord_ros.core.runs.history import History, HistoryRecorder
from sparse_coord_ros.core.runs.run import TeamTransition
from sparse_coord_ros.core.runs.run_config import RunConfig
from sparse_coord_ros.protocol.lockstep.saving import saves
from sparse_coord_ros.protocol.wire import StartReason


class WorldPort(Protocol):
    """The actions of the world on its surroundings."""

    def state(self, robot: int, step: int, cell: int) -> None:
        """Publish a robot's local state."""

    def reward(self, robot: int, step: int, reward: Reward) -> None:
        """Publish the reward of a robot's action at a time step."""

    def checkpoint(self, step: int) -> None:
        """Save: the robots do so too, when they have processed their states of this step."""


class WorldState(NamedTuple):
    """The state of the world from which it continues with the same bits.

    Attributes:
        step: the time step under which the robots save their states.
        position: the game's position; if an episode ended at `step`, the beginning of the next.
        counts: `episode` and `miscoordinations` of the game, `timeouts`, `left_out`, `stale`.
        began: why the episode began.
        absent: robots that the world does not wait for.
        history: the episodes.
    """

    step: int
    position: Position
    counts: tuple[int, int, int, int, int]
    began: str
    absent: tuple[int, ...]
    history: History


class WorldSide:
    """Drives one game by messages.

    Args:
        run: the run.
        port: the world's actions on its surroundings.
        game: the game; None: the Markov game of the run's scenario.

    Attributes:
        world: the game.
        timeouts: number of missed deadlines of robots.
        left_out: number of (robot, step) pairs: transitions without the robot's action although it
            had not arrived.
        began: why the episode began, a `StartReason`.
        stale: actions that came too late, or twice.
        absent: robots that missed a deadline and have not acted since: the world does not wait for
            them.
        history: gathers the episodes.
        watcher: called with each transition after it; None: no watcher.
        save_at: a time step at which all save, beside every `checkpoint` steps; 0: none.
        held: True from `go_on_from` to `start`: actions are from the time that was taken back.
    """

    def __init__(
        self, run: RunConfig, port: WorldPort, game: World | None = None
    ) -> None:
        self.world = World(run.scenario, run.seed) if game is None else game
        self.timeouts = self.left_out = self.stale = 0
        self.began: str = StartReason.START
        self.absent: set[int] = set()
        self.history = HistoryRecorder(run.scenario)
        self.watcher: Callable[[TeamTransition], None] | None = None
        self.held = False
        self.save_at = 0
        self._port = port
        self._budget = run.scenario.steps
        self._checkpoint = run.checkpoint
        self._robots = range(len(run.scenario.robots))
        self._begin_step()
        self._beginning = self.snapshot()

    @property
    def finished(self) -> bool:
        """True if the step budget is used up."""
        return self.world.transitions >= self._budget

    @property
    def complete(self) -> bool:
        """True if the barrier is open: all awaited robots have acted."""
        return not self._awaited and self._acted > 0

    @property
    def actions(self) -> tuple[Action | None, ...]:
        """The joint action as far as it is received; None for a robot that has not acted."""
        return tuple(self._actions)

    def missing(self) -> list[int]:
        """Return the robots whose actions the world waits for."""
        return sorted(self._awaited)

    def start(self) -> None:
        """Publish the first joint state, also the first one after `go_on_from`."""
        self.held = False
        self._publish_states()

    def snapshot(self, step: int | None = None) -> WorldState:
        """Return the world's state.

        Args:
            step: the time step under which the robots save; None: the current one.
        """
        world = self.world
        late = (self.timeouts, self.left_out, self.stale)
        counts = (world.episode, world.miscoordinations, *late)
        step = world.step if step is None else step
        absent = tuple(sorted(self.absent))
        history = self.history.so_far.copy()
        return WorldState(step, world.position(), counts, self.began, absent, history)

    def go_on_from(self, state: WorldState | None) -> None:
        """Continue from an earlier state of this run; None: its beginning. Then call `start`."""
        state = state or self._beginning
        world = self.world
        world.go_on_from(state.position)
        self.began = state.began
        self.absent = set(state.absent)
        world.episode, world.miscoordinations, *late = state.counts
        self.timeouts, self.left_out, self.stale = late
        under_way = state.position.under_way
        self.history = HistoryRecorder(
            world.scenario, history=state.history, under_way=under_way
        )
        self.held = True
        self._begin_step()

    def action(self, robot: int, step: int, action: Action) -> bool:
        """Process a robot's action; return whether the barrier is now open."""
        if self.held:
            return False
        if robot in self.absent:
            self.absent.remove(robot)
            self._await_robots()
        if (
            step != self.world.step
            or self._actions[robot] is not None
            or self.world.arrived[robot]
            or self.finished
        ):
            self.stale += 1
            return False
        self._actions[robot] = action
        self._acted += 1
        self._awaited.discard(robot)
        return not self._awaited

    def advance(self) -> None:
        """Make the time step and publish its results."""
        step = self.world.step
        acted = [k for k in self._robots if self._actions[k] is not None]
        self.left_out += self.world.arrived.count(False) - len(acted)
        before = tuple(self.world.cells) if self.watcher is not None else ()
        outcome = self.world.advance(self._actions)
        self.history.add(self.world.episode, step, self._actions, outcome)
        if self.watcher is not None:
            after = tuple(self.world.cells)
            observed = self.actions, after, outcome.miscoordination, outcome.rewards
            self.watcher(TeamTransition(step, before, *observed))
        self._begin_step()
        for k in acted:
            self._rewards[k] = (step, outcome.rewards[k])
            self._port.reward(k, step, outcome.rewards[k])
        self._publish_states()
        reached = self.world.step
        if not self.finished:
            if outcome.episode_over:
                self._begin_episode(
                    StartReason.ARRIVED
                    if all(self.world.arrived)
                    else StartReason.STEPS
                )
            elif self.absent and self._nobody_is_left():
                self._begin_episode(StartReason.NOBODY_LEFT)
        self._save_where_due(step, reached)
        if self.world.step > reached:  # an episode has begun
            self._save_where_due(reached, self.world.step)

    def _nobody_is_left(self) -> bool:
        """Return whether every robot has arrived or is absent."""
        return all(self.world.arrived[k] or k in self.absent for k in self._robots)

    def _begin_step(self) -> None:
        """Drop the actions of the last time step, and the rewards that were published with it."""
        self._actions: list[Action | None] = [None] * len(self._robots)
        self._rewards: list[tuple[int, Reward] | None] = [None] * len(self._robots)
        self._acted = 0
        self._await_robots()

    def _await_robots(self) -> None:
        """Note the robots whose actions the world waits for."""
        arrived = self.world.arrived
        self._awaited = {
            k
            for k in self._robots
            if self._actions[k] is None and not arrived[k] and k not in self.absent
        }

    def new_episode(self, began: str = StartReason.RESET) -> None:
        """Start an episode, for a reason; actions that wait at the barrier are dropped."""
        before = self.world.step
        self._begin_episode(began)
        self._save_where_due(before, self.world.step)

    def _begin_episode(self, began: str) -> None:
        self.began = began
        self.world.begin_episode()
        self._begin_step()
        self._publish_states()

    def expire(self) -> list[int]:
        """Leave out the robots that missed the deadline; return them.

        The barrier is open then. Where all other robots have arrived, a new episode begins.
        Without any other, the world continues to wait.
        """
        missing = self.missing()
        if not missing or len(self.absent.union(missing)) == len(self._robots):
            return []
        self.timeouts += len(missing)
        self.absent.update(missing)
        self._awaited.clear()
        if not self.complete:
            self.new_episode(StartReason.NOBODY_LEFT)
        return missing

    def repeat(self) -> None:
        """Repeat messages that robots may have lost; robots repeat their actions.

        They go to all robots: a missing robot may wait for the answer of an arrived one.
        """
        for k in self._robots:
            reward = self._rewards[k]
            if reward is not None:
                self._port.reward(k, *reward)
            self._port.state(k, self.world.step, self.world.cells[k])

    def _publish_states(self) -> None:
        for k in self._robots:
            self._port.state(k, self.world.step, self.world.cells[k])

    def _save_where_due(self, before: int, step: int) -> None:
        """Save at a published step, if it is one of the steps at which all save."""
        if saves(before, step, self._checkpoint, self.save_at):
            self._port.checkpoint(step)
