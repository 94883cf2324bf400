# Copyright 2026 The sparse_coord_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The messages of a bag in the order of their log times, from any position, in little memory.

One pass notes time and topic of every message (18 bytes each). Then the file is streamed. Only a
message that comes in the file before one with an earlier log time is kept until its turn.
"""

from array import array
from collections.abc import Collection, Iterator

import numpy as np

from sparse_coord_ros.base.errors import BagError
from sparse_coord_ros.log.bags import segments
from sparse_coord_ros.log.bags.reader import Bag, Message
from sparse_coord_ros.protocol.wire.messages import SECOND

LEAST_GAP = 5 * SECOND
GAP_STEPS = 20
"""A gap between two messages is longer than so many nanoseconds, and than so many usual steps."""


class Playlist:
    """A bag's messages in the order of log time; messages of equal times in file order.

    Messages that a later segment of the bag supersedes are left out.

    Args:
        bag: an open bag.
        topics: the topics to play; they must have messages.
        kept: topics whose last message stays valid until the next, such as latched ones.

    Attributes:
        start_ns: log time of the first message.
        end_ns: log time of the last message.
        step_count: number of time steps.
        longest_wait_ns: longest time between two messages that is no gap.

    Raises:
        BagError: these topics have no message.
    """

    def __init__(
        self, bag: Bag, topics: Collection[str], kept: Collection[str] = ()
    ) -> None:
        self._bag = bag
        self._topics = frozenset(topics)
        numbers = {name: number for number, name in enumerate(sorted(self._topics))}
        log_times = array("q")
        kinds = array("H")
        for message in segments.messages(bag, self._topics):
            log_times.append(message.log_time_ns)
            kinds.append(numbers[message.topic])
        if not log_times:
            raise BagError(
                f"bag {bag.path}: no message to play on {', '.join(sorted(topics))}"
            )
        times = np.frombuffer(log_times, np.int64)
        order = np.argsort(times, kind="stable")
        self._times = times[order]
        self._kinds = np.frombuffer(kinds, np.uint16)[order]
        self._places = np.empty(len(order), np.int64)
        self._places[order] = np.arange(len(order))
        self._kept = [numbers[name] for name in sorted(kept) if name in numbers]
        clock = numbers.get(bag.clock or "")
        ticks = (
            self._times[self._kinds == clock] if clock in self._kinds else self._times
        )
        self._ticks = np.unique(np.append(ticks, self._times[0]))
        self.start_ns = int(self._times[0])
        self.end_ns = int(self._times[-1])
        self.step_count = len(self._ticks)
        self.longest_wait_ns = LEAST_GAP
        if self.step_count > 1:
            usual_ns = int(np.median(np.diff(self._ticks)))
            self.longest_wait_ns = max(LEAST_GAP, GAP_STEPS * usual_ns)
        self._stream: Iterator[tuple[int, Message]] = iter(())
        self._waiting: dict[int, Message] = {}
        self._next = 0
        self.seek(self.start_ns)

    def __len__(self) -> int:
        """Return the number of messages."""
        return len(self._times)

    @property
    def next_ns(self) -> int | None:
        """Log time of the next message; None at the end."""
        return int(self._times[self._next]) if self._next < len(self._times) else None

    @property
    def step_end_ns(self) -> int | None:
        """Log time of the last message of the next step; None at the end.

        A step lasts until the next message of the clock; in a bag without a clock, a step is all
        messages of one log time.
        """
        if self._next == len(self._times):
            return None
        following = np.searchsorted(self._ticks, self._times[self._next], side="right")
        if following == len(self._ticks):
            return self.end_ns
        return int(
            self._times[np.searchsorted(self._times, self._ticks[following]) - 1]
        )

    def seek(self, time_ns: int) -> list[Message]:
        """Continue with the first message at or after a time.

        Returns:
            The last message before that time of each kept topic, in their order.
        """
        self._next = int(np.searchsorted(self._times, time_ns))
        lasts = (
            np.flatnonzero(self._kinds[: self._next] == kind)[-1:]
            for kind in self._kept
        )
        wanted = sorted(int(last[0]) for last in lasts if len(last))
        messages = segments.messages(self._bag, self._topics)
        self._stream = zip(memoryview(self._places.data), messages, strict=False)
        self._waiting.clear()
        found = {place: self._find(place, set(wanted)) for place in wanted}
        return [found[place] for place in wanted]

    def prepare(self) -> None:
        """Read ahead, so that the next `take` need not wait for the disk."""
        if self._next < len(self._times):
            self._waiting[self._next] = self._find(self._next)

    def take(self) -> Message:
        """Return the next message; there must be one (`next_ns`).

        Raises:
            BagError: the bag has changed on disk.
        """
        message = self._find(self._next)
        self._next += 1
        return message

    def _find(self, wanted: int, also: Collection[int] = ()) -> Message:
        """Return the message at a place: a kept one, or one further on in the file."""
        if wanted in self._waiting:
            return self._waiting.pop(wanted)
        for place, message in self._stream:
            if place == wanted:
                return message
            if place >= self._next or place in also:
                self._waiting[place] = message
        raise BagError(
            f"bag {self._bag.path}: has changed while it was played; start again"
        )
