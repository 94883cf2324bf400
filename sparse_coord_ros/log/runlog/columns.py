# Copyright 2026 The sparse_coord_ros authors
# SPDX-License-Identifier: Apache-2.0
"""A bag's messages as columns: topic by topic, many decoded at once."""

from collections.abc import Callable, Collection, Iterator, Mapping, Sequence
from typing import Any

import numpy as np

from sparse_coord_ros.log.bags.reader import Bag, Part
from sparse_coord_ros.log.bags.records import MESSAGE
from sparse_coord_ros.log.runlog.decode import Decoder
from sparse_coord_ros.log.runlog.difference import LOG_TIME, Difference
from sparse_coord_ros.log.runlog.timeline import Jump
from sparse_coord_ros.protocol import wire
from sparse_coord_ros.protocol.wire.cdr import rows_at
from sparse_coord_ros.protocol.wire.frame import SECOND
from sparse_coord_ros.protocol.wire.messages import MessageForm

READABLE = "readable"
"""Computed value of a message that cannot be decoded, or has another length than the run's. No
node of the run sends such a message."""
COMPLETE = "one with all values"
"""Computed value of a message without one of its values, which still names the run or has the
length of the run's: it may be a changed one."""

OFTEN = {
    wire.CLOCK,
    wire.LOCAL_STATE,
    wire.REWARD,
    wire.ACTION,
    wire.PERCEPT,
    wire.SERVICE_EVENTS,
}
"""Topics that may have a message at every time step. If a foreign message replaces one of the
run's there, that one is missing."""

ANY = -1
"""Any first sequence number is right: only a part of the bag is read."""

Reading = MessageForm | Callable[[Any], Any]
"""Converts messages into rows: a form many at once, or a function each decoded one."""

Forms = Mapping[str, tuple[wire.Topic, Reading]]
"""A run's topics by their full names, each with its `Reading`."""

Only = Collection[wire.Topic] | None
"""The topics to read; None: all."""

_STAMP = np.dtype([("encapsulation", "V4"), ("sec", "<i4"), ("nanosec", "<u4")])


