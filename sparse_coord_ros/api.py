# Copyright 2026 The sparse_coord_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The names of the Python API, and its functions; use them as `sparse_coord_ros.<name>`.

A scenario may be given as a `Scenario`, as the name of a shipped one, or as the path of a scenario
file; a learner as a `Learner`, its class, its name, or `module:Class`.
"""

import os
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass
from functools import cached_property
from importlib import import_module
from pathlib import Path
from typing import TYPE_CHECKING, Protocol

import numpy as np

from sparse_coord_ros.dataframes import data_frame
from sparse_coord_ros.engine import training
from sparse_coord_ros.engine.batch import run_batch, uses_numba
from sparse_coord_ros.engine.cluster import check_place, cluster_at
from sparse_coord_ros.engine.training import EVERY, Training
from sparse_coord_ros.errors import RunError, SettingError, SparseCoordError, TablesError, in_short
from sparse_coord_ros.experiments import benchmark as benchmark_module
from sparse_coord_ros.experiments.benchmark import TEAM_RUNS, TEAM_TRIALS, Benchmark, Standing
from sparse_coord_ros.experiments.catalogue import experiment_names
from sparse_coord_ros.experiments.conditions import Condition
from sparse_coord_ros.experiments.runner import (
    ExperimentResults,
    Progress,
    no_progress,
    parse_targets,
    run_targets,
)
from sparse_coord_ros.experiments.store import JOBS, RUNS, SUMS, TRIALS, TRIALS_OR_NONE, Plan
from sparse_coord_ros.game.perception import perception_model, register_perception
from sparse_coord_ros.game.plugins import allow_modules, allow_named
from sparse_coord_ros.game.scenario import Scenario, load_scenario, loaded, scenario_names
from sparse_coord_ros.game.unseen import TEAMS
from sparse_coord_ros.game.world import Reward, RewardWeights
from sparse_coord_ros.learn import evaluation, run_config
from sparse_coord_ros.learn.agent import Agent, Choice, Tables
from sparse_coord_ros.learn.evaluation import Evaluation
from sparse_coord_ros.learn.history import History, blank_history, load_history
from sparse_coord_ros.learn.learners import Learner, learner_of, register_learner
from sparse_coord_ros.learn.run_config import RUN_SETTINGS, RunConfig
from sparse_coord_ros.learn.tables import load_team
from sparse_coord_ros.solve import class_search, exact
from sparse_coord_ros.solve import joint_mdp as joint_mdp_module
from sparse_coord_ros.solve.exact import ExactEvaluation
from sparse_coord_ros.solve.joint_mdp import JointMDP
from sparse_coord_ros.solve.optimum import Optimum, joint_optimum
from sparse_coord_ros.solve.reference import Reference, shortest_path_reference
from sparse_coord_ros.solve.shipped import ClassBound, RobotPolicy, shipped_class_bound

if TYPE_CHECKING:
    import pandas as pd

    from sparse_coord_ros.runlog import RunLog, Verification

# Scenarios
__all__ = ["load_scenario", "scenario_names", "Scenario"]
# Learning
__all__ += ["train", "train_many", "Training", "Runs", "Tables", "History"]
# What it is worth
__all__ += ["evaluate", "evaluate_exact", "Evaluation", "ExactEvaluation"]
__all__ += ["optimum", "shortest_paths", "joint_mdp", "JointMDP"]
__all__ += ["class_bound", "shipped_class_bound", "ClassBound", "RobotPolicy"]
# What is on disk
__all__ += ["load_run", "SavedRun", "read_log", "RunLog", "verify", "Verification"]
# Experiments
__all__ += ["experiment_names", "run_experiment", "ExperimentResults"]
__all__ += ["benchmark", "Benchmark", "Standing"]
# Learners and perception models of one's own
__all__ += ["Learner", "Agent", "Choice", "Reward", "RewardWeights"]
__all__ += ["register_learner", "register_perception", "perception_model"]
# Errors
__all__ += ["SparseCoordError"]

LearnerLike = str | Learner | type[Learner]
ScenarioLike = str | Path | Scenario


class Learned(Protocol):
    """What `evaluate` takes: a `Training`, a `SavedRun`, or whatever has these attributes."""

    @property
    def scenario(self) -> Scenario:
        """The problem."""

    @property
    def learner(self) -> LearnerLike:
        """Who learned."""

    @property
    def tables(self) -> Sequence[Tables]:
        """What each robot learned."""


@dataclass(frozen=True)
class Runs:
    """Independent learning runs of one learner in one scenario, in the order of their seeds.

    Each is a `Training`, with its greedy trials in `trials`.

    Attributes:
        scenario: the problem and its protocol.
        learner: who learned, as it is called in files.
        runs: the runs.
    """

    scenario: Scenario
    learner: str
    runs: tuple[Training, ...]

    def __getitem__(self, place: int) -> Training:
        """Return a run."""
        return self.runs[place]

    def __iter__(self) -> Iterator[Training]:
        """Iterate over the runs."""
        return iter(self.runs)

    def __len__(self) -> int:
        """Return the number of runs."""
        return len(self.runs)

    def to_pandas(self) -> "pd.DataFrame":
        """Return a data frame: one row a run.

        Its columns: `seed`; `reward` (total discounted), `time_to_goal` (steps) and `asks`, means
        over the trials and robots; `miscoordinations`, mean of a trial; `arrived`, share of the
        trials in which every robot arrived.

        Raises:
            RunError: pandas is not installed.
        """
        columns: dict[str, Sequence[object]] = {"seed": [run.seed for run in self.runs]}
        played = [run.trials for run in self.runs if run.trials is not None]
        if played:
            for name in SUMS:
                columns[name] = [float(np.mean(getattr(trials, name))) for trials in played]
            columns["arrived"] = [float(t.arrived.all(axis=1).mean()) for t in played]
        return data_frame(columns)


@dataclass(frozen=True)
class SavedRun:
    """A run in its directory, as `run`, `train`, `reproduce` and `Training.save` write it.

    Attributes:
        directory: where it is.
        config: what the run is: scenario, learner, seed, versions, timing.
    """

    directory: Path
    config: RunConfig

    @property
    def scenario(self) -> Scenario:
        """The problem and its protocol."""
        return self.config.scenario

    @property
    def learner(self) -> Learner:
        """Who learned."""
        return self.config.rule

    @property
    def seed(self) -> int:
        """The run's seed."""
        return self.config.seed

    @cached_property
    def tables(self) -> list[Tables]:
        """What each robot learned.

        Raises:
            TablesError: they are missing or malformed, or do not fit the scenario.
        """
        tables = load_team(self.directory, self.scenario)
        evaluation.check_tables(self.scenario, tables, self.learner)
        return tables

    @cached_property
    def history(self) -> History:
        """What happened in each learning episode.

        Raises:
            RunError: there is no history, or it cannot be read.
        """
        return load_history(self.directory)


