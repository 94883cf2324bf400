# Copyright 2026 The sparse_coord_ros authors
# SPDX-License-Identifier: Apache-2.0
"""How many episodes and questions there were up to any time step of a log."""

from typing import NamedTuple

import numpy as np

from sparse_coord_ros.log.runlog.growing import Episodes, Questions, questions_in
from sparse_coord_ros.log.runlog.log import RunLog, learning_steps

SUM_EVERY = 20_000
"""Questions between two sums that are kept, so that no more than these are counted at once."""


class Counted(NamedTuple):
    """What there was up to a time step.

    Attributes:
        episodes: how many episodes had begun.
        questions: how many questions there were.
        asked: how often each robot asked in each cell, shape (K, cells), int64.
        read_to: up to which time step this was counted; before the one that was asked for, where
            the log has not been read so far.
    """

    episodes: int
    questions: int
    asked: np.ndarray
    read_to: int


class Counts:
    """Episodes and questions up to a time step of a log; `with_part` adds what more was read.

    It is not changed once it is made: a thread may count while another one reads on.

    Args:
        robots: how many robots there are.
        cells: how many cells the map has.

    Attributes:
        read_to: up to which time step the log has been read.
    """

    def __init__(self, robots: int, cells: int) -> None:
        self.read_to = -1
        self._shape = robots, cells
        self._begun = np.empty(0, dtype=np.int64)
        self._steps = np.empty(0, dtype=np.int64)
        self._places = np.empty(0, dtype=np.int32)
        self._sums = [np.zeros(robots * cells, dtype=np.int64)]

    def with_part(self, begin: int, part: Episodes) -> "Counts":
        """Return the counts with the newer content of a part of the log.

        Args:
            begin: the time step at which the part begins.
            part: the part.
        """
        new = Counts(*self._shape)
        new.read_to = part.read_to
        begun = self._begun[: np.searchsorted(self._begun, begin)]
        new._begun = np.concatenate([begun, part.history.first_step])
        kept = int(np.searchsorted(self._steps, begin))
        new._steps = np.concatenate([self._steps[:kept], part.questions.step])
        new._places = np.concatenate(
            [self._places[:kept], self._places_of(part.questions)]
        )
        new._sums = self._sums[: 1 + kept // SUM_EVERY]
        while len(new._sums) * SUM_EVERY <= len(new._steps):
            end = len(new._sums) * SUM_EVERY
            counted = new._counted(new._places[end - SUM_EVERY : end])
            new._sums = [*new._sums, new._sums[-1] + counted]
        return new

    def _places_of(self, questions: Questions) -> np.ndarray:
        """Return a number for each robot and cell: shape (n,), int32."""
        places: np.ndarray = questions.robot * self._shape[1] + questions.cell
        return places.astype(np.int32)

    def _counted(self, places: np.ndarray) -> np.ndarray:
        """Return how often each number of `_places_of` is there: shape (K * cells,), int64."""
        counts: np.ndarray = np.bincount(
            places, minlength=self._shape[0] * self._shape[1]
        )
        return counts

    def made_before(self, step: int) -> int | None:
        """Return the learning steps before a time step; None if the log is not read so far."""
        if step > self.read_to:
            return None
        episode = int(np.searchsorted(self._begun, step, side="right")) - 1
        return learning_steps(step, max(0, episode))

    def up_to(self, step: int, log: RunLog) -> Counted:
        """Return what there was up to a time step.

        Args:
            step: the time step.
            log: a part of the log around it: it helps where reading has not come so far, and the
                part goes back to where it has come.
        """
        end = int(np.searchsorted(self._steps, step, side="right"))
        block = end // SUM_EVERY
        episodes = int(np.searchsorted(self._begun, step, side="right"))
        asked = self._sums[block] + self._counted(self._places[block * SUM_EVERY : end])
        read_to = min(step, self.read_to)
        if read_to < step and len(log.step) and log.step[0] <= read_to:
            begun = log.step[1:][np.diff(log.step) > 1]
            episodes += int(((begun > read_to) & (begun <= step)).sum())
            more = questions_in(log, read_to + 1, step)
            end += len(more.step)
            asked = asked + self._counted(self._places_of(more))
            read_to = step
        return Counted(episodes, end, asked.reshape(self._shape), read_to)
