# Copyright 2026 The sparse_coord_ros authors
# SPDX-License-Identifier: Apache-2.0
"""What robots do to each other, in plain numbers, in arrays, in loops and in the world."""

from itertools import product

import numpy as np
import pytest
from teams import drawn

from sparse_coord_ros.base.errors import ScenarioError
from sparse_coord_ros.core.game.interactions import (
    NOWHERE,
    any_together,
    as_lists,
    can_miscoordinate,
    ends_of_two,
    interacting,
    interactions_of,
    miscoordinate,
    miscoordinate_two,
    miscoordinations,
    settle,
    settled,
)
from sparse_coord_ros.core.game.scenario import parse_yaml, scenario_from_dict

CORRIDOR = """
map: {name: corridor, text: "---\\n1.DD2"}
robots:
  a: {start: 1, goal: 2}
  b: {start: 2, goal: 1}
  c: {start: 2, goal: 1}
"""
STATES = np.array(list(product(range(5), repeat=3)))
TEAM = [0, 1, 2]


def corridor(interactions, text="1.DD2", robots=None):
    """Return the interactions on a map of one row."""
    data = parse_yaml(CORRIDOR, where="")
    data["map"]["text"] = f"---\n{text}"
    if robots is not None:
        data["robots"] = robots
    data["interactions"] = interactions
    return interactions_of(scenario_from_dict(data, where="", name="corridor"))


def ends(inter, before, wanted):
    """Return where robots end, by the loop over lists; arrays must say the same."""
    cells = list(wanted)
    settle(as_lists(inter), before, cells, range(len(before)))
    assert settled(inter, np.array(before), np.array(wanted)).tolist() == cells
    return cells


@pytest.mark.parametrize(
    ("interactions", "places", "count"),
    [
        ("together", [NOWHERE, NOWHERE, 2, 3, NOWHERE], 26),
        ("together:any_doorway", [NOWHERE, NOWHERE, 0, 0, NOWHERE], 44),
        ("together:anywhere", [NOWHERE, 1, 2, 3, NOWHERE], 39),
        ("swap", [NOWHERE] * 5, 0),
    ],
)
def test_together(interactions, places, count):
    inter = corridor(interactions)
    assert inter.places.tolist() == places
    lists = as_lists(inter)
    due = []
    for cells in STATES.tolist():
        at = [places[cell] for cell in cells]
        pairs = {
            (k, j) for k, j in product(TEAM, repeat=2) if k != j and at[k] == at[j] >= 0
        }
        due.append(bool(pairs))
        assert any_together(at) == bool(pairs)
        assert miscoordinate(lists, cells, cells, TEAM) == bool(pairs)
        for k in TEAM:
            partners = interacting(lists, cells, cells, cells, TEAM, k)
            assert partners == sum(1 << j for i, j in pairs if i == k)
    assert sum(due) == count  # of 125
    assert miscoordinations(inter, STATES.T, STATES.T).tolist() == due


def test_a_cell_that_is_not_known_is_no_miscoordination():
    cells = np.array([[-1, -1, 2], [-1, 2, 2], [-1, -1, -1]]).T
    found = miscoordinations(corridor("together"), cells, cells)
    assert found.tolist() == [False, True, False]
    before = np.array([[2, 3, 0], [-1, 3, 0]]).T
    after = np.array([[3, 2, 0], [3, 2, 0]]).T
    found = miscoordinations(corridor("swap"), before, after)
    assert found.tolist() == [True, False]


def test_the_first_cell_can_be_a_doorway_too():
    robots = {"a": {"start": 1, "goal": 2}, "b": {"start": 2, "goal": 1}}
    cells = np.array([[0, 0], [0, 1], [0, -1]]).T
    found = miscoordinations(corridor("together", "D.12", robots), cells, cells)
    assert found.tolist() == [True, False, False]


def test_swap_is_an_exchange_of_two_cells_that_are_no_goals():
    inter = as_lists(corridor("swap"))
    assert miscoordinate(inter, [1, 2, 0], [2, 1, 0], TEAM)
    assert interacting(inter, [1, 2, 0], [2, 1, 0], [2, 1, 0], TEAM, 0) == 2
    assert interacting(inter, [1, 2, 0], [2, 1, 0], [2, 1, 0], TEAM, 2) == 0
    assert not miscoordinate(inter, [0, 1, 2], [1, 0, 2], TEAM)  # one cell is a goal
    assert not miscoordinate(inter, [1, 2, 2], [2, 3, 3], TEAM)  # they follow
    assert not miscoordinate(inter, [1, 2, 2], [1, 2, 2], TEAM)