def load_run(directory: str | Path, *, allow: str | Iterable[str] = ()) -> SavedRun:
    """Open a run's directory; its tables and its history are read when they are first used.

    Args:
        directory: where it is.
        allow: modules that it may name, with a learner or a perception model of one's own.

    Raises:
        RunError: there is no run, or it is in another format.
        SettingError: its learner or its perception model is missing here.
    """
    allow_modules(allow)
    path = _path("run", directory)
    return SavedRun(path, run_config.load_run(path))


def train(
    scenario: ScenarioLike,
    learner: LearnerLike = "coop",
    *,
    seed: int = 0,
    evaluate_every: int = 0,
    trials: int = 200,
    engine: str = "auto",
    progress: Callable[[int, int], None] = lambda done, budget: None,
) -> Training:
    """Learn once, for the scenario's budget: its setting `steps`, in transitions.

    `Training.history` is what happened in each episode, `Training.save` writes a run's directory.

    Args:
        scenario: the problem and its protocol.
        learner: who learns.
        seed: seed of every random draw.
        evaluate_every: transitions between two evaluations on the way (`Training.evaluations`);
            0: none.
        trials: greedy trials of each of these evaluations.
        engine: "numba", "python", or "auto": what is quicker here. The bits are the same.
        progress: called with the transitions done and the budget, several times a second.

    Raises:
        ScenarioError, SettingError: no such scenario or learner, or a bad setting.
        PluginError: a learner or perception model of the user's own failed.
    """
    rule = _chosen(learner)
    return training.train(
        rule.with_defaults(loaded(scenario)),
        rule,
        RUN_SETTINGS["seed"].parse(seed),
        evaluate_every=EVERY.parse(evaluate_every),
        trials=trials,
        engine=engine,
        progress=progress,
    )


