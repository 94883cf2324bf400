# Copyright 2026 The sparse_coord_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The names of the Python API, and its functions; use them as `sparse_coord_ros.<name>`.

A scenario may be given as a `Scenario`, as the name of a shipped one, or as the path of a scenario
file; a learner as a `Learner`, its class, its name, or `module:Class`.
"""

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from importlib import import_module
from itertools import product
from pathlib import Path
from typing import TYPE_CHECKING, Any

from sparse_coord_ros.base.dataframes import data_frame
from sparse_coord_ros.base.errors import (
    RunError,
    SparseCoordError,
    TablesError,
    check_argument,
    check_choice,
    packages_needed,
    wrong_argument,
)
from sparse_coord_ros.base.files import path_argument
from sparse_coord_ros.base.progress import Show, shown
from sparse_coord_ros.core.engine.batch import run_batch
from sparse_coord_ros.core.engine.cluster import SchedulerLike, check_place, cluster_at
from sparse_coord_ros.core.engine.trained import Training
from sparse_coord_ros.core.engine.training import train
from sparse_coord_ros.core.game.perception import perception_model, register_perception
from sparse_coord_ros.core.game.plugins import allow_modules, allow_named
from sparse_coord_ros.core.game.scenario import (
    Scenario,
    ScenarioLike,
    load_scenario,
    loaded,
    refuse_unexpected,
    scenario_names,
)
from sparse_coord_ros.core.game.world import RewardWeights
from sparse_coord_ros.core.learners import rules
from sparse_coord_ros.core.learners.baselines import NonCoop
from sparse_coord_ros.core.learners.coop import Coop
from sparse_coord_ros.core.learners.cq import CQ
from sparse_coord_ros.core.learners.learner import Learner
from sparse_coord_ros.core.learners.registry import (
    LearnerLike,
    chosen_learner,
    register_learner,
)
from sparse_coord_ros.core.learners.tables import Tables
from sparse_coord_ros.core.learners.voi import Voi
from sparse_coord_ros.core.runs import evaluation, run_config
from sparse_coord_ros.core.runs.history import (
    CURVES,
    History,
    load_history,
    mean_curves,
)
from sparse_coord_ros.core.runs.measures import Measures, by_run
from sparse_coord_ros.core.runs.run_config import RUN_SETTINGS, RunConfig
from sparse_coord_ros.core.runs.saved_tables import load_team
from sparse_coord_ros.core.solve import exact
from sparse_coord_ros.core.solve.asking_search import find_asking_team
from sparse_coord_ros.core.solve.optimum import joint_optimum as optimum
from sparse_coord_ros.core.solve.shipped import (
    AskingTeam,
    RobotPolicy,
    shipped_asking_team,
)
from sparse_coord_ros.core.solve.shortest_paths import (
    shortest_paths,
)
from sparse_coord_ros.studies.benchmark import benchmark
from sparse_coord_ros.studies.catalogue import experiment_names
from sparse_coord_ros.studies.condition_result import ConditionResult
from sparse_coord_ros.studies.conditions import make_condition
from sparse_coord_ros.studies.frames import ResultsLike, listed, to_pandas
from sparse_coord_ros.studies.runner import run_experiment
from sparse_coord_ros.studies.store import RUNS, TRIALS_OR_NONE, Plan

if TYPE_CHECKING:
    import pandas as pd
    from matplotlib.figure import Figure

    from sparse_coord_ros.core.pettingzoo_env import SparseCoordEnv
    from sparse_coord_ros.core.vector_env import Seeds, VectorGame
    from sparse_coord_ros.log.runlog import RunLog, Verification

# Scenarios
__all__ = ["load_scenario", "scenario_names", "Scenario"]
# Learning
__all__ += ["train", "train_many", "Training", "Runs", "Tables", "History"]
# What it is worth
__all__ += ["evaluate", "evaluate_exact", "Measures", "by_run"]
__all__ += ["optimum", "shortest_paths"]
__all__ += ["find_asking_team", "shipped_asking_team", "AskingTeam", "RobotPolicy"]
# Environments for other people's learners
__all__ += ["vector_env", "VectorGame", "pettingzoo_env"]
# What is on disk
__all__ += ["load_run", "SavedRun", "read_log", "RunLog", "verify", "Verification"]
# Experiments
__all__ += ["sweep", "experiment_names", "run_experiment", "ConditionResult"]
__all__ += ["to_pandas", "plot", "benchmark"]
# The user's own learners and perception models
__all__ += ["Learner", "Coop", "NonCoop", "Voi", "CQ", "RewardWeights"]
__all__ += ["rules", "register_learner", "register_perception", "perception_model"]
# Errors
__all__ += ["SparseCoordError"]


@dataclass(frozen=True)
class SavedRun:
    """A run in its directory, as `run`, `train`, `reproduce` and `Training.save` write it.

    Attributes:
        directory: where it is.
        config: the run's configuration: scenario, learner, seed, versions, timing.
    """

    directory: Path
    config: RunConfig

    def __repr__(self) -> str:
        """Return a one-line description."""
        who = f"{self.config.learner}, seed {self.seed}"
        return f"<SavedRun {self.scenario.label}; {who}; in {self.directory}>"

    def _repr_html_(self) -> str:
        """Return the same for a notebook, with its policy and its learning curve."""
        return _in_html(self)

    @property
    def scenario(self) -> Scenario:
        """The problem and its protocol."""
        return self.config.scenario

    @property
    def learner(self) -> Learner:
        """The learner."""
        return self.config.rule

    @property
    def seed(self) -> int:
        """The run's seed."""
        return self.config.seed

    @cached_property
    def tables(self) -> list[Tables]:
        """Each robot's tables.

        Raises:
            TablesError: they are missing or malformed, or do not fit the scenario.
        """
        return load_team(self.directory, self.scenario, self.learner)

    @cached_property
    def history(self) -> History:
        """The history of the learning episodes.

        Raises:
            RunError: the history is missing or cannot be read.
        """
        return load_history(self.directory)


