# Copyright 2026 The sparse_coord_ros authors
# SPDX-License-Identifier: Apache-2.0
"""A bag's messages as columns: topic by topic, many decoded at once."""

from collections.abc import Callable, Collection, Iterator, Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np

from sparse_coord_ros.log.bags.reader import Bag, Part
from sparse_coord_ros.log.bags.records import MESSAGE
from sparse_coord_ros.log.runlog.decode import Decoder
from sparse_coord_ros.protocol import wire
from sparse_coord_ros.protocol.wire.messages import MessageForm

Reading = MessageForm | Callable[[Any], Any]
"""Converts messages into rows: a form many at once, or a function each decoded one."""

Forms = Mapping[str, tuple[wire.Topic, Reading]]
"""A run's topics by their full names, each with its `Reading`."""

Only = Collection[wire.Topic] | None
"""The topics to read; None: all."""


class Unreadable(NamedTuple):
    """A message that cannot be read.

    Attributes:
        topic: its topic's full name.
        log_ns: its log time.
        why: the end of a sentence about it.
    """

    topic: str
    log_ns: int
    why: str


class Columns:
    """Reads a bag once.

    Args:
        bag: the bag.
        forms: the run's topics by their full names, each with its `Reading`.
        only: the topics to read, the others seem to have no messages; None: all.

    Attributes:
        rows: of each file of the bag, the rows by topic, in the order of the file; shape
            (messages,).
        unreadable: the messages that could not be read.
    """

    def __init__(self, bag: Bag, forms: Forms, only: Only) -> None:
        self.rows: list[dict[str, np.ndarray]] = []
        self.unreadable: list[Unreadable] = []
        self._forms = forms
        self._decode = Decoder(bag.topics)
        self._wanted = {
            name for name, (topic, _) in forms.items() if only is None or topic in only
        }
        for place in range(len(bag.files)):
            parts = {name: [no_rows(form)] for name, (_, form) in forms.items()}
            for part in bag.parts([place]):
                for name, heads, begins in self._by_topic(bag, part):
                    if name not in self._decode:  # it was defined just now
                        self._decode = Decoder(bag.topics)
                    parts[name].append(self._read(name, part.content, heads, begins))
            self.rows.append(
                {name: np.concatenate(found) for name, found in parts.items()}
            )

    def _by_topic(
        self, bag: Bag, part: Part
    ) -> Iterator[tuple[str, np.ndarray, np.ndarray]]:
        """Yield each wanted topic of a part with its messages' heads and their offsets."""
        names = bag.channels
        channels = part.heads["channel"]
        order = np.argsort(channels, kind="stable")
        found, first = np.unique(channels[order], return_index=True)
        groups = np.split(order, first[1:])
        for channel, group in zip(found.tolist(), groups, strict=False):
            if names[channel] in self._wanted:
                yield names[channel], part.heads[group], part.begins[group]

    def _read(
        self, name: str, content: bytes, heads: np.ndarray, begins: np.ndarray
    ) -> np.ndarray:
        """Return the rows of a topic's readable messages; note the others."""
        _, form = self._forms[name]
        times = heads["log_ns"].tolist()
        sizes = heads["length"].astype(np.int64) - MESSAGE.size
        if isinstance(form, MessageForm):
            rows, fits = form.rows(content, begins, sizes)
            for place in np.flatnonzero(~fits).tolist():
                why = "has another form than the run's"
                self.unreadable.append(Unreadable(name, times[place], why))
            return np.asarray(rows[fits])
        found = []
        places = zip(begins.tolist(), sizes.tolist(), times, strict=True)
        for begin, size, log_ns in places:
            try:
                found.append(form(self._decode(name, content[begin : begin + size])))
            except (AttributeError, ValueError) as error:
                self.unreadable.append(Unreadable(name, log_ns, str(error)))
        return as_objects(found)


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
