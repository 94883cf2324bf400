# Copyright 2026 The sparse_coord_ros authors
# SPDX-License-Identifier: Apache-2.0
"""What a team's reward is measured against."""

import pytest

from sparse_coord_ros.game.scenario import load_scenario
from sparse_coord_ros.solve.yardsticks import yardsticks


@pytest.mark.parametrize(
    ("name", "names"),
    [
        ("env1", ["class bound", "exact joint optimum"]),
        ("crowd-4r", ["best known team", "bound (robots alone)"]),
    ],
)
def test_the_known_ones_best_last(name, names):
    found = yardsticks(load_scenario(name).with_settings({"penalty": -100}))
    assert [name for name, _ in found] == names
    assert [value for _, value in found] == sorted(value for _, value in found)
