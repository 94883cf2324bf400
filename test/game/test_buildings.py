# Copyright 2026 The sparse_coord_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Generated buildings: always the same, every goal reachable, and refused where they cannot be."""

import pytest

from sparse_coord_ros.errors import SettingError
from sparse_coord_ros.game.buildings import Building, building_text, generated_building
from sparse_coord_ros.game.grid import UNREACHABLE
from sparse_coord_ros.learn.learners import learner_of


@pytest.mark.parametrize(
    "numbers", [(3, 2, 4, 16, 0), (1, 2, 2, 4, 1), (2, 1, 2, 4, 2), (4, 3, 3, 54, 3)]
)
def test_a_building_is_whole(numbers):
    scenario = generated_building(*numbers)
    starts = {robot.start for robot in scenario.robots}
    goals = {robot.goal for robot in scenario.robots}
    assert len(starts | goals) == 2 * len(scenario.robots) == 2 * numbers[3]
    assert not (starts | goals) & scenario.map.doorways
    assert (scenario.map.distances_to(0) != UNREACHABLE).all()
    longest = max(scenario.map.distances_to(r.goal)[r.start] for r in scenario.robots)
    assert scenario.horizon >= 5 * longest or scenario.horizon == 100
    assert scenario.computation() == generated_building(*numbers).computation()


def test_the_seed_and_the_text_stay():
    assert building_text(Building(seed=1)) != building_text(Building(seed=2))
    rows = generated_building(rooms=2, size=2, robots=2, seed=7).map.rows
    assert rows == ("..#..", "..D..", "D##D#", ".....", ".....", "D###D", "..D..", "..#..")


def test_too_many_joint_states_matter_to_who_numbers_them():
    scenario = generated_building().with_settings({"peers": "all"})
    with pytest.raises(SettingError, match="below 2.63 joint states.*132.16.*factored"):
        learner_of("coop").check(scenario)
    learner_of("factored").check(scenario)
    assert learner_of("factored").tables(scenario).q_coord.shape[:2] == (132, 132)
