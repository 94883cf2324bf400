# Copyright 2026 The sparse_coord_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The world once more, from the seed and the logged actions."""

import struct
from collections.abc import Sequence
from typing import NamedTuple

from sparse_coord_ros.core.frame import Frame, action_from
from sparse_coord_ros.core.wire import REWARD_LABELS
from sparse_coord_ros.core.world import EPISODE_GAP, Action, World
from sparse_coord_ros.runlog.difference import MISSING, Difference
from sparse_coord_ros.runlog.log import RunLog


class WorldCheck(NamedTuple):
    """What came of it.

    Attributes:
        difference: the first, or None.
        transitions: steps of the world that agree.
        left_out: (robot, step) of the steps that the world made without a robot's action.
        resets: episodes that began early: by a reset, or as no robot was left to wait for.
        starts: the first time steps of the episodes.
        end: the last time step that was computed.
    """

    difference: Difference | None
    transitions: int
    left_out: frozenset[tuple[int, int]]
    resets: int
    starts: tuple[int, ...]
    end: int


class _DiffersError(Exception):
    def __init__(self, step, robot, quantity: str, logged: str, computed: str) -> None:
        self.difference = Difference(step, robot, quantity, logged, computed)


def check_world(log: RunLog, last: int | None) -> WorldCheck:
    """Step the world by the logged actions and compare states, rewards, clock and status.

    The log says who acted: the world rewards exactly those. A robot that is not rewarded was left
    out, which the world's status must confirm where the log holds one after it.

    Args:
        log: the log.
        last: the last time step to check; None: all, and the run's end.
    """
    walk = _Walk(log, last)
    difference = None
    try:
        walk.go()
    except _DiffersError as found:
        difference = found.difference
    return WorldCheck(
        difference=difference,
        transitions=walk.world.transitions,
        left_out=frozenset(walk.left_out),
        resets=walk.resets,
        starts=tuple(walk.starts),
        end=walk.world.step,
    )


