# Copyright 2026 The sparse_coord_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Experiments from start to end: load the results that exist, compute the others, save them.

A results directory holds one file a condition. Results of another plan, scenario or protocol are
refused.
"""

import math
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from itertools import islice
from pathlib import Path
from typing import TYPE_CHECKING, Any

from sparse_coord_ros.base.dataframes import data_frame, shown_as
from sparse_coord_ros.base.errors import (
    SettingError,
    check_argument,
    check_function,
    needed,
)
from sparse_coord_ros.base.files import import_apart, path_argument
from sparse_coord_ros.core.engine.batch import (
    Batch,
    agent_steps,
    run_batch,
    run_batches,
)
from sparse_coord_ros.core.engine.cluster import (
    Cluster,
    SchedulerLike,
    check_place,
    cluster_at,
)
from sparse_coord_ros.core.game.perception import check_found_elsewhere
from sparse_coord_ros.core.game.scenario import Scenario
from sparse_coord_ros.core.learners.learner import Learner
from sparse_coord_ros.core.learners.registry import learner_of
from sparse_coord_ros.core.runs.run_config import (
    RUN_SETTINGS,
)
from sparse_coord_ros.studies.condition_result import (
    CONFIDENCE,
    SUMS,
    ConditionResult,
    Sample,
    collect,
    sample,
)
from sparse_coord_ros.studies.conditions import Condition
from sparse_coord_ros.studies.store import (
    RUN_TRIALS,
    RUNS,
    Plan,
    Results,
    open_results,
)
from sparse_coord_ros.studies.targets import Targets, parse_targets

if TYPE_CHECKING:
    import pandas as pd
    from matplotlib.figure import Figure

Progress = Callable[[str, int, int], None]
"""Called with a condition's id, the agent-steps done so far and those of the whole call: as it
begins, and after each run; on a cluster, after each task."""


def no_progress(name: str, done: int, total: int) -> None:
    """Show nothing."""


@dataclass(frozen=True)
class ExperimentResults(Mapping[str, ConditionResult]):
    """The results of a call; a mapping from a condition's id to its result.

    Attributes:
        plan: first seed, learning runs and trials.
        targets: the requested targets.
        found: the results, by the conditions' ids.
        swept: settings that are columns of data frames in any case.
    """

    plan: Plan
    targets: Targets
    found: Mapping[str, ConditionResult]
    swept: tuple[str, ...] = ()

    def __repr__(self) -> str:
        """Return a description with one line for each condition."""
        return shown_as(self._title, self._means)

    def _repr_html_(self) -> str:
        """Return the same for a notebook, with a picture."""
        from sparse_coord_ros.show.charts import embedded

        return shown_as(self._title, self._means, markup=True) + embedded(
            self.plot(), "returns"
        )

    @property
    def _title(self) -> str:
        plan = self.plan
        many = f"{len(self)} condition{'s' * (len(self) != 1)}"
        return f"<{many}; runs of each: {plan.runs}, trials of a run: {plan.trials}>"

    @property
    def _means(self) -> dict[str, list[Any]]:
        columns: dict[str, list[Any]] = {"condition": list(self)}
        for name in SUMS:
            columns[name] = [one.measure(name).mean for one in self.values()]
        return columns | {"arrived": [one.arrived for one in self.values()]}

    def plot(self, x: str = "", measures: Sequence[str] = ("returns",)) -> "Figure":
        """Draw learners against a setting, beside their reference values.

        There is a panel for each combination of the other settings. Bars are standard errors of
        the means of the learning runs.

        Args:
            x: the setting; empty: the first that has several values.
            measures: of `returns`, `time_to_goal`, `asks`, `miscoordinations`, `loss` (against
                robots alone) and `variance` (of the return): a line of panels each.

        Raises:
            SettingError: `x` has only one value, or the measure is unknown.
        """
        from sparse_coord_ros.studies.figures import swept_figure

        return swept_figure(list(self.values()), x, measures)

    def __getitem__(self, name: str) -> ConditionResult:
        """Return the result of the condition of that id."""
        return self.found[name]

    def __iter__(self) -> Iterator[str]:
        """Iterate over the conditions' ids."""
        return iter(self.found)

    def __len__(self) -> int:
        """Return the number of conditions."""
        return len(self.found)

    def to_dict(self) -> dict[str, Any]:
        """Return plain data, as `reproduce --json` prints it."""
        return {"conditions": [result.to_dict() for result in self.found.values()]}

    def to_pandas(self, *, by_run: bool = False) -> "pd.DataFrame":
        """Return a data frame: one row a condition, or one row a learning run.

        Its columns: `condition` (the id), `scenario`, `learner`, each setting that was swept or
        that some condition names, `run` and `seed` where `by_run`, then the measures `returns`,
        `time_to_goal`, `asks` (means over trials and robots) and `miscoordinations` (mean of a
        trial), each with `<measure>_low` and `<measure>_high`, the 95 % confidence interval of
        that mean, and `arrived` (share of the trials in which every robot arrived).

        The samples of an interval are the learning runs; in a row of one run its trials, the
        robots of a trial being taken as wholly dependent. A row a condition has also
        `<measure>_spread`, `<measure>_standard_error`, `optimum` and `optimum_exact`.

        Raises:
            RunError: pandas is not installed.
        """
        rows = []
        for condition in self.targets.conditions:
            result = self.found[condition.id]
            head = self._head(condition)
            if by_run:
                rows += [
                    {**head, **self._row(result, run)} for run in range(self.plan.runs)
                ]
                continue
            for name in SUMS:
                measure = result.measure(name)
                head[name] = measure.mean
                head[f"{name}_spread"] = measure.spread
                head[f"{name}_standard_error"] = measure.standard_error
                head |= _interval(
                    name, measure.mean, measure.standard_error, result.runs
                )
            head |= {"arrived": result.arrived, "optimum": result.optimum}
            rows.append({**head, "optimum_exact": result.optimum_exact})
        names = dict.fromkeys(name for row in rows for name in row)
        return data_frame({name: [row[name] for row in rows] for name in names})

    def _row(self, result: ConditionResult, run: int) -> dict[str, Any]:
        row: dict[str, Any] = {"run": run, "seed": self.plan.seed + run}
        for name in SUMS:
            error = math.sqrt(result.variances[name][run] / result.trials)
            row[name] = result.means[name][run]
            row |= _interval(name, row[name], error, result.trials)
        return {**row, "arrived": 1.0 - result.not_arrived[run] / result.trials}

    def _head(self, condition: Condition) -> dict[str, Any]:
        scenario = condition.scenario
        keys = (key for one in self.targets.conditions for key, _ in one.settings)
        named = dict.fromkeys([*self.swept, *keys])
        return {
            "condition": condition.id,
            "scenario": scenario.name,
            "learner": condition.learner,
            **{key: scenario.plain_settings[key] for key in named},
        }


