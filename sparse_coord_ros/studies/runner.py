# Copyright 2026 The sparse_coord_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Experiments from start to end: load the results that exist, compute the others, save them.

A results directory holds one file a condition. Results of another plan, scenario or protocol are
refused.
"""

from collections.abc import Callable, Iterable, Iterator, Sequence
from contextlib import nullcontext
from itertools import islice
from pathlib import Path

from sparse_coord_ros.base.errors import (
    SettingError,
    check_argument,
    packages_needed,
)
from sparse_coord_ros.base.files import import_apart, path_argument
from sparse_coord_ros.base.progress import Show, shown
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
    ConditionResult,
    RunResult,
    collect,
    result_of_run,
)
from sparse_coord_ros.studies.conditions import Condition
from sparse_coord_ros.studies.store import (
    RUN_TRIALS,
    RUNS,
    Plan,
    Results,
    open_results,
)
from sparse_coord_ros.studies.targets import parse_targets

Progress = Callable[[str, int, int], None]
"""Called with a condition's id, the agent-steps done so far and those of the whole call: as it
begins, and after each run; on a cluster, after each task."""


def no_progress(name: str, done: int, total: int) -> None:
    """Show nothing."""


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
    progress: Show = True,
) -> dict[str, ConditionResult]:
    """Compute experiments or single conditions; with `out`, save them, and resume an earlier call.

    Args:
        what: names of experiments (see `experiment_names`), or ids of conditions such as
            "env1/coop/penalty=-20,ask_cost=2": scenario, learner, changed settings.
        out: results directory, as `sparse_coord reproduce` writes it; None: do not save.
        runs: independent learning runs of a condition.
        trials: greedy trials of each run's team, where it is not evaluated exactly.
        seed: seed of run 0; run i has seed + i.
        report: write the experiments' tables and figures into `out`.
        engine: "numba", "python", or "auto": numba where it is installed. The bits are the same.
        jobs: threads (or processes) at once; all cores that this process may use where None.
        scheduler: Dask cluster that computes: the address of its scheduler, a `Client` or, say, a
            `LocalCluster`; None: this machine.
        progress: True: a bar at a terminal and in notebooks; False: nothing; or a function,
            called with a condition's id, the agent-steps done and those of the whole call.

    Returns:
        The result of each condition, by its id.

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
    show = shown(progress, "agent-steps", named=True)
    if out is not None or scheduler is not None:
        for condition in targets.conditions:
            check_found_elsewhere(condition.scenario.perception)
    if out is None and report:
        raise SettingError("a report is files: name a results directory")
    directory = None if out is None else path_argument("out", out)
    write_report = _report_writer() if report and targets.experiments else None
    opened = nullcontext() if directory is None else open_results(directory, plan)
    with opened as results, cluster_at(scheduler) as cluster:
        by_id = compute(
            targets.conditions,
            plan,
            engine=engine,
            jobs=jobs,
            cluster=cluster,
            results=results,
            progress=show,
        )
        if write_report is not None:
            write_report(directory, targets.experiments, by_id)
    return by_id


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


def compute(
    conditions: Sequence[Condition],
    plan: Plan,
    *,
    engine: str = "auto",
    jobs: int | None = None,
    cluster: Cluster | None = None,
    results: Results | None = None,
    progress: Progress = no_progress,
) -> dict[str, ConditionResult]:
    """Return every condition's result; compute (and save) missing ones.

    Args:
        conditions: the conditions to compute.
        plan: first seed, learning runs and trials.
        engine: "numba", "python" or "auto".
        jobs: threads or processes at once; None: all cores.
        cluster: the cluster that computes; None: this machine.
        results: the results directory, open; None: do not save.
        progress: see `Progress`.
    """
    by_id: dict[str, ConditionResult | None] = {}
    for condition in conditions:
        by_id[condition.id] = None if results is None else results.load(condition)
    missing = [condition for condition in conditions if by_id[condition.id] is None]
    computed: dict[str, dict[int, list[RunResult]]] = {}
    done = 0
    total = sum(agent_steps(condition.scenario) * plan.runs for condition in missing)
    if missing:
        progress(missing[0].id, done, total)
    if cluster is None:
        parts = _here(missing, plan, engine, jobs)
    else:
        parts = _on_cluster(missing, plan, engine, cluster)
    for condition, first_seed, runs in parts:
        done += len(runs) * agent_steps(condition.scenario)
        progress(condition.id, done, total)
        of_condition = computed.setdefault(condition.id, {})
        of_condition[first_seed] = runs
        if sum(map(len, of_condition.values())) < plan.runs:
            continue
        ordered = [run for seed in sorted(of_condition) for run in of_condition[seed]]
        result = collect(condition, plan.seed, ordered)
        by_id[condition.id] = result
        del computed[condition.id]
        if results is not None:
            results.save(condition, result)
    return {name: result for name, result in by_id.items() if result is not None}


Computed = Iterator[tuple[Condition, int, list[RunResult]]]
"""Conditions, with the seed of the first of some of their runs, and these runs."""


def _here(
    conditions: Sequence[Condition], plan: Plan, engine: str, jobs: int | None
) -> Computed:
    """Compute conditions on this machine, one run after the other."""
    batches = [
        Batch(condition.scenario, learner_of(condition.learner), plan.seeds)
        for condition in conditions
    ]
    runs = run_batches(batches, trials=plan.trials, engine=engine, jobs=jobs)
    for condition in conditions:
        for run in islice(runs, plan.runs):
            yield condition, run.seed, [result_of_run(run)]


def _on_cluster(
    conditions: Sequence[Condition], plan: Plan, engine: str, cluster: Cluster
) -> Computed:
    """Compute conditions on a cluster, all at once, each task some runs of one condition."""
    work: list[tuple[Scenario, Learner, Sequence[int], int, str]] = []
    whose: list[Condition] = []
    for condition in conditions:
        steps = agent_steps(condition.scenario)
        runs = plan.runs * len(conditions)
        for share in cluster.shares(plan.seeds, steps, runs):
            whose.append(condition)
            rule = learner_of(condition.learner)
            work.append((condition.scenario, rule, share, plan.trials, engine))
    for number, runs in cluster.results(computed_runs, work):
        yield whose[number], work[number][2][0], runs


def computed_runs(
    scenario: Scenario, learner: Learner, seeds: Sequence[int], trials: int, engine: str
) -> list[RunResult]:
    """Compute some runs of a condition in a thread of a cluster's worker."""
    runs = run_batch(scenario, learner, seeds, trials=trials, engine=engine, jobs=1)
    return [result_of_run(run) for run in runs]


def _report_writer() -> Callable[..., None]:
    """Return the report writer; raise `RunError` early, before hours of work, if it is missing."""
    with packages_needed():
        import_apart("pandas", "matplotlibrc")
        import_apart("matplotlib", "matplotlibrc")
    from sparse_coord_ros.studies.report import write_report

    return write_report