class _Walk:
    def __init__(self, log: RunLog, last: int | None) -> None:
        self.log, self.tracks, self.last = log, log.tracks, last
        self.frame = Frame(log.run)
        self.world = World(log.run.scenario, log.run.seed)
        self.left_out: set[tuple[int, int]] = set()
        self.resets = 0
        # Whose absence the world has counted already: at least, and at most.
        self.absent: tuple[set[int], set[int]] = (set(), set())
        self.timeouts = [0, 0]
        self.finished = False
        self.starts = [self.world.step] if any(t.first for t in log.tracks.states) else []

    def go(self) -> None:
        """Walk through the steps of the log."""
        whole = self.last is None
        states = self.tracks.states
        # Steps that only actions speak of are not the world's.
        found = {t for track in (*states, *self.tracks.rewards) for t in track.first}
        found |= set(self.tracks.clock.first)
        steps = sorted(t for t in found if whole or t <= self.last)
        over = False
        for place, step in enumerate(steps):
            following = steps[place + 1] if place + 1 < len(steps) else None
            if step != self.world.step:
                self._fail_state(self.world.step)
                raise _DiffersError(
                    self.world.step, None, "clock", MISSING, f"step {self.world.step}"
                )
            self._check_states(step)
            self._check_status(step)
            rewarded = [k for k, track in enumerate(self.tracks.rewards) if step in track.first]
            if self.finished or over or not rewarded:
                for k in rewarded:
                    self._differ(step, k, "reward", f"{self._reward(step, k)}", "none")
                if following is None:
                    if whole and over and not self.finished:
                        self._fail_state(step + EPISODE_GAP)
                    break
                if self.finished:
                    raise _DiffersError(following, None, "local_state", "there", "the run is over")
                if following == step + 1:
                    self._fail_reward(step)
                if not over:
                    self._reset(step)
                self.world.begin_episode()
                self.starts.append(self.world.step)
                over = False
                continue
            over = self._advance(step, rewarded, following)
            if following is None and whole:
                self._fail_state(self.world.step)
        if whole:
            self._check_end()

    def _advance(self, step: int, rewarded: Sequence[int], following: int | None) -> bool:
        """Make one transition; return whether a new episode must begin."""
        world, names = self.world, self.log.names
        actions: list[Action | None] = [None] * len(names)
        for k in rewarded:
            numbers = self.tracks.actions[k].first.get(step)
            if numbers is None:
                self._differ(step, k, "action", MISSING, "one, for it is rewarded")
            if world.arrived[k]:
                self._differ(step, k, "reward", f"{self._reward(step, k)}", "none: it has arrived")
            try:
                actions[k] = action_from(numbers)
            except ValueError as error:
                self._differ(step, k, "action", str(error), "an action")
        self._leave_out(step, rewarded)
        outcome = world.advance(actions)
        for k in rewarded:
            logged, computed = self._reward(step, k), tuple(outcome.rewards[k])
            if struct.pack("<4d", *logged) != struct.pack("<4d", *computed):
                self._differ(step, k, "reward", _parts(logged), _parts(computed))
        self.finished = world.transitions >= self.log.run.scenario.steps
        nobody_moves = all(world.arrived[k] or k in self.absent[0] for k in range(len(names)))
        if outcome.episode_over or self.finished:
            return outcome.episode_over
        return nobody_moves and following == step + 1 and self._goes_over(step + 1)

    def _goes_over(self, step: int) -> bool:
        """Whether the log has no transition from a step where nobody is left to wait for."""
        return not any(step in track.first for track in self.tracks.rewards)

    def _check_states(self, step: int) -> None:
        if step not in self.tracks.clock.first:
            raise _DiffersError(step, None, "clock", MISSING, "this step")
        for k, cell in enumerate(self.world.cells):
            logged = self.tracks.states[k].first.get(step)
            if logged != self.frame.centres[cell]:
                self._fail_state(step, k)

    def _fail_state(self, step: int, k: int | None = None) -> None:
        """Raise for the first robot whose state of a step is not there, or for robot k."""
        for robot, track in enumerate(self.tracks.states):
            logged = track.first.get(step)
            if robot == k or (k is None and logged is None):
                computed = "a state"
                if step == self.world.step:
                    computed = self._place(self.frame.centres[self.world.cells[robot]])
                said = MISSING if logged is None else self._place(logged)
                self._differ(step, robot, "local_state", said, computed)

    def _place(self, position: tuple[float, float]) -> str:
        cell = self.frame.cell(*position)
        name = "no free cell" if cell is None else f"cell {cell}"
        return f"{name} ({position[0]!r}, {position[1]!r})"

    def _fail_reward(self, step: int) -> None:
        """The world made a step though the log rewards nobody for it."""
        for k, track in enumerate(self.tracks.actions):
            if step in track.first:
                self._differ(step, k, "reward", MISSING, "one: it acted and the world went on")
        self._differ(step, 0, "action", MISSING, "one: the world went on")

    def _leave_out(self, step: int, rewarded: Sequence[int]) -> None:
        """Note who was left out of a transition; the world's next status must know of them."""
        least, most = self.absent
        for k in range(len(self.log.names)):
            if k in rewarded:
                least.discard(k)
                most.discard(k)
            elif not self.world.arrived[k]:
                self.left_out.add((k, step))
                self.timeouts[0] += k not in least
                self.timeouts[1] += k not in most
                least.add(k)
                most.add(k)
                acted = step in self.tracks.actions[k].first
                if acted:  # too late: with it the robot is back
                    most.discard(k)
                later = next((s for s in self.tracks.statuses if s.step > step), None)
                if later is not None and self.timeouts[0] > later.timeouts:
                    due = "one, for the world reports no timeout"
                    self._differ(step, k, "reward" if acted else "action", MISSING, due)

    def _reset(self, step: int) -> None:
        """A new episode began before this one was over."""
        self.resets += 1
        least, most = self.absent
        for k in range(len(self.log.names)):
            if not self.world.arrived[k] and step not in self.tracks.actions[k].first:
                self.timeouts[1] += k not in most
                least.add(k)

    def _check_status(self, step: int) -> None:
        for status in self.tracks.statuses:
            if status.step != step:
                continue
            if status.transitions != self.world.transitions:
                logged = f"{status.transitions} transitions"
                raise _DiffersError(step, None, "status", logged, f"{self.world.transitions}")
            if not self.timeouts[0] <= status.timeouts <= self.timeouts[1]:
                low, high = self.timeouts
                computed = f"{low}" if low == high else f"{low} to {high}"
                raise _DiffersError(step, None, "status", f"{status.timeouts} timeouts", computed)

    def _check_end(self) -> None:
        """The log must say how the run ended, and end there."""
        statuses = self.tracks.statuses
        end = statuses[-1] if statuses else None
        if end is None or end.state not in ("finished", "stopped"):
            logged = MISSING if end is None else repr(end.state)
            raise _DiffersError(self.world.step, None, "status", logged, "the end of the run")
        if end.step != self.world.step:
            raise _DiffersError(
                self.world.step, None, "status", f"step {end.step}", "the last step"
            )
        if (end.state == "finished") != self.finished:
            left = self.log.run.scenario.steps - self.world.transitions
            computed = f"{left} steps of the budget left"
            raise _DiffersError(self.world.step, None, "status", repr(end.state), computed)

    def _reward(self, step: int, k: int) -> tuple[float, ...]:
        return self.tracks.rewards[k].first[step]

    def _differ(self, step: int, k: int, quantity: str, logged: str, computed: str) -> None:
        raise _DiffersError(step, self.log.names[k], quantity, logged, computed)


def _parts(numbers: Sequence[float]) -> str:
    return " ".join(f"{label}={n!r}" for label, n in zip(REWARD_LABELS, numbers, strict=True))
