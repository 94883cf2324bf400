# Copyright 2026 The sparse_coord_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Whether the numbers stored beside a robot's tables are what the log counts."""

from collections import Counter
from collections.abc import Collection, Iterator, Sequence

from sparse_coord_ros.runlog.attached import RecordedTables
from sparse_coord_ros.runlog.log import RunLog
from sparse_coord_ros.runlog.percepts import ANSWERED, LATE, REFUSED, UNSURE, Percept


class Counts:
    """Counts how one robot's asks ended and what it did not learn from.

    Args:
        log: the log.
        k: the robot's number.
        percepts: how every robot's COORDINATE actions ended.
    """

    def __init__(self, log: RunLog, k: int, percepts: Sequence[Percept]) -> None:
        self._ended = [(p.step, p.outcome) for p in percepts if p.robot == k]
        self._requests = [r for r in log.requests if r.asker == k]
        states, rewards, actions, _ = log.tracks.of(k)
        self._acted = [t for t in actions.first if t + 1 in states.first]
        self._rewarded = rewards.first

    def check(
        self, entry: RecordedTables, beyond: int, dropped: Collection[int]
    ) -> tuple[str, str, str] | None:
        """Return (quantity, logged, computed) of the first number that cannot be.

        Args:
            entry: tables with the numbers beside them.
            beyond: 1 to count what was asked at the time step of the tables itself, else 0.
            dropped: transitions that the robot has not learned from, although it was rewarded.
        """
        for name, (low, high) in self._bounds(entry.step, beyond, dropped):
            logged = entry.counts.get(name)
            if logged is None or not low <= logged <= high:
                due = f"{low}" if low == high else f"{low} to {high}"
                return f"tables count {name}", f"{logged}", due
        failed = sum(entry.counts[name] for name in ("refused", "late"))
        due = sum(how != ANSWERED for step, how in self._ended if step < entry.step + beyond)
        if failed != due:
            return "tables count refused and late", f"{failed}", f"{due}"
        return None

    def _bounds(
        self, step: int, beyond: int, dropped: Collection[int]
    ) -> Iterator[tuple[str, tuple[int, int]]]:
        """Yield the least and the most that each number can be."""
        ended = Counter(how for t, how in self._ended if t < step + beyond)
        yield "answered", (ended[ANSWERED], ended[ANSWERED])
        for name, how in (("refused", REFUSED), ("late", LATE)):
            yield name, (ended[how], ended[how] + ended[UNSURE])
        asked = [r for r in self._requests if r.step < step + beyond]
        behind = sum(r.answer is not None and r.answer[0] < r.step for r in asked)
        yield "repeated", (len(asked) - len({(r.peer, r.step) for r in asked}), behind)
        unlearned = (t not in self._rewarded or t in dropped for t in self._acted if t < step)
        yield "dropped", (0, sum(unlearned))
