# Copyright 2026 The sparse_coord_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Playing a playlist against a clock: rate, pause, steps, seeking, loop. Without ROS or threads.

At all times every message up to `position_ns` has been published, and no later one.
"""

from collections.abc import Callable
from dataclasses import dataclass

from sparse_coord_ros.log.bags.playlist import Playlist
from sparse_coord_ros.log.bags.reader import Message
from sparse_coord_ros.protocol.wire.messages import SECOND

BURST = 100
"""Most messages of one call of `play`, so that the caller can do other work in between."""


@dataclass(eq=False)
class Playback:
    """Publishes messages at absolute deadlines, so that delays do not add up.

    Args:
        playlist: the messages to play.
        publish: called with each message.
        now_ns: a monotonic clock.
        on_time: called with the current log time, before each message of that time.
        on_gap: called with the log times where a gap without messages begins and ends, when it is
            jumped over; None: gaps are waited for.
        rate: seconds of the log a second.
        loop: begin again at the end.
        paused: begin paused.

    Attributes:
        paused: whether playing is paused.
        done: whether playing has reached the end.
        published: number of messages published.
        late_ns: the longest delay of a published message; None: none was published.
    """

    playlist: Playlist
    publish: Callable[[Message], None]
    now_ns: Callable[[], int]
    on_time: Callable[[int], None] = lambda _: None
    on_gap: Callable[[int, int], None] | None = None
    rate: float = 1.0
    loop: bool = False
    paused: bool = False

    def __post_init__(self) -> None:
        """Begin at the playlist's start."""
        self.done = False
        self.published = 0
        self.late_ns: int | None = None
        self._go_on_from(self.playlist.start_ns)

    @property
    def position_ns(self) -> int:
        """The current log time."""
        if self.paused:
            return self._from_ns
        reached = self._from_ns + round((self.now_ns() - self._anchor_ns) * self.rate)
        next_ns = self.playlist.next_ns
        limit = self.playlist.end_ns if next_ns is None else next_ns
        return max(self._from_ns, min(reached, limit))

    def seek(self, time_ns: int) -> None:
        """Go to a log time: publish the last messages of kept topics, then those of that time."""
        self.done = False
        messages = self.playlist.seek(time_ns)
        self.on_time(time_ns)
        for message in messages:
            self._send(message)
        self._send_until(time_ns)
        self._go_on_from(time_ns)

    def pause(self, paused: bool) -> None:
        """Pause, or resume from the same place."""
        if paused != self.paused:
            self._go_on_from(self.position_ns)
            self.paused = paused

    def set_rate(self, rate: float) -> None:
        """Continue at another rate."""
        self._go_on_from(self.position_ns)
        self.rate = rate

    def step(self) -> bool:
        """Pause, and publish the next time step; return False at the end of the bag."""
        self.pause(True)
        end_ns = self.playlist.step_end_ns
        if end_ns is None:
            if not self.loop:
                return False
            self.seek(self.playlist.start_ns)
            return True
        self._send_until(end_ns)
        self._go_on_from(end_ns)
        return True

    def play(self) -> int | None:
        """Publish the due messages, `BURST` at most.

        Returns:
            Nanoseconds until the next message is due, 0 for at once; None: no message is due
            before a call of `pause` or `seek`.
        """
        if self.paused or self.done:
            return None
        for _ in range(BURST):
            next_ns = self.playlist.next_ns
            if next_ns is None:
                return self._end()
            self._jump_to(next_ns)
            due = self._deadline(next_ns)
            wait = due - self.now_ns()
            if wait > 0:
                return wait
            self.on_time(next_ns)
            self._send(self.playlist.take())
            self.late_ns = max(self.late_ns or 0, self.now_ns() - due)
        return 0

    def _jump_to(self, next_ns: int) -> None:
        """Jump to the next message if it lies behind a gap."""
        here_ns = self.position_ns
        if self.on_gap is None or next_ns - here_ns <= self.playlist.longest_wait_ns:
            return
        self.on_gap(here_ns, next_ns)
        self._go_on_from(next_ns)

    def _deadline(self, time_ns: int) -> int:
        return self._anchor_ns + round((time_ns - self._from_ns) / self.rate)

    def _go_on_from(self, time_ns: int) -> None:
        anchor_ns = self.now_ns()
        self._from_ns = time_ns
        self._anchor_ns = anchor_ns

    def _end(self) -> int | None:
        """End, or begin again: the first message follows the last after the time of one step."""
        if not self.loop:
            self.done = True
            return None
        playlist = self.playlist
        length = playlist.end_ns - playlist.start_ns
        gap = length // (playlist.step_count - 1) if length else SECOND
        self._anchor_ns = self._deadline(playlist.end_ns + gap)
        self._from_ns = playlist.start_ns
        playlist.seek(playlist.start_ns)
        return 0

    def _send(self, message: Message) -> None:
        self.publish(message)
        self.published += 1

    def _send_until(self, time_ns: int) -> None:
        while (next_ns := self.playlist.next_ns) is not None and next_ns <= time_ns:
            self.on_time(next_ns)
            self._send(self.playlist.take())
