# Copyright 2026 The sparse_coord_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Whether every message is logged at the time at which a recorder logs it."""

from collections.abc import Collection

from sparse_coord_ros.core.frame import SECOND, STAMPED, Frame
from sparse_coord_ros.recording.reader import Message
from sparse_coord_ros.runlog.difference import Difference

LOG_TIME = "log_time"


class LogTimes:
    """Follows the messages of a bag in their order.

    A message that begins with a stamp is logged at that time, any other at the newest of those
    before it.

    Args:
        frame: the run's clock.
        stamped: the topics whose messages begin with their stamp.
    """

    def __init__(self, frame: Frame, stamped: Collection[str]) -> None:
        self._period = frame.period
        self._stamped = frozenset(stamped)
        self._now = 0

    def check(self, message: Message) -> Collection[Difference]:
        """Return what is odd about the next message's times."""
        at = due = message.log_time_ns
        if message.topic not in self._stamped:
            due = self._now
        elif len(message.data) >= STAMPED.size:  # else its reader says so
            sec, nanosec = STAMPED.unpack_from(message.data)
            due = sec * SECOND + nanosec
            if at == due > self._now:
                self._now = at
        if at == due == message.publish_time_ns:
            return ()
        step = (due if message.topic in self._stamped else at) // self._period
        found = []
        if at != due:
            found.append(self._odd(step, message, f"{at} ns", f"{due} ns"))
        if message.publish_time_ns != at:
            logged = f"publish time {message.publish_time_ns} ns"
            found.append(self._odd(step, message, logged, f"{at} ns, as logged"))
        return found

    def _odd(self, step: int, message: Message, logged: str, computed: str) -> Difference:
        return Difference(step, None, f"{LOG_TIME} of {message.topic}", logged, computed)
