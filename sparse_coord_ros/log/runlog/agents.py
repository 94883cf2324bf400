# Copyright 2026 The sparse_coord_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Check of a robot's logged actions, tables and coordination maps against a computed agent."""

from collections import Counter
from collections.abc import Iterator, Sequence
from typing import NamedTuple

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
    Unknown,
    first_entry,
)
from sparse_coord_ros.log.runlog.log import RunLog
from sparse_coord_ros.log.runlog.replay import (
    Interval,
    Replay,
    Trajectory,
    fresh_agent,
)
from sparse_coord_ros.protocol import wire
from sparse_coord_ros.protocol.wire.messages import action_numbers
from sparse_coord_ros.protocol.wire.occupancy import OCCUPIED, OccupancyData


def first_memory(log: RunLog, k: int) -> tuple[Memory | None, Difference | None]:
    """Return a robot's memory at the run's beginning, and its difference from the log's tables.

    The memory is None if it is missing in the log.
    """
    run = log.run
    first = [one for one in log.all_tables if (one.robot, one.step) == (k, 0)]
    if run.tables or run.greedy:
        return (first[0].tables.memory if first else None), None
    fresh = memory_of(run.rule.mind(run.scenario, k))
    if not first:
        return fresh, None
    due = saved_arrays({k + 1: fresh})
    logged = {name: first[0].arrays.get(name) for name in due}
    entry = first_entry(logged, due, k)
    if entry is None:
        return fresh, None
    return fresh, log.messages.difference(0, k, *_of_tables(entry))


def _of_tables(entry: tuple[str, str, str]) -> tuple[str, str, str]:
    """Return a difference of arrays as one of tables: quantity, logged, computed."""
    name, logged, computed = entry
    return f"{wire.TABLES.name} {name}", logged, computed


class Published(NamedTuple):
    """Tables or a coordination map in the log, learned before a time step.

    Attributes:
        step: the time step.
        tables: the tables; None: a map.
        grid: the data of the map; None: tables, or the robot has no state of asking.
    """

    step: int
    tables: RecordedTables | None = None
    grid: bytes | None = None


