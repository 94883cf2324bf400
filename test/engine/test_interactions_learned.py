# Copyright 2026 The sparse_coord_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Learner voi learns to exchange no cells, and to let the other robot out of a lane."""

import numpy as np
import pytest
from teams import drawn

from sparse_coord_ros.core.engine.batch import prepare
from sparse_coord_ros.core.learners.registry import learner_of
from sparse_coord_ros.core.runs.run import LearningRun
from sparse_coord_ros.core.runs.team import Team

AISLE = "1.......2"
LANE = "1..###..2\n...DDD...\n...###..."


def worth(learner, grid, kind):
    """Return what teams of four seeds earn in greedy trials, a robot."""
    rule = learner_of(learner)
    chosen = {"interactions": kind, "penalty": -100, "steps": 20_000}
    scenario = rule.with_defaults(drawn(grid).with_settings(chosen))
    team = Team(scenario, rule, compiled=True)
    found = []
    for seed in range(4):
        run = LearningRun(team, seed)
        run.advance(scenario.steps)
        found.append(run.play(100).returns.mean())
    return np.mean(found)


@pytest.mark.usefixtures("compiled_loops")
@pytest.mark.parametrize(
    ("grid", "kind"), [(AISLE, "swap"), (LANE, "block"), (LANE, "block:anywhere")]
)
def test_it_earns_more_than_robots_that_ignore_each_other(grid, kind):
    prepare("voi")
    assert worth("voi", grid, kind) > worth("noncoop", grid, kind) + 5
