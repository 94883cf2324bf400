# Copyright 2026 The sparse_coord_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The speed of a world."""

from sparse_coord_ros.core.game.world import World


class WorldSpeed:
    """Counts transitions over time. Times are in seconds of a monotonic clock.

    Args:
        world: the game.
        now: the current time.

    Attributes:
        reported: the time of the last call of `report`.
    """

    def __init__(self, world: World, now: float) -> None:
        self._world = world
        self._began: tuple[float, int] | None = None
        self._ended: float | None = None
        self.reported = now
        self._transitions = 0

    @property
    def begun(self) -> bool:
        """True if the run has begun."""
        return self._began is not None

    def begin(self, now: float) -> None:
        """Begin to measure; another process may have made the earlier steps."""
        self._began = (now, self._world.transitions)
        self.reported, self._transitions = self._began

    def end(self, now: float) -> None:
        """Stop counting."""
        self._ended = now

    def report(self, now: float) -> tuple[float, bool]:
        """Return (transitions a second since the last report, whether there were any).

        At the end it is the speed of the whole run.
        """
        made = self._world.transitions - self._transitions
        if self._ended is None:
            rate = max(0, made) / (now - self.reported + 1e-9)
        else:
            rate = self.summary()["steps_per_second"]
        self.reported = now
        self._transitions = self._world.transitions
        return rate, self.begun and made != 0

    def summary(self) -> dict[str, float]:
        """Return the seconds of this process's part of the run, and its speed."""
        if self._began is None or self._ended is None:
            return {"seconds": 0.0, "steps_per_second": 0.0}
        began, before = self._began
        seconds = self._ended - began
        made = max(0, self._world.transitions - before)
        speed = round(made / seconds, 1) if seconds else 0.0
        return {"seconds": round(seconds, 3), "steps_per_second": speed}
