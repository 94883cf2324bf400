# Copyright 2026 The sparse_coord_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Learned tables as bytes and on disk: `tables.npz` of a team, one file a robot that is apart.

For robot k (1-based): `q_star_k`, shape (cells, 5), columns north, south, east, west, COORDINATE;
`q_coord_k`, shape (cells, cells, 4), first index the own cell. Where Q^C is sparse, instead of
`q_coord_k`: `q_coord_keys_k`, shape (rows, robots), the joint states in ascending order, each the
own cell and then the peers'; `q_coord_rows_k`, shape (rows, 4), their entries; `q_coord_unseen_k`,
what all others read as. Of a learner that learns in factors (`learn.factors.Factors`):
`u_k` and `r_bar_k`, shape (cells, 4); `w_k`, (cells,); `rho_states_k`, (rows, 3): own cell, number
of the peer (from 1) and its cell, 0 and -1 for failed percepts; `rho_k`, (rows, 4). With two
robots `q_coord_k` is there as well, as the robot acts on it; with more it is read from the
factors, and `robots_k` says how many there are.
Cells are numbered row by row from the top left, free cells only.
"""

import io
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any, TypeVar

import numpy as np

from sparse_coord_ros.errors import TablesError, newer_format
from sparse_coord_ros.files import write_whole
from sparse_coord_ros.game.actions import PRIMITIVES
from sparse_coord_ros.game.scenario import Scenario
from sparse_coord_ros.learn.agent import Tables
from sparse_coord_ros.learn.factors import AdditiveTable, Factors, coordination_table
from sparse_coord_ros.learn.sparse import SparseTable

T = TypeVar("T")

TEAM_FILE = "tables.npz"

FORMAT = 2
"""Number of the format, in the array `format`. Files of 0.1.0 have none: that is format 1, with
the same arrays."""


def robot_file(directory: Path, robot: str) -> Path:
    """Return where a robot node saves its own tables."""
    return directory / f"tables_{robot}.npz"


def pack_tables(tables: Mapping[int, Tables], *, counts: Mapping[str, int] | None = None) -> bytes:
    """Return the tables of some robots (numbers from 1) as the bytes of an .npz file.

    Equal tables give equal bytes.

    Args:
        tables: what each robot learned.
        counts: numbers to store beside them, as arrays `count_<name>`.
    """
    arrays: dict[str, Any] = {"format": np.int64(FORMAT)}
    arrays |= {f"count_{name}": np.int64(count) for name, count in (counts or {}).items()}
    for number, pair in tables.items():
        arrays[f"q_star_{number}"] = pair.q_star
        if pair.factors is not None:
            u, r_bar, w, states, rho = pair.factors
            said = states + np.array([0, 1, 0], dtype=np.int32)
            named = {"u": u, "r_bar": r_bar, "w": w, "rho_states": said, "rho": rho}
            arrays |= {f"{name}_{number}": array for name, array in named.items()}
            if isinstance(pair.q_coord, AdditiveTable):
                arrays[f"robots_{number}"] = np.int64(len(pair.q_coord.shape) - 1)
                continue
        if isinstance(pair.q_coord, SparseTable):
            arrays[f"q_coord_keys_{number}"] = pair.q_coord.keys
            arrays[f"q_coord_rows_{number}"] = pair.q_coord.rows
            arrays[f"q_coord_unseen_{number}"] = np.float64(pair.q_coord.unseen)
        else:
            arrays[f"q_coord_{number}"] = pair.q_coord
    file = io.BytesIO()
    np.savez_compressed(file, **arrays)
    return file.getvalue()


def save_tables(
    path: Path, tables: Mapping[int, Tables], *, counts: Mapping[str, int] | None = None
) -> None:
    """Write what `pack_tables` returns into a file, whole or not at all."""
    write_tables(path, pack_tables(tables, counts=counts))


def write_tables(path: Path, data: bytes) -> None:
    """Write the bytes of tables into a file, whole or not at all."""
    write_whole(path, data)


def save_team(directory: Path, tables: Sequence[Tables]) -> None:
    """Write `tables.npz` of a whole team."""
    save_tables(directory / TEAM_FILE, dict(enumerate(tables, start=1)))


def unpack_tables(data: bytes, numbers: Sequence[int], *, where: str) -> list[Tables]:
    """Read the tables of the given robots (numbers from 1) from the bytes of an .npz file.

    Raises:
        TablesError: not a tables file, or a robot is not in it; `where` says where they are from.
    """
    return _read(data, where, lambda file: [_load_pair(file, k) for k in numbers])


def unpack_robot(data: bytes, number: int, *, where: str) -> tuple[Tables, dict[str, int]]:
    """Read one robot's tables (numbers from 1) and the numbers stored beside them.

    Raises:
        TablesError: as `unpack_tables`, or a number beside them is none.
    """
    return _read(data, where, lambda file: (_load_pair(file, number), _counts(file)))


def unpack_counts(data: bytes, *, where: str = "tables") -> dict[str, int]:
    """Return the numbers stored beside tables in the bytes of an .npz file.

    Raises:
        TablesError: not a tables file, or one of them is no number.
    """
    return _read(data, where, _counts)


def _read(data: bytes, where: str, take: Callable[[Mapping[str, np.ndarray]], T]) -> T:
    """Return what `take` takes out of an .npz file; TablesError for whatever is wrong with it."""
    try:
        with np.load(io.BytesIO(data), allow_pickle=False) as file:
            written = int(file["format"]) if "format" in file else 1
            if written <= FORMAT:
                return take(file)
    except KeyError as error:
        raise TablesError(
            f"{where}: {error.args[0]}; use a file that run or train wrote"
        ) from None
    except Exception as error:  # zip, zlib and NumPy's parser raise what a broken file makes them
        raise _unreadable(where, error) from None
    raise TablesError(newer_format(where, written, FORMAT))


def _counts(file: Mapping[str, np.ndarray]) -> dict[str, int]:
    """Return the numbers `count_<name>`; raise whatever a malformed array makes NumPy raise."""
    counts = {}
    for name in file:
        if name.startswith("count_"):
            if file[name].shape != () or file[name].dtype.kind not in "iu":
                raise ValueError(f"{name} is no whole number")
            counts[name.removeprefix("count_")] = int(file[name])
    return counts


def load_tables(path: Path, numbers: Sequence[int]) -> list[Tables]:
    """Read the tables of the given robots (numbers from 1) from one file.

    Raises:
        TablesError: no such file, not a tables file, or a robot is not in it.
    """
    return unpack_tables(_bytes_of(path), numbers, where=str(path))


def load_counts(path: Path) -> dict[str, int]:
    """Return the numbers stored beside a robot's tables in its file; errors as `load_tables`."""
    return unpack_counts(_bytes_of(path), where=str(path))


