# Copyright 2026 The sparse_coord_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The messages of a bag in the order of their log times, from any position."""

from collections.abc import Collection

import numpy as np

from sparse_coord_ros.base.errors import BagError
from sparse_coord_ros.log.bags.reader import Bag, Message, Part, not_superseded
from sparse_coord_ros.protocol.wire import LOCAL_STATE
from sparse_coord_ros.protocol.wire.messages import SECOND

LEAST_GAP = 5 * SECOND
GAP_STEPS = 20
"""A gap between two messages is longer than so many nanoseconds, and than so many usual steps."""


class Playlist:
    """A bag's messages in the order of log time; messages of equal times in file order.

    Messages that a later file of the bag supersedes are left out.

    Args:
        bag: a bag with its messages.
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
        chosen = [self._chosen(part, topics) for part in bag.parts]
        if not sum(map(len, chosen)):
            names = ", ".join(sorted(topics))
            raise BagError(f"bag {bag.path}: no message to play on {names}")
        heads = np.concatenate(
            [
                part.heads[indices]
                for part, indices in zip(bag.parts, chosen, strict=True)
            ]
        )
        parts = np.repeat(np.arange(len(chosen)), [len(indices) for indices in chosen])
        order = np.argsort(heads["log_ns"], kind="stable")
        self._times = heads["log_ns"][order]
        self._kinds = heads["topic"][order]
        self._parts = parts[order]
        self._indices = np.concatenate(chosen)[order]
        known = {name: number for number, name in enumerate(bag.names)}
        self._kept = [known[name] for name in sorted(kept) if name in known]
        clock = known.get(bag.clock or "", -1)
        ticks = self._times[self._kinds == clock]
        if not len(ticks):
            ticks = self._times
        self._ticks = np.unique(np.append(ticks, self._times[0]))
        self.start_ns = int(self._times[0])
        self.end_ns = int(self._times[-1])
        self.step_count = len(self._ticks)
        self.longest_wait_ns = LEAST_GAP
        if self.step_count > 1:
            usual_ns = int(np.median(np.diff(self._ticks)))
            self.longest_wait_ns = max(LEAST_GAP, GAP_STEPS * usual_ns)
        self._next = 0

    def _chosen(self, part: Part, topics: Collection[str]) -> np.ndarray:
        """Return the indices of the messages to play in a part, without superseded ones."""
        end_ns = self._bag.ends_ns[part.file]
        indices = self._bag.chosen(part, topics)
        times = part.heads["log_ns"][indices]
        states = [topic for topic in topics if topic.endswith(f"/{LOCAL_STATE.name}")]
        is_state = np.isin(indices, self._bag.chosen(part, states))
        return indices[not_superseded(times, end_ns, states=is_state)]

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
        return [self._at(int(last[0])) for last in sorted(lasts, key=list) if len(last)]

    def take(self) -> Message:
        """Return the next message; there must be one (`next_ns`)."""
        message = self._at(self._next)
        self._next += 1
        return message

    def _at(self, number: int) -> Message:
        """Return a message by its place in the order of log times."""
        part = self._bag.parts[self._parts[number]]
        return self._bag.message(part, int(self._indices[number]))
