# Copyright 2026 The sparse_coord_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Learned tables as bytes and on disk: `tables.npz` of a team, one file a robot that is apart.

The container is that of `learn.archive`. For robot k (1-based): `q_star_k`, shape (cells,
actions), columns north, south, east, west, COORDINATE; `q_coord_k`, shape (cells, cells, moves),
first index the own cell. Where Q^C is sparse, instead of `q_coord_k`: `q_coord_keys_k`, shape
(rows, robots), the joint states in ascending order, each the own cell and then the peers';
`q_coord_rows_k`, shape (rows, moves), their entries; `q_coord_unseen_k`, what all others read as.
Of a learner that learns in factors (`learn.factors.Factors`): `u_k` and `r_bar_k`, shape (cells,
moves); `w_k`, (cells,); `rho_states_k`, (rows, 3): own cell, number of the peer (from 1) and its
cell, 0 and -1 for failed percepts; `rho_k`, (rows, moves). With two robots `q_coord_k` is there as
well, as the robot acts on it; with more, and on large maps, it is read from the factors, and
`robots_k` says how many there are.

All else that an agent needs to learn on, such as the counts of updates, is there as of
`learn.checkpoint.memory_arrays`. Cells are numbered row by row from the top left, free cells only.
"""

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from sparse_coord_ros.errors import TablesError, retold
from sparse_coord_ros.files import write_whole
from sparse_coord_ros.game.actions import ACTIONS, PRIMITIVES
from sparse_coord_ros.game.scenario import Scenario
from sparse_coord_ros.learn import archive
from sparse_coord_ros.learn.agent import PEER_FROM_1, Memory, Tables
from sparse_coord_ros.learn.archive import check_range
from sparse_coord_ros.learn.checkpoint import memory_arrays, memory_from
from sparse_coord_ros.learn.factors import Factors, check_states, coordination_table
from sparse_coord_ros.learn.sparse import SparseTable
from sparse_coord_ros.limits import ARRAYS, TABLES, Limit, read_file

TEAM_FILE = "tables.npz"

MOST_ROBOTS = 10_000
"""More than a scenario can have."""

COUNT = "count_"
"""What the names of the numbers beside the tables begin with."""

REMEDY = "use a file that run or train wrote"


def robot_file(directory: Path, robot: str) -> Path:
    """Return where a robot node saves its own tables."""
    return directory / f"tables_{robot}.npz"


def pack_tables(
    tables: Mapping[int, Tables],
    *,
    counts: Mapping[str, int] | None = None,
    memories: Mapping[int, Memory] | None = None,
) -> bytes:
    """Return the tables of some robots (numbers from 1) as the bytes of an .npz file.

    Equal tables give equal bytes.

    Args:
        tables: what each robot learned.
        counts: numbers to store beside them, as arrays `count_<name>`.
        memories: what each robot's agent remembers, to learn on from there.
    """
    return archive.pack(saved_arrays(tables, counts=counts, memories=memories))


def saved_arrays(
    tables: Mapping[int, Tables],
    *,
    counts: Mapping[str, int] | None = None,
    memories: Mapping[int, Memory] | None = None,
) -> dict[str, np.ndarray]:
    """Return what `pack_tables` writes, by name; arguments as there."""
    arrays: dict[str, np.ndarray] = {}
    for number, pair in tables.items():
        arrays |= {f"{name}_{number}": array for name, array in pair.arrays().items()}
    for number, memory in (memories or {}).items():
        arrays |= memory_arrays(memory, number)
    for name, count in (counts or {}).items():
        arrays[f"{COUNT}{name}"] = np.array(count, dtype=np.int64)
    return arrays


class SavedTables(NamedTuple):
    """What one robot has saved.

    Attributes:
        tables: what it learned.
        counts: the numbers beside its tables.
        memory: what its agent remembers; None where that was not saved.
        arrays: all that the file holds, by name: of each robot in it, and the counts.
    """

    tables: Tables
    counts: dict[str, int]
    memory: Memory | None
    arrays: Mapping[str, np.ndarray]


def unpack_saved(
    data: bytes, numbers: Sequence[int], *, where: str, limit: Limit = ARRAYS
) -> list[SavedTables]:
    """Read what the given robots (numbers from 1) saved from the bytes of an .npz file.

    Raises:
        TablesError: not a tables file, or a robot is not in it; `where` says where they are from.
    """
    how: Any = {"what": "tables", "remedy": REMEDY, "error": TablesError}
    arrays = archive.unpack(data, where=where, limit=limit, **how)
    with retold(TablesError, ValueError, where, f"; {REMEDY}"):
        counts = {
            name.removeprefix(COUNT): int(archive.member(arrays, name, np.int64))
            for name in arrays
            if name.startswith(COUNT)
        }
        return [
            SavedTables(
                _robot(arrays, k),
                counts,
                memory_from(arrays, k) if f"star_updates_{k}" in arrays else None,
                arrays,
            )
            for k in numbers
        ]


def unpack_robot(data: bytes, number: int, *, where: str) -> tuple[Tables, dict[str, int]]:
    """Read one robot's tables (numbers from 1) and the numbers stored beside them.

    Raises:
        TablesError: as `unpack_saved`.
    """
    [saved] = unpack_saved(data, [number], where=where, limit=TABLES)
    return saved.tables, saved.counts


def load_saved(path: Path, numbers: Sequence[int]) -> list[SavedTables]:
    """Read what the given robots (numbers from 1) saved from one file.

    Raises:
        TablesError: no such file, not a tables file, or a robot is not in it.
    """
    data = read_file(path, ARRAYS, TablesError, REMEDY)
    return unpack_saved(data, numbers, where=str(path))


def save_team(
    directory: Path, tables: Sequence[Tables], memories: Sequence[Memory | None] = ()
) -> None:
    """Write `tables.npz` of a whole team, whole or not at all; arguments as of `pack_tables`."""
    known = {k: memory for k, memory in enumerate(memories, start=1) if memory is not None}
    data = pack_tables(dict(enumerate(tables, start=1)), memories=known)
    write_whole(directory / TEAM_FILE, data)


def load_team(directory: Path, scenario: Scenario) -> list[Tables]:
    """Read a team's tables from an output directory; as `load_saved_team`."""
    return [saved.tables for saved in load_saved_team(directory, scenario)]


