# Copyright 2026 The sparse_coord_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Steps and cells to seconds and metres, and back."""

import math

import pytest

from sparse_coord_ros.core.game.scenario import load_scenario
from sparse_coord_ros.core.game.world import Action
from sparse_coord_ros.core.runs.run_config import make_run
from sparse_coord_ros.protocol.wire.frame import Frame
from sparse_coord_ros.protocol.wire.messages import action_from, action_numbers


@pytest.mark.parametrize("resolution", [0.05, 1 / 3, 1.0, 7.77])
def test_cells_come_back(resolution):
    frame = Frame(make_run(load_scenario("cmu"), {"resolution": resolution}))
    for cell, (x, y) in enumerate(frame.centres):
        assert frame.cell(x, y) == cell
        assert frame.cell(x + 0.49 * resolution, y - 0.49 * resolution) == cell


@pytest.mark.parametrize("resolution", [0.1, 1.0])
@pytest.mark.parametrize(
    "place",
    [
        (math.nan, 0.5),
        (math.inf, 0.5),
        (-0.5, 0.5),
        (0.5, 1e9),
        (1e308, 0.5),
        (0.5, -1e308),
    ],
)
def test_elsewhere_is_no_cell(place, resolution):
    frame = Frame(make_run(load_scenario("env1"), {"resolution": resolution}))
    assert frame.cell(*place) is None


@pytest.mark.parametrize("period", [0.001, 0.033, 0.1, 60.0])
def test_steps_come_back(period):
    frame = Frame(make_run(load_scenario("env1"), {"step_period": period}))
    for step in (0, 1, 29, 30, 31, 9_999_999):
        assert frame.step(*frame.stamp(step)) == step
        assert 0 <= frame.stamp(step)[1] < 1_000_000_000


def test_actions_come_back():
    for move in range(4):
        for action in (Action(move, False, -1, False), Action(move, True, 2, True)):
            assert action_from(action_numbers(action)) == action
    with pytest.raises(ValueError, match="no primitive action"):
        action_from((0.0, 0.0, 0.0, 0.0, 0.0))
    with pytest.raises(ValueError, match="no robot's number"):
        action_from((1.0, 0.0, 0.0, math.nan, 0.0))
