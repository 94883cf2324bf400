# Copyright 2026 The sparse_coord_ros authors
# SPDX-License-Identifier: Apache-2.0
"""A bag's messages sorted by topic and time step, with notes on errors in them."""

from pathlib import Path
from typing import NamedTuple

import numpy as np

from sparse_coord_ros.log.bags import segments
from sparse_coord_ros.log.bags.reader import Bag, open_bag
from sparse_coord_ros.log.runlog.bag_run import BagRun, find_run
from sparse_coord_ros.log.runlog.columns import Columns, Forms, Only, Reading
from sparse_coord_ros.log.runlog.difference import Difference
from sparse_coord_ros.log.runlog.recorded_tables import RecordedTables, recorded_tables
from sparse_coord_ros.protocol import wire
from sparse_coord_ros.protocol.wire import RunState, messages
from sparse_coord_ros.protocol.wire.status import RunStatus, read_status

COMPARED = (wire.LOCAL_STATE, wire.REWARD, wire.ACTION, wire.PERCEPT)
"""The topics with one message a robot and time step, which `verify` compares."""


class Series(NamedTuple):
    """The messages of a topic with one message a time step.

    Attributes:
        step: their time steps, ascending, shape (n,).
        rows: their contents, shape (n,).
    """

    step: np.ndarray
    rows: np.ndarray


class RunMessages:
    """A bag's messages of a run, sorted; without the tables, which `add_tables` reads.

    Args:
        bag: the bag, or a part of one.
        found: its run.
        only: the topics to read, the others seem to have no messages; None: all.

    Attributes:
        bag: the bag.
        run: the run.
        names: the robots.
        segments: for each file of the bag the checkpoint at which it begins (`segments.begins`).
        states, rewards, actions, percepts: the messages of each robot. Rows of states have `xy`;
            of rewards and actions `numbers`, in the order of their labels; of percepts `count`
            positions `places`, the own one first.
        coordination_maps: time steps and rows of each robot's maps, with the grid's `data`.
        statuses: the world's statuses, in the order of the log.
        tables: the robots' tables.
        problems: unreadable messages and tables, and messages of a time step that contradict each
            other.
    """

    def __init__(self, bag: Bag, found: BagRun, only: Only = None) -> None:
        self.bag = bag
        self.run = found.run
        self.names = tuple(robot.name for robot in self.run.scenario.robots)
        self.segments = segments.begins(bag)
        self.tables: list[RecordedTables] = []
        self.problems: list[Difference] = []
        self._prefix = found.prefix
        self._period = messages.Messages(self.run).period
        columns = Columns(bag, self._forms(), only)
        self._files = columns.rows
        self._note_unreadable(columns)
        robots = range(len(self.names))
        self.states = [self._series(wire.LOCAL_STATE, k) for k in robots]
        self.rewards = [self._series(wire.REWARD, k) for k in robots]
        self.actions = [self._series(wire.ACTION, k) for k in robots]
        self.percepts = [self._series(wire.PERCEPT, k) for k in robots]
        self.coordination_maps = [self._maps(k) for k in robots]
        self.statuses = self._statuses()

    def _forms(self) -> Forms:
        """Return the run's topics by their full names, each with its `Reading`."""
        of_robot: dict[wire.Topic, Reading] = {
            wire.LOCAL_STATE: messages.POSE_FORM,
            wire.REWARD: messages.REWARD_FORM,
            wire.ACTION: messages.ACTION_FORM,
            wire.PERCEPT: messages.percept_form(len(self.names)),
            wire.COORDINATION_MAP: messages.grid_form(self.run),
        }
        found: dict[str, tuple[wire.Topic, Reading]] = {}
        for topic, form in of_robot.items():
            for name in self.names:
                found[self._prefix + topic.of(name)] = topic, form
        found[self._prefix + wire.STATUS.name] = wire.STATUS, read_status
        return found

    def _note_unreadable(self, columns: Columns) -> None:
        """Note the unreadable messages of the topics that are compared."""
        for topic in COMPARED:
            for name in self.names:
                full_name = self._prefix + topic.of(name)
                for one in columns.unreadable:
                    if one.topic == full_name:
                        step = one.log_ns // self._period
                        words = f"a message that {one.why}", "a readable one"
                        self.problems.append(Difference(step, name, topic.name, *words))

    def difference(self, step: int, robot: int | None, *words: str) -> Difference:
        """Return a difference.

        Args:
            step: the time step.
            robot: the robot's number, or None.
            words: the quantity, its logged value, its computed value.
        """
        return Difference(step, None if robot is None else self.names[robot], *words)

    def add_tables(self) -> None:
        """Read the robots' tables."""
        self.tables, problems = recorded_tables(self.bag, self.run, self._prefix)
        self.problems += problems

    def of_robot(self, k: int) -> tuple[Series, Series, Series, Series]:
        """Return one robot's states, rewards, actions and percepts."""
        return self.states[k], self.rewards[k], self.actions[k], self.percepts[k]

    def _chained(self, topic: wire.Topic, k: int) -> np.ndarray:
        """Return the rows of a robot's topic in all files, without superseded ones."""
        name = self._prefix + topic.of(self.names[k])
        files = [rows[name] for rows in self._files]
        with_last = topic is wire.LOCAL_STATE
        return segments.chained(files, self.segments, self._period, with_last=with_last)

    def _series(self, topic: wire.Topic, k: int) -> Series:
        """Return a robot's messages on a topic with one message a time step.

        A message may be repeated. Of two different ones of a time step, the first one counts.
        """
        rows = self._chained(topic, k)
        steps = segments.steps_of(rows, self._period)
        for place in np.flatnonzero(rows["ns"] != steps * self._period).tolist():
            logged = f"{rows['ns'][place]} ns"
            due = f"{steps[place] * self._period} ns"
            words = f"{topic.name} stamp", logged, due
            self.problems.append(self.difference(int(steps[place]), k, *words))
        found, first = np.unique(steps, return_index=True)
        for place in np.setdiff1d(np.arange(len(steps)), first).tolist():
            step = steps[place]
            other = rows[first[np.searchsorted(found, step)]]
            if rows[place].tobytes() != other.tobytes():
                words = topic.name, "twice, with different content", "once"
                self.problems.append(self.difference(int(step), k, *words))
        return Series(found, rows[first])

    def _maps(self, k: int) -> tuple[np.ndarray, np.ndarray]:
        """Return the time steps and rows of a robot's coordination maps."""
        rows = self._chained(wire.COORDINATION_MAP, k)
        return segments.steps_of(rows, self._period), rows

    def _statuses(self) -> list[RunStatus]:
        """Return the statuses of the run, without superseded ones.

        A world that has not gone back yet does not know the team's time step.
        """
        found: list[RunStatus] = []
        name = self._prefix + wire.STATUS.name
        for rows, end in zip(self._files, segments.ends(self.segments), strict=True):
            for status in rows[name]:
                of_run = status.run == self.run.id
                knows = status.state != RunState.RESUMING
                if of_run and knows and status.step < end:
                    found.append(status)
        return found


def read_messages(path: Path) -> RunMessages:
    """Read a bag; arguments and errors as of `read_run`."""
    bag = open_bag(path)
    read = RunMessages(bag, find_run(bag))
    read.add_tables()
    return read
