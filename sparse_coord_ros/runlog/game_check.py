# Copyright 2026 The sparse_coord_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The world once more, from the seed and the logged actions: every transition at once.

Each is computed from the logged states before it. As long as nothing differs these are the
computed ones, so that the first difference is the one that stepping the world would find.
"""

from collections.abc import Iterator, Sequence
from typing import NamedTuple

import numpy as np

from sparse_coord_ros.game.miscoordination import (
    NOWHERE,
    meeting_places,
    miscoordinations,
    partners_of,
)
from sparse_coord_ros.game.schedules import exploring_starts
from sparse_coord_ros.game.streams import MOTION, START
from sparse_coord_ros.game.world import EPISODE_GAP, FIRST_STEP
from sparse_coord_ros.runlog.difference import MISSING, Difference
from sparse_coord_ros.runlog.draws import draws_at
from sparse_coord_ros.runlog.log import RunLog, merged
from sparse_coord_ros.runlog.tracks import THE_CLOCK
from sparse_coord_ros.wire import ACTION, LOCAL_STATE, PARTNERS, REWARD, STATUS, Began, RunState
from sparse_coord_ros.wire.frame import Frame

Finding = tuple[int, Difference]
"""The row of a difference, and what differs."""


class WorldCheck(NamedTuple):
    """What came of it.

    Attributes:
        difference: the first, or None.
        transitions: steps of the world that agree.
        left_out: number of (robot, step) that the world made without the robot's action.
        resets: episodes that began early: by a reset, or as no robot was left to wait for.
        starts: the first time steps of the episodes.
        end: the last time step that was computed.
    """

    difference: Difference | None
    transitions: int
    left_out: int
    resets: int
    starts: np.ndarray
    end: int


def check_world(log: RunLog, last: int | None) -> WorldCheck:
    """Compare states, rewards, clock and status with what the world does.

    The log says who acted: the world rewards exactly those. The others that had not arrived were
    left out; the status says how many.

    Args:
        log: the log.
        last: the last time step to check; None: all, and the run's end.
    """
    return _Walk(log, last).check()


class _Walk:
    def __init__(self, log: RunLog, last: int | None) -> None:
        self.log, self.last = log, last
        self.scenario, self.robots = log.run.scenario, range(len(log.names))
        self.frame = Frame(log.run)
        tracks = log.tracks
        # Steps that only actions or percepts speak of are not the world's.
        speakers = (*tracks.states, *tracks.rewards, tracks.clock)
        steps = merged([track.step for track in speakers])
        steps = steps if last is None else steps[steps <= last]
        self.steps = steps
        self.in_log = np.isin(steps, log.step)
        rows = np.minimum(np.searchsorted(log.step, steps), max(len(log.step) - 1, 0))

        def at(values: np.ndarray, nothing: float) -> np.ndarray:
            found = np.full((len(steps), *values.shape[1:]), nothing, dtype=values.dtype)
            found[self.in_log] = values[rows[self.in_log]]
            return found

        self.cells, self.centred = at(log.cells, -1), at(log.centred, False)
        self.move, self.asked = at(log.move, -1), at(log.asked, False)
        self.reward, self.position = at(log.reward, np.nan), at(log.position, np.nan)
        if self.scenario.referee:
            self.reward = np.concatenate(
                [self.reward, at(log.partners, np.nan)[..., None]], axis=2
            )
        self.numbers = at(log.numbers, np.nan)
        self.rewarded = np.stack([track.has(steps) for track in tracks.rewards], axis=1)
        self.stated = np.stack([track.has(steps) for track in tracks.states], axis=1)
        self.acted = np.stack([track.has(steps) for track in tracks.actions], axis=1)
        self.made = np.asarray(self.rewarded.any(axis=1))
        goals = np.array([robot.goal for robot in self.scenario.robots])
        self.arrived: np.ndarray = np.equal(self.cells, goals)
        self.goals = goals
        # Transitions before each row.
        self.before = np.concatenate([[0], np.cumsum(self.made)])[:-1]
        self.finished: np.ndarray = np.greater_equal(self.before, self.scenario.steps)
        begins = np.concatenate([[True], ~self.made[:-1]])[: len(steps)]
        begun = np.maximum.accumulate(np.where(begins, np.arange(len(steps)), 0))
        self.begins, self.begun = begins, begun
        self.used_up: np.ndarray = np.asarray(steps - steps[begun] >= self.scenario.max_steps)
        self.over: np.ndarray = np.asarray(self.arrived.all(axis=1) | self.used_up)
        self.left_out = self.made[:, None] & ~self.rewarded & ~self.arrived
        counted = np.cumsum(self.left_out.sum(axis=1))
        self.left_before = np.concatenate([[0], counted])[:-1]

    def check(self) -> WorldCheck:
        """Return the first difference, and what was there before it."""
        place, difference = len(self.steps), None
        found = list(self._found()) if len(self.steps) else []
        if found:
            place, difference = min(found, key=lambda one: one[0])
        elif self.last is None:
            difference = self._end()
        rows = slice(0, place + (difference is None))
        early = self.begins.copy()
        early[1:] &= ~self.over[:-1]
        early[:1] = False
        end = min(place, len(self.steps) - 1)
        # Where the first difference is no time step that was not due, its row is one of the run.
        known = place + (place <= end and not self._gaps()[place])
        return WorldCheck(
            difference=difference,
            transitions=int(self.made[:place].sum()),
            left_out=int(self.left_out[:place].sum()),
            resets=int(early[rows].sum()),
            starts=self.steps[:known][self.begins[:known]],
            end=int(self.steps[end]) if len(self.steps) else FIRST_STEP,
        )

    def _found(self) -> Iterator[Finding]:
        """Yield the first difference of each kind."""
        for row in _first(self._gaps()):
            yield row, self._gap(row)
        for row in _first(~self.log.tracks.clock.has(self.steps)):
            yield row, Difference(int(self.steps[row]), None, THE_CLOCK, MISSING, "this step")
        due = self._due_cells()
        for k in self.robots:
            for row in _first(~self.centred[:, k] | (self.cells[:, k] != due[:, k])):
                stated = self.stated[row, k]
                logged = self._place(*self.position[row, k].tolist()) if stated else MISSING
                computed = self._place(*self.frame.centres[due[row, k]])
                yield row, self._differ(row, k, LOCAL_STATE.name, logged, computed)
        yield from self._statuses()
        for k in self.robots:
            yield from self._rewards(k)

    # The clock.

    def _gaps(self) -> np.ndarray:
        """Return at which rows another time step was due, or none."""
        due = np.empty_like(self.steps)
        due[:1] = FIRST_STEP
        due[1:] = self.steps[:-1] + np.where(self.made[:-1], 1, EPISODE_GAP)
        over = np.zeros(len(self.steps), dtype=bool)
        over[1:] = self.finished[:-1] & ~self.made[:-1]
        return np.asarray((self.steps != due) | over)

    def _gap(self, row: int) -> Difference:
        name = self.log.names[0]
        if row == 0:
            return Difference(FIRST_STEP, name, LOCAL_STATE.name, MISSING, "a state")
        before, step = int(self.steps[row - 1]), int(self.steps[row])
        if self.made[row - 1]:
            return Difference(before + 1, name, LOCAL_STATE.name, MISSING, "a state")
        if self.finished[row - 1]:
            return Difference(step, None, LOCAL_STATE.name, "there", "the run is over")
        if step != before + 1:
            return Difference(before + EPISODE_GAP, name, LOCAL_STATE.name, MISSING, "a state")
        for k in np.flatnonzero(self.acted[row - 1]).tolist():
            due = "one: it acted and the world went on"
            return self._differ(row - 1, k, REWARD.name, MISSING, due)
        return self._differ(row - 1, 0, ACTION.name, MISSING, "one: the world went on")

    # States.

    def _due_cells(self) -> np.ndarray:
        """Return in which cells the robots must be, shape (n, K)."""
        steps, scenario = self.steps, self.scenario
        next_cell = np.asarray(scenario.map.next_cell)
        share = exploring_starts(scenario.starts, scenario.steps)
        share = share[np.clip(steps, 0, len(share) - 1)]
        due = np.empty_like(self.cells)
        self.after = np.empty_like(self.cells)
        for k in self.robots:
            moves = draws_at(self.log.run.seed, k, MOTION, steps)[:, 0] < scenario.move_success
            moves &= self.rewarded[:, k] & (self.move[:, k] >= 0)
            led = next_cell[self.cells[:, k], self.move[:, k]]
            self.after[:, k] = np.where(moves, led, self.cells[:, k])
            draws = draws_at(self.log.run.seed, k, START, steps[self.begins])
            free = np.flatnonzero(scenario.map.distances_to(scenario.robots[k].goal) > 0)
            drawn = free[(draws[:, 1] * len(free)).astype(np.int64)]
            due[1:, k] = self.after[:-1, k]
            start = scenario.robots[k].start
            due[self.begins, k] = np.where(draws[:, 0] < share[self.begins], drawn, start)
        return due

    def _place(self, x: float, y: float) -> str:
        cell = self.frame.cell(x, y)
        return f"{'no free cell' if cell is None else f'cell {cell}'} ({x!r}, {y!r})"

    # What the world says of itself.

    def _statuses(self) -> Iterator[Finding]:
        """Yield the first status that says otherwise than the log counts.

        A reward that is missing looks like a robot that was left out; there it is named.
        """
        named = 0
        for status in self.log.tracks.statuses:
            row = int(np.searchsorted(self.steps, status.step))
            if row == len(self.steps) or self.steps[row] != status.step:
                continue
            counted, said = int(self.left_before[row]), status.left_out
            pairs = np.argwhere(self.left_out[named:row]) + [named, 0]
            reasons = self._reasons(row)
            odd: tuple[str, str] | None = None
            if status.transitions != self.before[row]:
                odd = f"{status.transitions} transitions", f"{self.before[row]}"
            elif said is not None and counted > said and len(pairs):
                acted = [pair for pair in pairs.tolist() if self.acted[*pair]]
                at, k = acted[0] if acted else pairs[0].tolist()
                quantity = REWARD.name if acted else ACTION.name
                due = "one, for the world does not say that it left the robot out"
                yield at, self._differ(at, k, quantity, MISSING, due)
                return
            elif said is not None and counted != said:
                odd = f"{said} robots' steps left out", f"{counted}"
            elif status.began is not None and status.began not in reasons:
                odd = f"episode began: {status.began}", " or ".join(reasons)
            if odd is not None:
                yield row, Difference(status.step, None, STATUS.name, *odd)
                return
            named = row

    def _reasons(self, row: int) -> tuple[str, ...]:
        """Return why the episode of a row can have begun."""
        begun = int(self.begun[row])
        if begun == 0:
            return (Began.START,)
        if self.arrived[begun - 1].all():
            return (Began.ARRIVED,)
        return (Began.STEPS,) if self.used_up[begun - 1] else (Began.RESET, Began.NOBODY_LEFT)

    # Rewards.

    def _rewards(self, k: int) -> Iterator[Finding]:
        """Yield the first odd reward of a robot of each kind; after `_due_cells`."""
        mine, acted = self.rewarded[:, k], self.acted[:, k]
        over = self.finished | self.over
        none = mine & (over | self.arrived[:, k])
        none &= ~self.begins | self.finished  # an episode's first state is not its last
        for row in _first(none):
            logged = f"{tuple(self.reward[row, k].tolist())}"
            computed = "none" if over[row] else "none: it has arrived"
            yield row, self._differ(row, k, REWARD.name, logged, computed)
        for row in _first(mine & ~acted):
            yield row, self._differ(row, k, ACTION.name, MISSING, "one, for it is rewarded")
        for row in _first(mine & acted & (self.move[:, k] < 0)):
            logged = f"(east, north) {tuple(self.numbers[row, k, :2].tolist())}"
            yield row, self._differ(row, k, ACTION.name, logged, "an action")
        said, due = np.ascontiguousarray(self.reward[:, k]), self._due_rewards(k)
        for row in _first(mine & (said.view(np.int64) != due.view(np.int64)).any(axis=1)):
            logged, computed = _parts(said[row].tolist()), _parts(due[row].tolist())
            yield row, self._differ(row, k, REWARD.name, logged, computed)

    def _due_rewards(self, k: int) -> np.ndarray:
        """Return the numbers of a robot's rewards after each step, shape (n, 4 or 5)."""
        scenario = self.scenario
        conflict = miscoordinations(scenario, self.after)
        common = np.where(conflict, scenario.penalties[k], 0.0)
        individual = np.where(self.after[:, k] == self.goals[k], scenario.goal_reward, 0.0)
        cost = np.where(self.asked[:, k], -scenario.ask_cost, 0.0)
        numbers = [individual, common, cost, individual + common + cost]
        if scenario.referee:
            places = np.where(self.after < 0, NOWHERE, meeting_places(scenario)[self.after])
            numbers.append(np.zeros(len(self.after)) + partners_of(k, places.T))
        return np.stack(numbers, axis=1)

    # The end.

    def _end(self) -> Difference | None:
        """The log must say how the run ended, and end there."""
        name, step, finished, transitions = self.log.names[0], FIRST_STEP, False, 0
        if len(self.steps):
            step, transitions = int(self.steps[-1]), int(self.before[-1])
            finished = bool(self.finished[-1])
            if self.made[-1]:
                return Difference(step + 1, name, LOCAL_STATE.name, MISSING, "a state")
            if self.over[-1] and not self.begins[-1] and not finished:
                return Difference(step + EPISODE_GAP, name, LOCAL_STATE.name, MISSING, "a state")
        statuses = self.log.tracks.statuses
        end = statuses[-1] if statuses else None
        if end is None or end.state not in (RunState.FINISHED, RunState.STOPPED):
            odd = MISSING if end is None else repr(end.state), "the end of the run"
        elif end.step != step:
            odd = f"step {end.step}", "the last step"
        elif (end.state == RunState.FINISHED) != finished:
            odd = repr(end.state), f"{self.scenario.steps - transitions} steps of the budget left"
        else:
            return None
        return Difference(step, None, STATUS.name, *odd)

    def _differ(self, row: int, k: int, quantity: str, logged: str, computed: str) -> Difference:
        return Difference(int(self.steps[row]), self.log.names[k], quantity, logged, computed)


def _first(wrong: np.ndarray) -> list[int]:
    """Return the first row that is wrong, if there is one."""
    return [int(np.argmax(wrong))] if wrong.any() else []


def _parts(numbers: Sequence[float]) -> str:
    labels = (*REWARD.labels, PARTNERS)
    return " ".join(f"{label}={n!r}" for label, n in zip(labels, numbers, strict=False))