def _in_html(run: "Training | SavedRun") -> str:
    """Return a run as notebooks show it."""
    from sparse_coord_ros.show.figures import in_html
    from sparse_coord_ros.show.sources import in_memory, open_run

    if isinstance(run, SavedRun):
        return in_html(repr(run), open_run(run.directory))
    config = run_config.make_run(
        run.scenario, {"seed": run.seed, "learner": run.learner}
    )
    return in_html(repr(run), in_memory(config, run.tables, run.history))


Training._repr_html_ = _in_html  # type: ignore[attr-defined]  # the engine knows no pictures


class Runs(list[Training]):
    """Learning runs of one learner in one scenario, as `train_many` returns them: a list."""

    def __repr__(self) -> str:
        """Return a one-line description."""
        return f"<Runs of {len(self)}: {self[0]!r}, ...>" if self else "<Runs of 0>"

    @property
    def measures(self) -> Measures:
        """The measures of all teams, a row for each.

        Raises:
            SettingError: the runs were not evaluated (`trials=0`).
        """
        return by_run(run.measures for run in self if run.measures is not None)

    @property
    def history(self) -> "pd.DataFrame":
        """The mean learning curves of the runs, a row for each of 50 parts of the learning steps.

        Its columns: `steps`, the learning steps at the end of the part; and of the episodes that
        end in it `returns` (of a robot, discounted, with exploration and the starts of learning
        episodes), `length`, `miscoordinations`, `asks` (of a robot) and `arrived` (their share),
        each with its standard error over the runs, `<name>_error`.

        Raises:
            RunError: pandas is not installed, or there are no episodes.
        """
        if not any(run.history.episodes for run in self):
            raise RunError(
                "the runs have no learning history; give train_many(history=True)"
            )
        curves = mean_curves([run.history for run in self], self[0].scenario.steps)
        return data_frame(curves)

    def plot(
        self, names: str | Sequence[str] = ("returns", "miscoordinations", "asks")
    ) -> "Figure":
        """Draw the mean learning curves; a band is a standard error over the runs.

        Args:
            names: some of the columns of `history`.

        Raises:
            SettingError: there is no such curve.
            RunError: as `history`.
        """
        with packages_needed():
            from sparse_coord_ros.show.figures import curves_figure
        names = [names] if isinstance(names, str) else names
        for name in names:
            check_choice("curve", name, CURVES)
        curves = self.history
        first = self[0]
        game = f"{first.scenario.name}, penalty {first.scenario.penalty:g}"
        title = (
            f"{first.learner.label}, {game}: {len(self)} runs; band: a standard error"
        )
        return curves_figure(curves, names, title)


LEARNED_ARGUMENT = "what was learned"
"""How a message calls the argument of this type."""

Learned = str | Path | Training | SavedRun | Sequence[Tables]


