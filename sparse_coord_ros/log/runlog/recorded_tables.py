# Copyright 2026 The sparse_coord_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The robots' tables in a bag."""

from collections.abc import Iterator, Mapping
from typing import NamedTuple

import numpy as np

from sparse_coord_ros.base.errors import TablesError
from sparse_coord_ros.core.learners.tables import Tables
from sparse_coord_ros.core.runs.run_config import RunConfig
from sparse_coord_ros.core.runs.tables import tables_of, unpack_saved
from sparse_coord_ros.log.bags import segments
from sparse_coord_ros.log.bags.reader import Bag
from sparse_coord_ros.log.runlog.decode import Decoder
from sparse_coord_ros.log.runlog.difference import Difference
from sparse_coord_ros.protocol import wire
from sparse_coord_ros.protocol.wire.tables import SavedTables, read_tables


class RecordedTables(NamedTuple):
    """One robot's tables in the log.

    Attributes:
        robot: its number from 0.
        step: the robot had learned from everything before this time step.
        tables: the tables.
        counts: the numbers stored beside them.
        arrays: all recorded arrays, by name; empty for computed tables.
    """

    robot: int
    step: int
    tables: Tables
    counts: Mapping[str, int]
    arrays: Mapping[str, np.ndarray]


def saved_tables(
    bag: Bag, run: RunConfig, prefix: str
) -> Iterator[tuple[int, SavedTables]]:
    """Yield the robots' tables in a bag, without superseded ones: the robot from 0, its tables.

    Unreadable messages are left out.
    """
    names = [prefix + wire.TABLES.of(name) for name in run.scenario.names]
    numbers = {name: k for k, name in enumerate(names)}
    first_steps = segments.begins(bag)
    ends = segments.ends(first_steps)
    for place, (begin, end) in enumerate(zip(first_steps, ends, strict=True)):
        decode = Decoder(bag.topics)
        for message in bag.messages(names, [place]):
            try:
                said = read_tables(decode(message.topic, message.data))
            except ValueError:
                continue
            if begin <= said.step < end:
                yield numbers[message.topic], said


def opened(run: RunConfig, robot: int, said: SavedTables) -> RecordedTables:
    """Return a robot's tables; raises TablesError."""
    name = f"tables of {run.scenario.names[robot]} of time step {said.step}"
    [saved] = unpack_saved(said.packed, [robot + 1], where=name)
    tables = tables_of(run.scenario, run.known_rule, robot, saved.memory)
    return RecordedTables(robot, said.step, tables, saved.counts, saved.arrays)


def recorded_tables(
    bag: Bag, run: RunConfig, prefix: str
) -> tuple[list[RecordedTables], list[Difference]]:
    """Return the tables in a bag, and the unreadable ones."""
    found: list[RecordedTables] = []
    problems: list[Difference] = []
    known = set()
    for k, said in saved_tables(bag, run, prefix):
        if (k, said.packed, said.step) in known:
            continue
        known.add((k, said.packed, said.step))
        try:
            found.append(opened(run, k, said))
        except TablesError as error:
            words = wire.TABLES.name, str(error), "readable tables"
            problems.append(Difference(said.step, run.scenario.names[k], *words))
    return found, problems


def checkpoints_in(bag: Bag, run: RunConfig, prefix: str) -> list[int]:
    """Return the time steps before which a bag holds everything.

    These are the steps with tables of all robots that have any.
    """
    robots: dict[int, set[int]] = {}
    for k, said in saved_tables(bag, run, prefix):
        robots.setdefault(said.step, set()).add(k)
    everyone = set().union(*robots.values())
    return sorted(step for step, known in robots.items() if known == everyone)
