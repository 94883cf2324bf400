# Copyright 2026 The sparse_coord_ros authors
# SPDX-License-Identifier: Apache-2.0
"""A bag's messages as columns: topic by topic, decoded many at a time."""

from collections.abc import Callable, Collection, Iterator, Mapping
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
COMPLETE = "one that says all"
"""What a message ought to be. One that is not readable is none of the run's; one that lacks
something, but names the run, or is as long as the run's, may be one that was changed."""

OFTEN = {
    wire.CLOCK,
    wire.LOCAL_STATE,
    wire.REWARD,
    wire.ACTION,
    wire.PERCEPT,
    wire.SERVICE_EVENTS,
}
"""Topics that may say something at every time step: what is replaced there would be missed."""

ANY = -1
"""In place of the number that is due first: only a part of the bag is read."""

Reading = MessageForm | Callable[[Any], Any]
"""How a topic's messages become rows, or what object is made of a decoded one."""

Forms = Mapping[str, tuple[wire.Topic, Reading]]
"""A run's topics by their full names, and how their messages are read."""

Only = Collection[wire.Topic] | None
"""Topics of which no more than some are read; None: all."""

_STAMP = np.dtype([("encapsulation", "V4"), ("sec", "<i4"), ("nanosec", "<u4")])


class Columns:
    """Reads a bag once.

    Args:
        bag: the bag.
        forms: the run's topics by their full names, and how their messages are read; other topics'
            messages are only counted and timed.
        only: of these topics no more than some are read; None: all.
        period: nanoseconds of a time step.
        begins: by the place of a file in the bag the time at which its recorder begins to count
            anew.

    Attributes:
        rows: by topic, in the order of the file, of each file of the bag; shape (messages,).
        problems: messages out of number or time, or unreadable.
        suspects: messages that no node of the run says.
        jumps: where numbers are missing.
    """

    def __init__(
        self, bag: Bag, forms: Forms, only: Only, period: int, begins: Mapping[int, int]
    ) -> None:
        self.problems: list[Difference] = []
        self.suspects: list[Difference] = []
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
        """Yield topics with the heads of their messages and where these begin."""
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
        """Return the rows of a topic's messages that can be read, note the others."""
        (topic, form) = self._forms[name]
        sizes = heads["length"].astype(np.int64) - MESSAGE.size
        if isinstance(form, MessageForm):
            rows, fits = form.rows(content, begins, sizes)
            why = "has another form than the run's"
            altered = np.isin(sizes, [layout.size for layout, _ in form.layouts])
            due_of = np.where(altered, COMPLETE, READABLE).tolist()
            odd = {
                place: (why, due_of[place]) for place in np.flatnonzero(~fits).tolist()
            }
        else:
            rows = np.empty(len(heads), dtype=object)
            odd = {}
            ends = (begins + sizes).tolist()
            for place, (begin, end) in enumerate(
                zip(begins.tolist(), ends, strict=True)
            ):
                due = READABLE
                try:
                    message = self._decode(name, content[begin:end])
                    due = COMPLETE
                    rows[place] = form(message)
                except (AttributeError, ValueError) as error:
                    odd[place] = str(error), due
        for place, (why, due) in odd.items():
            step = int(heads["log_ns"][place]) // self._period
            found = (
                self.suspects if due == READABLE or topic in OFTEN else self.problems
            )
            found.append(
                Difference(step, None, f"topic {name}", f"a message that {why}", due)
            )
        return np.delete(rows, list(odd))

    def _check_numbers(self, name: str, heads: np.ndarray) -> None:
        """Every message has the next number of its topic."""
        said = heads["sequence"].astype(np.int64)
        times = heads["log_ns"].astype(np.int64)
        due_first, newest = self._due[name]
        due = np.concatenate([[due_first], said[:-1] + 1])
        for place in np.flatnonzero(said != due).tolist():
            at = int(times[place])
            before = int(times[place - 1]) if place else newest
            logged = f"number {said[place]} after {due[place] - 1}"
            odd = Difference(
                at // self._period, None, f"topic {name}", logged, "the next one"
            )
            if said[place] < due[place]:
                self.problems.append(odd)
            elif due[place] != ANY:
                self.jumps.append(Jump(name, before, at, odd))
        self._due[name] = int(said[-1]) + 1, int(times[-1])

    def _check_times(self, part: Part, numbers: np.ndarray) -> None:
        """A message that begins with a stamp is logged then, any other at the newest before.

        So is one whose stamp is not of the run's time.
        """
        if not len(numbers):
            return
        logged = part.heads["log_ns"].astype(np.int64)
        published = part.heads["publish_ns"].astype(np.int64)
        stamped = self._stamped[numbers]
        due = logged.copy()
        sizes = part.heads["length"].astype(np.int64) - MESSAGE.size
        readable = stamped & (sizes >= _STAMP.itemsize)  # of others their form says so
        rows = rows_at(part.content, part.begins[readable], _STAMP)
        due[readable] = rows["sec"].astype(np.int64) * SECOND + rows["nanosec"]
        moved = np.where(stamped & (logged == due), logged, 0)
        newest = np.maximum(np.maximum.accumulate(moved), self._now)
        now = ~stamped | ((logged == newest) & ((due < 0) | (due > newest)))
        due[now] = newest[now]
        self._now = int(newest[-1])
        for place in np.flatnonzero((logged != due) | (published != logged)).tolist():
            at, expected, said = (
                int(column[place]) for column in (logged, due, published)
            )
            step = (
                expected if stamped[place] and expected >= 0 else at
            ) // self._period
            what = f"{LOG_TIME} of {self._topics[numbers[place]]}"
            odd = [(f"{at} ns", f"{expected} ns")] if at != expected else []
            odd += (
                [(f"publish time {said} ns", f"{at} ns, as logged")]
                if said != at
                else []
            )
            self.problems += [Difference(step, None, what, *words) for words in odd]


def no_rows(form: Reading) -> np.ndarray:
    """Return an array of rows without any, shape (0,)."""
    return np.empty(0, form.columns if isinstance(form, MessageForm) else object)