def _interval(
    name: str, mean: float, standard_error: float, samples: int
) -> dict[str, float]:
    """Return a measure's confidence interval, by Student's t; NaN of a single sample."""
    from scipy.special import stdtrit

    half = standard_error * float(stdtrit(samples - 1, (1 + CONFIDENCE) / 2))
    return {f"{name}_low": mean - half, f"{name}_high": mean + half}


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
    scheduler: SchedulerLike = None,
    progress: Progress = no_progress,
) -> ExperimentResults:
    """Compute experiments or single conditions; with `out`, save them, and resume an earlier call.

    Args:
        what: names of experiments (see `experiment_names`), or ids of conditions such as
            "env1/coop/penalty=-20,ask_cost=2": scenario, learner, changed settings.
        out: results directory, as of `sparse_coord reproduce`; None: do not save.
        runs: independent learning runs of a condition.
        trials: greedy trials of each run.
        seed: seed of run 0; run i has seed + i.
        report: write the experiments' tables and figures into `out`.
        engine: "numba", "python", or "auto": numba where it is installed. The bits are the same.
        jobs: threads (or processes) at once; all cores that this process may use where None.
        scheduler: Dask cluster that computes: the address of its scheduler, a `Client` or, say, a
            `LocalCluster`; None: this machine.
        progress: called with a condition's id, the agent-steps done and those of the whole call.

    Raises:
        ScenarioError, SettingError: no such experiment, scenario or learner, or a bad setting.
        ResultsError: `out` holds results of something else, or is in use.
        OSError: `out` cannot be written.
        RunError: the cluster cannot be reached, or was lost; a process that computed runs was
            killed; pandas or Matplotlib is missing, which tables and figures need.
        PluginError: a learner or perception model of the user's own failed.
    """
    plan = Plan(
        RUN_SETTINGS["seed"].parse(seed), RUNS.parse(runs), RUN_TRIALS.parse(trials)
    )
    targets = parse_targets(_as_list(what))
    jobs = check_place(jobs, scheduler)
    check_function("progress", progress)
    if out is not None or scheduler is not None:
        for one in targets.conditions:
            check_found_elsewhere(one.scenario.perception)
    if out is None:
        if report:
            raise SettingError("a report is files: name a results directory")
        with cluster_at(scheduler) as cluster:
            by = Computing(engine, jobs, cluster)
            found = compute(targets.conditions, plan, by, progress=progress)
        return ExperimentResults(plan, targets, found)
    directory = path_argument("out", out)
    write_report = _report_writer() if report and targets.experiments else None
    with (
        open_results(directory, plan) as results,
        cluster_at(scheduler) as cluster,
    ):
        by = Computing(engine, jobs, cluster)
        found = compute(
            targets.conditions, plan, by, results=results, progress=progress
        )
        if write_report is not None:
            write_report(directory, targets.experiments, found)
    return ExperimentResults(plan, targets, found)