def _bytes_of(path: Path) -> bytes:
    try:
        return path.read_bytes()
    except OSError as error:
        raise _unreadable(str(path), error) from None


def _unreadable(where: str, error: Exception) -> TablesError:
    problem = " ".join(str(error).split())
    return TablesError(
        f"{where}: cannot be read as tables ({problem}); use a file that run or train wrote"
    )


def _load_pair(file: Mapping[str, np.ndarray], number: int) -> Tables:
    """Return one robot's tables; raise whatever a malformed array makes NumPy raise."""
    q_star = np.ascontiguousarray(file[f"q_star_{number}"], dtype=np.float64)
    if f"u_{number}" in file:
        return _load_factored(file, number, q_star)
    if f"q_coord_keys_{number}" not in file:
        return Tables(q_star, np.ascontiguousarray(file[f"q_coord_{number}"], dtype=np.float64))
    keys = file[f"q_coord_keys_{number}"].astype(np.int32, casting="safe")
    rows = file[f"q_coord_rows_{number}"].astype(np.float64, casting="safe")
    unseen = float(file[f"q_coord_unseen_{number}"])
    return Tables(q_star, SparseTable(len(q_star), keys.shape[1], unseen, keys, rows))


def _load_factored(file: Mapping[str, np.ndarray], number: int, q_star: np.ndarray) -> Tables:
    """Return tables with their factors; raise whatever a malformed array makes NumPy raise."""
    named = [file[f"{name}_{number}"] for name in ("u", "r_bar", "w", "rho")]
    u, r_bar, w, rho = (array.astype(np.float64, casting="safe") for array in named)
    states = file[f"rho_states_{number}"].astype(np.int32, casting="safe")
    cells = len(q_star)
    robots = int(file[f"robots_{number}"]) if f"robots_{number}" in file else 2
    shapes = (u.shape, r_bar.shape, w.shape, states.shape, rho.shape)
    rows = (len(rho), 3), (len(rho), PRIMITIVES)
    if shapes != ((cells, PRIMITIVES), (cells, PRIMITIVES), (cells,), *rows):
        raise ValueError(f"the factors of robot {number} have shapes {shapes}")
    low, high = states.min(axis=0, initial=0), states.max(axis=0, initial=0)
    if low[0] < 0 or low[1] < 0 or high[0] >= cells or high[1] > robots or high[2] >= cells:
        raise ValueError(f"rho_states_{number} names what is not there")
    factors = Factors(u, r_bar, w, states - np.array([0, 1, 0], dtype=np.int32), rho)
    if robots > 2:
        return Tables(q_star, coordination_table(factors, number - 1, robots), factors)
    q_coord = np.ascontiguousarray(file[f"q_coord_{number}"], dtype=np.float64)
    return Tables(q_star, q_coord, factors)


def load_team(directory: Path, scenario: Scenario) -> list[Tables]:
    """Read a team's tables from an output directory.

    They are in `tables.npz`, or in one file a robot where the robot nodes were started by hand.

    Raises:
        TablesError: neither is there, or a file is malformed.
    """
    numbers = range(1, len(scenario.robots) + 1)
    if (directory / TEAM_FILE).exists():
        return load_tables(directory / TEAM_FILE, numbers)
    parts = [robot_file(directory, robot.name) for robot in scenario.robots]
    missing = [part.name for part in parts if not part.exists()]
    if missing:
        raise TablesError(
            f"{directory}: neither {TEAM_FILE} nor {', '.join(missing)} is there; give the output "
            "directory of a finished run"
        )
    return [load_tables(part, [k])[0] for k, part in zip(numbers, parts, strict=True)]
