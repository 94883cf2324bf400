# Copyright 2026 The sparse_coord_ros authors
# SPDX-License-Identifier: Apache-2.0
"""A bag's messages as columns: topic by topic, decoded many at a time."""

from collections.abc import Iterator, Mapping, Sequence

import numpy as np

from sparse_coord_ros.bags.reader import Bag, Part
from sparse_coord_ros.bags.records import MESSAGE
from sparse_coord_ros.runlog.decode import Decoder
from sparse_coord_ros.runlog.difference import LOG_TIME, Difference
from sparse_coord_ros.wire.cdr import rows_at
from sparse_coord_ros.wire.frame import SECOND
from sparse_coord_ros.wire.messages import Form

PART_BYTES = 4 * 1024 * 1024
"""Bytes of messages that are decoded at once: more take no less time."""

_STAMP = np.dtype([("encapsulation", "V4"), ("sec", "<i4"), ("nanosec", "<u4")])


class Columns:
    """Reads a bag once.

    Args:
        bag: the bag.
        forms: by topic; other topics' messages are only counted and timed.
        stamped: the topics whose messages begin with the time at which they are logged.
        period: nanoseconds of a time step.
        begins: for each of the bag's files the time at which its recorder begins to count anew;
            None: it goes on.

    Attributes:
        rows: by topic, in the order of the file, of each file of the bag.
        problems: messages out of number or time, or unreadable.
    """

    def __init__(
        self,
        bag: Bag,
        forms: Mapping[str, Form],
        stamped: Sequence[str],
        period: int,
        begins: Sequence[int | None],
    ) -> None:
        self.problems: list[Difference] = []
        self._decode = Decoder(bag.topics)
        self._period = period
        self._forms = forms
        self._topics = sorted(bag.topics)
        number = {name: place for place, name in enumerate(self._topics)}
        self._number = np.zeros(1 << 16, dtype=np.int64)
        for channel, name in bag.channels.items():
            self._number[channel] = number[name]
        self._stamped = np.array([name in stamped for name in self._topics], dtype=bool)
        self._due = dict.fromkeys(self._topics, 0)
        self._now = 0
        self.rows: list[dict[str, np.ndarray]] = []
        for begins_at in begins:
            if begins_at is not None:
                self._now = begins_at
            parts: dict[str, list[np.ndarray]] = {name: [] for name in forms}
            for part in bag.parts_of(len(self.rows), PART_BYTES):
                for name, rows in self._part(part):
                    parts[name].append(rows)
            self.rows.append(
                {
                    name: np.concatenate([np.empty(0, forms[name].columns), *found])
                    for name, found in parts.items()
                }
            )

    def _part(self, part: Part) -> Iterator[tuple[str, np.ndarray]]:
        """Yield topics with the rows of their messages."""
        heads = part.heads
        lengths = heads["length"].astype(np.int64) - MESSAGE.size
        numbers = self._number[heads["channel"]]
        self._check_times(part, numbers, lengths)
        order = np.argsort(numbers, kind="stable")
        found, first = np.unique(numbers[order], return_index=True)
        for number, group in zip(found.tolist(), np.split(order, first[1:]), strict=False):
            name = self._topics[number]
            self._check_numbers(name, heads[group])
            form = self._forms.get(name)
            if form is not None:
                log_ns = heads["log_ns"][group]
                yield name, self._rows(name, form, part, group, lengths[group], log_ns)

    def _rows(
        self,
        name: str,
        form: Form,
        part: Part,
        group: np.ndarray,
        lengths: np.ndarray,
        log_ns: np.ndarray,
    ) -> np.ndarray:
        rows = np.zeros(len(group), dtype=form.columns)
        left = np.ones(len(group), dtype=bool)
        bad = np.zeros(len(group), dtype=bool)

        for layout, fill in form.layouts:
            mine = np.flatnonzero(left & (lengths == layout.size))
            if len(mine):
                fits, fields = layout.read(part.content, part.begins[group[mine]])
                mine = mine[fits]
                filled = rows[mine]
                taken = fill(filled, fields[fits])
                rows[mine] = filled
                left[mine if taken is None else mine[taken]] = False
        for place in np.flatnonzero(left).tolist():
            begin = int(part.begins[group[place]])
            data = part.content[begin : begin + int(lengths[place])]
            try:
                rows[place] = form.read(self._decode(name, data))
            except (ArithmeticError, AttributeError, LookupError, TypeError, ValueError) as error:
                bad[place] = True
                step = int(log_ns[place]) // self._period
                self._problem(step, f"topic {name}", f"a message that {error}", "readable")
        return rows[~bad]

    def _check_numbers(self, name: str, heads: np.ndarray) -> None:
        """Every message has the next number of its topic."""
        said = heads["sequence"].astype(np.int64)
        due = np.concatenate([[self._due[name]], said[:-1] + 1])
        for place in np.flatnonzero(said != due).tolist():
            step = int(heads["log_ns"][place]) // self._period
            logged = f"number {said[place]} after {due[place] - 1}"
            self._problem(step, f"topic {name}", logged, "the next one")
        self._due[name] = int(said[-1]) + 1

    def _check_times(self, part: Part, numbers: np.ndarray, lengths: np.ndarray) -> None:
        """A message that begins with a stamp is logged then, any other at the newest before."""
        if not len(numbers):
            return
        logged = part.heads["log_ns"].astype(np.int64)
        published = part.heads["publish_ns"].astype(np.int64)
        stamped = self._stamped[numbers]
        due = logged.copy()
        readable = stamped & (lengths >= _STAMP.itemsize)  # of others their form says so
        rows = rows_at(part.content, part.begins[readable], _STAMP)
        due[readable] = rows["sec"].astype(np.int64) * SECOND + rows["nanosec"]
        moved = np.where(stamped & (logged == due), logged, 0)
        newest = np.maximum(np.maximum.accumulate(moved), self._now)
        due[~stamped] = newest[~stamped]
        self._now = int(newest[-1])
        for place in np.flatnonzero((logged != due) | (published != logged)).tolist():
            at, expected, said = (int(column[place]) for column in (logged, due, published))
            step = (expected if stamped[place] and expected >= 0 else at) // self._period
            what = f"{LOG_TIME} of {self._topics[numbers[place]]}"
            if at != expected:
                self._problem(step, what, f"{at} ns", f"{expected} ns")
            if said != at:
                self._problem(step, what, f"publish time {said} ns", f"{at} ns, as logged")

    def _problem(self, step: int, quantity: str, logged: str, computed: str) -> None:
        self.problems.append(Difference(step, None, quantity, logged, computed))