def load_memories(directory: Path, scenario: Scenario) -> list[Memory]:
    """Read what a team's agents remember from an output directory.

    Raises:
        TablesError: as `load_saved_team`; or there are tables alone.
    """
    found = [saved.memory for saved in load_saved_team(directory, scenario)]
    known = [memory for memory in found if memory is not None]
    if len(known) < len(found):
        what = f"{directory}: holds tables alone, not what they were learned from"
        raise TablesError(f"{what}; give the directory of the run itself")
    return known


def load_saved_team(directory: Path, scenario: Scenario) -> list[SavedTables]:
    """Read what a team saved in an output directory.

    It is in `tables.npz`, or in one file a robot where the robot nodes were started by hand.

    Raises:
        TablesError: neither is there, or a file is malformed.
    """
    numbers = range(1, len(scenario.robots) + 1)
    if (directory / TEAM_FILE).exists():
        return load_saved(directory / TEAM_FILE, numbers)
    parts = [robot_file(directory, robot.name) for robot in scenario.robots]
    missing = [part.name for part in parts if not part.exists()]
    if missing:
        what = f"{directory}: neither {TEAM_FILE} nor {', '.join(missing)} is there"
        raise TablesError(f"{what}; give the output directory of a finished run")
    return [load_saved(part, [k])[0] for k, part in zip(numbers, parts, strict=True)]


def _robot(arrays: Mapping[str, np.ndarray], number: int) -> Tables:
    """Return one robot's tables.

    Raises:
        ValueError: they are not there, or malformed.
    """

    def take(name: str, kind: Any, *shape: int | None, **range: int) -> np.ndarray:
        return archive.member(arrays, f"{name}_{number}", kind, *shape, **range)

    q_star = take("q_star", np.float64, None, len(ACTIONS))
    cells, factors = len(q_star), None
    if f"u_{number}" in arrays:
        robots = int(take("robots", np.int64)) if f"robots_{number}" in arrays else 2
        u, r_bar = (take(name, np.float64, cells, PRIMITIVES) for name in ("u", "r_bar"))
        states = take("rho_states", np.int32, None, 3) - PEER_FROM_1
        rho = take("rho", np.float64, len(states), PRIMITIVES)
        check_states(states, cells, robots)
        factors = Factors(u, r_bar, take("w", np.float64, cells), states, rho)
        if f"robots_{number}" in arrays:
            check_range(np.array(robots), max(number, 2), MOST_ROBOTS, "robots")
            return Tables(q_star, coordination_table(factors, number - 1, robots), factors)
    if f"q_coord_keys_{number}" not in arrays:
        agents = np.ndim(arrays.get(f"q_coord_{number}", 0)) - 1
        q_coord = take("q_coord", np.float64, *(cells,) * agents, PRIMITIVES)
        return Tables(q_star, q_coord, factors)
    keys = take("q_coord_keys", np.int32, None, None, below=cells)
    check_range(np.array(keys.shape[1]), 1, MOST_ROBOTS, "robots")
    rows = take("q_coord_rows", np.float64, len(keys), PRIMITIVES)
    unseen = float(take("q_coord_unseen", np.float64))
    return Tables(q_star, SparseTable(cells, keys.shape[1], unseen, keys, rows))
