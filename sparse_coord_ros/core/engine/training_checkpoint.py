# Copyright 2026 The sparse_coord_ros authors
# SPDX-License-Identifier: Apache-2.0
"""`checkpoint.npz`: an interrupted learning run, which either engine can continue.

It holds the positions of G groups of robots that learn together (one group; K groups for a
learner that learns `alone`), each robot's memory, the fields of `core.runs.history.History` of
group g from 1 as `history_g_...`, and the evaluations as JSON in `evaluations`. The container is
that of `core.runs.checkpoint_bytes`.
"""

import hashlib
import json
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from sparse_coord_ros.base.errors import RunError, TablesError
from sparse_coord_ros.base.files import write_whole
from sparse_coord_ros.core.game.scenario import Scenario
from sparse_coord_ros.core.learners.learner import Learner
from sparse_coord_ros.core.learners.memory import check_memory
from sparse_coord_ros.core.learners.mind import Memory
from sparse_coord_ros.core.runs import checkpoint_bytes
from sparse_coord_ros.core.runs.checkpoint_bytes import position_arrays, positions_from
from sparse_coord_ros.core.runs.history import history_from
from sparse_coord_ros.core.runs.run import LearningState
from sparse_coord_ros.core.runs.saved_tables import memory_from, saved_arrays
from sparse_coord_ros.core.runs.team import groups_of

CHECKPOINT_FILE = "checkpoint.npz"


@dataclass(frozen=True)
class Checkpoint:
    """A learning run that was broken off.

    Attributes:
        state: where it is.
        evaluations: those so far, as in `Training`.
        evaluate_every: transitions between two of them; 0: none.
        trials: of each of them.
    """

    state: LearningState
    evaluations: tuple[dict[str, Any], ...]
    evaluate_every: int
    trials: int

    def save(self, path: Path, scenario: Scenario, learner: Learner, seed: int) -> None:
        """Write the file, whole or not at all."""
        arrays: dict[str, np.ndarray] = {
            "evaluations": np.array(
                json.dumps([self.evaluate_every, self.trials, self.evaluations])
            )
        }
        arrays |= position_arrays(self.state.positions)
        arrays |= saved_arrays(dict(enumerate(self.state.memories, start=1)))
        for g, history in enumerate(self.state.histories, start=1):
            arrays |= {
                f"history_{g}_{name}": a for name, a in history._asdict().items()
            }
        write_whole(
            path, checkpoint_bytes.pack(run_digest(scenario, learner, seed), arrays)
        )


def load_checkpoint(
    path: Path, scenario: Scenario, learner: Learner, seed: int
) -> Checkpoint:
    """Read a checkpoint of a run.

    Raises:
        RunError: the file is missing, cannot be read, or belongs to another run.
    """
    if not path.exists():
        remedy = "only a run that was interrupted can be resumed"
        raise RunError(f"{path}: there is no such file; {remedy}")
    run_in_words = f"learner {learner.label}, seed {seed}"
    arrays = checkpoint_bytes.read(
        path, run_digest(scenario, learner, seed), run_in_words=run_in_words
    )
    robots = len(scenario.robots)
    groups = len(groups_of(scenario, learner))
    try:
        memories = [_memory(arrays, scenario, learner, k) for k in range(robots)]
        histories = [
            history_from(arrays, f"history_{g}_") for g in range(1, groups + 1)
        ]
        positions = positions_from(arrays, scenario, groups)
        state = LearningState(positions, tuple(memories), tuple(histories))
        every, trials, rows = json.loads(str(arrays["evaluations"]))
        evaluations = tuple(dict(row) for row in rows)
    except (KeyError, ValueError, IndexError, TypeError, TablesError) as error:
        raise checkpoint_bytes.broken(path, error) from None
    return Checkpoint(state, evaluations, every, trials)


def _memory(
    arrays: Mapping[str, np.ndarray], scenario: Scenario, learner: Learner, k: int
) -> Memory:
    return check_memory(scenario, learner, k, memory_from(arrays, k + 1))


def run_digest(scenario: Scenario, learner: Learner, seed: int) -> str:
    """Return a digest of a run's computation."""
    content = json.dumps([scenario.computation(), learner.label, seed], sort_keys=True)
    return hashlib.sha256(content.encode()).hexdigest()[:16]
