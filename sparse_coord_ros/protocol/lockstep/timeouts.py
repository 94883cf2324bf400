# Copyright 2026 The sparse_coord_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Timeouts of world, robots and recorder: silence, reminders, deadlines, presence of the world.

The world says its status every second, with the identity of its run. What another world says, or
one that forges it, does not count. Times are seconds of any clock that never goes back.
"""

from sparse_coord_ros.protocol.wire import RunState

SILENT_SECONDS = 3.0
"""A world that has not been heard for so long is missed: it says its status every second."""

REMIND_SECONDS = 5.0
"""Between two words about what is waited for."""


REPEAT_SECONDS = 0.5
"""After this silence the world publishes again what a missing robot may have lost."""


class Silence:
    """The time that the world has waited for its robots.

    Args:
        now: the time.

    Attributes:
        since: when it last heard of them, or the time step began.
    """

    def __init__(self, now: float) -> None:
        self._ticked = now
        self._repeated = 0.0
        self.begin(now)

    def begin(self, now: float) -> None:
        """A time step begins, or the world goes on after a break."""
        self.since = self._stands_since = now

    def tick(self, now: float) -> None:
        """Note that this process lives; where it stood still itself, no robot was silent."""
        if now - self._ticked > REPEAT_SECONDS:
            self.since = now
        self._ticked = now

    def lasts(self, now: float) -> float:
        """Return the seconds since the world last heard its robots."""
        return now - self.since

    def stands(self, now: float) -> float:
        """Return the seconds since the world's last time step."""
        return now - self._stands_since

    def repeats(self, now: float) -> bool:
        """Return whether it is time to say everything again; it is then said."""
        due = now - self._repeated >= REPEAT_SECONDS
        if due:
            self._repeated = now
        return due


class Reminder:
    """Times of reminders while a node waits: every `REMIND_SECONDS`."""

    def __init__(self) -> None:
        self._since: float | None = None
        self._said = 0.0

    def due(self, now: float) -> float:
        """Return the seconds of waiting so far if it is time to say so, else 0."""
        if self._since is None:
            self._since = self._said = now
        if now - self._said < REMIND_SECONDS:
            return 0.0
        self._said = now
        return now - self._since

    def over(self) -> None:
        """There is nothing to wait for."""
        self._since = None


class Deadline:
    """The deadline of a robot's waiting in the lock step.

    A peer that answers "not there yet" is not silent: its deadline runs from its last word, but
    no longer than the world would wait for it.

    Args:
        percept_timeout: seconds of silence.
        step_timeout: seconds in all for a peer that says that it is behind.
    """

    def __init__(self, percept_timeout: float, step_timeout: float) -> None:
        self._silence = percept_timeout
        self._longest = max(percept_timeout, step_timeout)
        self._waiting: tuple[str, int] | None = None
        self._since = 0.0

    def passed(self, waiting: tuple[str, int] | None, heard: float, now: float) -> bool:
        """Return True, once, when the deadline of the waiting has passed.

        Args:
            waiting: as `RobotSide.waiting`.
            heard: when the peer that is asked was last heard.
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
        self._waiting = None
        return True


class WorldPresence:
    """Watches the world of one run.

    Args:
        run_id: the identity of the run; budget: its transitions.
        patience: seconds without a word until the world is given up; 0: never.
        now: the time.

    Attributes:
        end: the run's last time step, once the world has said that the run is over.
        ended: when it said so first.
    """

    def __init__(self, run_id: str, budget: int, patience: float, now: float) -> None:
        self._run_id = run_id
        self._budget = budget
        self._patience = patience
        self._heard = now
        self._other = False
        self.end: int | None = None
        self.ended = 0.0

    def hear(
        self, run_id: str, state: str, step: int, transitions: int, now: float
    ) -> None:
        """Take in a world's status.

        Raises:
            ValueError: it cannot be that of this run's world.
        """
        if run_id != self._run_id:
            raise ValueError(
                f"is of run {run_id or '(none)'}, not of this run {self._run_id}"
            )
        if state == RunState.FINISHED and transitions < self._budget:
            raise ValueError(f"finished after {transitions} of {self._budget} steps")
        self._heard = now
        self._other = False
        if state in (RunState.FINISHED, RunState.STOPPED):
            self.ended = now if self.end is None else self.ended
            self.end = step
        else:
            self.end = None

    def sees(self, step: int) -> bool:
        """Take in a time step that the world has made; return whether it belies the run's end."""
        belied = self.end is not None and step > self.end
        if belied:
            self.end = None
        return belied

    def another_run(self) -> None:
        """Another run was announced."""
        self._other = True

    def silent(self, now: float) -> float:
        """Return the seconds since the world was last heard."""
        return now - self._heard

    def given_up(self, now: float) -> str:
        """Return the reason not to wait for the world any more, or an empty text."""
        silent = self.silent(now)
        if self._other and silent >= SILENT_SECONDS:
            return f"no word from the world for {silent:.0f} s, and another one has begun a run"
        if 0 < self._patience <= silent:
            return (
                f"no word from the world for {silent:.0f} s (parameter world_timeout)"
            )
        return ""
