# Copyright 2026 The sparse_coord_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The tables of robots that are attached to a bag."""

import hashlib
import re
from collections.abc import Iterator, Mapping, Sequence
from typing import NamedTuple

import numpy as np

from sparse_coord_ros.base.errors import TablesError
from sparse_coord_ros.core.learners.tables import Tables
from sparse_coord_ros.core.runs.run_config import RunConfig
from sparse_coord_ros.core.runs.tables import tables_of, unpack_saved
from sparse_coord_ros.log.bags.contents import Attachment
from sparse_coord_ros.log.bags.metadata import RESTARTED
from sparse_coord_ros.log.bags.reader import Bag
from sparse_coord_ros.log.runlog.difference import TWICE, Difference
from sparse_coord_ros.log.runlog.timeline import Rollback, superseded
from sparse_coord_ros.protocol import wire

TABLES = wire.TABLES.name


def _pattern(name: str) -> re.Pattern[str]:
    return re.compile(name.replace(".npz", r"\.npz"), re.ASCII)


NAME = _pattern(wire.tables_attachment("(.+)", "(0|[1-9][0-9]{0,17})"))


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


def attached_tables(
    bag: Bag, run: RunConfig, backs: Sequence[Rollback]
) -> Iterator[tuple[int, Attachment, tuple[int, int] | None]]:
    """Yield the attachments with a name of tables, without superseded ones (roll-backs).

    Yields:
        The place of the file in the bag, the attachment, and (robot from 0, time step); None if it
        belongs to no robot.
    """
    robots = run.scenario.names
    for place, file in enumerate(bag.files):
        for attachment in file.attachments:
            match = NAME.fullmatch(attachment.name)
            if match is not None and match[1] in robots:
                step = int(match[2])
                if not superseded(place, step, backs):
                    yield place, attachment, (robots.index(match[1]), step)
            elif attachment.name.startswith(wire.TABLES_FOLDER):
                yield place, attachment, None


def read_tables(
    bag: Bag, run: RunConfig, backs: Sequence[Rollback] = ()
) -> tuple[list[RecordedTables], list[Difference]]:
    """Return the attachments tables/<robot>_<step>.npz, and their problems.

    Tables that a roll-back superseded are left out. Tables from its checkpoint on may come again.
    """
    found: list[RecordedTables] = []
    problems: list[Difference] = []
    copies = _Copies(bag)
    for in_file, attachment, of in attached_tables(bag, run, backs):
        if of is None:
            problems.append(_of_no_robot(attachment))
            continue
        k, step = of
        robot = run.scenario.names[k]
        again = any(
            back.file == in_file and back.step <= step <= back.until for back in backs
        )
        copy = copies.of(in_file, attachment)
        if copy is not None and not again:
            problems += [Difference(step, robot, TABLES, *words) for words in copy]
            continue
        try:
            [saved] = unpack_saved(attachment.data, [k + 1], where=attachment.name)
            tables = tables_of(run.scenario, run.known_rule, k, saved.memory)
        except TablesError as error:
            problems.append(
                Difference(step, robot, TABLES, str(error), "readable tables")
            )
            continue
        saved_step = saved.counts.get("step")
        if saved_step != step:
            words = f"of time step {saved_step}", f"of {step}"
            problems.append(Difference(step, robot, TABLES, *words))
        found.append(RecordedTables(k, step, tables, saved.counts, saved.arrays))
    return found, problems


def _of_no_robot(attachment: Attachment) -> Difference:
    name = attachment.name
    what = f"attachment {name if len(name) < 100 else f'{name[:60]}...'}"
    return Difference(None, None, what, "of no robot of the run", "of one")


class _Copies:
    """Finds repeated attachments, with the same name and content.

    Args:
        bag: the bag.
    """

    def __init__(self, bag: Bag) -> None:
        self._bag = bag
        self._last_file: dict[tuple[str, bytes], int] = {}

    def of(self, in_file: int, attachment: Attachment) -> list[tuple[str, str]] | None:
        """Return the problems of a copy, as (logged, computed); None: it is the first one.

        A restarted recorder receives the robots' last tables again.

        Args:
            in_file: the place of its file in the bag.
            attachment: the attachment.
        """
        key = attachment.name, hashlib.sha256(attachment.data).digest()
        before = self._last_file.get(key)
        self._last_file[key] = in_file
        if before is None:
            return None
        why = (self._bag.files[in_file].continued or {}).get("why")
        if why == RESTARTED and before != in_file:
            return []
        return [(TWICE, "once")]
