# Copyright 2026 The sparse_coord_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The learned tables that are attached to a bag."""

import hashlib
import re
from collections.abc import Iterator, Mapping, Sequence
from typing import NamedTuple

from sparse_coord_ros import wire
from sparse_coord_ros.bags.contents import Attachment
from sparse_coord_ros.bags.metadata import RESTARTED
from sparse_coord_ros.bags.reader import Bag
from sparse_coord_ros.errors import TablesError
from sparse_coord_ros.game.actions import ACTIONS, PRIMITIVES
from sparse_coord_ros.learn.agent import Memory, Tables
from sparse_coord_ros.learn.run_config import RunConfig
from sparse_coord_ros.learn.tables import unpack_saved
from sparse_coord_ros.runlog.difference import Difference
from sparse_coord_ros.runlog.timeline import Rollback, holds

TABLES = wire.TABLES.name
_PATTERN = wire.tables_attachment("(.+)", "(0|[1-9][0-9]{0,17})").replace(".npz", r"\.npz")
NAME = re.compile(_PATTERN, re.ASCII)


class RecordedTables(NamedTuple):
    """One robot's tables in the log.

    Attributes:
        robot: its number from 0.
        step: everything is learned that happened before this time step.
        tables: what it had learned.
        counts: the numbers stored beside them.
        memory: what its agent remembers, to go on from there; None where that was not saved.
    """

    robot: int
    step: int
    tables: Tables
    counts: Mapping[str, int]
    memory: Memory | None = None


def attached_tables(
    bag: Bag, run: RunConfig, backs: Sequence[Rollback]
) -> Iterator[tuple[int, Attachment, tuple[int, int] | None]]:
    """Yield the attachments that are called like tables, but those that a roll-back superseded.

    Each with the place of its file before it, and (robot from 0, time step) after it; None where
    they are of no robot.
    """
    robots = [robot.name for robot in run.scenario.robots]
    for place, file in enumerate(bag.files):
        for attachment in file.attachments:
            match = NAME.fullmatch(attachment.name)
            if match is not None and match[1] in robots:
                step = int(match[2])
                if holds(place, step, backs):
                    yield place, attachment, (robots.index(match[1]), step)
            elif attachment.name.startswith(wire.TABLES_FOLDER):
                yield place, attachment, None


def read_tables(
    bag: Bag, run: RunConfig, backs: Sequence[Rollback] = ()
) -> tuple[list[RecordedTables], list[Difference]]:
    """Return the attachments tables/<robot>_<step>.npz, and what is odd about them.

    Those that a roll-back superseded are left out; those from its checkpoint on come again,
    and to a recorder that was started again the last ones of each robot.
    """
    scenario = run.scenario
    cells = len(scenario.map.cells)
    due = (cells, len(ACTIONS)), (cells,) * scenario.perceived + (PRIMITIVES,)
    found: list[RecordedTables] = []
    problems: list[Difference] = []
    first_file: dict[tuple[str, bytes], int] = {}
    for in_file, attachment, of in attached_tables(bag, run, backs):
        name, data = attachment.name, attachment.data
        if of is None:
            what = f"attachment {name if len(name) < 100 else f'{name[:60]}...'}"
            problems.append(Difference(None, None, what, "of no robot of the run", "of one"))
            continue
        k, step = of
        robot, key = scenario.robots[k].name, (name, hashlib.sha256(data).digest())
        again = any(back.file == in_file and back.step <= step <= back.until for back in backs)
        if key in first_file and not again:
            why = (bag.files[in_file].continued or {}).get("why")
            if why != RESTARTED or first_file[key] == in_file:
                problems.append(Difference(step, robot, TABLES, "twice", "once"))
            continue
        first_file[key] = in_file
        try:
            one = RecordedTables(k, step, *unpack_saved(data, [k + 1], where=name)[0])
            shapes = one.tables.q_star.shape, one.tables.q_coord.shape
            if shapes != due:
                raise TablesError(f"shapes {shapes}, not {due}")
        except TablesError as error:
            problems.append(Difference(step, robot, TABLES, str(error), "readable tables"))
            continue
        if (said := one.counts.get("step")) != step:
            problems.append(Difference(step, robot, TABLES, f"of step {said}", f"of {step}"))
        found.append(one)
    return found, problems