def load_run(directory: str | Path, *, allow: str | Iterable[str] = ()) -> SavedRun:
    """Open a run's directory; its tables and its history are read when they are first used.

    Args:
        directory: where it is.
        allow: modules that it may name, with the user's learner or perception model.

    Raises:
        RunError: the run is missing, or has another format.
        SettingError: its learner or its perception model is missing here.
    """
    allow_modules(allow)
    path = path_argument("run", directory)
    return SavedRun(path, run_config.load_run(path))


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
    scheduler: SchedulerLike = None,
    progress: Show = True,
    **unexpected: object,
) -> Runs:
    """Learn several times, each time with another seed, on all cores.

    Run i is the same, bit for bit, as `train` with seed `seed + i`. Plain Python computes in
    processes that import the calling script, which must call this function below
    `if __name__ == "__main__":`. A learner typed into a notebook learns in that process alone.

    Args:
        scenario: the problem and its protocol.
        learner: who learns.
        runs: learning runs.
        seed: seed of run 0.
        trials: greedy trials of each run's team, seeded by the run's seed, where an exact
            evaluation is not quick (more than two robots, large maps); 0: no evaluation.
        history: whether each run keeps its learning history; else it has no episodes.
        engine: "numba", "python", or "auto": numba where it is installed. The bits are the same.
        jobs: threads (or processes) at once; all cores that this process may use where None.
        scheduler: Dask cluster that computes: the address of its scheduler, a `Client` or, say, a
            `LocalCluster`; None: this machine.
        progress: True: a bar at a terminal and in notebooks; False: nothing; or a function,
            called with the runs done and to be done.
        **unexpected: refused: settings are given with the scenario.

    Returns:
        A list of the runs, in the order of their seeds, each with the `measures` of its team.
        `runs.measures` are those of all teams; `runs.history` is their mean learning curve, and
        `runs.plot()` draws it.

    Raises:
        ScenarioError, SettingError: no such scenario or learner, or a bad setting.
        RunError: the cluster cannot be reached, or was lost.
        PluginError: a learner or perception model of the user's own failed.
    """
    refuse_unexpected("train_many", unexpected)
    rule = chosen_learner(learner)
    problem = rule.with_defaults(loaded(scenario))
    seed = RUN_SETTINGS["seed"].parse(seed)
    plan = Plan(seed, RUNS.parse(runs), TRIALS_OR_NONE.parse(trials))
    jobs = check_place(jobs, scheduler)
    show = shown(progress, "runs")
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
            done.append(run)
            show(len(done), plan.runs)
    return Runs(done)


def evaluate(
    learned: Learned,
    *,
    scenario: ScenarioLike | None = None,
    learner: LearnerLike | None = None,
    trials: int = 1000,
    seed: int = 0,
) -> Measures:
    """Play greedy Monte-Carlo trials from the scenario's starts (paper, Section 4).

    Args:
        learned: a `Training`, a `SavedRun` or its directory; or the tables of every robot.
        scenario: the problem to play; needed with tables alone, else that of the learning run.
            Where neither it nor the user chose a setting, the default of the learner holds.
        learner: whose greedy policy acts; the one that learned where None.
        trials: number of trials, >= 1.
        seed: seed of the trials' draws, independent of the draws of learning.

    Returns:
        The total discounted reward, steps to the goal, miscoordinations and asks of each trial;
        `mean`, `error` and `spread` sum them up.

    Raises:
        TablesError: the tables do not fit the scenario.
    """
    problem, tables, who = _learned(learned, scenario, learner)
    played = evaluation.TRIALS.parse(trials)
    seed = RUN_SETTINGS["seed"].parse(seed)
    return evaluation.play(problem, tables, trials=played, seed=seed, learner=who)


def evaluate_exact(
    learned: Learned,
    *,
    scenario: ScenarioLike | None = None,
    learner: LearnerLike | None = None,
) -> Measures:
    """Compute what `evaluate` estimates, for one or two robots: from the joint Markov chain.

    Args:
        learned: a `Training`, a `SavedRun` or its directory; or the tables of every robot.
        scenario: the problem to play; needed with tables alone, else that of the learning run.
            Where neither it nor the user chose a setting, the default of the learner holds.
        learner: whose greedy policy acts; the one that learned where None.

    Returns:
        The same measures, of the expected trial; their standard errors are 0.

    Raises:
        TablesError: the tables do not fit the scenario.
        SettingError: more than two robots, or a learner whose agents act by a rule of their own.
    """
    problem, tables, who = _learned(learned, scenario, learner)
    return exact.evaluate_exact(problem, tables, learner=who)


