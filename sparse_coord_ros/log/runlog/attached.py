# Copyright 2026 The sparse_coord_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The tables of robots that are attached to a bag."""

import re
from collections.abc import Iterator, Mapping
from typing import NamedTuple

import numpy as np

from sparse_coord_ros.base.errors import TablesError
from sparse_coord_ros.core.learners.tables import Tables
from sparse_coord_ros.core.runs.run_config import RunConfig
from sparse_coord_ros.core.runs.tables import tables_of, unpack_saved
from sparse_coord_ros.log.bags import segments
from sparse_coord_ros.log.bags.contents import Attachment
from sparse_coord_ros.log.bags.reader import Bag
from sparse_coord_ros.log.runlog.difference import Difference
from sparse_coord_ros.protocol import wire

NAME = re.compile(
    wire.tables_attachment("(.+)", "(0|[1-9][0-9]{0,17})").replace(".npz", r"\.npz"),
    re.ASCII,
)


class RecordedTables(NamedTuple):
    """One robot's tables in the log.

    Attributes:
        robot: its number from 0.
        step: the robot had learned from everything before this time step.
        tables: the tables.
        counts: the numbers stored beside them.
        arrays: all attached arrays, by name; empty for computed tables.
    """

    robot: int
    step: int
    tables: Tables
    counts: Mapping[str, int]
    arrays: Mapping[str, np.ndarray]


def attached_tables(bag: Bag, run: RunConfig) -> Iterator[tuple[int, int, Attachment]]:
    """Yield the attached tables of the run's robots, without superseded ones.

    Yields:
        The robot from 0, the time step, the attachment.
    """
    robots = run.scenario.names
    first_steps = segments.begins(bag)
    bounds = zip(bag.files, first_steps, segments.ends(first_steps), strict=True)
    for file, begin, end in bounds:
        for attachment in file.attachments:
            match = NAME.fullmatch(attachment.name)
            if match is not None and match[1] in robots:
                step = int(match[2])
                if begin <= step < end:
                    yield robots.index(match[1]), step, attachment


def read_tables(
    bag: Bag, run: RunConfig
) -> tuple[list[RecordedTables], list[Difference]]:
    """Return the attachments tables/<robot>_<step>.npz, and the unreadable ones."""
    found: list[RecordedTables] = []
    problems: list[Difference] = []
    for k, step, attachment in attached_tables(bag, run):
        try:
            [saved] = unpack_saved(attachment.data, [k + 1], where=attachment.name)
            tables = tables_of(run.scenario, run.known_rule, k, saved.memory)
        except TablesError as error:
            words = wire.TABLES.name, str(error), "readable tables"
            problems.append(Difference(step, run.scenario.names[k], *words))
            continue
        found.append(RecordedTables(k, step, tables, saved.counts, saved.arrays))
    return found, problems
