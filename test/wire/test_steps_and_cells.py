# Copyright 2026 The sparse_coord_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Steps and cells to seconds and metres, and back."""

import functools
import math
from dataclasses import replace

import pytest
from hypothesis import given
from hypothesis import strategies as st

from sparse_coord_ros.core.game.scenario import load_scenario
from sparse_coord_ros.core.game.world import Action
from sparse_coord_ros.core.runs.run_config import make_run
from sparse_coord_ros.protocol.wire.messages import (
    Messages,
    action_from,
    action_numbers,
)


@functools.cache
def scenario(name):
    return load_scenario(name)


def with_cells_of(name, resolution):
    """Return a run on a map whose cells have so many metres."""
    found = scenario(name)
    grid = replace(found.map, resolution=resolution)
    return make_run(replace(found, map=grid), {})


@given(st.floats(0.05, 10.0), st.data())
def test_cells_come_back(resolution, data):
    """From anywhere in their squares."""
    messages = Messages(with_cells_of("cmu", resolution))
    cell = data.draw(st.integers(0, len(messages.centres) - 1))
    x, y = messages.centres[cell]
    off = [resolution * data.draw(st.floats(-0.49, 0.49)) for _ in range(2)]
    assert messages.cell(x, y) == messages.cell(x + off[0], y + off[1]) == cell


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
    messages = Messages(with_cells_of("env1", resolution))
    assert messages.cell(*place) is None


@given(st.integers(0, 9_999_999))
def test_steps_come_back(step):
    messages = Messages(make_run(scenario("env1"), {}))
    sec, nanosec = messages.stamp(step)
    assert messages.step(sec, nanosec) == step
    assert 0 <= nanosec < 1_000_000_000


def test_actions_come_back():
    for move in range(4):
        for action in (Action(move, False, -1, False), Action(move, True, 2, True)):
            assert action_from(action_numbers(action)) == action
    with pytest.raises(ValueError, match="no primitive action"):
        action_from((0.0, 0.0, 0.0, 0.0, 0.0))
    with pytest.raises(ValueError, match="no robot's number"):
        action_from((1.0, 0.0, 0.0, math.nan, 0.0))
