# Copyright 2026 The sparse_coord_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The benchmark of unseen buildings: how near a learner's teams come to the best known.

A building's gap lies between robots on fixed shortest paths, which ignore each other, and the best
known team: with two robots the best asking team found, with more the team of a planner that sees
all robots for free. Neither is an upper bound: a share may exceed 1. Rules and numbers are chosen
on the buildings for tuning. Those for the test are opened once, for the closing figures.
"""

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from sparse_coord_ros.dataframes import data_frame
from sparse_coord_ros.engine.cluster import SchedulerLike
from sparse_coord_ros.errors import check_argument
from sparse_coord_ros.experiments.catalogue import unseen_conditions
from sparse_coord_ros.experiments.runner import (
    SURE,
    ExperimentResults,
    Progress,
    no_progress,
    run_experiment,
    warn,
)
from sparse_coord_ros.experiments.store import ConditionResult, Say
from sparse_coord_ros.game.scenario import Scenario
from sparse_coord_ros.game.settings import Setting
from sparse_coord_ros.game.unseen import TEAMS
from sparse_coord_ros.learn.evaluation import Measure
from sparse_coord_ros.learners.registry import LearnerLike, chosen_learner
from sparse_coord_ros.solve.shipped import known_best

if TYPE_CHECKING:
    import pandas as pd

TEAM_RUNS = Setting("runs", int, 10, "teams that learn in each building", low=2, high=1_000_000)
TEAM_TRIALS = Setting(
    "trials", int, 500, "trials of a team of more than two robots", low=2, high=1_000_000
)

RESAMPLES = 2000
"""Of a bootstrap."""

ARRIVE = 0.999
"""Share of trials in which every robot is to arrive."""


@dataclass(frozen=True)
class Standing:
    """How teams stand in some buildings, each of which counts as much as another.

    Attributes:
        buildings: how many there are.
        teams: teams that learned there.
        paths: worth of fixed shortest paths.
        best_known: value of the best asking team found, or of the route planner.
        reward: total discounted reward; its standard error is that of the teams in just these
            buildings.
        share: share of the pooled gap that is closed: (reward - paths) / (best_known - paths). Its
            standard error is a bootstrap over buildings, and over the teams in each: what other
            buildings of these kinds would change. Of a single building it is that of its teams.
        worst: share of the gap in the building where it is least.
        asks, miscoordinations: of a robot, and of a team, in a trial.
        below: teams that are worth less than shortest paths.
        failed: teams in which some robot fails to arrive in more than one trial of a thousand.
    """

    buildings: int
    teams: int
    paths: float
    best_known: float
    reward: Measure
    share: Measure
    worst: float
    asks: float
    miscoordinations: float
    below: int
    failed: int

    def share_and_failed(self) -> str:
        """Return the share of the gap with its error in percent, and how many teams fail."""
        share = self.share
        percent = f"{100 * share.mean:.1f} % ({100 * share.standard_error:.1f})"
        return f"{percent}; {self.of_teams(self.failed)} fail"

    def of_teams(self, count: int) -> str:
        """Return a number of teams; where it is none, what their share is surely below (95 %)."""
        most = 1.0 - (1.0 - SURE) ** (1.0 / self.teams)
        surely = f" (< {100 * most:.1f} %)" if count == 0 else ""
        return f"{count} of {self.teams}{surely}"

    def to_dict(self) -> dict[str, Any]:
        """Return plain data."""
        said = dict(vars(self))
        for name in ("reward", "share"):
            measure = said[name]
            said[name] = measure.mean
            said[f"{name}_standard_error"] = measure.standard_error
        return said


@dataclass(frozen=True)
class Benchmark:
    """How a learner's teams stand in the unseen buildings.

    Attributes:
        learner: the learner, as it is called in files.
        split: "tuning" or "test".
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
                one.scenario.name: standing([one]).to_dict() for one in self.results.values()
            },
        }

    def to_pandas(self) -> "pd.DataFrame":
        """Return a data frame: one row a building, its columns as of `Standing` and `building`.

        Raises:
            RunError: pandas is not installed.
        """
        rows = [{"building": name, **row} for name, row in self.to_dict()["buildings"].items()]
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
        learner: who learns.
        split: "tuning": the buildings by which rules and numbers are chosen; "test": the others,
            to be opened once, for closing figures.
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


def standings(results: Iterable[ConditionResult], *, by_kind: bool = False) -> dict[str, Standing]:
    """Return how teams stand; arguments as of `Benchmark.standings`."""
    groups: dict[str, list[ConditionResult]] = {}
    for one in results:
        _, kind, team, _ = one.scenario.name.split("-")
        groups.setdefault(f"{team} {kind}" if by_kind else team, []).append(one)
    return {name: standing(own) for name, own in groups.items()}


def standing(
    results: Sequence[ConditionResult],
    best_of: Callable[[Scenario], float | None] = known_best,
) -> Standing:
    """Return how teams of one learner stand in these buildings.

    Args:
        results: of the buildings.
        best_of: returns the value of the best known team of a building.
    """
    rewards = [one.best("reward") for one in results]
    error = float(np.sqrt(sum(one.standard_error**2 for one in rewards))) / len(rewards)
    values = [best_of(one.scenario) for one in results]
    known = np.array([np.nan if value is None else value for value in values])
    paths = [one.reference["reward"] for one in results]
    learned = [one.run_means("reward") for one in results]
    gained = np.array([own.mean() for own in learned]) - paths

    def mean(values: Iterable[float]) -> float:
        return float(np.mean(list(values)))

    return Standing(
        buildings=len(results),
        teams=sum(one.runs for one in results),
        paths=mean(paths),
        best_known=mean(known),
        reward=Measure(mean(one.mean for one in rewards), float("nan"), error),
        share=pooled_share(learned, np.array(paths), known),
        worst=float((gained / (known - paths)).min()),
        asks=mean(one.best("asks").mean for one in results),
        miscoordinations=mean(one.best("miscoordinations").mean for one in results),
        below=sum(int((own < low - 1e-9).sum()) for own, low in zip(learned, paths, strict=True)),
        failed=sum(map(failed_teams, results)),
    )


def pooled_share(learned: Sequence[np.ndarray], low: np.ndarray, high: np.ndarray) -> Measure:
    """Return the share of the pooled gap that teams close, with a bootstrap standard error.

    A resample draws as many buildings with replacement, and in each as many teams. Its draws are
    the same in every call.

    Args:
        learned: the teams' rewards in each building, shape (teams,) each.
        low: where the gap begins in each building, shape (buildings,).
        high: where it ends, shape (buildings,).

    Returns:
        A measure without a spread (NaN).
    """
    rng = np.random.default_rng(0)
    count = len(learned)
    chosen = rng.integers(count, size=(RESAMPLES, count))
    gained = np.zeros((RESAMPLES, count))
    for building, rewards in enumerate(learned):
        places = chosen == building
        teams = rng.integers(len(rewards), size=(int(places.sum()), len(rewards)))
        gained[places] = rewards[teams].mean(axis=1) - low[building]
    shares = gained.sum(axis=1) / (high - low)[chosen].sum(axis=1)
    means = np.array([rewards.mean() for rewards in learned])
    share = float((means - low).sum() / (high - low).sum())
    return Measure(share, float("nan"), float(shares.std(ddof=1)))


def failed_teams(result: ConditionResult) -> int:
    """Return how many teams miss in more than one trial of a thousand; exact where it is known."""
    if result.exact is None:
        return result.failed_teams
    return int((np.array(result.exact["arrived"]) < ARRIVE).sum())
