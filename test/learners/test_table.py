# Copyright 2026 The sparse_coord_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Tables that grow: each key keeps its row."""

import numpy as np
import pytest

from sparse_coord_ros.core.game.scenario import load_scenario
from sparse_coord_ros.core.learners.mind import team_mind, with_room
from sparse_coord_ros.core.learners.registry import learner_of
from sparse_coord_ros.core.learners.table import find, met


@pytest.mark.parametrize("stride", [1, 64, 1000])
def test_each_key_keeps_its_row_where_a_table_grows(stride):
    learner = learner_of("factored")
    scenario = load_scenario("building-4x4x4-16r-0")
    task = learner.task(scenario)
    mind = team_mind(learner, scenario, [0, 1])
    keys = [number * stride for number in range(200)]
    for k in (0, 1):
        for key in keys[: 100 * (k + 1)]:
            row = met(mind.rho, task, k, key)
            mind.rho.values[k, row] = key
    grown = with_room(mind).rho
    assert grown.keys.shape[1] == 2 * mind.rho.keys.shape[1]
    for k in (0, 1):
        for key in keys[: 100 * (k + 1)]:
            assert find(grown, k, key) == find(mind.rho, k, key) > 0
            assert (grown.values[k, find(grown, k, key)] == key).all()
        assert np.count_nonzero(grown.index[k]) == 100 * (k + 1)
    assert find(grown, 0, keys[150]) == 0
