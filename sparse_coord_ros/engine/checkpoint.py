# Copyright 2026 The sparse_coord_ros authors
# SPDX-License-Identifier: Apache-2.0
"""`checkpoint.npz`: a learning run that was broken off, for either engine to go on with.

Arrays, G groups of robots that learn together (one; K for a learner that learns `alone`), for
group g and robot k from 1: `format`; `run`, a digest of what the run computes; `transitions`,
`step`, `under_way`, `episode_start`, each of shape (G,), `cells` and `arrived`, (G, K): the fields
of `core.world.Position`; `q_star_k`, `star_updates_k`, `states_k`, `values_k`, `updates_k`: those
of `core.agent.Memory`; `factors_..._k`: those of `core.factors.FactorMemory`, where there are
any; `history_g_...`: those of `core.history.History`; `evaluation_steps` (N,)
and `evaluations` (N, 14): trials, mean, spread and standard error of the four measures, trials in
which some robot did not arrive; `evaluate_every` and `trials`; `digest`, the SHA-256 of all these
(names, dtypes, shapes and bytes, in the order of the names): the compiled loops trust their
numbers, so a file that does not fit it is refused.
"""

import hashlib
import io
import json
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from sparse_coord_ros.core.agent import Memory
from sparse_coord_ros.core.evaluation import Evaluation, Measure
from sparse_coord_ros.core.factors import FactorMemory
from sparse_coord_ros.core.history import history_from
from sparse_coord_ros.core.learners import Learner
from sparse_coord_ros.core.scenario import Scenario
from sparse_coord_ros.core.simulation import LearningState, groups_of
from sparse_coord_ros.core.world import Position
from sparse_coord_ros.errors import RunError, newer_format
from sparse_coord_ros.files import write_whole

CHECKPOINT_FILE = "checkpoint.npz"
FORMAT = 1
MEASURES = ("reward", "time_to_goal", "miscoordinations", "asks")


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
            "format": np.array(FORMAT),
            "run": np.array(_digest(scenario, learner, seed)),
            "evaluate_every": np.array(self.evaluate_every),
            "trials": np.array(self.trials),
            "evaluation_steps": np.array([step for step, _ in self.evaluations], dtype=np.int64),
            "evaluations": np.array([_numbers(e) for _, e in self.evaluations]).reshape(-1, 14),
        }
        for name in Position._fields:
            arrays[name] = np.array([getattr(p, name) for p in self.state.positions])
        for k, memory in enumerate(self.state.memories, start=1):
            whole = memory._asdict()
            factors = whole.pop("factors")
            arrays |= {f"{name}_{k}": array for name, array in whole.items()}
            if factors is not None:
                arrays |= {f"factors_{name}_{k}": a for name, a in factors._asdict().items()}
        for g, history in enumerate(self.state.histories, start=1):
            arrays |= {f"history_{g}_{name}": a for name, a in history.arrays().items()}
        arrays["digest"] = np.array(_digest_of_arrays(arrays))
        file = io.BytesIO()
        np.savez(file, allow_pickle=False, **arrays)
        write_whole(path, file.getvalue())


def load_checkpoint(path: Path, scenario: Scenario, learner: Learner, seed: int) -> Checkpoint:
    """Read a checkpoint of a run.

    Raises:
        RunError: there is none, it cannot be read, or it is that of another run.
    """
    try:
        with np.load(path, allow_pickle=False) as file:
            number = int(file["format"])
            if number > FORMAT:
                raise RunError(newer_format(str(path), number, FORMAT))
            arrays = {name: file[name] for name in file.files}
        if str(arrays.pop("digest", None)) != _digest_of_arrays(arrays):
            raise ValueError("its contents do not fit its digest")
        if str(arrays["run"]) != _digest(scenario, learner, seed):
            raise RunError(
                f"{path}: is the checkpoint of another run than this one (learner "
                f"{learner.label}, seed {seed}); go on with the scenario, its settings, the "
                "learner and the seed that it began with"
            )
        return _from(arrays, scenario, learner)
    except RunError:
        raise
    except FileNotFoundError:
        raise RunError(
            f"{path}: there is no such file; only a run that was interrupted can be resumed"
        ) from None
    except Exception as error:  # zip, zlib and NumPy's parser raise what a broken file makes them
        problem = " ".join(str(error).split())
        raise RunError(
            f"{path}: cannot be read as a checkpoint ({problem}); begin the run anew"
        ) from None


def _from(file: Mapping[str, np.ndarray], scenario: Scenario, learner: Learner) -> Checkpoint:
    columns = [file[name].tolist() for name in Position._fields]
    positions = [
        Position(done, step, under_way, start, tuple(cells), tuple(arrived))
        for done, step, under_way, start, cells, arrived in zip(*columns, strict=True)
    ]
    robots = len(scenario.robots)
    groups = len(groups_of(scenario, learner))
    if len(positions) != groups or any(len(p.cells) != robots for p in positions):
        raise ValueError("has other robots")
    memories = [_memory(file, k) for k in range(1, robots + 1)]
    for memory in memories:
        if len({len(memory.states), len(memory.values), len(memory.updates)}) > 1:
            raise ValueError("has rows without their states")
    histories = [history_from(file, f"history_{g}_") for g in range(1, groups + 1)]
    steps, rows = file["evaluation_steps"].tolist(), file["evaluations"]
    evaluations = [
        (step, _evaluation(row)) for step, row in zip(steps, rows.tolist(), strict=True)
    ]
    return Checkpoint(
        LearningState(tuple(positions), tuple(memories), tuple(histories)),
        tuple(evaluations),
        int(file["evaluate_every"]),
        int(file["trials"]),
    )


def _memory(file: Mapping[str, np.ndarray], k: int) -> Memory:
    memory = Memory._make([*(file[f"{name}_{k}"] for name in Memory._fields[:-1]), None])
    if f"factors_tried_{k}" not in file:
        return memory
    return memory._replace(
        factors=FactorMemory(*(file[f"factors_{name}_{k}"] for name in FactorMemory._fields))
    )


def _numbers(evaluation: Evaluation) -> list[float]:
    measures = [getattr(evaluation, name) for name in MEASURES]
    numbers = [n for m in measures for n in (m.mean, m.spread, m.standard_error)]
    return [evaluation.trials, *numbers, evaluation.not_arrived]


def _evaluation(numbers: list[float]) -> Evaluation:
    reward, time_to_goal, miscoordinations, asks = (
        Measure(*numbers[i : i + 3]) for i in range(1, len(numbers) - 1, 3)
    )
    trials, not_arrived = int(numbers[0]), int(numbers[-1])
    return Evaluation(trials, reward, time_to_goal, miscoordinations, asks, not_arrived)


def _digest(scenario: Scenario, learner: Learner, seed: int) -> str:
    said = json.dumps([scenario.computation(), learner.label, seed], sort_keys=True)
    return hashlib.sha256(said.encode()).hexdigest()[:16]


def _digest_of_arrays(arrays: Mapping[str, np.ndarray]) -> str:
    """Return a digest of all arrays but the digest itself."""
    said = hashlib.sha256()
    for name in sorted(arrays):
        array = arrays[name]
        said.update(json.dumps([name, array.dtype.str, array.shape]).encode())
        said.update(array.tobytes())
    return said.hexdigest()
