# Copyright 2026 The sparse_coord_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Whether a robot's actions, tables and coordination maps are those of an agent."""

from collections.abc import Iterator

import numpy as np

from sparse_coord_ros.game.world import Action
from sparse_coord_ros.learn.agent import Tables
from sparse_coord_ros.learn.simulation import tables_equal
from sparse_coord_ros.runlog.attached import RecordedTables
from sparse_coord_ros.runlog.dialogue import heard, times_asked_again
from sparse_coord_ros.runlog.difference import MISSING, Difference, first_entry
from sparse_coord_ros.runlog.log import RunLog
from sparse_coord_ros.runlog.replay import Replay, fresh_agent
from sparse_coord_ros.runlog.trajectory import due_numbers, trajectory_of
from sparse_coord_ros.wire import (
    ACTION,
    ACTION_LABELS,
    COORDINATION_MAP,
    TABLES,
    PerceptEnd,
    RunState,
    tables_attachment,
)
from sparse_coord_ros.wire.frame import Frame
from sparse_coord_ros.wire.messages import action_numbers
from sparse_coord_ros.wire.occupancy import OCCUPIED, OccupancyData


def first_tables(log: RunLog, k: int) -> tuple[Tables | None, Difference | None]:
    """Return what a robot began with, and in what the log says otherwise.

    The tables are None where the log ought to hold them and does not.
    """
    run = log.run
    recorded = [e.tables for e in log.all_tables if (e.robot, e.step) == (k, 0)]
    if run.tables or run.greedy:
        return (recorded[0] if recorded else None), None
    fresh = run.rule.tables(run.scenario)
    if recorded and not tables_equal(recorded[:1], [fresh]):
        return fresh, Difference(0, log.names[k], *first_entry(recorded[0], fresh))
    return fresh, None


