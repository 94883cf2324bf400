# Copyright 2026 The sparse_coord_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The benchmark of unseen buildings: how near a learner's teams come to the best known.

A building's gap lies between robots on fixed shortest paths, which ignore each other, and the best
known team: with two robots the best asking team found, with more the team of a planner that sees
all robots for free. Neither is an upper bound: a share may exceed 1. Rules and numbers are chosen
on the buildings for tuning. Those for validation show whether these hold elsewhere. Those for the
test are opened once, for the closing figures.
"""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

from sparse_coord_ros.base.dataframes import data_frame
from sparse_coord_ros.base.errors import check_argument
from sparse_coord_ros.core.engine.cluster import SchedulerLike
from sparse_coord_ros.core.game.settings import Setting
from sparse_coord_ros.core.game.unseen import TEAMS
from sparse_coord_ros.core.learners.registry import LearnerLike, chosen_learner
from sparse_coord_ros.studies.catalogue import unseen_conditions
from sparse_coord_ros.studies.runner import (
    ExperimentResults,
    Progress,
    no_progress,
    run_experiment,
    warn,
)
from sparse_coord_ros.studies.standings import Standing, standing, standings
from sparse_coord_ros.studies.store import Say

if TYPE_CHECKING:
    import pandas as pd

TEAM_RUNS = Setting(
    "runs", int, 10, "teams that learn in each building", low=2, high=1_000_000
)
TEAM_TRIALS = Setting(
    "trials",
    int,
    500,
    "trials of a team of more than two robots",
    low=2,
    high=1_000_000,
)


@dataclass(frozen=True)
class Benchmark:
    """How a learner's teams stand in the unseen buildings.

    Attributes:
        learner: the learner, as it is called in files.
        split: one of `SPLITS` of `core.game.unseen`.
        results: what the conditions brought, one a building.
    """

    learner: str
    split: str
    results: ExperimentResults

    def standings(self, *, by_kind: bool = False) -> dict[str, Standing]:
        """Return how the teams stand, by their robots, such as `2r`.

        Args:
            by_kind: by the kind of their building too, such as `2r door`.
        """
        return standings(self.results.values(), by_kind=by_kind)

    def to_dict(self) -> dict[str, Any]:
        """Return plain data: what `benchmark --json` prints."""
        found = self.standings() | self.standings(by_kind=True)
        return {
            "learner": self.learner,
            "split": self.split,
            "standings": {name: one.to_dict() for name, one in found.items()},
            "buildings": {
                one.scenario.name: standing([one]).to_dict()
                for one in self.results.values()
            },
        }

    def to_pandas(self) -> "pd.DataFrame":
        """Return a data frame: one row a building, its columns as of `Standing` and `building`.

        Raises:
            RunError: pandas is not installed.
        """
        rows = [
            {"building": name, **row}
            for name, row in self.to_dict()["buildings"].items()
        ]
        return data_frame({name: [row[name] for row in rows] for name in rows[0]})


def benchmark(
    learner: LearnerLike = "factored",
    *,
    split: str = "tuning",
    robots: int | Sequence[int] = TEAMS,
    steps: int = 100_000,
    out: str | Path | None = None,
    runs: int = TEAM_RUNS.default,
    trials: int = TEAM_TRIALS.default,
    seed: int = 0,
    engine: str = "auto",
    jobs: int | None = None,
    scheduler: SchedulerLike = None,
    progress: Progress = no_progress,
    say: Say = warn,
    **settings: object,
) -> Benchmark:
    """Judge a learner on generated buildings that no search has seen, at a penalty of -100.

    `Benchmark.standings()` says what share of the gap its teams close: between fixed shortest
    paths and the best known team: with two robots the best asking team found, with more that of a
    planner with full sight.

    Args:
        learner: the learner.
        split: "tuning": the buildings by which rules and numbers are chosen; "validation": those
            by which one looks whether these hold elsewhere; "test": to be opened once, for closing
            figures.
        robots: sizes of teams, of 2, 4 and 8, or one of them.
        steps: step budget of learning, in transitions.
        out: results directory, as of `run_experiment`; None: nothing is saved.
        runs: teams that learn in each building.
        trials: greedy trials of a team; those of two robots are evaluated exactly.
        seed: seed of team 0; team i has seed + i.
        engine: "numba", "python", or "auto": numba where it is installed. The bits are the same.
        jobs: threads (or processes) at once; all cores that this process may use where None.
        scheduler: as of `run_experiment`.
        progress: called with a condition's id, the agent-steps done and those of the whole call.
        say: as of `run_experiment`.
        **settings: settings of learning to change, as of `load_scenario`.

    Raises:
        SettingError: no such learner, split or size of team; a setting that changes the game.
        ResultsError, OSError, RunError, PluginError: as `run_experiment`.
    """
    name = chosen_learner(learner).label
    given = isinstance(robots, int | Iterable)
    check_argument("robots", robots, given, "a size of teams, or a list of them")
    sizes = (robots,) if isinstance(robots, int) else tuple(robots)
    conditions = unseen_conditions(name, split, {"steps": steps, **settings}, sizes)
    results = run_experiment(
        conditions,
        out=out,
        runs=TEAM_RUNS.parse(runs),
        trials=TEAM_TRIALS.parse(trials),
        seed=seed,
        engine=engine,
        jobs=jobs,
        scheduler=scheduler,
        progress=progress,
        say=say,
    )
    return Benchmark(name, split, results)
