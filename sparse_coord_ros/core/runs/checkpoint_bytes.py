# Copyright 2026 The sparse_coord_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Checkpoints as bytes: the state to continue a run from, as one .npz file.

Arrays beside those of `base.npz`: `run`, a digest of what the run computes, and whatever the
caller adds. A file of another run is refused.

For robot k from 1 there is what it remembers, as in `core.runs.saved_tables`. Of G games:
`transitions`, `step`, `under_way`, `episode_start`, each of shape (G,), `cells` and `arrived`,
(G, K): the fields of `core.game.world.Position`.
"""

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from sparse_coord_ros.base import npz
from sparse_coord_ros.base.errors import RunError
from sparse_coord_ros.base.files import read_file
from sparse_coord_ros.core.game.scenario import Scenario
from sparse_coord_ros.core.game.world import Position, before_episode


class BrokenCheckpointError(RunError):
    """A checkpoint is there, but cannot be read; an earlier one may serve."""


def pack(run: str, arrays: Mapping[str, np.ndarray]) -> bytes:
    """Return the bytes of a checkpoint.

    Args:
        run: a digest of what the run computes.
        arrays: the owner's state.
    """
    return npz.pack({**arrays, "run": np.array(run)}, compressed=False)


def broken(path: Path, problem: object) -> BrokenCheckpointError:
    """Return the error for a checkpoint that cannot be read."""
    return BrokenCheckpointError(
        f"{path}: cannot be read as a checkpoint ({problem}); begin the run anew"
    )


def read(path: Path, run: str, *, run_in_words: str) -> dict[str, np.ndarray]:
    """Return the arrays of a checkpoint.

    Args:
        path: its file.
        run: the digest of the run that is to go on.
        run_in_words: the run in words.

    Raises:
        BrokenCheckpointError: it cannot be read.
        RunError: it is of another run, or in another format.
    """
    remedy = "begin the run anew"
    data = read_file(path, BrokenCheckpointError, remedy)
    how: Any = {"error": RunError, "damaged": BrokenCheckpointError, "remedy": remedy}
    arrays = npz.unpack(data, where=str(path), what="a checkpoint", **how)
    saved_run = str(arrays.pop("run", ""))
    if saved_run != run:
        raise RunError(
            f"{path}: is the checkpoint of another run than this one ({run_in_words}); "
            "continue with the scenario, settings, learner and seed of that run"
        )
    return arrays


def position_arrays(positions: Sequence[Position]) -> dict[str, np.ndarray]:
    """Return the positions of games as named arrays."""
    return {
        name: np.array([getattr(p, name) for p in positions])
        for name in Position._fields
    }


def positions_from(
    arrays: Mapping[str, np.ndarray], scenario: Scenario, games: int = 1
) -> tuple[Position, ...]:
    """Return the positions of games from the arrays of `position_arrays`.

    Raises:
        ValueError: something is missing, or has another type or shape than it must have.
    """
    robots = len(scenario.robots)
    like = position_arrays([before_episode(0, 0, robots)] * games)
    fields = [
        npz.member(arrays, name, array.dtype, *array.shape)
        for name, array in like.items()
    ]
    return tuple(
        Position._make([*array, tuple(places), tuple(arrived)])
        for *array, places, arrived in zip(
            *(array.tolist() for array in fields), strict=True
        )
    )
