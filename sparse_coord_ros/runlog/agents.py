# Copyright 2026 The sparse_coord_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Whether a robot's actions, tables and coordination maps are those of an agent."""

from collections.abc import Iterator, Sequence

from sparse_coord_ros.core.agent import Tables
from sparse_coord_ros.core.frame import action_numbers
from sparse_coord_ros.core.simulation import tables_equal
from sparse_coord_ros.core.wire import ACTION_LABELS
from sparse_coord_ros.runlog.attached import RecordedTables
from sparse_coord_ros.runlog.counts import Counts
from sparse_coord_ros.runlog.difference import MISSING, Difference, first_entry
from sparse_coord_ros.runlog.episode_maps import CoordinationMaps
from sparse_coord_ros.runlog.log import RunLog
from sparse_coord_ros.runlog.percepts import Percept
from sparse_coord_ros.runlog.rerun import Choice, Handled, rerun

MOST_DROPPED, MOST_TRIED = 20, 5
"""How many transitions of a left-out robot `verify` takes as not learned from, and how many it
tries for each of them, the latest first."""


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
    """Compares one robot's actions and tables with those of an agent fed from the log."""

    def __init__(
        self,
        log: RunLog,
        k: int,
        percepts: Sequence[Percept],
        left_out: frozenset[tuple[int, int]],
        last: int | None,
    ) -> None:
        self.log, self.k, self.last = log, k, last
        self.left_out = {step for robot, step in left_out if robot == k}
        self.name = log.names[k]
        self.choices = self.updates = self.compared = 0
        self.recorded = [entry for entry in log.all_tables if entry.robot == k]
        self.counts = Counts(log, k, percepts)
        self.maps = CoordinationMaps(log, k, frozenset(self.left_out), last)
        statuses = log.tracks.statuses
        self.state = statuses[-1].state if last is None and statuses else None

    def follow(self) -> Difference | None:
        """Return the first difference, or None; `dropped` is then known.

        A robot that was left out may have got reward or state too late to learn from the
        transition before. Which of the two it was, what it did afterwards shows.
        """
        self.dropped: frozenset[int] = frozenset()
        difference = self._first()
        rewarded = self.log.tracks.rewards[self.k].first
        doubtful = [t - 1 for t in sorted(self.left_out) if t - 1 in rewarded]
        for _ in range(MOST_DROPPED):
            if difference is None:
                break
            before = [t for t in doubtful if t < difference.step]
            known = self.dropped
            for step in [t for t in reversed(before) if t not in known][:MOST_TRIED]:
                self.dropped = known | {step}
                other = self._first()
                if other is None or other.step > difference.step:
                    difference = other
                    break
            else:
                self.dropped = known
                return self._first()
        return difference

    def _first(self) -> Difference | None:
        self.choices = self.updates = self.compared = 0
        begun, difference = first_tables(self.log, self.k)
        if difference is not None or begun is None:  # `without_tables` says that there are none
            return difference
        self.maps.restart()
        difference = self.maps.begun(begun)
        if difference is not None:
            return difference
        waiting = sorted(self.recorded, key=lambda entry: entry.step)
        for event in rerun(self.log, self.k, begun, self.dropped):
            if self.last is not None and event.step > self.last:
                break
            if isinstance(event, Handled):
                while waiting and waiting[0].step <= event.step:
                    difference = self._compare(waiting.pop(0), event.tables)
                    if difference is not None:
                        return difference
                difference = self.maps.handled(event)
                if difference is not None:
                    return difference
            elif isinstance(event, Choice):
                self.choices += 1
                computed = action_numbers(event.computed)
                if tuple(map(repr, event.logged)) != tuple(map(repr, computed)):
                    pairs = zip(ACTION_LABELS, event.logged, computed, strict=True)
                    odd = [(name, a, b) for name, a, b in pairs if repr(a) != repr(b)]
                    logged = " ".join(f"{name}={a:g}" for name, a, _ in odd)
                    due = " ".join(f"{name}={b:g}" for name, _, b in odd)
                    return self._differ(event.step, "action", logged, due)
            else:
                self.updates += not self.log.run.greedy
        if waiting and self.last is None:
            end = max(self.log.tracks.states[self.k].first, default=0)
            return self._differ(waiting[0].step, "tables", "there", f"the log ends at step {end}")
        return None

    def without_tables(self) -> Iterator[Difference]:
        """Yield the tables that ought to be in the log and are not."""
        run, states = self.log.run, sorted(self.log.tracks.states[self.k].first)
        steps = {entry.step for entry in self.recorded}
        due = [0]
        if run.checkpoint:
            pairs = zip(states, states[1:], strict=False)
            due += [
                b
                for a, b in pairs
                if a // run.checkpoint < b // run.checkpoint and b not in self.left_out
            ]
        if states:
            due += [states[-1]] if self.state == "finished" else []
            if self.state == "stopped" and max(steps, default=0) < states[-1] - 1:
                due.append(states[-1])
        unreadable = {
            p.step for p in self.log.problems if p.robot == self.name and p.quantity == "tables"
        }
        for step in due:
            beyond = self.last is not None and step > min(self.last, max(steps, default=0))
            if step not in steps and step not in unreadable and not beyond:
                yield self._differ(step, "tables", MISSING, f"tables/{self.name}_{step}.npz")

    def _compare(self, entry: RecordedTables, tables: Tables) -> Difference | None:
        self.compared += 1
        if not tables_equal([entry.tables], [tables]):
            return self._differ(entry.step, *first_entry(entry.tables, tables))
        last = entry is self.recorded[-1] and self.state == "stopped"
        for beyond in (0, 1) if last else (0,):  # whether the ask of this very step has ended
            odd = self.counts.check(entry, beyond, self.dropped)
            if odd is None:
                return None
        return self._differ(entry.step, *odd)

    def _differ(self, step: int, quantity: str, logged: str, computed: str) -> Difference:
        return Difference(step, self.name, quantity, logged, computed)