def _as_list(
    what: str | Condition | Iterable[str | Condition],
) -> list[str | Condition]:
    """Return the targets of a call as a list; raise `SettingError` if it is empty."""
    given = isinstance(what, str | Condition | Iterable)
    check_argument(
        "what", what, given, "an experiment or a condition, or a list of them"
    )
    asked = [what] if isinstance(what, str | Condition) else list(what)
    if not asked:
        remedy = "name at least one, or all: experiment_names()"
        raise SettingError(f"no experiment is asked for; {remedy}")
    return asked


@dataclass(frozen=True)
class Computing:
    """Settings of the computation; attributes as of `run_batch`."""

    engine: str = "auto"
    jobs: int | None = None
    cluster: Cluster | None = None


def compute(
    conditions: Sequence[Condition],
    plan: Plan,
    by: Computing = Computing(),  # noqa: B008 - it never changes
    *,
    results: Results | None = None,
    progress: Progress = no_progress,
) -> dict[str, ConditionResult]:
    """Return every condition's result; compute (and save) missing ones.

    Args:
        conditions: the conditions to compute.
        plan: first seed, learning runs and trials.
        by: engine, threads or cluster.
        results: the results directory, open; None: do not save.
        progress: see `Progress`.
    """
    found: dict[str, ConditionResult | None] = {}
    for one in conditions:
        found[one.id] = None if results is None else results.load(one)
    missing = [one for one in conditions if found[one.id] is None]
    samples_of_runs: dict[str, dict[int, list[Sample]]] = {}
    done = 0
    total = sum(agent_steps(one.scenario) * plan.runs for one in missing)
    if missing:
        progress(missing[0].id, done, total)
    compute_all = _here if by.cluster is None else _on_cluster
    for one, first_seed, samples in compute_all(missing, plan, by):
        done += len(samples) * agent_steps(one.scenario)
        progress(one.id, done, total)
        own = samples_of_runs.setdefault(one.id, {})
        own[first_seed] = samples
        if sum(map(len, own.values())) < plan.runs:
            continue
        ordered = [sample for seed in sorted(own) for sample in own[seed]]
        result = collect(one, plan.trials, ordered)
        found[one.id] = result
        del samples_of_runs[one.id]
        if results is not None:
            results.save(one, result)
    return {name: result for name, result in found.items() if result is not None}


Computed = Iterator[tuple[Condition, int, list[Sample]]]
"""Conditions, with samples of some of their runs and the first one's seed."""


def _here(conditions: Sequence[Condition], plan: Plan, by: Computing) -> Computed:
    """Compute conditions on this machine, one run after the other."""
    batches = [
        Batch(one.scenario, learner_of(one.learner), plan.seeds) for one in conditions
    ]
    runs = run_batches(batches, trials=plan.trials, engine=by.engine, jobs=by.jobs)
    for one in conditions:
        for run in islice(runs, plan.runs):
            yield one, run.seed, [sample(run)]


def _on_cluster(conditions: Sequence[Condition], plan: Plan, by: Computing) -> Computed:
    """Compute conditions on a cluster, all at once, each task some runs of one condition."""
    assert by.cluster is not None
    work: list[tuple[Scenario, Learner, Sequence[int], int, str]] = []
    whose: list[Condition] = []
    for one in conditions:
        steps = agent_steps(one.scenario)
        runs = plan.runs * len(conditions)
        for share in by.cluster.shares(plan.seeds, steps, runs):
            whose.append(one)
            rule = learner_of(one.learner)
            work.append((one.scenario, rule, share, plan.trials, by.engine))
    for number, samples in by.cluster.results(samples_of, work):
        yield whose[number], work[number][2][0], samples


def samples_of(
    scenario: Scenario, learner: Learner, seeds: Sequence[int], trials: int, engine: str
) -> list[Sample]:
    """Compute some runs of a condition in a thread of a cluster's worker."""
    runs = run_batch(scenario, learner, seeds, trials=trials, engine=engine, jobs=1)
    return [sample(run) for run in runs]


def _report_writer() -> Callable[..., None]:
    """Return the report writer; raise `RunError` early, before hours of work, if it is missing."""
    for package in ("pandas", "matplotlib"):
        remedy = "pip install pandas matplotlib"
        with needed(f"a report needs the Python package {package}", remedy):
            import_apart(package, "matplotlibrc")
    from sparse_coord_ros.studies.report import write_report

    return write_report