LATER = {
    "RunLog": "sparse_coord_ros.log.runlog",
    "Verification": "sparse_coord_ros.log.runlog",
    "VectorGame": "sparse_coord_ros.core.vector_env",
}
"""Modules of names that are loaded when they are first used: they take as long as all the rest."""


def __getattr__(name: str) -> object:
    """Load the log reader and the environments when their names are first used."""
    if name in LATER:
        return getattr(import_module(LATER[name]), name)
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")


def read_log(bag: str | Path, *, allow: str | Iterable[str] = ()) -> "RunLog":
    """Read a run's log as arrays: cells, actions, questions, percepts and rewards.

    Args:
        bag: a bag's directory or that of its run, an `.mcap` or an `.mcap.partial`. Of an
            unfinished or damaged file, what can be read before the damage.
        allow: modules that it may name, with the user's learner or perception model.

    Raises:
        BagError: nothing can be read, or the bag holds no run.
        RunError: `bag` is no path.
        SettingError: its learner or its perception model is missing here.
    """
    from sparse_coord_ros.log.runlog import read_run

    allow_modules(allow)
    return read_run(path_argument("bag", bag))


def verify(bag: str | Path, *, allow: str | Iterable[str] = ()) -> "Verification":
    """Compute a recorded run again from its seed and its log alone, and compare.

    The result's `same` is True if nothing differs and nothing is undecided, `difference` is the
    first difference, `undecided` says from which time step on the log does not decide.

    Args:
        bag: as for `read_log`.
        allow: as for `read_log`.

    Raises:
        BagError, RunError, SettingError: as `read_log`.
    """
    from sparse_coord_ros.log import runlog

    allow_modules(allow)
    return runlog.verify(path_argument("bag", bag))


def vector_env(
    scenario: ScenarioLike,
    games: int,
    *,
    seed: "Seeds" = None,
    asking: str = "half_steps",
    phase: str = "evaluation",
) -> "VectorGame":
    """Return many games of a scenario at once, as a vector environment for a learner of any kind.

    `reset` and `step` are those of Gymnasium's vector environments, with arrays of NumPy; see
    `VectorGame`, which also says more of the arguments. The discounted sum of the rewards of an
    episode is the return that `evaluate` reports.

    Args:
        scenario: the problem.
        games: number of games.
        seed: game i is that of a single run with seed `seed + i`; or a list of the games' seeds;
            None: random seeds.
        asking: "half_steps": a robot that asks gets the answer, then moves, in one time step, as
            in the paper; "in_observation": it asks with a move, and the answer is in the next
            observation. They are different classes of teams.
        phase: "evaluation": episodes begin at the scenario's starts, and last `horizon` steps;
            "learning": exploring starts and `max_steps`, as learning episodes do here.

    Raises:
        ScenarioError, SettingError: no such scenario, or a bad value.
    """
    from sparse_coord_ros.core.vector_env import VectorGame

    return VectorGame(scenario, games, seed=seed, asking=asking, phase=phase)


def pettingzoo_env(
    scenario: ScenarioLike,
    *,
    asking: str = "half_steps",
    phase: str = "evaluation",
    render_mode: str | None = None,
) -> "SparseCoordEnv":
    """Return a scenario as a parallel environment of PettingZoo.

    With "half_steps" a learner must not discount between the halves of a time step
    (`infos[agent]["half_step"]`); then the discounted sum of the rewards of an episode is the
    return that `evaluate` reports.

    Args:
        scenario: the problem.
        asking: "half_steps": a robot that asks gets the answer, then moves, as in the paper, and
            masks say what is allowed; "in_observation": for learners without masks: a robot asks
            with a move, and the answer is in the next observation.
        phase: as for `vector_env`.
        render_mode: None or "rgb_array".

    Raises:
        ScenarioError, SettingError: no such scenario, or a bad value.
        RunError: PettingZoo is not installed.
    """
    from sparse_coord_ros.core.pettingzoo_env import SparseCoordEnv

    return SparseCoordEnv(scenario, asking=asking, phase=phase, render_mode=render_mode)