class AgentCheck:
    """Compares one robot's actions and tables with those of an agent fed from the log.

    Args:
        log: the log.
        k: the robot's number.
        starts: the first time steps of the episodes.
        last: the last time step to check; None: all.

    Attributes:
        name: the robot's.
        trajectory: what the log says that it did.
        recorded: its recorded tables.
        state: the world's last state; None where the log breaks off, or says none.
        choices, updates, compared: actions, updates and tables that agree, after `differences`.
    """

    def __init__(
        self,
        log: RunLog,
        k: int,
        starts: np.ndarray,
        last: int | None,
    ) -> None:
        self.log, self.k, self.last = log, k, last
        self.name = log.names[k]
        self.trajectory = trajectory_of(log, k)
        self.choices = self.updates = self.compared = 0
        self.recorded = [entry for entry in log.all_tables if entry.robot == k]
        statuses = log.tracks.statuses
        self.state = statuses[-1].state if last is None and statuses else None
        self._grids = OccupancyData(Frame(log.run))
        self._starts = starts

    @property
    def killed(self) -> bool:
        """Whether it can have been killed: the run was stopped, or went on without it."""
        if self.state == RunState.STOPPED:
            return True
        log, rows = self.log, self.log.step > self.trajectory.step.max(initial=-1)
        rewarded = ~np.isnan(log.reward[rows, :, 0])
        goal = log.run.scenario.robots[self.k].goal
        return bool(
            (rewarded.any(axis=1) & ~rewarded[:, self.k] & (log.cells[rows, self.k] != goal)).any()
        )

    @property
    def unlearned(self) -> int:
        """Transitions that the world made with it and that it has not learned from."""
        rewarded = ~np.isnan(self.log.reward[self.trajectory.row, self.k, 0])
        done = (rewarded & ~self.trajectory.learned)[: self.choices]
        return 0 if self.log.run.greedy else int(done.sum())

    def differences(self) -> Iterator[Difference]:
        """Yield the first thing that an agent would have done otherwise, and what is missing."""
        yield from self._missing_tables()
        yield from self._missing_maps()
        first = self._first()
        if first is not None:
            yield first

    def _first(self) -> Difference | None:
        begun, difference = first_tables(self.log, self.k)
        if difference is not None or begun is None:  # that there are none is said elsewhere
            return difference
        trajectory = self.trajectory
        limit = len(trajectory.step)
        if self.last is not None:
            limit = int(np.searchsorted(trajectory.step, self.last, side="right"))
        odd = self._odd_numbers(limit)
        limit = limit if odd is None else odd[0]
        replay = Replay(self.log, trajectory, fresh_agent(self.log, self.k, begun))
        difference = self._first_shown(replay, limit)
        if difference is None:
            replay.advance(limit)
            difference = None if odd is None else odd[1]
            if replay.other is not None:
                logged = self.log.numbers[trajectory.row[replay.reached], self.k]
                step = int(trajectory.step[replay.reached])
                said = said_otherwise(logged, replay.other)
                difference = self._differ(step, ACTION.name, *said)
        self.choices = replay.reached
        if not self.log.run.greedy:
            self.updates = int(trajectory.learned[: replay.reached].sum())
        return difference

    def _first_shown(self, replay: Replay, limit: int) -> Difference | None:
        """Replay up to an action; return the first tables or map that the agent has not."""
        end = int(self.log.tracks.states[self.k].step.max(initial=0))
        for step, _, what in sorted(
            [*self._table_stops(), *self._map_stops()], key=lambda stop: stop[:2]
        ):
            if self.last is not None and step > self.last:
                return None
            if isinstance(what, RecordedTables) and step > end:
                return self._differ(step, TABLES.name, "there", f"the log ends at step {end}")
            to = int(np.searchsorted(self.trajectory.step, step))
            if to > limit or not replay.advance(to):
                return None
            if isinstance(what, RecordedTables):
                difference = self._compare_tables(what, replay, to)
            else:
                difference = self._compare_map(step, what, replay)
            if difference is not None:
                return difference
        return None

    def _odd_numbers(self, limit: int) -> tuple[int, Difference] | None:
        """Return the first action whose numbers cannot be, whatever is learned."""
        trajectory, log = self.trajectory, self.log
        numbers = log.numbers[trajectory.row[:limit], self.k]
        due = due_numbers(trajectory)[:limit]
        said = numbers[:, : len(ACTION_LABELS)]
        wrong = (said.copy().view(np.int64) != due.view(np.int64)).any(axis=1)
        able = np.concatenate([[False], trajectory.told[:-1]])[:limit] & (not log.run.greedy)
        account = log.has_learned[trajectory.row[:limit], self.k]
        lies = (account != 0.0) & ((account != 1.0) | ~able)
        if not (wrong | lies).any():
            return None
        i = int(np.argmax(wrong | lies))
        step = int(trajectory.step[i])
        if wrong[i]:
            return i, self._differ(step, ACTION.name, *said_otherwise(numbers[i], due[i]))
        allowed = "0 or 1" if able[i] else "0: there was nothing to learn from"
        return i, self._differ(step, ACTION.name, f"learned={account[i]:g}", allowed)

    # Tables.

    def _table_stops(self) -> Iterator[tuple[int, int, RecordedTables]]:
        for place, entry in enumerate(self.recorded):
            yield entry.step, place, entry

    def _compare_tables(self, entry: RecordedTables, replay: Replay, to: int) -> Difference | None:
        self.compared += 1
        tables = replay.agent.tables
        if not tables_equal([entry.tables], [tables]):
            return self._differ(entry.step, *first_entry(entry.tables, tables))
        # Of the last tables: what was asked at their very step may have ended.
        there = to < len(self.trajectory.step) and self.trajectory.step[to] == entry.step
        ends = [to, to + 1] if entry is self.recorded[-1] and there else [to]
        found = [self._odd_count(entry, to, end) for end in ends]
        odd = [one for one in found if one is not None]
        return self._differ(entry.step, *odd[-1]) if len(odd) == len(found) else None

    def _odd_count(self, entry: RecordedTables, to: int, end: int) -> tuple[str, str, str] | None:
        """Return (quantity, logged, computed) of the first number that cannot be."""
        log, trajectory = self.log, self.trajectory
        ended = log.ended[trajectory.row[:end], self.k]
        due = {end.words: int((ended == end).sum()) for end in PerceptEnd}
        learned = int(trajectory.learned[:to].sum())
        mine = [r for r in log.requests if r.asker == self.k and r.step < entry.step + end - to]
        # What was sent again as no answer came is the same request.
        mine = [r for r in heard(mine) if r.answer is not None]
        again = times_asked_again(mine)
        # A robot that stops while it asks has repeated without an action that follows.
        until = entry.step + (entry is self.recorded[-1])
        asked = [r for r in log.requests if r.asker == self.k and r.step < until]
        behind = sum(r.answer is not None and r.answer[0] < r.step for r in asked)
        bounds = {name: (due[name], due[name]) for name in ("answered", "refused", "late")}
        bounds |= {"learned": (learned, learned), "dropped": (0, to - learned)}
        bounds["repeated"] = (again, behind)
        for name, (low, high) in bounds.items():
            logged = entry.counts.get(name)
            if logged is None or not low <= logged <= high:
                allowed = f"{low}" if low == high else f"{low} to {high}"
                return f"{TABLES.name} count {name}", f"{logged}", allowed
        return None

    def _missing_tables(self) -> Iterator[Difference]:
        """Yield the tables that ought to be in the log and are not."""
        log, run = self.log, self.log.run
        states = log.tracks.states[self.k].step
        steps = {entry.step for entry in self.recorded}
        due = [0]
        if run.checkpoint and len(states):
            rows = np.searchsorted(log.step, states)
            goal = run.scenario.robots[self.k].goal
            # Acting on a state, or resting at the goal, a robot has worked it off.
            handled = (log.move[rows, self.k] >= 0) | (log.cells[rows, self.k] == goal)
            crossed = states[:-1] // run.checkpoint < states[1:] // run.checkpoint
            due += states[1:][crossed & handled[1:]].tolist()
        # A robot's last tables are of a state that it has acted on, or of one after it: it may
        # have missed those that came when it was stopped.
        acted = int(self.trajectory.step.max(initial=0))
        end = int(states.max(initial=0))
        newest = max((step for step in steps if step <= end), default=0)
        if self.state in (RunState.FINISHED, RunState.STOPPED) and newest < acted:
            due.append(end)
        unreadable = {
            p.step for p in log.problems if p.robot == self.name and p.quantity == TABLES.name
        }
        for step in due:
            beyond = self.last is not None and step > min(self.last, max(steps, default=0))
            if step not in steps and step not in unreadable and not beyond:
                yield self._differ(step, TABLES.name, MISSING, tables_attachment(self.name, step))

    # Coordination maps.

    def _due_maps(self) -> np.ndarray:
        """Return the starts of episodes that the robot has shown: where it acted."""
        return self._starts[np.isin(self._starts, self.trajectory.step)]

    def _map_stops(self) -> Iterator[tuple[int, int, bytes | None]]:
        """Yield step, place and the data of each; None where the robot has no such state."""
        steps, rows = self.log.tracks.coordination_maps[self.k]
        known = (steps == 0) | np.isin(steps, self.log.tracks.states[self.k].step)
        for place in range(len(steps)):
            shown = rows["data"][place].tobytes() if known[place] else None
            yield int(steps[place]), 1_000_000 + place, shown

    def _compare_map(self, step: int, shown: bytes | None, replay: Replay) -> Difference | None:
        due = self._grids.coordination(replay.agent.tables)
        if shown == due:
            return None
        computed = self._cells(due)
        logged = "there" if shown is None else self._cells(shown)
        if logged == computed:
            logged += ", with other values elsewhere"
        return self._differ(step, COORDINATION_MAP.name, logged, computed)

    def _cells(self, data: bytes) -> str:
        shown = np.frombuffer(data, dtype=np.int8)[self._grids.places] == OCCUPIED
        return f"COORDINATE in cells {np.flatnonzero(shown).tolist()}"

    def _missing_maps(self) -> Iterator[Difference]:
        """Yield the coordination maps that ought to be in the log and are not.

        Where it breaks off, only those before the last one that was shown.
        """
        steps = self.log.tracks.coordination_maps[self.k][0]
        due = self._due_maps()
        if self.last is not None:
            due = due[due <= min(self.last, steps.max(initial=0))]
        for step in due[~np.isin(due, steps)].tolist():
            yield self._differ(step, COORDINATION_MAP.name, MISSING, "one as the episode begins")

    def _differ(self, step: int, quantity: str, logged: str, computed: str) -> Difference:
        return Difference(step, self.name, quantity, logged, computed)


def said_otherwise(logged: np.ndarray, computed: Action | np.ndarray) -> tuple[str, str]:
    """Return in which numbers an action differs, as (logged, computed)."""
    due = computed.tolist() if isinstance(computed, np.ndarray) else action_numbers(computed)
    pairs = zip(ACTION_LABELS, logged.tolist(), due, strict=False)
    odd = [(name, a, b) for name, a, b in pairs if repr(a) != repr(b)]
    return (
        " ".join(f"{name}={a:g}" for name, a, _ in odd),
        " ".join(f"{name}={b:g}" for name, _, b in odd),
    )
