# Copyright 2026 The sparse_coord_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Filters impossible time steps: one wrong stamp must not make a robot ignore the right ones.

The world's steps grow by one, and by a little more at an episode's beginning. A robot that was
disconnected sees a jump. It accepts a jump once the world's `status` has named a step so far
ahead.
"""

from sparse_coord_ros.core.game.rules import EPISODE_GAP

NEAR = EPISODE_GAP + 1
"""Largest distance to the next step: a transition, and the start of an episode after it."""


class StepFilter:
    """Lets time steps pass in the order in which the world makes them.

    Args:
        newest: the newest step that has passed.

    Attributes:
        newest: the newest step that has passed.
        said: the newest step in the world's status.
    """

    def __init__(self, newest: int = 0) -> None:
        self.newest = self.said = newest
        self._first = self._last = 0

    def passes(self, step: int) -> bool:
        """Return whether a received step can be the world's now.

        Past steps pass. A step that does not pass is kept, with its successors, until the world
        confirms them: see `confirmed`.
        """
        if step <= self.newest + NEAR or step <= self.said + NEAR:
            if step > self.newest:
                self.newest = step
            self._first = 0  # the world is at this step
            return True
        if not self._last < step <= self._last + NEAR or self._first == 0:
            self._first = step
        self._last = step
        return False

    def confirmed(self, said: int) -> bool:
        """Note the step of the world's status; return whether the last kept step passes now."""
        self.said = max(self.said, said)
        if not self.newest < self._first <= self.said + NEAR:
            return False
        self.newest = self._last
        self._first = 0
        return True
