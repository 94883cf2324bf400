# Copyright 2026 The sparse_coord_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Timeouts of world, robots and recorder: silence, reminders, deadlines, presence of the world.

The world publishes its status every second, with the identity of its run. The status of another
world does not count. Times are seconds of any monotonic clock.
"""

from sparse_coord_ros.protocol.wire import OVER

SILENT_SECONDS = 3.0
"""After so long without a status the world counts as silent; it publishes one every second."""

REMIND_SECONDS = 5.0
"""Until the first reminder of a wait; each further one comes after twice the time of the wait."""

LONGEST_BETWEEN_REMINDERS = 60.0
"""Seconds between two reminders at most."""


REPEAT_SECONDS = 0.5
"""After this silence the world repeats the messages that a missing robot may have lost."""


class Silence:
    """The time that the world has waited for its robots.

    Args:
        now: the time.

    Attributes:
        since: the time at which the time step began, or this process went on after a stop.
    """

    def __init__(self, now: float) -> None:
        self._ticked = now
        self._repeated = 0.0
        self.begin(now)

    def begin(self, now: float) -> None:
        """A time step begins, or the world continues after a break."""
        self.since = self._stands_since = now

    def tick(self, now: float) -> None:
        """Note that this process runs; while it was stopped itself, no robot was silent."""
        if now - self._ticked > REPEAT_SECONDS:
            self.since = now
        self._ticked = now

    def lasts(self, now: float) -> float:
        """Return the seconds since the time step began."""
        return now - self.since

    def stands(self, now: float) -> float:
        """Return the seconds since the world's last time step."""
        return now - self._stands_since

    def repeats(self, now: float) -> bool:
        """Return whether it is time to repeat all messages; the time then counts anew."""
        due = now - self._repeated >= REPEAT_SECONDS
        if due:
            self._repeated = now
        return due


class Reminder:
    """Times of reminders while a node waits, at growing intervals: 5, 10, 20, 40, 80, 140 s."""

    def __init__(self) -> None:
        self._since: float | None = None
        self._next = 0.0

    def due(self, now: float) -> float:
        """Return the seconds of waiting so far if a reminder is due, else 0."""
        if self._since is None:
            self._since = now
            self._next = REMIND_SECONDS
        waited = now - self._since
        if waited < self._next:
            return 0.0
        self._next = waited + min(waited, LONGEST_BETWEEN_REMINDERS)
        return waited

    def over(self) -> None:
        """The wait is over."""
        self._since = None


class Deadline:
    """The deadline of a robot's waiting in the lock step.

    Peers that answer, also "not there yet", are not silent: the deadline runs from their last
    answer, but no longer than the world would wait for the robot.

    Args:
        percept_timeout: seconds of silence.
        step_timeout: seconds in total for a peer that answers "not there yet".
    """

    def __init__(self, percept_timeout: float, step_timeout: float) -> None:
        self._silence = percept_timeout
        self._longest = step_timeout
        self._waiting: tuple[str, int] | None = None
        self._since = 0.0

    def over(self) -> None:
        """The wait is over."""
        self._waiting = None

    def passed(self, waiting: tuple[str, int] | None, heard: float, now: float) -> bool:
        """Return True, once, when the deadline of a wait has passed.

        Args:
            waiting: as `RobotSide.waiting`.
            heard: the time of the last answer of a peer.
            now: the time.
        """
        if waiting is None or waiting != self._waiting:
            self._waiting = waiting
            self._since = now
            return False
        if (
            now - max(self._since, heard) < self._silence
            and now - self._since < self._longest
        ):
            return False
        self.over()
        return True


class WorldPresence:
    """Watches the world of one run.

    Args:
        run_id: the identity of the run.
        patience: seconds without a status until the world is given up; 0: never.
        now: the time.

    Attributes:
        end: the run's last time step, once the world has reported the run's end.
        ended: the time of its first report of the end.
    """

    def __init__(self, run_id: str, patience: float, now: float) -> None:
        self._run_id = run_id
        self._patience = patience
        self._heard = now
        self._other = False
        self.end: int | None = None
        self.ended = 0.0

    def hear(self, run_id: str, state: str, step: int, now: float) -> None:
        """Process a world's status.

        Raises:
            ValueError: it is of another run.
        """
        if run_id != self._run_id:
            raise ValueError(
                f"is of run {run_id or '(none)'}, not of this run {self._run_id}"
            )
        self._heard = now
        self._other = False
        if state in OVER:
            self.ended = now if self.end is None else self.ended
            self.end = step
        else:
            self.end = None

    def another_run(self) -> None:
        """Another run was announced."""
        self._other = True

    def silent(self, now: float) -> float:
        """Return the seconds since the world's last status."""
        return now - self._heard

    def given_up(self, now: float) -> str:
        """Return the reason to give up the world, or an empty text."""
        silent = self.silent(now)
        if self._other and silent >= SILENT_SECONDS:
            return f"no word from the world for {silent:.0f} s, and another one has begun a run"
        if 0 < self._patience <= silent:
            return f"no word from the world for {silent:.0f} s"
        return ""
