# Copyright 2026 The sparse_coord_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Checkpoints as bytes: what somebody needs to go on with a run, as one .npz file.

Arrays: `format`; `version`, of the software; `run`, a digest of what the run computes; whatever
the caller adds; `digest`, the SHA-256 of all these (names, dtypes, shapes and bytes, in the order
of the names). A file that does not fit its digest, its run or the version is refused.

For robot k from 1: `q_star_k`, `star_updates_k`, `states_k`, `values_k`, `updates_k`: the fields
of `learn.agent.Memory`; `more_k_...`: what is in its `more`. Of G games: `transitions`, `step`,
`under_way`, `episode_start`, each of shape (G,), `cells` and `arrived`, (G, K): the fields of
`game.world.Position`.
"""

import hashlib
import io
import json
from collections.abc import Mapping, Sequence

import numpy as np

from sparse_coord_ros.errors import RunError, newer_format
from sparse_coord_ros.game.world import Position
from sparse_coord_ros.learn.agent import Memory
from sparse_coord_ros.version import __version__

FORMAT = 1


class BrokenCheckpointError(RunError):
    """A checkpoint is there, but cannot be read; an earlier one may serve."""


def pack(run: str, arrays: Mapping[str, np.ndarray]) -> bytes:
    """Return the bytes of a checkpoint.

    Args:
        run: a digest of what the run computes.
        arrays: what its owner needs to go on.
    """
    whole = {name: np.asarray(array) for name, array in arrays.items()}
    whole |= {"format": np.array(FORMAT), "version": np.array(__version__), "run": np.array(run)}
    whole["digest"] = np.array(_digest(whole))
    file = io.BytesIO()
    np.savez(file, allow_pickle=False, **whole)
    return file.getvalue()


def unpack(data: bytes, run: str, *, where: str, said: str) -> dict[str, np.ndarray]:
    """Return the arrays of a checkpoint.

    Args:
        data: its bytes.
        run: the digest of the run that is to go on.
        where: its file.
        said: the run in words.

    Raises:
        BrokenCheckpointError: it cannot be read, or does not fit its digest.
        RunError: it is of another run, version or a newer format.
    """
    try:
        with np.load(io.BytesIO(data), allow_pickle=False) as file:
            number = int(file["format"])
            arrays = {name: file[name] for name in file.files} if number <= FORMAT else {}
        if arrays and str(arrays.pop("digest", None)) != _digest(arrays):
            raise ValueError("its contents do not fit its digest")
        version, found = (str(arrays.pop(name, "")) for name in ("version", "run"))
    except Exception as error:  # zip, zlib and NumPy's parser raise what a broken file makes them
        problem = " ".join(str(error).split())
        raise BrokenCheckpointError(
            f"{where}: cannot be read as a checkpoint ({problem}); begin the run anew"
        ) from None
    if number > FORMAT:
        raise RunError(newer_format(where, number, FORMAT))
    if version != __version__:
        raise RunError(
            f"{where}: was written by version {version} of sparse_coord_ros, this is "
            f"{__version__}; go on with that version, or begin the run anew"
        )
    if found != run:
        raise RunError(
            f"{where}: is the checkpoint of another run than this one ({said}); go on with the "
            "scenario, its settings, the learner and the seed that it began with"
        )
    return arrays


def memory_arrays(memory: Memory, k: int) -> dict[str, np.ndarray]:
    """Return what robot k (from 1) has learned as named arrays."""
    whole = memory._asdict()
    more = whole.pop("more")
    arrays = {f"{name}_{k}": array for name, array in whole.items()}
    return arrays | {f"more_{k}_{name}": array for name, array in more.items()}


def memory_from(arrays: Mapping[str, np.ndarray], k: int) -> Memory:
    """Return what `memory_arrays` took apart.

    Raises:
        KeyError, ValueError: it is not there, or makes no sense.
    """
    prefix = f"more_{k}_"
    more = {name.removeprefix(prefix): a for name, a in arrays.items() if name.startswith(prefix)}
    memory = Memory._make([*(arrays[f"{name}_{k}"] for name in Memory._fields[:-1]), more])
    if len({len(memory.states), len(memory.values), len(memory.updates)}) > 1:
        raise ValueError("has rows without their states")
    return memory


def position_arrays(positions: Sequence[Position]) -> dict[str, np.ndarray]:
    """Return where games are as named arrays."""
    return {name: np.array([getattr(p, name) for p in positions]) for name in Position._fields}


def positions_from(
    arrays: Mapping[str, np.ndarray], games: int, robots: int
) -> tuple[Position, ...]:
    """Return what `position_arrays` took apart.

    Raises:
        KeyError, ValueError: it is not there, or is of other games or robots.
    """
    columns = [arrays[name].tolist() for name in Position._fields]
    positions = tuple(
        Position(done, step, under_way, start, tuple(cells), tuple(arrived))
        for done, step, under_way, start, cells, arrived in zip(*columns, strict=True)
    )
    if len(positions) != games or any(len(p.cells) != robots for p in positions):
        raise ValueError("has other robots")
    return positions


def _digest(arrays: Mapping[str, np.ndarray]) -> str:
    """Return a digest of all arrays."""
    said = hashlib.sha256()
    for name in sorted(arrays):
        array = arrays[name]
        said.update(json.dumps([name, array.dtype.str, array.shape]).encode())
        said.update(array.tobytes())
    return said.hexdigest()
