# Copyright 2026 The sparse_coord_ros authors
# SPDX-License-Identifier: Apache-2.0
"""What results are compared with: the paper's numbers, known teams, robots alone."""

from collections.abc import Iterable

from sparse_coord_ros.core.solve.shipped import shipped_asking_team
from sparse_coord_ros.studies.condition_result import ConditionResult
from sparse_coord_ros.studies.paper import paper_row


def paper(result: ConditionResult, measure: str) -> tuple[float, float] | None:
    """Return mean and spread that the paper prints for a condition; None if it prints none."""
    row = paper_row(result.scenario, result.condition.learner)
    if measure not in row:
        return None
    mean, spread = row[measure]
    return mean, spread


def best_asking_team(result: ConditionResult) -> float | None:
    """Return the value of the best asking team found; None if no search was made."""
    team = shipped_asking_team(result.scenario)
    return team.value if team else None


def by_scenario(results: Iterable[ConditionResult]) -> list[list[ConditionResult]]:
    """Return the results of each scenario, in the order in which the scenarios come first."""
    groups: dict[str, list[ConditionResult]] = {}
    for result in results:
        groups.setdefault(result.scenario.name, []).append(result)
    return list(groups.values())
