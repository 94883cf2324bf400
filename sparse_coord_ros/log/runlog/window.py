# Copyright 2026 The sparse_coord_ros authors
# SPDX-License-Identifier: Apache-2.0
"""A part of a long log, read separately; the learning history of a log, part by part."""

from collections.abc import Collection, Iterator
from pathlib import Path
from typing import NamedTuple

import numpy as np

from sparse_coord_ros.core.runs.history import History
from sparse_coord_ros.core.runs.run_config import RunConfig
from sparse_coord_ros.log.bags import segments
from sparse_coord_ros.log.bags.contents import Block
from sparse_coord_ros.log.bags.reader import Bag, open_bag
from sparse_coord_ros.log.runlog.bag_run import find_run
from sparse_coord_ros.log.runlog.log import RunLog
from sparse_coord_ros.log.runlog.recorded_tables import (
    RecordedTables,
    opened,
    saved_tables,
)
from sparse_coord_ros.log.runlog.run_messages import RunMessages
from sparse_coord_ros.protocol import wire
from sparse_coord_ros.protocol.wire.messages import Messages
from sparse_coord_ros.protocol.wire.tables import SavedTables

MOVES = (wire.LOCAL_STATE, wire.REWARD, wire.ACTION)
"""The topics from which the history is computed."""

STEPS_AROUND = 500
"""Number of time steps that are read before and after a shown one."""

BYTES_AT_ONCE = 500_000
"""Number of the file's bytes in a part of the history."""


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
            again;
            None: all are whole.
    """

    history: History
    questions: Questions
    read_to: int
    log: RunLog
    last_step: int
    open_step: int | None


class LongLog:
    """A bag of any length, read in parts.

    Superseded messages are left out. A damaged bag is read up to the damage.

    Args:
        path: as in `read_run`.

    Attributes:
        bag: the bag, with the places of its messages.
        run: the run.
        period: nanoseconds a time step.

    Raises:
        BagError: the bag cannot be read, contains no run, or has another format.
        RunError, ScenarioError, SettingError: the run in the bag is not one of this version.
    """

    def __init__(self, path: Path) -> None:
        self.bag = open_bag(path, checked=False)
        try:
            self._source = find_run(self.bag)
        except BaseException:
            self.bag.close()
            raise
        self.run: RunConfig = self._source.run
        self.period = Messages(self.run).period
        self._ends = segments.ends(segments.begins(self.bag))
        self._known: list[dict[int, SavedTables]] = []
        self._known_size = -1

    @property
    def blocks(self) -> list[Block]:
        """The places of the messages in the files, without superseded ones."""
        found = []
        for blocks, last in zip(self.bag.blocks, self._ends, strict=True):
            end_ns = last * self.period
            known = [block for block in blocks if block.start_ns <= end_ns]
            found += [
                block._replace(end_ns=min(block.end_ns, end_ns)) for block in known
            ]
        return found

    @property
    def last_step(self) -> int:
        """The newest time step in the file's blocks."""
        return max((place.end_ns for place in self.blocks), default=0) // self.period

    @property
    def damage(self) -> str | None:
        """One line if reading has reached damage, or the bag has no end; else None."""
        return self.bag.ends_early(f"time step {self.last_step}")

    def read(
        self, first: int, last: int, only: Collection[wire.Topic] | None = None
    ) -> RunLog:
        """Return the time steps from `first` to `last`, of some topics; None: of all."""
        bag = self.bag.between(first * self.period, last * self.period)
        return RunLog(RunMessages(bag, self._source, only)).between(first, last)

    def whole(self, only: Collection[wire.Topic]) -> RunLog:
        """Return all time steps of some topics, and all tables, read once."""
        tracks = RunMessages(Bag(self.bag.files), self._source, only)
        tracks.add_tables()
        return RunLog(tracks)

    def around(self, step: int) -> RunLog:
        """Return the time steps around one, or around the newest."""
        step = min(step, self.last_step)
        return self.read(max(0, step - STEPS_AROUND), step + STEPS_AROUND)

    def episodes(
        self, begin: int = 0, also: Collection[wire.Topic] = ()
    ) -> Iterator[Episodes]:
        """Yield the learning history from a time step on, part by part.

        Args:
            begin: the first time step of an episode; 0: that of the log.
            also: further topics to read.
        """
        finished = self.bag.finished
        size = 0
        last_ns = 0
        places = [one for one in self.blocks if one.end_ns >= begin * self.period]
        for number, place in enumerate(places, start=1):
            size = size + place.length
            last_ns = max(last_ns, place.end_ns)
            whole = number == len(places)
            if size < BYTES_AT_ONCE and not whole:
                continue
            last = last_ns // self.period
            log = self.read(begin, last, (*MOVES, *also))
            history = log.history()
            size = 0
            end = last + 1
            open_step = None
            read_to = last
            if not whole and history.episodes < 2:
                size = -3 * BYTES_AT_ONCE  # an episode may be longer
                continue
            if not whole:
                end = int(history.first_step[-1])
                read_to = end - 1
                history = history.first(-1)
            elif not finished and history.episodes:
                end = open_step = int(history.first_step[-1])
            questions = questions_in(log, begin, read_to)
            log = log.between(begin, end - 1)
            yield Episodes(history, questions, read_to, log, end - 1, open_step)
            begin = end

    def tables_before(
        self, robot: int, step: int | None = None
    ) -> RecordedTables | None:
        """Return a robot's newest tables of a time step or earlier; None: there are none.

        Args:
            robot: its number from 0.
            step: the time step; None: the newest of all.

        Raises:
            BagError, TablesError: they cannot be read.
        """
        known = self._known_tables()[robot]
        at = max((at for at in known if step is None or at <= step), default=None)
        if at is None:
            return None
        return opened(self.run, robot, known[at])

    @property
    def empty(self) -> bool:
        """True if it contains no time step."""
        return not any(place.end_ns for place in self.blocks)

    def begin(self) -> RunLog:
        """Return the first time steps."""
        ends = [place.end_ns for place in self.blocks if place.end_ns][:2]
        return self.read(0, max(ends) // self.period)

    def table_steps(self) -> list[list[int]]:
        """Return for each robot the time steps of its tables."""
        return [sorted(known) for known in self._known_tables()]

    def _known_tables(self) -> list[dict[int, SavedTables]]:
        """Return each robot's tables, by time step; of equal steps the last."""
        size = sum(file.size for file in self.bag.files)
        if size != self._known_size:
            known: list[dict[int, SavedTables]] = [{} for _ in self.run.scenario.robots]
            for k, said in saved_tables(self.bag, self.run, self._source.prefix):
                known[k][said.step] = said
            self._known = known
            self._known_size = size
        return self._known