def train_many(
    scenario: ScenarioLike,
    learner: LearnerLike = "coop",
    *,
    runs: int = 20,
    seed: int = 0,
    trials: int = 1000,
    history: bool = True,
    engine: str = "auto",
    jobs: int | None = None,
    scheduler: str | None = None,
    progress: Callable[[int, int], None] = lambda done, runs: None,
) -> Runs:
    """Learn several times, each time with another seed, on all cores.

    Run i is the same, bit for bit, as `train` with seed `seed + i`.

    Args:
        scenario: the problem and its protocol.
        learner: who learns.
        runs: learning runs.
        seed: seed of run 0.
        trials: greedy trials of each run afterwards, seeded by the run's seed; 0: none.
        history: whether each run keeps its learning history; else it has no episodes.
        engine: "numba", "python", or "auto": numba where it is installed. The bits are the same.
        jobs: threads (or processes) at once; all cores that this process may use where None.
        scheduler: address of the scheduler of a Dask cluster that computes; None: this machine.
        progress: called with the runs done and to be done.

    Raises:
        ScenarioError, SettingError: no such scenario or learner, or a bad setting.
        RunError: the cluster cannot be reached, or was lost.
        PluginError: a learner or perception model of the user's own failed.
    """
    rule = _chosen(learner)
    problem = rule.with_defaults(loaded(scenario))
    plan = _plan(seed, runs, trials, no_trials=True)
    jobs = _jobs(jobs)
    check_place(jobs, scheduler)
    used = "numba" if uses_numba(engine, rule) else "python"
    done: list[Training] = []
    with cluster_at(scheduler) as cluster:
        for run in run_batch(
            problem,
            rule,
            plan.seeds,
            trials=plan.trials,
            engine=engine,
            jobs=jobs,
            history=history,
            cluster=cluster,
        ):
            done.append(
                Training(
                    scenario=problem,
                    learner=rule,
                    seed=run.seed,
                    engine=used,
                    tables=run.tables,
                    history=run.history or blank_history(0, len(problem.robots)),
                    visited=run.visited,
                    evaluations=(),
                    transitions=problem.steps,
                    finished=True,
                    trials=run.trials,
                )
            )
            progress(len(done), plan.runs)
    return Runs(problem, rule.label, tuple(done))


def evaluate(
    learned: str | Path | Learned | Sequence[Tables],
    *,
    scenario: ScenarioLike | None = None,
    learner: LearnerLike | None = None,
    trials: int = 1000,
    seed: int = 0,
) -> Evaluation:
    """Play greedy Monte-Carlo trials from the scenario's starts (paper, Section 4).

    Args:
        learned: a `Training`, a `SavedRun` or its directory; or the tables of every robot.
        scenario: the problem to play; needed with tables alone, else that of the learning run.
            Where neither it nor the user chose a setting, the default of the learner holds.
        learner: whose greedy policy acts; the one that learned where None.
        trials: how many trials, >= 1.
        seed: seed of the trials' draws, independent of the draws of learning.

    Returns:
        Mean, spread and standard error of the total discounted reward, of the steps to the goal,
        of the miscoordinations and of the asks.

    Raises:
        TablesError: the tables do not fit the scenario.
    """
    problem, tables, who = _learned(learned, scenario, learner)
    played, seed = evaluation.TRIALS.parse(trials), RUN_SETTINGS["seed"].parse(seed)
    return evaluation.evaluate(problem, tables, trials=played, seed=seed, learner=who)


def evaluate_exact(
    learned: str | Path | Learned | Sequence[Tables],
    *,
    scenario: ScenarioLike | None = None,
    learner: LearnerLike | None = None,
) -> ExactEvaluation:
    """Compute what `evaluate` estimates, for one or two robots: from the joint Markov chain.

    Args:
        learned: a `Training`, a `SavedRun` or its directory; or the tables of every robot.
        scenario: the problem to play; needed with tables alone, else that of the learning run.
            Where neither it nor the user chose a setting, the default of the learner holds.
        learner: whose greedy policy acts; the one that learned where None.

    Returns:
        Mean and spread of the same measures; their standard errors are 0.

    Raises:
        TablesError: the tables do not fit the scenario.
        SettingError: more than two robots, or a learner whose agents act by a rule of their own.
    """
    problem, tables, who = _learned(learned, scenario, learner)
    return exact.evaluate_exact(problem, tables, learner=who)


def optimum(scenario: ScenarioLike) -> Optimum:
    """Return the exact joint optimum: full joint state and action, no cost of asking.

    Its `value` is the total discounted reward from the starts, averaged over the robots. Where the
    joint state space is too large (`exact` is False), it is an upper bound.
    """
    return joint_optimum(loaded(scenario))