def sweep(
    scenario: ScenarioLike,
    over: Mapping[str, Iterable[object]],
    *,
    learner: LearnerLike = "coop",
    out: str | Path | None = None,
    runs: int = 20,
    trials: int = 1000,
    seed: int = 0,
    engine: str = "auto",
    jobs: int | None = None,
    scheduler: SchedulerLike = None,
    progress: Show = True,
) -> dict[str, ConditionResult]:
    """Learn with every combination of some settings, a condition each; on all cores.

    ::

        swept = sc.sweep("env1", {"penalty": [-1, -10, -100], "learner": ["coop", "voi"]})
        frame = sc.to_pandas(swept, by_run=True)
        figure = sc.plot(swept)

    With `out` each finished condition is saved, and repeating the call continues the work.

    Args:
        scenario: the problem and its protocol.
        over: the values of each setting; under `learner`, learners.
        learner: the learner, if `over` does not give it.
        out: results directory, as for `run_experiment`; None: do not save.
        runs: independent learning runs of a condition.
        trials: greedy trials of each run's team, where it is not evaluated exactly.
        seed: seed of run 0; run i has seed + i.
        engine: "numba", "python", or "auto": numba where it is installed. The bits are the same.
        jobs: threads (or processes) at once; all cores that this process may use where None.
        scheduler: as for `run_experiment`.
        progress: True: a bar at a terminal and in notebooks; False: nothing; or a function,
            called with a condition's id, the agent-steps done and those of the whole call.

    Returns:
        The result of each condition, by its id.

    Raises:
        ScenarioError, SettingError: no such scenario, setting or learner, or a bad value.
        ResultsError, OSError, RunError, PluginError: as `run_experiment`.
    """
    problem = loaded(scenario)
    allowed = "the values of each setting by its name, e.g. {'penalty': [-1, -10]}"
    check_argument("over", over, isinstance(over, Mapping), allowed)
    values: dict[str, list[Any]] = {"learner": [learner]}
    for name, listed_values in over.items():
        is_list = isinstance(listed_values, Iterable) and not isinstance(
            listed_values, str
        )
        values[name] = list(listed_values) if is_list else []
        check_argument(
            f"over: {name}", listed_values, bool(values[name]), "a list of values"
        )
    conditions = []
    for combination in product(*values.values()):
        who, *rest = combination
        settings = dict(zip(list(values)[1:], rest, strict=True))
        allow_named(settings.get("perception"))
        conditions.append(make_condition(problem, chosen_learner(who).label, settings))
    return run_experiment(
        conditions,
        out=out,
        runs=runs,
        trials=trials,
        seed=seed,
        engine=engine,
        jobs=jobs,
        scheduler=scheduler,
        progress=progress,
    )


def plot(
    results: ResultsLike, x: str = "", measures: str | Sequence[str] = ("returns",)
) -> "Figure":
    """Draw learners against a setting, beside their reference values.

    Learners that differ in no setting are bars.

    There is a panel for each combination of the other settings. Bars are standard errors of
    the means of the learning runs.

    Args:
        results: of `sweep` or `run_experiment`.
        x: the setting; empty: the first that has several values.
        measures: some, or one, of `returns`, `time_to_goal`, `asks`, `miscoordinations`, `loss`
            (against robots alone) and `variance` (of the return): a line of panels each.

    Raises:
        SettingError: there is no result, `x` has only one value, or the measure is unknown.
    """
    with packages_needed():
        from sparse_coord_ros.studies.experiment_figures import swept_figure
    measures = [measures] if isinstance(measures, str) else measures
    return swept_figure(listed(results), x, measures)


def _learned(
    learned: Learned, scenario: ScenarioLike | None, learner: LearnerLike | None
) -> tuple[Scenario, Sequence[Tables], Learner | None]:
    """Return the problem to play, the tables, and the learner that acts on them."""
    run = load_run(learned) if isinstance(learned, str | Path) else learned
    tables = run
    problem = None
    if isinstance(run, Training | SavedRun):
        tables = run.tables
        problem = run.scenario
        learner = learner or run.learner
    if not isinstance(tables, list | tuple) or not all(
        isinstance(entry, Tables) for entry in tables
    ):
        allowed = (
            "a Training, a SavedRun, its directory, or a list of the robots' Tables (of many "
            "runs, one: runs[0])"
        )
        raise TablesError(wrong_argument(LEARNED_ARGUMENT, learned, allowed))
    rule = None if learner is None else chosen_learner(learner)
    if scenario is not None:
        problem = loaded(scenario)
        problem = problem if rule is None else rule.with_defaults(problem)
    if problem is None:
        raise TablesError(
            "tables alone do not say their scenario; give evaluate(scenario=...)"
        )
    return problem, tables, rule
