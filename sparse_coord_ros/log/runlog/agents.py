# Copyright 2026 The sparse_coord_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Whether a robot's actions, tables and coordination maps are those of an agent."""

from collections import Counter
from collections.abc import Iterator, Mapping, Sequence

import numpy as np

from sparse_coord_ros.core.game.world import Action
from sparse_coord_ros.core.learners.agent import Agent
from sparse_coord_ros.core.learners.mind import Memory, memory_of
from sparse_coord_ros.core.runs.tables import saved_arrays
from sparse_coord_ros.log.runlog.attached import RecordedTables
from sparse_coord_ros.log.runlog.dialogue import heard, times_asked_again
from sparse_coord_ros.log.runlog.difference import (
    MISSING,
    NOTHING_TO_LEARN,
    Difference,
    first_entry,
)
from sparse_coord_ros.log.runlog.log import RunLog
from sparse_coord_ros.log.runlog.replay import (
    Replay,
    Stretch,
    fresh_agent,
    trajectory_of,
)
from sparse_coord_ros.protocol import wire
from sparse_coord_ros.protocol.wire.messages import action_numbers
from sparse_coord_ros.protocol.wire.occupancy import OCCUPIED, OccupancyData


def first_memory(log: RunLog, k: int) -> tuple[Memory | None, Difference | None]:
    """Return what a robot began with, and in what the log says otherwise.

    The tables are None where the log ought to hold them and does not.
    """
    run = log.run
    recorded = next(
        (one for one in log.all_tables if (one.robot, one.step) == (k, 0)), None
    )
    if run.tables or run.greedy:
        return (None if recorded is None else recorded.tables.memory), None
    fresh = memory_of(run.rule.mind(run.scenario, k))
    if recorded is None:
        return fresh, None
    due = saved_arrays({k + 1: fresh})
    odd = first_entry({name: recorded.arrays.get(name) for name in due}, due, k)
    return fresh, None if odd is None else log.tracks.odd(0, k, *_of_tables(odd))


def _of_tables(odd: tuple[str, str, str]) -> tuple[str, str, str]:
    """Return what differs in an array as what differs in tables."""
    name, logged, computed = odd
    return f"{wire.TABLES.name} {name}", logged, computed


