# Copyright 2026 The sparse_coord_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Results of conditions: selection, reference values of the paper and of searches, CSV."""

import math
from collections.abc import Callable, Iterable, Iterator, Mapping
from dataclasses import asdict
from typing import Any

import numpy as np
import pandas as pd

from sparse_coord_ros.core.runs.evaluation import Measure
from sparse_coord_ros.core.solve.shipped import shipped_asking_team, shipped_best_team
from sparse_coord_ros.studies.condition_result import (
    BY_ROBOT,
    SUMS,
    ConditionResult,
    standard_error,
)

PAPER_SETTINGS = (("penalty", "-20"),)
"""Settings of the conditions that the paper's Tables 1 to 3 show."""

PAPER_TRIALS = 1000
"""Monte-Carlo trials behind each number of the paper (Section 4)."""

PAPER = ("returns", "time_to_goal", "miscoordinations")
"""Measures that the paper prints."""

PROPERTIES = (
    *("optimum", "optimum_exact", "arrived", "failed_teams", "joint_states"),
    *("visited_share", "visited_bytes", "dense_bytes"),
)
"""Of a result, as columns."""


def paper(result: ConditionResult, measure: str) -> Measure | None:
    """Return the number that the paper prints for a condition; None if it prints none.

    The standard error is that of the paper's trials, the robots of one trial being taken as
    wholly dependent.
    """
    row = result.scenario.paper.get(result.condition.learner, {})
    if result.condition.settings != PAPER_SETTINGS or measure not in row:
        return None
    mean, spread = row[measure]
    return Measure(mean, spread, spread / PAPER_TRIALS**0.5)


def best_asking_team(result: ConditionResult) -> float | None:
    """Return the value of the best asking team found; None if no search was made."""
    bound = shipped_asking_team(result.scenario)
    return bound.value if bound else None


def best_team(result: ConditionResult) -> float | None:
    """Return the value of the best team found by learning, of more than two robots, or None."""
    team = shipped_best_team(result.scenario)
    return team.value if team else None


def pick(results: Iterable[ConditionResult], **wanted: object) -> list[ConditionResult]:
    """Return the results with these values: `name`, `learner`, or a scenario's setting."""

    def value(result: ConditionResult, key: str) -> object:
        return (
            result.condition.learner
            if key == "learner"
            else getattr(result.scenario, key)
        )

    return [
        one for one in results if all(value(one, key) == wanted[key] for key in wanted)
    ]


def names(results: Iterable[ConditionResult]) -> list[str]:
    """Return the names of the scenarios, each once."""
    return list(dict.fromkeys(one.scenario.name for one in results))


def by_scenario(results: Iterable[ConditionResult]) -> list[list[ConditionResult]]:
    """Return the results of each scenario."""
    results = list(results)
    return [pick(results, name=name) for name in names(results)]


def ends(
    results: Iterable[ConditionResult], key: Callable[[ConditionResult], Any]
) -> tuple[ConditionResult, ConditionResult]:
    """Return the results of the least and of the greatest value of a setting."""
    ordered = sorted(results, key=key)
    return ordered[0], ordered[-1]


def to_csv(results: Iterable[ConditionResult]) -> str:
    """Return a CSV file: one row a condition, one value a field, in full precision."""
    rows = pd.DataFrame([dict(_flat(_row(one))) for one in results])
    return rows.to_csv(index=False, lineterminator="\n")


def _flat(row: Mapping[Any, Any], head: str = "") -> Iterator[tuple[str, object]]:
    """Yield names and values of columns: nested keys are joined."""
    for key, value in row.items():
        if isinstance(value, Mapping):
            yield from _flat(value, f"{head}{key}_")
        else:
            yield f"{head}{key}", value


def _row(result: ConditionResult) -> dict[str, Any]:
    """Return the values of a row, nested; the keys are joined to the column's name."""
    scenario = result.scenario
    robots = len(scenario.robots)
    by_robot = {name: result.robot_means[name] for name in BY_ROBOT}
    by_robot["common_reward_factor"] = (
        list(scenario.common_reward.numbers) or [1.0] * robots
    )
    exact = result.exact or dict.fromkeys((*SUMS, "arrived"), [math.nan])
    found = {
        name: paper(result, name) or Measure(math.nan, math.nan, 0) for name in PAPER
    }
    return {
        "id": result.id,
        "scenario": scenario.name,
        "learner": result.condition.learner,
        "robots": robots,
        **scenario.plain_settings,
        "runs": result.runs,
        "trials": result.trials,
        **{name: asdict(result.measure(name)) for name in SUMS},
        "paper": {
            name: {"mean": m.mean, "spread": m.spread} for name, m in found.items()
        },
        "shortest_path": {name: result.reference[name] for name in PAPER},
        **{name: getattr(result, name) for name in PROPERTIES},
        **{
            f"{name}_robot": dict(enumerate(own, start=1))
            for name, own in by_robot.items()
        },
        "exact": {
            name: {
                "mean": np.mean(own),
                "standard_error": standard_error(np.array(own)),
            }
            for name, own in exact.items()
        },
        "best_asking_team": best_asking_team(result),
        "best_team": best_team(result),
    }