class AgentCheck:
    """Compares one robot's actions and tables with those of an agent fed from the log.

    Args:
        log: the log.
        k: the robot's number.
        interval: the time steps to check.
        trajectory: the robot's actions in the log.

    Attributes:
        name: the robot's name.
        recorded: its recorded tables.
        agent: the agent as far as it was fed, after `check`; None if it is unknown.
        end: the time step of the robot's last state in the log.
        state: the world's last state; None if the log breaks off, or has no status.
        choices, updates, compared: numbers of actions, updates and tables that agree, after
            `check`.
        lost_copies: number of tables that may be lost, after `check`; later ones agree.
    """

    def __init__(
        self, log: RunLog, k: int, interval: Interval, trajectory: Trajectory
    ) -> None:
        self.log = log
        self.k = k
        self.interval = interval
        self.trajectory = trajectory
        self.name = log.names[k]
        self.recorded = [entry for entry in log.all_tables if entry.robot == k]
        statuses = log.messages.statuses
        self.state = statuses[-1].state if interval.last is None and statuses else None
        self.end = int(log.messages.states[k].step.max(initial=0))
        self.agent: Agent | None = None
        self.choices = 0
        self.updates = 0
        self.compared = 0
        self.lost_copies = 0
        self._grids = OccupancyData(log.frame)
        self._goal = log.run.scenario.robots[k].goal

    @property
    def unlearned(self) -> int:
        """Transitions of the world from which the robot has not learned."""
        if self.log.run.greedy:
            return 0
        rewarded = ~np.isnan(self.log.reward[self.trajectory.row, self.k, 0])
        unlearned = rewarded & ~self.trajectory.learned
        return int(unlearned[: self.choices].sum())

    def check(self) -> list[Difference | Unknown]:
        """Return missing tables, and the first action or tables that differ from the agent's."""
        found = list(self._missing_tables())
        begun, difference = first_memory(self.log, self.k)
        if difference is not None:
            return [*found, difference]
        if begun is None:  # its first tables are among the missing ones
            return found
        self.agent = fresh_agent(self.log, self.k, begun, self.interval)
        replay = Replay(self.log, self.trajectory, self.agent)
        difference = self._first_difference(replay)
        if difference is not None:
            found.append(difference)
        self.choices = replay.reached
        if not self.log.run.greedy:
            self.updates = int(self.trajectory.learned[: self.choices].sum())
        return found

    def _first_difference(self, replay: Replay) -> Difference | None:
        """Return the first action, tables or map that differ from the agent's."""
        end = self._actions()
        false_claim = self._false_claim()
        if false_claim is not None:
            end = min(end, false_claim)
        for published in self._published():
            place = int(np.searchsorted(self.trajectory.step, published.step))
            if place > end or not replay.advance(place):
                break
            words = self._compare(published, replay.agent, place)
            if words is not None:
                return self.log.messages.difference(published.step, self.k, *words)
        replay.advance(end)
        if replay.other is not None:
            return self._other_action(replay.reached, replay.other)
        if false_claim is not None and false_claim == end:
            return self._claim_of_learning(false_claim)
        return None

    def _actions(self) -> int:
        """Return the number of actions in the interval."""
        steps = self.trajectory.step
        if self.interval.last is None:
            return len(steps)
        return int(np.searchsorted(steps, self.interval.last, side="right"))

    # Actions.

    def _could_learn(self) -> np.ndarray:
        """Return for each action whether the robot could learn from the one before it."""
        told_before = self.interval.start is not None
        told = np.concatenate([[told_before], self.trajectory.told])[:-1]
        return told & (not self.log.run.greedy)

    def _false_claim(self) -> int | None:
        """Return the first action whose number `learned` is impossible, or None."""
        logged = self.log.has_learned[self.trajectory.row, self.k]
        no = (logged == 0.0) & ~np.signbit(logged)
        yes = (logged == 1.0) & self._could_learn()
        false = np.flatnonzero(~(no | yes))
        return int(false[0]) if len(false) else None

    def _claim_of_learning(self, place: int) -> Difference:
        """Return the difference for an impossible number `learned` of an action."""
        logged = self.log.has_learned[self.trajectory.row[place], self.k]
        allowed = "0 or 1" if self._could_learn()[place] else NOTHING_TO_LEARN
        words = wire.ACTION.name, f"learned={logged:g}", allowed
        step = int(self.trajectory.step[place])
        return self.log.messages.difference(step, self.k, *words)

    def _other_action(self, place: int, computed: Action) -> Difference:
        """Return the difference for an action that the agent does not choose."""
        logged = self.log.numbers[self.trajectory.row[place], self.k]
        words = different_numbers(logged, action_numbers(computed))
        step = int(self.trajectory.step[place])
        return self.log.messages.difference(step, self.k, wire.ACTION.name, *words)

    # Tables and coordination maps.

    def _published(self) -> list[Published]:
        """Return the tables and coordination maps of the interval, in the order of time."""
        found = [Published(entry.step, tables=entry) for entry in self.recorded]
        states = self.log.messages.states[self.k].step
        steps, rows = self.log.messages.coordination_maps[self.k]
        known = (steps == 0) | np.isin(steps, states)
        for place, step in enumerate(steps.tolist()):
            grid = rows["data"][place].tobytes() if known[place] else None
            found.append(Published(step, grid=grid))
        mine = [one for one in found if self.interval.holds(one.step)]
        return sorted(mine, key=_step)

    def _compare(
        self, published: Published, agent: Agent, place: int
    ) -> tuple[str, str, str] | None:
        """Return (quantity, logged, computed) if tables or a map differ from the agent's.

        Args:
            published: the tables or the map.
            agent: the agent at that time step.
            place: the first of its actions from that time step on.
        """
        entry = published.tables
        if entry is None:
            return self._compare_map(published.grid, np.array(agent.mind.q_star))
        if entry.step > self.end:
            return wire.TABLES.name, "there", f"the log ends at time step {self.end}"
        self.compared += 1
        # The counts have bounds, and are compared separately.
        counts = {name: entry.counts.get(name, 0) for name in wire.COUNTS}
        due = saved_arrays({self.k + 1: agent.memory()}, counts=counts)
        words = first_entry(entry.arrays, due, self.k)
        if words is not None:
            return _of_tables(words)
        return self._compare_counts(entry, place)

    def _compare_map(
        self, logged: bytes | None, q_star: np.ndarray
    ) -> tuple[str, str, str] | None:
        """Return a coordination map's difference from the agent's cells of asking, or None."""
        due = self._grids.coordination(q_star)
        if logged == due:
            return None
        computed = self._cells(due)
        if logged is None:
            return wire.COORDINATION_MAP.name, "there", computed
        words = self._cells(logged)
        if words == computed:
            words += ", with other values elsewhere"
        return wire.COORDINATION_MAP.name, words, computed

    def _cells(self, data: bytes) -> str:
        marked = np.frombuffer(data, dtype=np.int8)[self._grids.places] == OCCUPIED
        return f"COORDINATE in cells {np.flatnonzero(marked).tolist()}"

    def _compare_counts(
        self, entry: RecordedTables, place: int
    ) -> tuple[str, str, str] | None:
        """Return (quantity, logged, computed) of a count beside tables that is impossible."""
        words = self._impossible_count(entry, place, place)
        # A robot may save its last tables after its action at their time step.
        steps = self.trajectory.step
        acted = place < len(steps) and steps[place] == entry.step
        if words is not None and acted and entry is self.recorded[-1]:
            words = self._impossible_count(entry, place, place + 1)
        return words

    def _impossible_count(
        self, entry: RecordedTables, place: int, end: int
    ) -> tuple[str, str, str] | None:
        """Return (quantity, logged, computed) of the first count that is impossible.

        Args:
            entry: the tables.
            place: the robot's first action from which it has not learned.
            end: the first action whose percept does not count.
        """
        before = Counter(self.interval.counts(self.k))
        ended = self.log.ended[self.trajectory.row[:end], self.k]
        bounds: dict[str, tuple[int, int]] = {}
        for way in (
            wire.PerceptEnd.ANSWERED,
            wire.PerceptEnd.REFUSED,
            wire.PerceptEnd.LATE,
        ):
            count = before[way.words] + int((ended == way).sum())
            bounds[way.words] = count, count
        learned = int(self.trajectory.learned[:place].sum())
        bounds["learned"] = (before["learned"] + learned,) * 2
        bounds["dropped"] = before["dropped"], before["dropped"] + place - learned
        low, high = self._times_repeated(entry, end - place)
        bounds["repeated"] = before["repeated"] + low, before["repeated"] + high
        for name, (low, high) in bounds.items():
            logged = entry.counts.get(name)
            if logged is None or not low <= logged <= high:
                allowed = f"{low}" if low == high else f"{low} to {high}"
                return f"{wire.TABLES.name} count {name}", f"{logged}", allowed
        return None

    def _times_repeated(self, entry: RecordedTables, more: int) -> tuple[int, int]:
        """Return the least and the most repeated requests of the robot before tables.

        Args:
            entry: the tables.
            more: number of actions from their time step on that count.
        """
        mine = [
            one
            for one in self.log.requests
            if one.asker == self.k and one.step >= self.interval.first
        ]
        # A request that was sent again because no answer came is the same request.
        before = heard([one for one in mine if one.step < entry.step + more])
        least = times_asked_again([one for one in before if one.answer is not None])
        # A robot that was stopped while it asked may have repeated requests without a later
        # action.
        last = entry is self.recorded[-1]
        most = sum(
            one.answer is not None and one.answer[0] < one.step
            for one in mine
            if one.step < entry.step + last
        )
        return least, most

    # Missing tables.

    def _missing_tables(self) -> Iterator[Difference | Unknown]:
        """Yield the tables that are missing in the log."""
        steps = {entry.step for entry in self.recorded}
        name = wire.TABLES.name
        unreadable = {
            one.step
            for one in self.log.problems
            if (one.robot, one.quantity) == (self.name, name)
        }
        until = self.interval.last
        if until is not None:
            until = min(until, max(steps, default=0))
        for step in [*self._due_checkpoints(), *self._due_at_the_end(steps)]:
            if step in steps or step in unreadable:
                continue
            if until is None or step <= until:
                yield from self._missing(step)

    def _due_checkpoints(self) -> list[int]:
        """Return the time steps of the robot's start and its checkpoints."""
        log = self.log
        every = log.run.checkpoint
        states = log.messages.states[self.k].step
        if not every or not len(states):
            return [0]
        rows = np.searchsorted(log.step, states)
        # A robot has processed a state when it acts on it, or rests at the goal.
        acted = log.move[rows, self.k] >= 0
        rests = log.cells[rows, self.k] == self._goal
        crossed = states[:-1] // every < states[1:] // every
        due = crossed & (acted | rests)[1:]
        return [0, *states[1:][due].tolist()]

    def _due_at_the_end(self, steps: set[int]) -> list[int]:
        """Return the time step of the robot's last tables, if later than those in the log.

        The robot may have missed the last states, so its last tables may be of its last action's
        time step or any later one.
        """
        acted = int(self.trajectory.step.max(initial=0))
        newest = max((step for step in steps if step <= self.end), default=0)
        if self.state in wire.OVER and newest < acted:
            return [self.end]
        return []

    def _missing(self, step: int) -> Iterator[Difference | Unknown]:
        """Yield the missing tables of a time step as a finding; count lost copies."""
        later = sum(entry.step > step for entry in self.recorded)
        if step == self.end:
            why = f"{self.name} saved no tables at its end (killed?)"
            yield Unknown(step, step, why)
        elif step and later >= wire.TABLES_DEPTH:
            # ROS keeps only the last tables for a slow recorder. Later tables include all earlier
            # learning.
            self.lost_copies += 1
        elif self.log.messages.incomplete:
            yield Unknown(step, step, f"the tables of {self.name} are not in the log")
        else:
            due = wire.tables_attachment(self.name, step)
            yield self.log.messages.difference(
                step, self.k, wire.TABLES.name, MISSING, due
            )


def _step(one: Published | RecordedTables) -> int:
    return one.step


def different_numbers(logged: np.ndarray, computed: Sequence[float]) -> tuple[str, str]:
    """Return the numbers of an action that differ, as words: logged, computed."""
    pairs = zip(wire.ACTION_LABELS, logged.tolist(), computed, strict=False)
    found = [(name, a, b) for name, a, b in pairs if repr(a) != repr(b)]
    return (
        " ".join(f"{name}={a:g}" for name, a, _ in found),
        " ".join(f"{name}={b:g}" for name, _, b in found),
    )
