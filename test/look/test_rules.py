# Copyright 2026 The sparse_coord_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The rules of a scenario in words."""

import pytest

from sparse_coord_ros.core.game.scenario import load_scenario
from sparse_coord_ros.show.narrator import rules_in_words

ENV1 = "If two robots are in one doorway, every robot pays 100. A question costs 1."


@pytest.mark.parametrize(
    ("settings", "due"),
    [
        ({}, ENV1),
        ({"penalty": -2500, "ask_cost": 0}, "pays 2,500. A question is free."),
        ({"common_reward": "each:1:0"}, "every robot pays its own factor times 100. "),
        (
            {"interactions": "together:anywhere"},
            "are in one cell that is no goal, every",
        ),
        ({"interactions": "together:any_doorway"}, "robots are in doorways, every"),
        (
            {"interactions": "together+swap"},
            "are in one doorway or exchange cells, every",
        ),
        ({"interactions": "block"}, "A doorway holds one robot. A question costs 1."),
        (
            {"interactions": "swap+block:anywhere"},
            "A cell that is no goal holds one robot.",
        ),
        ({"perception": "never"}, "No question is answered."),
        ({"perception": "probability:0.6"}, "is answered with probability 0.6."),
        ({"perception": "range:2"}, "A question is answered within 2 cells."),
        (
            {"perception": "line_of_sight"},
            "answered where no wall is between the robots.",
        ),
    ],
)
def test_rules(settings, due):
    said = rules_in_words(load_scenario("env1", **settings))
    assert due in said
    assert ("A question is answered" in said) == (
        "perception" in settings
    ) or "No" in said


def test_robots_that_only_block_pay_nothing():
    said = rules_in_words(load_scenario("env1", interactions="block"))
    assert said == "A doorway holds one robot. A question costs 1."