@pytest.mark.parametrize(
    ("before", "wanted", "after", "partners"),
    [
        ([1, 2, 0], [2, 2, 0], [1, 2, 0], [2, 0, 0]),  # a cell that is held
        ([1, 2, 0], [2, 3, 0], [2, 3, 0], [0, 0, 0]),  # one follows
        ([1, 2, 3], [2, 3, 3], [1, 2, 3], [2, 4, 0]),  # the first stays, so all stay
        ([1, 3, 0], [2, 2, 0], [2, 3, 0], [0, 1, 0]),  # the lower number goes
        ([2, 3, 0], [3, 2, 0], [2, 3, 0], [2, 1, 0]),  # nobody passes through another
        ([1, 2, 0], [2, 1, 0], [1, 1, 0], [2, 0, 0]),  # out of a doorway one may come
        ([3, 2, 4], [2, 2, 4], [3, 2, 4], [2, 0, 0]),
        ([2, 2, 0], [3, 1, 0], [3, 1, 0], [0, 0, 0]),  # two that began in one cell
        ([1, 1, 2], [2, 2, 1], [1, 1, 1], [4, 4, 0]),
        ([3, 3, 3], [4, 4, 4], [4, 4, 4], [0, 0, 0]),  # a goal holds all
    ],
)
def test_a_narrow_cell_holds_one_robot(before, wanted, after, partners):
    inter = corridor("block")
    assert inter.narrow.tolist() == [False, False, True, True, False]
    assert ends(inter, before, wanted) == after
    found = [interacting(as_lists(inter), before, wanted, after, TEAM, k) for k in TEAM]
    assert found == partners
    assert not miscoordinate(as_lists(inter), before, after, TEAM)


@pytest.mark.parametrize(
    ("interactions", "text", "can"),
    [
        ("together", "1.DD2", True),
        ("together", "1...2", False),
        ("together:anywhere", "1...2", True),
        ("swap", "1...2", True),
        ("block", "1.DD2", False),
        ("block:anywhere", "1.DD2", False),
    ],
)
def test_where_nobody_pays_nobody_miscoordinates(interactions, text, can):
    assert can_miscoordinate(corridor(interactions, text)) is can


def test_robots_may_go_around_in_a_circle():
    robots = {"a": {"start": 1, "goal": 2}, "b": {"start": 2, "goal": 1}}
    inter = corridor("block:anywhere", "1.\n..\n2.", robots)
    assert ends(inter, [0, 1, 3, 2], [1, 3, 2, 0]) == [1, 3, 2, 0]
    assert ends(inter, [2, 3, 1], [3, 1, 1]) == [2, 3, 1]


def test_loop_and_arrays_settle_all_steps_alike():
    inter = corridor("block:anywhere")
    lead = [[max(0, x - 1), x, min(4, x + 1)] for x in range(5)]
    steps = [
        (before, wanted)
        for before in STATES.tolist()
        for wanted in product(*(lead[x] for x in before))
    ]
    before = np.array([one for one, _ in steps]).T
    wanted = np.array([list(one) for _, one in steps]).T
    after = settled(inter, before, wanted)
    for i, (x, y) in enumerate(steps):
        assert ends(inter, x, y) == after[:, i].tolist()
    # No robot enters a narrow cell that another one is in, or through which another one comes.
    for k, j in [(0, 1), (0, 2), (1, 2)]:
        moved = (after != before)[[k, j]].any(axis=0)
        same = (after[k] == after[j]) & inter.narrow[after[k]]
        assert not (same & moved & (before[k] != before[j])).any()
        passed = (
            (after[k] == before[j]) & (after[j] == before[k]) & (after[k] != after[j])
        )
        assert not (passed & inter.narrow[before[k]] & inter.narrow[before[j]]).any()


@pytest.mark.parametrize(
    ("text", "why"),
    [
        ("swop", "did you mean 'swap'"),
        ("together+together:anywhere", "names 'together' 2 times"),
        ("", "unknown value ''"),
    ],
)
def test_a_bad_value_is_refused(text, why):
    with pytest.raises(ScenarioError, match="setting interactions") as raised:
        corridor(text)
    assert why in str(raised.value)


def test_kinds_are_kept_in_one_order():
    data = {**parse_yaml(CORRIDOR, where=""), "interactions": "block+together"}
    scenario = scenario_from_dict(data, where="", name="corridor")
    assert scenario.interactions == "together+block"


def test_spaces_around_the_plus_do_not_matter():
    data = {**parse_yaml(CORRIDOR, where=""), "interactions": "swap + block"}
    scenario = scenario_from_dict(data, where="", name="corridor")
    assert scenario.interactions == "swap+block"


@pytest.mark.parametrize("kinds", ["together+swap+block", "swap+block:anywhere"])
def test_two_robots_end_as_a_team_of_two(kinds):
    scenario = drawn("1.D.2\n..#..", interactions=kinds)
    inter = interactions_of(scenario)
    listed = as_lists(inter)
    cells = range(len(scenario.map.cells))
    lead = scenario.map.next_cell.tolist()
    differ = 0
    for x, z in product(cells, repeat=2):
        for y, w in product([x, *lead[x]], [z, *lead[z]]):
            ends = [y, w]
            settle(listed, [x, z], ends, [0, 1])
            assert ends_of_two(inter, x, z, y, w) == tuple(ends)
            differ += ends != [y, w]
            paid = miscoordinate(listed, [x, z], ends, [0, 1])
            assert miscoordinate_two(inter, x, z, *ends) == paid
    assert differ >= 20
