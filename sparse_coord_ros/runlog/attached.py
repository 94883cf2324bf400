# Copyright 2026 The sparse_coord_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The learned tables that are attached to a bag."""

import hashlib
import re
from collections.abc import Iterator, Mapping, Sequence
from typing import NamedTuple

from sparse_coord_ros.bags.contents import Attachment
from sparse_coord_ros.bags.metadata import RESTARTED
from sparse_coord_ros.bags.reader import Bag
from sparse_coord_ros.errors import TablesError
from sparse_coord_ros.game.actions import ACTIONS, PRIMITIVES
from sparse_coord_ros.learn.agent import Tables
from sparse_coord_ros.learn.run_config import RunConfig
from sparse_coord_ros.learn.tables import unpack_robot
from sparse_coord_ros.runlog.difference import Difference
from sparse_coord_ros.runlog.timeline import Rollback, of_last
from sparse_coord_ros.wire import TABLES as TABLES_TOPIC
from sparse_coord_ros.wire import TABLES_FOLDER, tables_attachment

TABLES = TABLES_TOPIC.name
NAME = re.compile(
    tables_attachment("(.+)", "(0|[1-9][0-9]{0,17})").replace(".npz", r"\.npz"), re.ASCII
)


class RecordedTables(NamedTuple):
    """One robot's tables in the log.

    Attributes:
        robot: its number from 0.
        step: everything is learned that happened before this time step.
        tables: what it had learned.
        counts: the numbers stored beside them.
    """

    robot: int
    step: int
    tables: Tables
    counts: Mapping[str, int]


def tables_name(name: str, robots: Sequence[str]) -> tuple[int, int] | None:
    """Return robot (from 0) and time step of tables with that name; None: of no robot's."""
    match = NAME.fullmatch(name)
    if match is None or match[1] not in robots:
        return None
    return robots.index(match[1]), int(match[2])


def read_tables(
    bag: Bag, run: RunConfig, backs: Sequence[Rollback] = ()
) -> tuple[list[RecordedTables], list[Difference]]:
    """Return the attachments tables/<robot>_<step>.npz, and what is odd about them.

    Those that a roll-back superseded are left out; those from its checkpoint on come again,
    and to a recorder that was started again the last ones of each robot.
    """
    robots = [robot.name for robot in run.scenario.robots]
    found, odd = [], []
    first_file: dict[tuple[str, bytes], int] = {}
    for in_file, attachment in _attached(bag):
        name = attachment.name
        of = tables_name(name, robots)
        if of is None:
            what = f"attachment {name if len(name) < 100 else f'{name[:60]}...'}"
            odd.append(Difference(None, None, what, "of no robot of the run", "of one"))
            continue
        k, step = of
        if not of_last([in_file], [step], backs)[0]:
            continue
        data = attachment.data
        key = (name, hashlib.sha256(data).digest())
        if key in first_file and not _of_checkpoint(in_file, step, backs):
            why = (bag.files[in_file].continued or {}).get("why")
            if why != RESTARTED or first_file[key] == in_file:
                odd.append(Difference(step, robots[k], TABLES, "twice", "once"))
            continue
        first_file[key] = in_file
        entry, wrong = _unpacked(data, k, step, name, run)
        found += entry
        odd += wrong
    return found, odd


def _attached(bag: Bag) -> Iterator[tuple[int, Attachment]]:
    """Yield all that is called like tables, with the place of its file."""
    for place, file in enumerate(bag.files):
        for attachment in file.attachments:
            if attachment.name.startswith(TABLES_FOLDER):
                yield place, attachment


def _of_checkpoint(in_file: int, step: int, backs: Sequence[Rollback]) -> bool:
    """Whether tables come again as a file takes the run back: of its checkpoint or later."""
    return any(back.file == in_file and back.step <= step <= back.until for back in backs)


def _unpacked(
    data: bytes, k: int, step: int, name: str, run: RunConfig
) -> tuple[list[RecordedTables], list[Difference]]:
    """Return one robot's tables if they can be read, and what is wrong with them."""
    scenario = run.scenario
    robot, cells = scenario.robots[k].name, len(scenario.map.cells)
    due = (cells, len(ACTIONS)), (cells,) * scenario.perceived + (PRIMITIVES,)
    try:
        tables, counts = unpack_robot(data, k + 1, where=name)
    except TablesError as error:
        return [], [Difference(step, robot, TABLES, str(error), "readable tables")]
    shapes = tables.q_star.shape, tables.q_coord.shape
    if shapes != due:
        logged, computed = (f"shapes {q_star} and {q_coord}" for q_star, q_coord in (shapes, due))
        return [], [Difference(step, robot, TABLES, logged, computed)]
    odd = []
    if counts.get("step") != step:
        odd.append(Difference(step, robot, TABLES, f"of step {counts.get('step')}", f"of {step}"))
    return [RecordedTables(k, step, tables, counts)], odd
