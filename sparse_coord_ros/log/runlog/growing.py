# Copyright 2026 The sparse_coord_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The log of a bag that may grow, and its learning history, for the page."""

from collections.abc import Callable, Iterator
from pathlib import Path
from typing import NamedTuple

import numpy as np

from sparse_coord_ros.core.runs.history import History
from sparse_coord_ros.log.bags.reader import Bag, bag_files
from sparse_coord_ros.log.runlog.log import RunLog
from sparse_coord_ros.log.runlog.reading import Read, Reader, arrange, find_run, sort

STEPS_AROUND = 500
"""Number of time steps before and after a shown one that are at hand."""


PART_STEPS = 20_000
"""Number of time steps in a part of the history."""


class Questions(NamedTuple):
    """Each COORDINATE of a part of a log, in the order of the time steps; n of them.

    Attributes:
        step: the time step, shape (n,), int64.
        robot: the asking robot, from 0, shape (n,), int64.
        cell: its cell, shape (n,), int64.
    """

    step: np.ndarray
    robot: np.ndarray
    cell: np.ndarray


def questions_in(log: RunLog, first: int, last: int) -> Questions:
    """Return each COORDINATE with a known cell from one time step of a log to another."""
    begin, end = np.searchsorted(log.step, [first, last + 1])
    cells = log.cells[begin:end]
    rows, robots = np.nonzero(log.asked[begin:end] & (cells >= 0))
    return Questions(
        log.step[begin + rows], robots, cells[rows, robots].astype(np.int64)
    )


class Episodes(NamedTuple):
    """The episodes of a part of a log.

    Attributes:
        history: its episodes.
        questions: its questions, those of the last episode included.
        read_to: the last time step of these two.
        log: its time steps, without a last episode that may continue.
        last_step: the last time step of `log`.
        open_step: the first time step of a last episode that may continue, and has to be read
            again; None: all are whole.
    """

    history: History
    questions: Questions
    read_to: int
    log: RunLog
    last_step: int
    open_step: int | None


class GrowingLog:
    """The log of a bag that may still be written.

    Args:
        path: as in `read_run`.
        progress: as in `read_run`, of the first reading.

    Attributes:
        run: the run.
        so_far: all that was read so far.

    Raises:
        BagError: the bag cannot be read, contains no run, or has another format.
        RunError, ScenarioError, SettingError: the run in the bag is not one of this version.
    """

    def __init__(
        self,
        path: Path,
        progress: Callable[[int, int], None] = lambda done, total: None,
    ) -> None:
        self._bag = Bag(bag_files(Path(path)))
        bag_run = find_run(self._bag)
        self.run = bag_run.run
        self._reader = Reader(self._bag, bag_run)
        self.so_far = self._arranged(self._reader.read(progress))

    def _arranged(self, messages: Read) -> RunLog:
        return arrange(self._bag, self.run, sort(messages, self.run))

    def extend(self) -> bool:
        """Read on if the file has grown; return whether it has new messages."""
        before = self._bag.message_count
        last = self._bag.files[-1]
        if last.finished or (
            last.path.exists() and last.path.stat().st_size == last.size
        ):
            return False
        self.so_far = self._arranged(self._reader.read())
        return self._bag.message_count != before

    @property
    def path(self) -> Path:
        """The bag."""
        return self._bag.path

    @property
    def last_file(self) -> Path:
        """The file that grows, if one does."""
        return self._bag.files[-1].path

    @property
    def finished(self) -> bool:
        """True if its recorder closed its last file."""
        return self._bag.finished

    @property
    def damaged(self) -> bool:
        """True if reading has reached damage."""
        return self._bag.damage is not None

    @property
    def last_step(self) -> int:
        """The newest time step."""
        return int(self.so_far.step.max(initial=0))

    @property
    def empty(self) -> bool:
        """True if it contains no time step."""
        return not len(self.so_far.step)

    def around(self, step: int) -> RunLog:
        """Return the time steps around one, or around the newest."""
        step = min(step, self.last_step)
        return self.so_far.between(max(0, step - STEPS_AROUND), step + STEPS_AROUND)

    def episodes(self, begin: int = 0) -> Iterator[Episodes]:
        """Yield the learning history from a time step on, part by part.

        Args:
            begin: the first time step of an episode; 0: that of the log.
        """
        finished = self.finished
        end_of_all = self.last_step
        size = PART_STEPS
        while begin <= end_of_all:
            read_to = min(begin + size, end_of_all)
            at_end = read_to == end_of_all
            log = self.so_far.between(begin, read_to)
            history = log.history()
            if not at_end and history.episodes < 2:
                size = 2 * size  # an episode may be longer
                continue
            size = PART_STEPS
            end = read_to + 1
            open_step = None
            if not at_end:
                end = int(history.first_step[-1])
                read_to = end - 1
                history = history.first(-1)
            elif not finished and history.episodes:
                end = open_step = int(history.first_step[-1])
            questions = questions_in(log, begin, read_to)
            part = log.between(begin, end - 1)
            yield Episodes(history, questions, read_to, part, end - 1, open_step)
            if at_end:
                return
            begin = end
