# Copyright 2026 The sparse_coord_ros authors
# SPDX-License-Identifier: Apache-2.0
"""What results are compared with: the paper's numbers, known teams, robots alone."""

from collections.abc import Iterable

from sparse_coord_ros.core.runs.evaluation import Measure
from sparse_coord_ros.core.solve.optimum import independent_bound
from sparse_coord_ros.core.solve.shipped import shipped_asking_team
from sparse_coord_ros.studies.condition_result import ConditionResult
from sparse_coord_ros.studies.paper import paper_rows

PAPER_SETTINGS = (("penalty", "-20"),)
"""Settings of the conditions that the paper's Tables 1 to 3 show."""

PAPER_TRIALS = 1000
"""Monte-Carlo trials behind each number of the paper (Section 4)."""


def paper(result: ConditionResult, measure: str) -> Measure | None:
    """Return the number that the paper prints for a condition; None if it prints none.

    The standard error is that of the paper's trials, the robots of one trial being taken as
    wholly dependent.
    """
    row = paper_rows().get(result.scenario.name, {}).get(result.condition.learner, {})
    if result.condition.own_scenario is not None:
        return None
    if result.condition.settings != PAPER_SETTINGS or measure not in row:
        return None
    mean, spread = row[measure]
    return Measure(mean, spread, spread / PAPER_TRIALS**0.5)


def best_asking_team(result: ConditionResult) -> float | None:
    """Return the value of the best asking team found; None if no search was made."""
    team = shipped_asking_team(result.scenario)
    return team.value if team else None


def loss_alone(result: ConditionResult) -> Measure:
    """Return the loss of return against robots that are each alone on the map.

    Such robots take shortest paths and never miscoordinate, wait or ask. Unlike the return, the
    loss does not depend on the lengths of the paths.
    """
    returns = result.best("returns")
    loss = independent_bound(result.scenario) - returns.mean
    return Measure(loss, returns.spread, returns.standard_error)


def by_scenario(results: Iterable[ConditionResult]) -> list[list[ConditionResult]]:
    """Return the results of each scenario, in the order in which the scenarios come first."""
    groups: dict[str, list[ConditionResult]] = {}
    for one in results:
        groups.setdefault(one.scenario.name, []).append(one)
    return list(groups.values())