def joint_mdp(scenario: ScenarioLike) -> JointMDP:
    """Return the finite MDP whose value `optimum` computes, as arrays for planners.

    One controller sees every robot's cell, chooses every robot's move, and pays nothing for
    asking: `P[a]` holds the probabilities of the next joint state, `R` the expected rewards.

    Raises:
        SettingError: it has more than 100,000 joint states.
    """
    return joint_mdp_module.joint_mdp(loaded(scenario))


def class_bound(
    scenario: ScenarioLike,
    *,
    restarts: int = 20,
    seed: int = 0,
    file: str | Path | None = None,
    progress: Callable[[int, int, float], None] = lambda done, restarts, best: None,
) -> ClassBound:
    """Search for the best team of two robots that has Algorithm 1's form.

    Its `value` is a lower bound of what such a team can be worth: the search may miss the best.
    `shipped_class_bound` returns what was found once for the paper's scenarios.

    Args:
        scenario: a problem of two robots.
        restarts: how often the search begins anew.
        seed: of the search.
        file: a JSON file to keep the search in, and to go on from; None: nothing is kept.
        progress: called after each restart with those done, all, and the best value so far.

    Raises:
        SettingError: not two robots, or a bad value.
        ResultsError: the file is that of another search.
    """
    return class_search.class_bound(
        loaded(scenario),
        restarts=class_search.RESTARTS.parse(restarts),
        seed=RUN_SETTINGS["seed"].parse(seed),
        file=None if file is None else Path(file),
        progress=progress,
    )


def shortest_paths(scenario: ScenarioLike) -> Reference:
    """Return the exact worth of fixed shortest paths that mind nobody (paper, Section 4).

    It is what Indiv. tends to. `reward` (total discounted) and `time_to_goal` (steps) are means
    over the robots, `miscoordinations` is that of a trial.
    """
    return shortest_path_reference(loaded(scenario))


def __getattr__(name: str) -> object:
    """Load what reads logs when its names are first used: it takes as long as all the rest."""
    if name in ("RunLog", "Verification"):
        return getattr(import_module("sparse_coord_ros.runlog"), name)
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")


def read_log(bag: str | Path, *, allow: str | Iterable[str] = ()) -> "RunLog":
    """Read a run's log as arrays: who was where, chose what, asked whom, perceived and got what.

    Args:
        bag: a bag's directory or that of its run, an `.mcap` or an `.mcap.partial`. Of an
            unfinished or damaged file, what can be read before the damage.
        allow: modules that it may name, with a learner or a perception model of one's own.

    Raises:
        BagError: nothing can be read, or the bag holds no run.
        RunError: `bag` is no path.
        SettingError: its learner or its perception model is missing here.
    """
    from sparse_coord_ros.runlog import read_run

    allow_modules(allow)

    return read_run(_path("bag", bag))


def verify(bag: str | Path, *, allow: str | Iterable[str] = ()) -> "Verification":
    """Compute a recorded run again from its seed and its log alone, and compare.

    Its attribute `same` says whether nothing differs, `differences` says what does.

    Args:
        bag: as of `read_log`.
        allow: as of `read_log`.

    Raises:
        BagError, RunError, SettingError: as `read_log`.
    """
    from sparse_coord_ros import runlog

    allow_modules(allow)

    return runlog.verify(_path("bag", bag))


def _path(what: str, value: object) -> Path:
    if not isinstance(value, str | os.PathLike):
        raise RunError(f"{what}: value is {value!r}, allowed: a path, as a text or a Path")
    return Path(value)


def run_experiment(
    what: str | Condition | Iterable[str | Condition],
    *,
    out: str | Path | None = None,
    runs: int = 100,
    trials: int = 1000,
    seed: int = 0,
    report: bool = False,
    engine: str = "auto",
    jobs: int | None = None,
    scheduler: str | None = None,
    progress: Progress = no_progress,
) -> ExperimentResults:
    """Compute experiments or single conditions; with `out`, save them and go on where it stopped.

    Args:
        what: names of experiments (see `experiment_names`), or ids of conditions such as
            "env1/coop/penalty=-20,ask_cost=2": scenario, learner, changed settings.
        out: results directory, as of `sparse_coord reproduce`; None: nothing is saved.
        runs: independent learning runs of a condition.
        trials: greedy trials of each run.
        seed: seed of run 0; run i has seed + i.
        report: write the experiments' tables, figures and text into `out`.
        engine: "numba", "python", or "auto": numba where it is installed. The bits are the same.
        jobs: threads (or processes) at once; all cores that this process may use where None.
        scheduler: address of the scheduler of a Dask cluster that computes; None: this machine.
        progress: called with a condition's id, the agent-steps done and those of the whole call.

    Raises:
        ScenarioError, SettingError: no such experiment, scenario or learner, or a bad setting.
        ResultsError: `out` holds results of something else, or is in use.
        OSError: `out` cannot be written.
        RunError: the cluster cannot be reached, or was lost.
        PluginError: a learner or perception model of the user's own failed.
    """
    asked = [what] if isinstance(what, str | Condition) else list(what)
    if not asked:
        raise SettingError(
            "no experiment is asked for; name at least one, or all: experiment_names()"
        )
    plan = _plan(seed, runs, trials)
    return run_targets(
        parse_targets(asked, plan),
        plan,
        out=None if out is None else Path(out),
        report=report,
        engine=engine,
        jobs=_jobs(jobs),
        scheduler=scheduler,
        progress=progress,
    )