class AgentCheck:
    """Compares one robot's actions and tables with those of an agent fed from the log.

    Args:
        log: the log.
        k: the robot's number.
        stretch: the time steps to check.

    Attributes:
        name: the robot's.
        trajectory: what the log says that it did.
        recorded: its recorded tables.
        agent: the agent, as far as it was fed, after `differences`; None where it is not known.
        end: the newest time step that the world told it.
        state: the world's last state; None where the log breaks off, or says none.
        choices, updates, compared: actions, updates and tables that agree, after `differences`.
    """

    def __init__(self, log: RunLog, k: int, stretch: Stretch) -> None:
        self.log = log
        self.k = k
        self.stretch = stretch
        self.name = log.names[k]
        self.trajectory = trajectory_of(log, k, stretch)
        self.choices = self.updates = self.compared = 0
        self.agent: Agent | None = None
        self.recorded = [entry for entry in log.all_tables if entry.robot == k]
        statuses = log.tracks.statuses
        self.state = statuses[-1].state if stretch.last is None and statuses else None
        self._grids = OccupancyData(log.frame)
        self._goal = log.run.scenario.robots[k].goal
        self.end = int(log.tracks.states[k].step.max(initial=0))

    @property
    def unlearned(self) -> int:
        """Transitions that the world made with it and that it has not learned from."""
        rewarded = ~np.isnan(self.log.reward[self.trajectory.row, self.k, 0])
        done = (rewarded & ~self.trajectory.learned)[: self.choices]
        return 0 if self.log.run.greedy else int(done.sum())

    @property
    def last_counts(self) -> Mapping[str, int] | None:
        """The numbers beside its tables at its end; None: the log does not hold these tables."""
        acted = int(self.trajectory.step.max(initial=0))
        last = max(self.recorded, key=lambda entry: entry.step, default=None)
        if last is None or last.step <= acted:
            return None
        return {**last.counts, "step": self.end}

    def differences(self) -> list[Difference]:
        """Return the first thing that an agent would have done otherwise, and what is missing."""
        found = [*self._missing_tables()]
        begun, odd = first_memory(self.log, self.k)
        if odd is not None:
            return [*found, odd]
        if begun is None:  # that there are none is among the missing
            return found
        self.agent = fresh_agent(self.log, self.k, begun, self.stretch)
        replay = Replay(self.log, self.trajectory, self.agent)
        found += self._first(replay)
        self.choices = replay.reached
        if not self.log.run.greedy:
            self.updates = int(self.trajectory.learned[: self.choices].sum())
        return found

    def _first(self, replay: Replay) -> list[Difference]:
        """Return the first action, table or map that the agent has not; at most one."""
        false = self._false_account()
        end = self._actions() if false is None else min(false, self._actions())
        for step, shown in self._stops():
            to = int(np.searchsorted(self.trajectory.step, step))
            if to > end or not replay.advance(to):
                break
            odd = self._compare(step, shown, replay.agent, to)
            if odd is not None:
                return [self.log.tracks.odd(step, self.k, *odd)]
        replay.advance(end)
        if replay.other is not None:
            return [self._other_action(replay.reached, replay.other)]
        if false == end:
            return [self._said_of_learning(false)]
        return []

    def _actions(self) -> int:
        """Return how many actions the stretch has."""
        last = self.stretch.last
        steps = self.trajectory.step
        return (
            len(steps)
            if last is None
            else int(np.searchsorted(steps, last, side="right"))
        )

    def _able(self) -> np.ndarray:
        """Return with which actions the robot can say that it has learned from the one before."""
        told_before = self.stretch.start is not None
        told = np.concatenate([[told_before], self.trajectory.told])[:-1]
        return told & (not self.log.run.greedy)

    def _false_account(self) -> int | None:
        """Return the first action that says of learning what cannot be; None: there is none."""
        said = self.log.has_learned[self.trajectory.row, self.k]
        no = (said == 0.0) & ~np.signbit(said)
        yes = (said == 1.0) & self._able()
        false = np.flatnonzero(~(no | yes))
        return int(false[0]) if len(false) else None

    def _said_of_learning(self, place: int) -> Difference:
        """Return that an action says of learning what cannot be."""
        said = self.log.has_learned[self.trajectory.row[place], self.k]
        allowed = "0 or 1" if self._able()[place] else NOTHING_TO_LEARN
        words = wire.ACTION.name, f"learned={said:g}", allowed
        return self.log.tracks.odd(int(self.trajectory.step[place]), self.k, *words)

    def _other_action(self, place: int, computed: Action) -> Difference:
        """Return in what an action is another one than the agent's."""
        logged = self.log.numbers[self.trajectory.row[place], self.k]
        words = said_otherwise(logged, action_numbers(computed))
        step = int(self.trajectory.step[place])
        return self.log.tracks.odd(step, self.k, wire.ACTION.name, *words)

    def _stops(self) -> list[tuple[int, RecordedTables | bytes | None]]:
        """Return time steps with what the log shows there of what was learned before.

        That is tables, then the data of coordination maps; None where the robot has no such state.
        """
        steps, rows = self.log.tracks.coordination_maps[self.k]
        known = (steps == 0) | np.isin(steps, self.log.tracks.states[self.k].step)
        maps = zip(steps.tolist(), rows["data"], known.tolist(), strict=True)
        stops: list[tuple[int, RecordedTables | bytes | None]]
        stops = [(entry.step, entry) for entry in self.recorded]
        stops += [
            (step, data.tobytes() if there else None) for step, data, there in maps
        ]
        return sorted(
            (s for s in stops if self.stretch.holds(s[0])), key=lambda stop: stop[0]
        )

    def _compare(
        self, step: int, shown: RecordedTables | bytes | None, agent: Agent, to: int
    ) -> tuple[str, str, str] | None:
        """Return (quantity, logged, computed) where what the log shows is not what is due.

        Args:
            step: the time step.
            shown: what the log shows, as of `_stops`.
            agent: the agent at that time step.
            to: the first of its actions from that time step on.
        """
        if not isinstance(shown, RecordedTables):
            return self._compare_map(shown, np.array(agent.mind.q_star))
        if step > self.end:
            return wire.TABLES.name, "there", f"the log ends at step {self.end}"
        self.compared += 1
        number = self.k + 1
        counts = {
            name: shown.counts.get(name, 0) for name in wire.COUNTS
        }  # they have bounds
        due = saved_arrays({number: agent.memory()}, counts=counts)
        odd = first_entry(shown.arrays, due, self.k)
        return self._compare_counts(shown, to) if odd is None else _of_tables(odd)

    def _compare_map(
        self, shown: bytes | None, q_star: np.ndarray
    ) -> tuple[str, str, str] | None:
        """Return where a coordination map shows other cells than those where the agent asks."""
        due = self._grids.coordination(q_star)
        if shown == due:
            return None
        logged = "there" if shown is None else self._cells(shown)
        computed = self._cells(due)
        logged += ", with other values elsewhere" * (logged == computed)
        return wire.COORDINATION_MAP.name, logged, computed

    def _compare_counts(
        self, entry: RecordedTables, to: int
    ) -> tuple[str, str, str] | None:
        """Return a number beside the tables that cannot be."""
        # Of the last tables: what was asked at their very step may have ended.
        steps = self.trajectory.step
        there = to < len(steps) and steps[to] == entry.step
        ends = [to, to + 1] if entry is self.recorded[-1] and there else [to]
        odd = [self._odd_count(entry, to, end) for end in ends]
        return None if None in odd else odd[-1]

    def _odd_count(
        self, entry: RecordedTables, to: int, end: int
    ) -> tuple[str, str, str] | None:
        """Return (quantity, logged, computed) of the first number that cannot be."""
        log = self.log
        trajectory = self.trajectory
        ended = log.ended[trajectory.row[:end], self.k]
        base = Counter(self.stretch.counts(self.k))
        due = {
            end.words: base[end.words] + int((ended == end).sum())
            for end in wire.PerceptEnd
        }
        learned = int(trajectory.learned[:to].sum())
        all_mine = [
            r
            for r in log.requests
            if r.asker == self.k and r.step >= self.stretch.first
        ]
        mine = [r for r in all_mine if r.step < entry.step + end - to]
        # What was sent again as no answer came is the same request.
        mine = [r for r in heard(mine) if r.answer is not None]
        again = base["repeated"] + times_asked_again(mine)
        # A robot that stops while it asks has repeated without an action that follows.
        asked = [
            r for r in all_mine if r.step < entry.step + (entry is self.recorded[-1])
        ]
        later = sum(r.answer is not None and r.answer[0] < r.step for r in asked)
        bounds = {
            name: (due[name], due[name]) for name in ("answered", "refused", "late")
        }
        bounds["learned"] = (base["learned"] + learned,) * 2
        bounds["dropped"] = (base["dropped"], base["dropped"] + to - learned)
        bounds["repeated"] = (again, base["repeated"] + later)
        for name, (low, high) in bounds.items():
            logged = entry.counts.get(name)
            if logged is None or not low <= logged <= high:
                allowed = f"{low}" if low == high else f"{low} to {high}"
                return f"{wire.TABLES.name} count {name}", f"{logged}", allowed
        return None

    def _missing_tables(self) -> Iterator[Difference]:
        """Yield the tables that ought to be in the log and are not."""
        log = self.log
        run = self.log.run
        states = log.tracks.states[self.k].step
        steps = {entry.step for entry in self.recorded}
        due = [0]
        if run.checkpoint and len(states):
            rows = np.searchsorted(log.step, states)
            # Acting on a state, or resting at the goal, a robot has worked it off.
            handled = (log.move[rows, self.k] >= 0) | (
                log.cells[rows, self.k] == self._goal
            )
            crossed = states[:-1] // run.checkpoint < states[1:] // run.checkpoint
            due += states[1:][crossed & handled[1:]].tolist()
        # A robot's last tables are of a state that it has acted on, or of one after it: it may
        # have missed those that came when it was stopped.
        acted = int(self.trajectory.step.max(initial=0))
        newest = max((step for step in steps if step <= self.end), default=0)
        if self.state in wire.OVER and newest < acted:
            due.append(self.end)
        mine = (self.name, wire.TABLES.name)
        unreadable = {
            one.step for one in log.problems if (one.robot, one.quantity) == mine
        }
        for step in due:
            last = self.stretch.last
            beyond = last is not None and step > min(last, max(steps, default=0))
            if step not in steps and step not in unreadable and not beyond:
                yield self.missing_tables(step)

    def missing_tables(self, step: int) -> Difference:
        """Return that its tables of a time step are missing."""
        due = wire.tables_attachment(self.name, step)
        return self.log.tracks.odd(step, self.k, wire.TABLES.name, MISSING, due)

    def _cells(self, data: bytes) -> str:
        shown = np.frombuffer(data, dtype=np.int8)[self._grids.places] == OCCUPIED
        return f"COORDINATE in cells {np.flatnonzero(shown).tolist()}"


def said_otherwise(logged: np.ndarray, computed: Sequence[float]) -> tuple[str, str]:
    """Return in which of its numbers an action differs, as (logged, computed)."""
    pairs = zip(wire.ACTION_LABELS, logged.tolist(), computed, strict=False)
    odd = [
        (f"{name}={a:g}", f"{name}={b:g}") for name, a, b in pairs if repr(a) != repr(b)
    ]
    return " ".join(a for a, _ in odd), " ".join(b for _, b in odd)
