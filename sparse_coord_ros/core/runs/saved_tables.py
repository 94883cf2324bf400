# Copyright 2026 The sparse_coord_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Learned tables as bytes and on disk: `tables.npz` of a team, or one file for each robot.

The container is that of `base.npz`. Of robot k (from 1) there is each field of its learner's mind
(`core.learners.mind`) as an array `<field>_k`: `q_star_k`, shape (cells, actions), columns north,
south, east, west, COORDINATE; `updates_k`, how often each entry was updated; and so on. A table of
rows such as Q^C is three arrays: `q_coord_keys_k`, shape (rows,), ascending, `q_coord_values_k`
and `q_coord_updates_k`, shape (rows, moves): the rows that were learned. The key of a joint state
is a number whose digits, in base cells, are the own cell and then those of the perceived peers.

Cells are numbered row by row from the top left, free cells only.
"""

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from sparse_coord_ros.base import npz
from sparse_coord_ros.base.errors import TablesError, retold
from sparse_coord_ros.base.files import read_file, write_whole
from sparse_coord_ros.core.game.actions import ACTIONS
from sparse_coord_ros.core.game.scenario import Scenario
from sparse_coord_ros.core.learners.learner import Learner
from sparse_coord_ros.core.learners.memory import check_memory
from sparse_coord_ros.core.learners.mind import Memory
from sparse_coord_ros.core.learners.tables import Tables

TEAM_FILE = "tables.npz"

COUNT = "count."
"""What the names of the numbers beside the tables begin with: no field of a mind has a dot."""

REMEDY = "use a file that run or train wrote"


def robot_file(directory: Path, robot: str) -> Path:
    """Return the path where a robot node saves its own tables."""
    return directory / f"tables_{robot}.npz"


def pack_tables(
    memories: Mapping[int, Memory], *, counts: Mapping[str, int] | None = None
) -> bytes:
    """Return the memories of some robots (numbers from 1) as the bytes of an .npz file.

    Equal memories give equal bytes.

    Args:
        memories: each robot's memory.
        counts: numbers to store beside them, as arrays `count.<name>`.
    """
    return npz.pack(saved_arrays(memories, counts=counts))


def saved_arrays(
    memories: Mapping[int, Memory], *, counts: Mapping[str, int] | None = None
) -> dict[str, np.ndarray]:
    """Return the arrays that `pack_tables` writes, by name; arguments as there."""
    arrays: dict[str, np.ndarray] = {}
    for number, memory in memories.items():
        arrays |= {f"{name}_{number}": array for name, array in memory.items()}
    for name, count in (counts or {}).items():
        arrays[f"{COUNT}{name}"] = np.array(count, dtype=np.int64)
    return arrays


class SavedTables(NamedTuple):
    """The saved tables of one robot.

    Attributes:
        memory: its memory; not checked.
        counts: the numbers beside its tables.
        arrays: all that the file holds, by name: of each robot in it, and the counts.
    """

    memory: Memory
    counts: dict[str, int]
    arrays: Mapping[str, np.ndarray]


def unpack_saved(
    data: bytes, numbers: Sequence[int], *, where: str
) -> list[SavedTables]:
    """Read the saved tables of robots (numbers from 1) from the bytes of an .npz file.

    Raises:
        TablesError: not a tables file, or a robot is not in it; `where` says where they are from.
    """
    how: Any = {"what": "tables", "remedy": REMEDY, "error": TablesError}
    arrays = npz.unpack(data, where=where, **how)
    with retold(TablesError, ValueError, where, f"; {REMEDY}"):
        counts = {
            name.removeprefix(COUNT): int(npz.member(arrays, name, np.int64))
            for name in arrays
            if name.startswith(COUNT)
        }
        return [SavedTables(memory_from(arrays, k), counts, arrays) for k in numbers]


def memory_from(arrays: Mapping[str, np.ndarray], number: int) -> dict[str, np.ndarray]:
    """Return the memory of a robot (from 1) from the arrays of a file.

    Raises:
        ValueError: it is not there, or has no Q*.
    """
    ending = f"_{number}"
    memory = {
        name.removesuffix(ending): array
        for name, array in arrays.items()
        if name.endswith(ending) and not name.startswith(COUNT)
    }
    if "q_star" not in memory:
        raise ValueError(f"has no q_star{ending}")
    npz.member(memory, "q_star", np.float64, None, len(ACTIONS))
    return memory


def load_saved(path: Path, numbers: Sequence[int]) -> list[SavedTables]:
    """Read the saved tables of robots (numbers from 1) from one file.

    Raises:
        TablesError: no such file, not a tables file, or a robot is not in it.
    """
    data = read_file(path, TablesError, REMEDY)
    return unpack_saved(data, numbers, where=str(path))


def save_team(directory: Path, memories: Sequence[Memory]) -> None:
    """Write `tables.npz` of a whole team, whole or not at all."""
    data = pack_tables(dict(enumerate(memories, start=1)))
    write_whole(directory / TEAM_FILE, data)


def missing_files(directory: Path, scenario: Scenario) -> list[str]:
    """Return the names of the robots' files that are missing; none if `tables.npz` is there."""
    if (directory / TEAM_FILE).exists():
        return []
    parts = [robot_file(directory, robot.name) for robot in scenario.robots]
    return [part.name for part in parts if not part.exists()]


def load_team(
    directory: Path, scenario: Scenario, learner: Learner | None
) -> list[Tables]:
    """Read a team's tables from an output directory.

    They are in `tables.npz`, or in one file a robot where the robot nodes were started by hand.

    Raises:
        TablesError: neither is there, a file is malformed, or no robot of this scenario and
            learner can have learned what it says.
    """
    numbers = range(1, len(scenario.robots) + 1)
    missing = missing_files(directory, scenario)
    if missing:
        what = f"{directory}: neither {TEAM_FILE} nor {', '.join(missing)} is there"
        raise TablesError(f"{what}; give the output directory of a finished run")
    if (directory / TEAM_FILE).exists():
        saved = load_saved(directory / TEAM_FILE, numbers)
    else:
        parts = [robot_file(directory, robot.name) for robot in scenario.robots]
        saved = [
            load_saved(part, [k])[0] for k, part in zip(numbers, parts, strict=True)
        ]
    with retold(TablesError, TablesError, str(directory)):
        return [
            tables_of(scenario, learner, k, entry.memory)
            for k, entry in enumerate(saved)
        ]


def tables_of(
    scenario: Scenario, learner: Learner | None, k: int, memory: Memory
) -> Tables:
    """Return the tables of a robot from its memory, after a check.

    Args:
        scenario: the problem.
        learner: its learner; None: its code may not be imported.
        k: the robot, from 0.
        memory: the robot's memory, to be checked.

    Raises:
        TablesError: no robot of this scenario and learner can have learned that.
    """
    if learner is not None:
        memory = check_memory(scenario, learner, k, memory)
    cells = len(scenario.map.cells)
    if len(memory["q_star"]) != cells:
        raise TablesError(
            f"q_star has {len(memory['q_star'])} cells, the map has {cells}"
        )
    return Tables(scenario, learner, k, memory)
