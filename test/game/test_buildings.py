# Copyright 2026 The sparse_coord_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Generated buildings: always the same, every goal reachable, and refused where they cannot be."""

import pytest
from teams import untrained

from sparse_coord_ros.base.errors import ScenarioError, SettingError
from sparse_coord_ros.core.game.buildings import building
from sparse_coord_ros.core.game.grid import UNREACHABLE
from sparse_coord_ros.core.game.scenario import load_scenario
from sparse_coord_ros.core.learners.registry import learner_of


@pytest.mark.parametrize(
    ("name", "robots"),
    [("3x2x4-16r-0", 16), ("1x2x2-4r-1", 4), ("2x1x2-4r-2", 4), ("4x3x3-53r-3", 53)],
)
def test_a_building_is_whole(name, robots):
    scenario = load_scenario(f"building-{name}")
    starts = {robot.start for robot in scenario.robots}
    goals = {robot.goal for robot in scenario.robots}
    assert len(starts | goals) == 2 * len(scenario.robots) == 2 * robots
    assert not (starts | goals) & scenario.map.doorways
    assert (scenario.map.distances_to(0) != UNREACHABLE).all()
    longest = max(scenario.map.distances_to(r.goal)[r.start] for r in scenario.robots)
    assert scenario.horizon >= 5 * longest or scenario.horizon == 100
    assert scenario.computation() == load_scenario(f"building-{name}").computation()


def test_the_seed_and_the_text_stay():
    assert building("building-3x2x4-16r-1") != building("building-3x2x4-16r-2")
    rows = load_scenario("building-2x2x2-2r-7").map.rows
    assert rows == (
        "..#..",
        "..D..",
        "D##D#",
        ".....",
        ".....",
        "D###D",
        "..D..",
        "..#..",
    )


@pytest.mark.parametrize(
    "numbers",
    [
        "21x2x4-2r-0",
        "3x21x4-2r-0",
        "3x2x21-2r-0",
        "3x2x1-2r-0",
        "3x2x4-61r-0",
        "3x2x4-0r-0",
        "1x1x4-2r-0",
        "0x2x4-2r-0",
        "3x2x4-49r-0",
    ],
)
def test_buildings_that_there_are_not(numbers):
    with pytest.raises(ScenarioError, match=f"'building-{numbers}'"):
        load_scenario(f"building-{numbers}")


def test_too_many_joint_states_matter_to_who_numbers_them():
    scenario = load_scenario("building-3x2x4-16r-0").with_settings({"peers": "all"})
    with pytest.raises(SettingError, match="132.16.*voi"):
        learner_of("coop").check(scenario)
    learner_of("voi").check(scenario)
    assert untrained(scenario, "voi").q_coord.shape == (132,) * 16 + (4,)