def benchmark(
    learner: LearnerLike = "factored",
    *,
    split: str = "tuning",
    robots: Sequence[int] = TEAMS,
    steps: int = 100_000,
    out: str | Path | None = None,
    runs: int = TEAM_RUNS.default,
    trials: int = TEAM_TRIALS.default,
    seed: int = 0,
    engine: str = "auto",
    jobs: int | None = None,
    scheduler: str | None = None,
    progress: Progress = no_progress,
    **settings: object,
) -> Benchmark:
    """Judge a learner on generated buildings that no search has seen, at a penalty of -100.

    `Benchmark.standings()` says what share of the gap its teams close: between fixed shortest
    paths and, with two robots, the class bound, with more what a planner with full sight reaches.

    Args:
        learner: who learns.
        split: "tuning": the buildings by which rules and numbers are chosen; "test": the others,
            to be opened once, for closing figures.
        robots: sizes of teams, of 2, 4 and 8.
        steps: step budget of learning, in transitions.
        out: results directory, as of `run_experiment`; None: nothing is saved.
        runs: teams that learn in each building.
        trials: greedy trials of a team; those of two robots are evaluated exactly.
        seed: seed of team 0; team i has seed + i.
        engine: "numba", "python", or "auto": numba where it is installed. The bits are the same.
        jobs: threads (or processes) at once; all cores that this process may use where None.
        scheduler: address of the scheduler of a Dask cluster that computes; None: this machine.
        progress: called with a condition's id, the agent-steps done and those of the whole call.
        **settings: settings of learning to change, as of `load_scenario`.

    Raises:
        SettingError: no such learner, split or size of team; a setting that changes the game.
        ResultsError, OSError, RunError, PluginError: as `run_experiment`.
    """
    return benchmark_module.benchmark(
        learner,
        split=split,
        robots=tuple(robots),
        settings={"steps": steps, **settings},
        out=None if out is None else Path(out),
        runs=runs,
        trials=trials,
        seed=RUN_SETTINGS["seed"].parse(seed),
        engine=engine,
        jobs=_jobs(jobs),
        scheduler=scheduler,
        progress=progress,
    )


def _learned(
    learned: str | Path | Learned | Sequence[Tables],
    scenario: ScenarioLike | None,
    learner: LearnerLike | None,
) -> tuple[Scenario, Sequence[Tables], Learner | None]:
    """Return the problem to play, the tables, and who acts on them."""
    run = load_run(learned) if isinstance(learned, str | Path) else learned
    tables = getattr(run, "tables", run)
    if not isinstance(tables, list | tuple) or not all(isinstance(one, Tables) for one in tables):
        raise TablesError(
            f"what was learned: value is {in_short(learned)}, allowed: a Training, a SavedRun, "
            "its directory, or a list of the robots' Tables (of many runs, one: runs[0])"
        )
    learner = getattr(run, "learner", None) if learner is None else learner
    rule = None if learner is None else _chosen(learner)
    if scenario is not None:
        problem = loaded(scenario)
        return problem if rule is None else rule.with_defaults(problem), tables, rule
    own = getattr(run, "scenario", None)
    if own is None:
        raise TablesError("tables alone do not say their scenario; give evaluate(scenario=...)")
    return own, tables, rule


def _chosen(learner: LearnerLike) -> Learner:
    """Return the learner that the caller names, and so allows."""
    allow_named(learner)
    return learner_of(learner)


def _plan(seed: int, runs: int, trials: int, *, no_trials: bool = False) -> Plan:
    played = (TRIALS_OR_NONE if no_trials else TRIALS).parse(trials)
    return Plan(RUN_SETTINGS["seed"].parse(seed), RUNS.parse(runs), played)


def _jobs(jobs: int | None) -> int | None:
    return None if jobs is None else JOBS.parse(jobs)