class Columns:
    """Reads a bag once.

    Args:
        bag: the bag.
        forms: the run's topics by their full names, each with its `Reading`. Of other topics only
            numbers and times are checked.
        only: the topics to read; None: all of them.
        period: nanoseconds of a time step.
        begins: by a file's place in the bag, the log time at which its recorder begins anew.

    Attributes:
        rows: of each file of the bag, the rows by topic, in the order of the file; shape
            (messages,).
        problems: messages with a wrong number or time, and changed ones.
        foreign: messages that no node of the run sends.
        jumps: jumps in the sequence numbers.
    """

    def __init__(
        self, bag: Bag, forms: Forms, only: Only, period: int, begins: Mapping[int, int]
    ) -> None:
        self.problems: list[Difference] = []
        self.foreign: list[Difference] = []
        self.jumps: list[Jump] = []
        self._decode = Decoder(bag.topics)
        self._period = period
        self._forms = forms
        self._topics = sorted(bag.topics)
        number = {name: place for place, name in enumerate(self._topics)}
        self._number = np.zeros(1 << 16, dtype=np.int64)
        for channel, name in bag.channels.items():
            self._number[channel] = number[name]
        stamped = [name in forms and forms[name][0].stamped for name in self._topics]
        self._stamped = np.array(stamped, dtype=bool)
        self._due = dict.fromkeys(self._topics, (ANY if bag.part else 0, 0))
        self._now = 0
        self.rows: list[dict[str, np.ndarray]] = []
        read = {
            name for name, (topic, _) in forms.items() if only is None or topic in only
        }
        for place in range(len(bag.files)):
            self._now = begins.get(place, self._now)
            parts = {name: [no_rows(form)] for name, (_, form) in forms.items()}
            for part in bag.parts([place]):
                for name, heads, begins_here in self._part(part):
                    if name in read:
                        parts[name].append(
                            self._rows(name, part.content, heads, begins_here)
                        )
            self.rows.append(
                {name: np.concatenate(found) for name, found in parts.items()}
            )

    def _part(self, part: Part) -> Iterator[tuple[str, np.ndarray, np.ndarray]]:
        """Yield each topic of a part with its messages' heads and their offsets."""
        heads = part.heads
        numbers = self._number[heads["channel"]]
        self._check_times(part, numbers)
        order = np.argsort(numbers, kind="stable")
        found, first = np.unique(numbers[order], return_index=True)
        for number, group in zip(
            found.tolist(), np.split(order, first[1:]), strict=False
        ):
            name = self._topics[number]
            self._check_numbers(name, heads[group])
            yield name, heads[group], part.begins[group]

    def _rows(
        self, name: str, content: bytes, heads: np.ndarray, begins: np.ndarray
    ) -> np.ndarray:
        """Return the rows of a topic's readable messages; note the others."""
        _, form = self._forms[name]
        sizes = heads["length"].astype(np.int64) - MESSAGE.size
        if isinstance(form, MessageForm):
            rows, fits = form.rows(content, begins, sizes)
            if fits.all():
                return rows
            known_sizes = [layout.size for layout, _ in form.layouts]
            for place in np.flatnonzero(~fits).tolist():
                due = COMPLETE if sizes[place] in known_sizes else READABLE
                why = "has another form than the run's"
                self._note_unread(name, int(heads["log_ns"][place]), why, due)
            return np.asarray(rows[fits])
        found = []
        for place, begin in enumerate(begins.tolist()):
            due = READABLE
            try:
                message = self._decode(name, content[begin : begin + int(sizes[place])])
                due = COMPLETE
                found.append(form(message))
            except (AttributeError, ValueError) as error:
                self._note_unread(name, int(heads["log_ns"][place]), str(error), due)
        return as_objects(found)

    def _note_unread(self, name: str, log_ns: int, why: str, due: str) -> None:
        """Note a message that cannot be read."""
        topic, _ = self._forms[name]
        step = log_ns // self._period
        logged = f"a message that {why}"
        difference = Difference(step, None, f"topic {name}", logged, due)
        if due == READABLE or topic in OFTEN:
            self.foreign.append(difference)
        else:
            self.problems.append(difference)

    def _check_numbers(self, name: str, heads: np.ndarray) -> None:
        """Check that each message has the next number of its topic."""
        numbers = heads["sequence"].astype(np.int64)
        times = heads["log_ns"].astype(np.int64)
        due_first, newest = self._due[name]
        due = np.concatenate([[due_first], numbers[:-1] + 1])
        for place in np.flatnonzero(numbers != due).tolist():
            at = int(times[place])
            before = int(times[place - 1]) if place else newest
            logged = f"number {numbers[place]} after {due[place] - 1}"
            found = Difference(
                at // self._period, None, f"topic {name}", logged, "the next one"
            )
            if numbers[place] < due[place]:
                self.problems.append(found)
            elif due[place] != ANY:
                self.jumps.append(Jump(name, before, at, found))
        self._due[name] = int(numbers[-1]) + 1, int(times[-1])

    def _check_times(self, part: Part, topics: np.ndarray) -> None:
        """Check the log times of a part's messages.

        A message that begins with a stamp is logged at its stamp. Any other message, or one with
        a stamp outside of the run, is logged at the newest stamp before.

        Args:
            part: the part.
            topics: number of each message's topic, shape (messages,).
        """
        if not len(topics):
            return
        logged = part.heads["log_ns"].astype(np.int64)
        published = part.heads["publish_ns"].astype(np.int64)
        stamped = self._stamped[topics]
        stamps = self._stamps(part, stamped)
        advances = stamped & (logged == stamps)
        newest = np.maximum.accumulate(np.where(advances, logged, 0))
        newest = np.maximum(newest, self._now)
        self._now = int(newest[-1])
        # A foreign stamp, before the run or ahead of it, does not move the time.
        foreign = (logged == newest) & ((stamps < 0) | (stamps > newest))
        due = np.where(stamped & ~foreign, stamps, newest)
        wrong = (logged != due) | (published != logged)
        for place in np.flatnonzero(wrong).tolist():
            self._note_time(
                self._topics[topics[place]],
                int(logged[place]),
                int(due[place]),
                int(published[place]),
                at_due=bool(stamped[place]) and due[place] >= 0,
            )

    def _stamps(self, part: Part, stamped: np.ndarray) -> np.ndarray:
        """Return the stamps of messages in nanoseconds; the log time if a message has none."""
        stamps = part.heads["log_ns"].astype(np.int64)
        sizes = part.heads["length"].astype(np.int64) - MESSAGE.size
        readable = stamped & (sizes >= _STAMP.itemsize)  # `_rows` reports the others
        rows = rows_at(part.content, part.begins[readable], _STAMP)
        stamps[readable] = rows["sec"].astype(np.int64) * SECOND + rows["nanosec"]
        return stamps

    def _note_time(
        self, topic: str, logged: int, due: int, published: int, *, at_due: bool
    ) -> None:
        """Note a message with a wrong log time or publish time.

        Args:
            topic: its topic.
            logged: its log time.
            due: the correct log time.
            published: its publish time.
            at_due: whether it belongs to the time step of `due`, not of `logged`.
        """
        step = (due if at_due else logged) // self._period
        what = f"{LOG_TIME} of {topic}"
        if logged != due:
            found = Difference(step, None, what, f"{logged} ns", f"{due} ns")
            self.problems.append(found)
        if published != logged:
            said = f"publish time {published} ns"
            found = Difference(step, None, what, said, f"{logged} ns, as logged")
            self.problems.append(found)


def no_rows(form: Reading) -> np.ndarray:
    """Return an empty array of a form's rows, shape (0,)."""
    if isinstance(form, MessageForm):
        return np.empty(0, form.columns)
    return as_objects([])


def as_objects(found: Sequence[Any]) -> np.ndarray:
    """Return an array of objects, shape (n,)."""
    rows = np.empty(len(found), dtype=object)
    for place, one in enumerate(found):
        rows[place] = one
    return rows
