# Copyright 2026 The sparse_coord_ros authors
# SPDX-License-Identifier: Apache-2.0
"""A robot's tables in a log."""

from collections.abc import Mapping
from typing import NamedTuple

import numpy as np

from sparse_coord_ros.core.learners.tables import Tables
from sparse_coord_ros.core.runs.run_config import RunConfig
from sparse_coord_ros.core.runs.tables import tables_of, unpack_saved
from sparse_coord_ros.protocol.wire.tables import PublishedTables


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


def opened(run: RunConfig, robot: int, said: PublishedTables) -> RecordedTables:
    """Return a robot's tables; raises TablesError."""
    name = f"tables of {run.scenario.names[robot]} of time step {said.step}"
    [saved] = unpack_saved(said.packed, [robot + 1], where=name)
    tables = tables_of(run.scenario, run.known_rule, robot, saved.memory)
    return RecordedTables(robot, said.step, tables, saved.counts, saved.arrays)
