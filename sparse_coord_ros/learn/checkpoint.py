# Copyright 2026 The sparse_coord_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Checkpoints as bytes: what somebody needs to go on with a run, as one .npz file.

Arrays beside those of `learn.archive`: `run`, a digest of what the run computes, and whatever the
caller adds. A file of another run is refused.

For robot k from 1: `q_star_k`, `star_updates_k`, `states_k`, `values_k`, `updates_k`: the fields
of `learn.agent.Memory`; `more_k_...`: what is in its `more`. Of G games: `transitions`, `step`,
`under_way`, `episode_start`, each of shape (G,), `cells` and `arrived`, (G, K): the fields of
`game.world.Position`.

`checkpoint.npz` is a learning run that was broken off, for either engine to go on with. It has
the positions of G groups of robots that learn together (one; K for a learner that learns `alone`),
what each robot remembers, `history_g_...`: the fields of `learn.history.History` of group g from
1, and `evaluations`, the text of their evaluations as JSON. The compiled loops trust the numbers,
so a file that does not fit its digest is refused.
"""

import hashlib
import json
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import numpy as np

from sparse_coord_ros.errors import RunError, TablesError
from sparse_coord_ros.files import write_whole
from sparse_coord_ros.game.actions import ACTIONS, PRIMITIVES
from sparse_coord_ros.game.scenario import Scenario
from sparse_coord_ros.game.settings import LARGEST_WHOLE
from sparse_coord_ros.game.world import Position, before_episode
from sparse_coord_ros.learn import archive
from sparse_coord_ros.learn.agent import Memory
from sparse_coord_ros.learn.evaluation import Evaluation, Measure
from sparse_coord_ros.learn.history import history_from
from sparse_coord_ros.learn.learners import Learner, check_memory
from sparse_coord_ros.learn.simulation import LearningState, groups_of
from sparse_coord_ros.limits import ARRAYS, read_file


class BrokenCheckpointError(RunError):
    """A checkpoint is there, but cannot be read; an earlier one may serve."""


def pack(run: str, arrays: Mapping[str, np.ndarray]) -> bytes:
    """Return the bytes of a checkpoint.

    Args:
        run: a digest of what the run computes.
        arrays: what its owner needs to go on.
    """
    return archive.pack({**arrays, "run": np.array(run)}, compressed=False)


def broken(path: Path, problem: object) -> BrokenCheckpointError:
    """Return the error for a checkpoint that cannot be read."""
    return BrokenCheckpointError(
        f"{path}: cannot be read as a checkpoint ({problem}); begin the run anew"
    )


def read(path: Path, run: str, *, said: str) -> dict[str, np.ndarray]:
    """Return the arrays of a checkpoint.

    Args:
        path: its file.
        run: the digest of the run that is to go on.
        said: the run in words.

    Raises:
        BrokenCheckpointError: it cannot be read, or does not fit its digest.
        RunError: it is of another run, or in another format.
    """
    remedy = "begin the run anew"
    data = read_file(path, ARRAYS, BrokenCheckpointError, remedy)
    how: Any = {"error": RunError, "damaged": BrokenCheckpointError, "remedy": remedy}
    arrays = archive.unpack(data, where=str(path), what="a checkpoint", **how)
    found = str(arrays.pop("run", ""))
    if found != run:
        raise RunError(
            f"{path}: is the checkpoint of another run than this one ({said}); go on with the "
            "scenario, its settings, the learner and the seed that it began with"
        )
    return arrays


def memory_arrays(memory: Memory, k: int) -> dict[str, np.ndarray]:
    """Return what robot k (from 1) has learned as named arrays."""
    whole = memory._asdict()
    more = whole.pop("more")
    arrays = {f"{name}_{k}": array for name, array in whole.items()}
    return arrays | {f"more_{k}_{name}": array for name, array in more.items()}


def memory_from(arrays: Mapping[str, np.ndarray], k: int, cells: int | None = None) -> Memory:
    """Return what `memory_arrays` took apart.

    Args:
        arrays: those of a file.
        k: the robot, from 1.
        cells: of the map; None: as many as the tables have.

    Raises:
        ValueError: something is missing, or has another type, shape or range than it must have.
    """

    def take(name: str, kind: Any, *shape: int | None, **range: int) -> np.ndarray:
        return archive.member(arrays, f"{name}_{k}", kind, *shape, **range)

    q_star = take("q_star", np.float64, cells, len(ACTIONS))
    counts = take("star_updates", np.int64, *q_star.shape, below=archive.MOST_UPDATES)
    states = take("states", np.int32, None, None)
    shape = len(states), PRIMITIVES
    values = take("values", np.float64, *shape)
    updates = take("updates", np.int64, *shape, below=archive.MOST_UPDATES)
    prefix = f"more_{k}_"
    more = {name.removeprefix(prefix): a for name, a in arrays.items() if name.startswith(prefix)}
    return Memory(q_star, counts, states, values, updates, more)


def position_arrays(positions: Sequence[Position]) -> dict[str, np.ndarray]:
    """Return where games are as named arrays."""
    return {name: np.array([getattr(p, name) for p in positions]) for name in Position._fields}


def positions_from(
    arrays: Mapping[str, np.ndarray], scenario: Scenario, games: int = 1
) -> tuple[Position, ...]:
    """Return what `position_arrays` took apart: the positions of so many games.

    Raises:
        ValueError: something is missing, or has another type, shape or range than it must have.
    """
    robots, cells = len(scenario.robots), len(scenario.map.cells)
    like = position_arrays([before_episode(0, 0, robots)] * games)
    fields = [
        archive.member(
            arrays, name, one.dtype, *one.shape, below=cells if name == "cells" else LARGEST_WHOLE
        )
        for name, one in like.items()
    ]
    return tuple(
        Position._make([*one, tuple(places), tuple(arrived)])
        for *one, places, arrived in zip(*(array.tolist() for array in fields), strict=True)
    )


CHECKPOINT_FILE = "checkpoint.npz"


@dataclass(frozen=True)
class Checkpoint:
    """A learning run that was broken off.

    Attributes:
        state: where it is.
        evaluations: those so far, as (transitions, evaluation).
        evaluate_every: transitions between two of them; 0: none.
        trials: of each of them.
    """

    state: LearningState
    evaluations: tuple[tuple[int, Evaluation], ...]
    evaluate_every: int
    trials: int

    def save(self, path: Path, scenario: Scenario, learner: Learner, seed: int) -> None:
        """Write the file, whole or not at all."""
        arrays: dict[str, np.ndarray] = {
            "evaluations": np.array(
                json.dumps([self.evaluate_every, self.trials, self.evaluations], default=asdict)
            )
        }
        arrays |= position_arrays(self.state.positions)
        for k, memory in enumerate(self.state.memories, start=1):
            arrays |= memory_arrays(memory, k)
        for g, history in enumerate(self.state.histories, start=1):
            arrays |= {f"history_{g}_{name}": a for name, a in history._asdict().items()}
        write_whole(path, pack(_digest(scenario, learner, seed), arrays))


def load_checkpoint(path: Path, scenario: Scenario, learner: Learner, seed: int) -> Checkpoint:
    """Read a checkpoint of a run.

    Raises:
        RunError: there is none, it cannot be read, or it is that of another run.
    """
    if not path.exists():
        remedy = "only a run that was interrupted can be resumed"
        raise RunError(f"{path}: there is no such file; {remedy}")
    said = f"learner {learner.label}, seed {seed}"
    arrays = read(path, _digest(scenario, learner, seed), said=said)
    robots, groups = len(scenario.robots), len(groups_of(scenario, learner))
    try:
        cells = len(scenario.map.cells)
        memories = [memory_from(arrays, k, cells) for k in range(1, robots + 1)]
        histories = [history_from(arrays, f"history_{g}_") for g in range(1, groups + 1)]
        positions = positions_from(arrays, scenario, groups)
        made = max(position.transitions for position in positions)
        for k, memory in enumerate(memories):
            check_memory(scenario, learner, k, memory)
            if learner.minds is not None:  # compiled loops look step sizes up by these counts
                archive.check_range(memory.star_updates, 0, made + 1, "star_updates")
                if learner.factors is None:
                    archive.check_range(memory.updates, 0, made + 1, "updates")
        state = LearningState(positions, tuple(memories), tuple(histories))
        every, trials, found = json.loads(str(arrays["evaluations"]))
        evaluations = tuple((step, _evaluation(**data)) for step, data in found)
    except (KeyError, ValueError, IndexError, TypeError, TablesError) as error:
        raise broken(path, error) from None
    return Checkpoint(state, evaluations, every, trials)


def _evaluation(trials: int, not_arrived: int, **measures: dict[str, float]) -> Evaluation:
    found = {name: Measure(**numbers) for name, numbers in measures.items()}
    return Evaluation(trials=trials, not_arrived=not_arrived, **found)


def _digest(scenario: Scenario, learner: Learner, seed: int) -> str:
    said = json.dumps([scenario.computation(), learner.label, seed], sort_keys=True)
    return hashlib.sha256(said.encode()).hexdigest()[:16]
