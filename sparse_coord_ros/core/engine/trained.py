# Copyright 2026 The sparse_coord_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The results of a learning run, from any engine, and its directory."""

import shutil
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from sparse_coord_ros.base.errors import RunError
from sparse_coord_ros.base.files import path_argument, write_whole
from sparse_coord_ros.core.game.scenario import Scenario
from sparse_coord_ros.core.learners.learner import Learner
from sparse_coord_ros.core.learners.tables import Tables
from sparse_coord_ros.core.runs.history import History
from sparse_coord_ros.core.runs.measures import Measures
from sparse_coord_ros.core.runs.run_config import RUN_FILE, create_output, make_run
from sparse_coord_ros.core.runs.saved_tables import save_team


@dataclass(frozen=True, eq=False)
class Training:
    """A learning run: its settings and results.

    Attributes:
        scenario: the problem and its protocol.
        learner: the learner.
        seed: the run's seed.
        engine: "numba" or "python", which computed it; the bits are the same.
        tables: each robot's tables.
        history: one row an episode; none where it was not gathered.
        visited: joint states of Q^C that each robot has updated, shape (robots,), int64.
        transitions: transitions learned from; of a learner that learns `alone`, by each robot.
        evaluations: measures of the team on the way, in trials: `steps`, the transitions before
            them, `peers_seen`, and `Measures.to_dict`.
        measures: what its team earns, as `train_many` finds it: exactly where that is quick, else
            in greedy trials, seeded by the run's seed; None where it was not asked for.
    """

    scenario: Scenario
    learner: Learner
    seed: int
    engine: str
    tables: list[Tables]
    history: History
    visited: np.ndarray
    transitions: int
    evaluations: tuple[dict[str, Any], ...] = ()
    measures: Measures | None = None

    def __repr__(self) -> str:
        """Return a one-line description."""
        done = f"{self.transitions:,} steps, {self.history.episodes:,} episodes"
        return f"<Training {self.scenario.label}; {self.learner.label}, seed {self.seed}; {done}>"

    def save(self, directory: str | Path) -> Path:
        """Write a run's directory, as `sparse_coord train` does: every verb reads it.

        Args:
            directory: it must not exist; nothing is overwritten.

        Returns:
            The directory, with `run.yaml`, `tables.npz` and `history.npz`.

        Raises:
            RunError: it exists already, or cannot be written.
            SettingError: other processes cannot find its perception model, a function.
        """
        run = make_run(self.scenario, {"seed": self.seed, "learner": self.learner})
        text = run.to_yaml()
        folder = create_output(path_argument("directory", directory))
        try:
            write_whole(folder / RUN_FILE, text)
            save_team(folder, [table.memory for table in self.tables])
            self.history.save(folder)
        except BaseException as error:
            shutil.rmtree(folder, ignore_errors=True)  # leave no half of a run
            if isinstance(error, OSError):
                what = (
                    f"output directory {folder}: cannot be written ({error.strerror})"
                )
                raise RunError(f"{what}; choose another") from None
            raise
        return folder
