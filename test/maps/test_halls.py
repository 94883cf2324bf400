# Copyright 2026 The sparse_coord_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Teams that cross halls of the size of nav2's depot and warehouse, by the suggested settings."""

import pytest
from floor_plans import write

from sparse_coord_ros.core.engine.training import train
from sparse_coord_ros.core.learners.registry import learner_of
from sparse_coord_ros.core.solve.exact import evaluate_best
from sparse_coord_ros.core.solve.verdict import LOST, verdict_on
from sparse_coord_ros.lab.maps.image import read_floor_plan
from sparse_coord_ros.lab.maps.plan import import_map, scenario_of


@pytest.mark.long
@pytest.mark.parametrize("robots", [2, 4])
@pytest.mark.parametrize("hall", ["depot", "store"])
def test_all_arrive(tmp_path, hall, robots):
    write(hall, tmp_path)
    plan = read_floor_plan(tmp_path / f"{hall}.yaml")
    x = plan.origin.x
    y = plan.origin.y
    (rows, columns) = plan.free.shape
    west = x + 1.5
    east = x + columns * plan.resolution - 1.5
    south = y + 1.5
    north = y + rows * plan.resolution - 1.5
    corners = [(west, south), (east, north), (east, south), (west, north)]
    pairs = [(corners[k], corners[k ^ 1]) for k in range(robots)]
    done = import_map(plan, cell=0.5, radius=0.2, robots=pairs)
    assert done.grid.doorway_count >= 2
    scenario, *_ = scenario_of(done, pairs, {})
    learner = learner_of("voi")
    scenario = learner.with_defaults(scenario)
    training = train(scenario, learner, 1)
    found = evaluate_best(
        scenario, training.tables, trials=1000, seed=1, learner=learner
    )
    assert found.mean("arrived") >= 0.999
    assert verdict_on(scenario, learner, found).kind != LOST
