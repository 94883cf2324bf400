# Copyright 2026 The sparse_coord_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Which time steps can be those of the world: a wrong stamp must not deafen a robot.

The world's steps grow by one, and by a little more where an episode begins. A robot that was cut
off sees them jump. It believes a jump once the world's `status` has named a step so far ahead.
"""

from sparse_coord_ros.core.game.rules import EPISODE_GAP

NEAR = EPISODE_GAP + 1
"""How far the next step may lie ahead: that of a transition, and an episode's start after it."""


class StepFilter:
    """Lets time steps pass in the order in which the world makes them.

    Args:
        newest: the newest step that has passed.

    Attributes:
        newest: the newest step that has passed.
        said: the newest step that the world's status has named.
    """

    def __init__(self, newest: int = 0) -> None:
        self.newest = self.said = newest
        self._first = self._last = 0

    def passes(self, step: int) -> bool:
        """Take in a step; return whether it can be the world's now.

        Steps of the past pass. One that does not is kept, with those that follow it, until the
        world confirms them: see `confirmed`.
        """
        if step <= self.newest + NEAR or step <= self.said + NEAR:
            if step > self.newest:
                self.newest = step
            self._first = 0  # the world is here
            return True
        if not self._last < step <= self._last + NEAR or self._first == 0:
            self._first = step
        self._last = step
        return False

    def confirmed(self, said: int) -> bool:
        """Take in the step of the world's status; return whether the last step kept passes now."""
        self.said = max(self.said, said)
        if not self.newest < self._first <= self.said + NEAR:
            return False
        self.newest = self._last
        self._first = 0
        return True
