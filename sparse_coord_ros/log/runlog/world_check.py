# Copyright 2026 The sparse_coord_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Check of the world's states and rewards against a computed world with the logged actions.

`World` computes each step again from the seed and the logged actions. The motion of bodies cannot
be computed: if robots have bodies, the check takes the logged states, and compares everything that
follows from them.
"""

from collections import deque
from collections.abc import Iterator, Sequence

import numpy as np

from sparse_coord_ros.core.game.rules import EPISODE_GAP
from sparse_coord_ros.core.game.world import Action, World
from sparse_coord_ros.core.learners.agent import NOBODY
from sparse_coord_ros.log.runlog.difference import Difference, Finding, Undecided
from sparse_coord_ros.log.runlog.log import NONE, RunLog
from sparse_coord_ros.protocol import wire
from sparse_coord_ros.protocol.lockstep.bodies import BodyWorld


class WorldCheck:
    """Compares states and rewards with those of a computed world, step by step.

    For each of `steps`, in their order, call `arrive`, then `advance`; at the end call `end`. The
    first finding ends the check: the world is unknown after it.

    The rewards in the log show which robots acted: the world rewards exactly those. The others
    that had not arrived were left out, or the log lacks their messages: the next status tells.

    Args:
        log: the log.

    Attributes:
        steps: the time steps with a state of any robot.
        transitions: number of the world's steps that agree.
        left_out: number of (robot, step) pairs without the robot's action.
        resets: number of episodes that began early: by a reset, or as the world had no robot left
            to wait for.
        unsure: the first time step of which the log may lack a robot's action and reward, as no
            status has confirmed yet that the robot was left out; None: there is none.
    """

    def __init__(self, log: RunLog) -> None:
        self.world = World(log.run.scenario, log.run.seed)
        if log.run.bodies:
            self.world = BodyWorld(log.run.scenario, log.run.seed, slips=log.run.slips)
        self.steps: list[int] = np.unique(
            np.concatenate(
                [log.series[wire.LOCAL_STATE, k].step for k in range(len(log.names))]
            )
        ).tolist()
        self.transitions = 0
        self.left_out = 0
        self.resets = 0
        self.unsure: int | None = None
        self._log = log
        self._robots = range(len(log.names))
        self._centres = [np.array(centre) for centre in log.frame.centres]
        self._rewarded = [
            set(log.series[wire.REWARD, k].step.tolist()) for k in self._robots
        ]
        self._acted = [
            set(log.series[wire.ACTION, k].step.tolist()) for k in self._robots
        ]
        self._statuses = deque(log.statuses)
        self._move = log.move.tolist()
        self._asked = log.asked.tolist()
        self._begun = False
        self._went_on = False

    def arrive(self, step: int) -> Iterator[Finding]:
        """Go to a time step of the log, and compare the robots' states."""
        if self._begun and not self._went_on:
            yield from self._begin_episode(step)
        self._begun = True
        if step > self.world.step:
            yield _lost(self.world.step, "the states")
        elif step < self.world.step:
            words = wire.LOCAL_STATE.name, "there", "none: no step of the run"
            yield Difference(step, None, *words)
        yield from self._states(step)
        yield from self._left_out_by_status(step)

    def _begin_episode(self, step: int) -> Iterator[Finding]:
        """Begin an episode: the log has no rewards of the world's step."""
        world = self.world
        before = world.step
        if world.transitions == world.scenario.steps:
            words = wire.LOCAL_STATE.name, "there", "none: the run is over"
            yield Difference(step, None, *words)
        over = world.episode_over
        world.begin_episode()
        if over:
            return
        # Someone reset the world, or it had no robot left to wait for; or messages are lost.
        cells = self._log.cells[self._log.row_of[step]].tolist()
        if step != world.step or cells != list(world.cells):
            yield _lost(before, "rewards")
        self.resets += 1

    def _states(self, step: int) -> Iterator[Finding]:
        """Compare the robots' states with the world's."""
        log = self._log
        row = log.row_of[step]
        for k, cell in enumerate(self.world.cells):
            logged = log.position[row, k]
            due = self._centres[cell]
            if np.isnan(logged).all():
                yield _lost(step, f"the state of {log.names[k]}")
            elif logged.tobytes() != due.tobytes():
                words = wire.LOCAL_STATE.name, self._place(logged), self._place(due)
                yield Difference(step, log.names[k], *words)

    def _place(self, position: np.ndarray) -> str:
        x, y = position.tolist()
        cell = self._log.frame.cell(x, y)
        return f"{'no free cell' if cell is None else f'cell {cell}'} ({x!r}, {y!r})"

    def _left_out_by_status(self, step: int) -> Iterator[Finding]:
        """Compare the number of steps without a robot's action with the statuses up to a step."""
        while self._statuses and self._statuses[0].step <= step:
            status = self._statuses.popleft()
            if status.left_out == self.left_out:
                self.unsure = None
            elif self.unsure is not None:
                yield _lost(self.unsure, "a robot's action and reward")

    def advance(self, step: int) -> Iterator[Finding]:
        """Make the transition with the actions of the robots that the log rewards, if any."""
        rewarded = [k for k in self._robots if step in self._rewarded[k]]
        self._went_on = bool(rewarded)
        if not rewarded:
            return
        world = self.world
        row = self._log.row_of[step]
        for k in rewarded:
            yield from self._rightly_rewarded(step, k)
        left = [k for k in self._robots if k not in rewarded and not world.arrived[k]]
        if left and self.unsure is None:
            self.unsure = step
        actions: list[Action | None] = [None] * len(self._robots)
        for k in rewarded:
            actions[k] = Action(self._move[row][k], self._asked[row][k], NOBODY, False)
        if isinstance(world, BodyWorld):
            yield from self._bodies(world, step)
        outcome = world.advance(actions)
        for k in rewarded:
            logged = self._log.rewards[row, k]
            due = np.array(outcome.rewards[k], dtype=np.float64)
            if logged.tobytes() != due.tobytes():
                words = wire.REWARD.name, _parts(logged.tolist()), _parts(due.tolist())
                yield Difference(step, self._log.names[k], *words)
        self.transitions += 1
        self.left_out += len(left)

    def _rightly_rewarded(self, step: int, k: int) -> Iterator[Finding]:
        """Yield a finding if a robot's reward of a time step is impossible."""
        log = self._log
        world = self.world
        over = world.episode_over or world.transitions == world.scenario.steps
        if over or world.arrived[k]:
            due = "none" if over else "none: it has arrived"
            words = wire.REWARD.name, "there", due
            yield Difference(step, log.names[k], *words)
        elif step not in self._acted[k]:
            yield _lost(step, f"the action of {log.names[k]}")

    def _bodies(self, world: BodyWorld, step: int) -> Iterator[Finding]:
        """Put the bodies into the cells of the next states."""
        after = self._log.row_of.get(step + 1)
        for k in self._robots:
            cell = NONE if after is None else int(self._log.cells[after, k])
            if cell == NONE:
                yield _lost(step + 1, f"the state of {self._log.names[k]}")
            world.there[k] = cell

    def end(self) -> Iterator[Finding]:
        """Check that the log contains the run's end, and ends there."""
        log = self._log
        world = self.world
        left = world.scenario.steps - world.transitions
        if log.damage is not None:
            yield Undecided(world.step, log.damage)
        if self._went_on:
            yield _lost(world.step, "the states")
        if left and world.episode_over:
            yield _lost(world.step + EPISODE_GAP, "the states")
        yield from self._left_out_by_status(world.step)
        if self.unsure is not None:
            yield _lost(self.unsure, "a robot's action or the world's status")
        later = log.step[log.step > world.step].tolist()
        if later:
            yield _lost(later[0], "the states")
        statuses = log.statuses
        if left and (not statuses or statuses[-1].state not in wire.OVER):
            why = "the world does not show how the run ended"
            yield Undecided(world.step, why)


def _lost(step: int, what: str) -> Undecided:
    """Return that messages of a time step are not in the log."""
    verb = "are" if what.endswith("s") else "is"
    return Undecided(step, f"{what} of time step {step} {verb} not in the log")


def _parts(numbers: Sequence[float]) -> str:
    pairs = zip(wire.REWARD.labels, numbers, strict=True)
    return " ".join(f"{label}={number!r}" for label, number in pairs)
