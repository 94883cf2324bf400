# Copyright 2026 The sparse_coord_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The best known teams of more than two robots: of which game, and not above what can be."""

import pytest

from sparse_coord_ros.game.scenario import load_scenario
from sparse_coord_ros.solve.best_team import shipped_best_team
from sparse_coord_ros.solve.optimum import independent_bound


@pytest.mark.parametrize("name", ["env2-4r", "crowd-4r", "crowd-6r", "crowd-8r"])
def test_the_shipped_teams(name):
    scenario = load_scenario(name).with_settings({"penalty": -100, "steps": 7, "max_steps": 9})
    team = shipped_best_team(scenario)
    assert team.value + 5 * team.standard_error < independent_bound(scenario)
    assert team.seed >= 950_000 and team.trials >= 10_000
    assert str(team).startswith(f"{team.value:.2f} (")
    assert shipped_best_team(scenario.with_settings({"ask_cost": 2})) is None
    assert shipped_best_team(load_scenario("env1")) is None
