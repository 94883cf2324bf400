# Copyright 2026 The sparse_coord_ros authors
# SPDX-License-Identifier: Apache-2.0
"""What a team's reward is measured against."""

from sparse_coord_ros.game.scenario import Scenario
from sparse_coord_ros.solve.best_team import shipped_best_team
from sparse_coord_ros.solve.class_bound import shipped_class_bound
from sparse_coord_ros.solve.optimum import joint_optimum


def yardsticks(scenario: Scenario) -> list[tuple[str, float]]:
    """Return name and total discounted reward of each team or bound that is known, best last."""
    found = []
    bound, team = shipped_class_bound(scenario), shipped_best_team(scenario)
    if bound is not None:
        found.append(("class bound", bound.value))
    if team is not None:
        found.append(("best known team", team.value))
    optimum = joint_optimum(scenario)
    name = "exact joint optimum" if optimum.exact else "bound (robots alone)"
    return [*found, (name, optimum.value)]
