# Copyright 2026 The sparse_coord_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Two robots at one meeting place, in plain numbers, in arrays and in the compiled loops."""

from itertools import product

import numpy as np
import pytest

from sparse_coord_ros.core.game import rules
from sparse_coord_ros.core.game.miscoordination import (
    NOWHERE,
    meeting_places,
    miscoordinated,
    miscoordinations,
)
from sparse_coord_ros.core.game.rules import problem_of
from sparse_coord_ros.core.game.scenario import parse_yaml, scenario_from_dict

CORRIDOR = """
map: {name: corridor, text: "---\\n1.DD2"}
robots:
  a: {start: 1, goal: 2}
  b: {start: 2, goal: 1}
  c: {start: 2, goal: 1}
"""
STATES = np.array(list(product(range(5), repeat=3)))


@pytest.mark.parametrize(
    ("conflict", "places"),
    [
        ("same_cell", [NOWHERE, NOWHERE, 2, 3, NOWHERE]),
        ("any_doorway", [-1, -1, 0, 0, -1]),
    ],
)
def test_one_rule_for_numbers_arrays_and_the_loops(conflict, places):
    data = {**parse_yaml(CORRIDOR, where=""), "conflict": conflict}
    scenario = scenario_from_dict(data, where="", name="corridor")
    assert meeting_places(scenario).tolist() == places
    problem = problem_of(scenario, plain=True)
    members = [0, 1, 2]
    due = []
    for cells in STATES.tolist():
        at = [places[cell] for cell in cells]
        pairs = {
            (k, j)
            for k, j in product(range(3), repeat=2)
            if k != j and at[k] == at[j] >= 0
        }
        due.append(bool(pairs))
        assert miscoordinated(at) == bool(pairs)
        partners = [sum(1 << j for i, j in pairs if i == k) for k in range(3)]
        assert rules.miscoordination(problem, cells, members) == bool(pairs)
        assert [
            rules.partners_of(problem, cells, members, k) for k in range(3)
        ] == partners
    assert sum(due) == (26 if conflict == "same_cell" else 44)  # of 125
    assert miscoordinations(scenario, STATES).tolist() == due


def test_a_state_that_nobody_knows_is_none():
    scenario = scenario_from_dict(
        parse_yaml(CORRIDOR, where=""), where="", name="corridor"
    )
    found = miscoordinations(
        scenario, np.array([[-1, -1, 2], [-1, 2, 2], [-1, -1, -1]])
    )
    assert found.tolist() == [False, True, False]


def test_the_first_cell_can_be_a_doorway_too():
    data = {
        "map": {"name": "end", "text": "---\nD.12"},
        "robots": {"a": {"start": 1, "goal": 2}, "b": {"start": 2, "goal": 1}},
    }
    scenario = scenario_from_dict(data, where="", name="end")
    found = miscoordinations(scenario, np.array([[0, 0], [0, 1], [0, -1]]))
    assert found.tolist() == [True, False, False]
