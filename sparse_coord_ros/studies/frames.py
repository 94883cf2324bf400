# Copyright 2026 The sparse_coord_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Results of experiments as a data frame, which is their CSV file, too."""

from collections.abc import Iterable, Iterator, Mapping
from typing import TYPE_CHECKING, Any, TypeAlias

from sparse_coord_ros.base.dataframes import data_frame
from sparse_coord_ros.base.errors import check_argument
from sparse_coord_ros.core.solve.shipped import shipped_best_team
from sparse_coord_ros.studies.compared import best_asking_team, paper
from sparse_coord_ros.studies.condition_result import ConditionResult
from sparse_coord_ros.studies.paper import PAPER_MEASURES

if TYPE_CHECKING:
    import pandas as pd

ResultsLike: TypeAlias = Mapping[str, ConditionResult] | Iterable[ConditionResult]
"""Results of conditions: as `run_experiment` returns them, or a list of them."""

SIZES = ("joint_states", "visited_share", "visited_bytes", "dense_bytes")
"""Of a result, as columns."""


def listed(results: ResultsLike) -> list[ConditionResult]:
    """Return results as a list.

    Raises:
        SettingError: there is none, or one is no result of `sweep` or `run_experiment`.
    """
    values = results.values() if isinstance(results, Mapping) else results
    chosen = list(values) if isinstance(values, Iterable) else []
    fits = all(isinstance(result, ConditionResult) for result in chosen)
    allowed = (
        "results of sweep or run_experiment, one at least (of train_many, draw runs.plot(), and "
        "use runs.history and runs.measures.to_pandas())"
    )
    check_argument("results", results, bool(chosen) and fits, allowed)
    return chosen


def to_pandas(results: ResultsLike, *, by_run: bool = False) -> "pd.DataFrame":
    """Return results as a data frame: a row for each condition, or for each learning run.

    Its columns: `condition` (the id), `scenario`, `learner`, `robots` and every setting. Then

    - of a condition: `source` ("exact", or "trials" where that is not quick), `runs`, `trials` of
      each run, the measures (`returns`, `time_to_goal` and `asks`, means over the
      robots; `miscoordinations` of a trial; `arrived`, share of trials in which every robot
      arrived), each with `<measure>_spread` (over robots, trials and runs) and
      `<measure>_error` (standard error of the mean; the runs are the samples); `failed_teams`;
      `optimum`, `optimum_exact`, `errors_above_optimum` (by how many standard errors trials exceed
      it); values of other teams and of the paper; the size of Q^C; means of each robot;
    - of a run: `run`, `seed`, and the columns of `Measures.to_pandas`.

    Args:
        results: of `run_experiment` or `sweep`.
        by_run: whether to return a row for each run.

    Raises:
        RunError: pandas is not installed.
    """
    rows_of = _rows_of_runs if by_run else _rows_of_conditions
    rows = [row for result in listed(results) for row in rows_of(result)]
    names = dict.fromkeys(name for row in rows for name in row)
    return data_frame({name: [row.get(name) for row in rows] for name in names})


def _head(result: ConditionResult) -> dict[str, Any]:
    scenario = result.scenario
    return {
        "condition": result.id,
        "scenario": scenario.name,
        "learner": result.condition.learner,
        "robots": len(scenario.robots),
        **scenario.plain_settings,
    }


def _rows_of_runs(result: ConditionResult) -> Iterator[dict[str, Any]]:
    columns = result.measures.columns()
    for run in range(result.runs):
        values = {name: column[run] for name, column in columns.items()}
        yield {**_head(result), "run": run, "seed": result.seed + run, **values}


def _rows_of_conditions(result: ConditionResult) -> Iterator[dict[str, Any]]:
    scenario = result.scenario
    measures = result.measures
    row = _head(result)
    row |= measures.to_dict()
    row["failed_teams"] = measures.failed
    row["optimum"] = result.optimum
    row["optimum_exact"] = result.optimum_exact
    row["errors_above_optimum"] = measures.errors_above(result.optimum)
    row["best_asking_team"] = best_asking_team(result)
    best = shipped_best_team(scenario)
    row["best_team"] = None if best is None else best.value
    for name in PAPER_MEASURES:
        row[f"shortest_paths_{name}"] = result.shortest_paths.mean(name)
    for name in PAPER_MEASURES:
        mean, spread = paper(result, name) or (None, None)
        row[f"paper_{name}"] = mean
        row[f"paper_{name}_spread"] = spread
    for name in SIZES:
        row[name] = getattr(result, name)
    shares = list(scenario.common_reward.numbers) or [1.0] * len(scenario.robots)
    by_robot = {**measures.by_robot(), "common_reward_factor": shares}
    for name, values in by_robot.items():
        for number, value in enumerate(values, start=1):
            row[f"{name}_robot_{number}"] = value
    yield row
