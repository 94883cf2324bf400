# Copyright 2026 The sparse_coord_ros authors
# SPDX-License-Identifier: Apache-2.0
"""`checkpoint.npz`: a learning run that was broken off, for either engine to go on with.

The bytes are those of `learn.checkpoint`. Arrays, besides the positions of G groups of robots that
learn together (one; K for a learner that learns `alone`) and what each robot remembers:
`history_g_...`: the fields of `learn.history.History` of group g from 1; and `evaluations`, the
text of their evaluations as JSON. The compiled loops trust the numbers, so a file that does not
fit its digest is refused.
"""

import hashlib
import json
from collections.abc import Mapping
from dataclasses import asdict, dataclass
from pathlib import Path

import numpy as np

from sparse_coord_ros.errors import RunError
from sparse_coord_ros.files import write_whole
from sparse_coord_ros.game.scenario import Scenario
from sparse_coord_ros.learn.checkpoint import (
    BrokenCheckpointError,
    memory_arrays,
    memory_from,
    pack,
    position_arrays,
    positions_from,
    unpack,
)
from sparse_coord_ros.learn.evaluation import Evaluation, Measure
from sparse_coord_ros.learn.history import history_from
from sparse_coord_ros.learn.learners import Learner
from sparse_coord_ros.learn.simulation import LearningState, groups_of

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
    try:
        data = path.read_bytes()
    except FileNotFoundError:
        raise RunError(
            f"{path}: there is no such file; only a run that was interrupted can be resumed"
        ) from None
    except OSError as error:
        raise BrokenCheckpointError(
            f"{path}: cannot be read as a checkpoint ({error.strerror}); begin the run anew"
        ) from None
    said = f"learner {learner.label}, seed {seed}"
    arrays = unpack(data, _digest(scenario, learner, seed), where=str(path), said=said)
    try:
        return _from(arrays, scenario, learner)
    except (KeyError, ValueError, IndexError, TypeError) as error:
        raise BrokenCheckpointError(
            f"{path}: cannot be read as a checkpoint ({error}); begin the run anew"
        ) from None


def _from(file: Mapping[str, np.ndarray], scenario: Scenario, learner: Learner) -> Checkpoint:
    robots = len(scenario.robots)
    groups = len(groups_of(scenario, learner))
    positions = positions_from(file, groups, robots)
    memories = [memory_from(file, k) for k in range(1, robots + 1)]
    histories = [history_from(file, f"history_{g}_") for g in range(1, groups + 1)]
    every, trials, found = json.loads(str(file["evaluations"]))
    evaluations = [(step, _evaluation(**data)) for step, data in found]
    state = LearningState(positions, tuple(memories), tuple(histories))
    return Checkpoint(state, tuple(evaluations), every, trials)


def _evaluation(trials: int, not_arrived: int, **measures: dict[str, float]) -> Evaluation:
    found = {name: Measure(**numbers) for name, numbers in measures.items()}
    return Evaluation(trials=trials, not_arrived=not_arrived, **found)


def _digest(scenario: Scenario, learner: Learner, seed: int) -> str:
    said = json.dumps([scenario.computation(), learner.label, seed], sort_keys=True)
    return hashlib.sha256(said.encode()).hexdigest()[:16]
