# Copyright 2026 The sparse_coord_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Checkpoints as bytes: what somebody needs to go on with a run, as one .npz file.

Arrays beside those of `learn.archive`: `run`, a digest of what the run computes, and whatever the
caller adds. A file of another run or version is refused.

For robot k from 1: `q_star_k`, `star_updates_k`, `states_k`, `values_k`, `updates_k`: the fields
of `learn.agent.Memory`; `more_k_...`: what is in its `more`. Of G games: `transitions`, `step`,
`under_way`, `episode_start`, each of shape (G,), `cells` and `arrived`, (G, K): the fields of
`game.world.Position`.
"""

from collections.abc import Mapping, Sequence

import numpy as np

from sparse_coord_ros.errors import RunError
from sparse_coord_ros.game.world import Position
from sparse_coord_ros.learn import archive
from sparse_coord_ros.learn.agent import Memory
from sparse_coord_ros.version import __version__


class BrokenCheckpointError(RunError):
    """A checkpoint is there, but cannot be read; an earlier one may serve."""


def pack(run: str, arrays: Mapping[str, np.ndarray]) -> bytes:
    """Return the bytes of a checkpoint.

    Args:
        run: a digest of what the run computes.
        arrays: what its owner needs to go on.
    """
    return archive.pack({**arrays, "run": np.array(run)}, compressed=False)


def unpack(data: bytes, run: str, *, where: str, said: str) -> dict[str, np.ndarray]:
    """Return the arrays of a checkpoint.

    Args:
        data: its bytes.
        run: the digest of the run that is to go on.
        where: its file.
        said: the run in words.

    Raises:
        BrokenCheckpointError: it cannot be read, or does not fit its digest.
        RunError: it is of another run or version.
    """
    how = {"what": "a checkpoint", "remedy": "begin the run anew"}
    arrays, version = archive.unpack(data, where=where, error=BrokenCheckpointError, **how)
    found = str(arrays.pop("run", ""))
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
        KeyError: it is not there.
    """
    prefix = f"more_{k}_"
    more = {name.removeprefix(prefix): a for name, a in arrays.items() if name.startswith(prefix)}
    return Memory._make([*(arrays[f"{name}_{k}"] for name in Memory._fields[:-1]), more])


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
