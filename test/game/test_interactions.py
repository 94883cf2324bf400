# Copyright 2026 The sparse_coord_ros authors
# SPDX-License-Identifier: Apache-2.0
"""What robots do to each other, in one step and in many."""

from itertools import combinations, permutations, product

import numpy as np
import pytest

from sparse_coord_ros.base.errors import ScenarioError
from sparse_coord_ros.core.game.interactions import (
    NOWHERE,
    can_miscoordinate,
    interactions_of,
    miscoordinates,
    miscoordinations,
    partners,
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
    """Return where robots end."""
    cells = list(wanted)
    settle(inter, before, cells)
    return cells


def by_all_sets(inter, before, wanted):
    """Return where robots end, by trying which of them move: all sets, the largest first.

    Just those robots stay that cannot move beside the others.
    """
    team = range(len(before))
    sets = [set(own) for n in reversed(range(4)) for own in combinations(team, n)]
    tried = ([wanted[k] if k in own else before[k] for k in team] for own in sets)
    return next(
        after
        for own, after in zip(sets, tried, strict=True)
        if all(can_move(inter, before, wanted, after, k) == (k in own) for k in team)
    )


def can_move(inter, before, wanted, after, k):
    """Return whether a robot can go where it wants, beside the others as they end."""
    x = before[k]
    c = wanted[k]
    if c == x or not inter.narrow[c]:
        return True
    for j in range(len(before)):
        holds_it = before[j] == after[j] == c
        goes_first = before[j] != c and after[j] == c and j < k
        comes_towards = before[j] == c and after[j] == x
        if j != k and (holds_it or goes_first or comes_towards):
            return False
    return True


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
    assert inter.places.tolist() == [*places, NOWHERE]
    due = []
    for cells in STATES.tolist():
        at = [places[cell] for cell in cells]
        pairs = {(k, j) for k, j in permutations(TEAM, 2) if at[k] == at[j] >= 0}
        due.append(bool(pairs))
        assert miscoordinates(inter, cells, cells) == bool(pairs)
        for k in TEAM:
            others = partners(inter, cells, cells, cells, k)
            assert others == sum(1 << j for i, j in pairs if i == k)
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
    inter = corridor("swap")
    assert miscoordinates(inter, [1, 2, 0], [2, 1, 0])
    assert partners(inter, [1, 2, 0], [2, 1, 0], [2, 1, 0], 0) == 2
    assert partners(inter, [1, 2, 0], [2, 1, 0], [2, 1, 0], 2) == 0
    assert not miscoordinates(inter, [0, 1, 2], [1, 0, 2])  # one cell is a goal
    assert not miscoordinates(inter, [1, 2, 2], [2, 3, 3])  # they follow
    assert not miscoordinates(inter, [1, 2, 2], [1, 2, 2])


@pytest.mark.parametrize(
    ("before", "wanted", "after", "others"),
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
def test_a_narrow_cell_holds_one_robot(before, wanted, after, others):
    inter = corridor("block")
    assert np.flatnonzero(inter.narrow).tolist() == [2, 3]
    assert ends(inter, before, wanted) == after
    assert [partners(inter, before, wanted, after, k) for k in TEAM] == others
    assert not miscoordinates(inter, before, after)


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


@pytest.mark.parametrize(
    "interactions", ["block", "block:anywhere", "together+swap+block"]
)
def test_robots_end_as_all_sets_of_movers_say(interactions):
    inter = corridor(interactions)
    lead = [[max(0, x - 1), x, min(4, x + 1)] for x in range(5)]
    steps = [
        (before, list(wanted))
        for before in STATES.tolist()
        for wanted in product(*(lead[x] for x in before))
    ]
    due = [by_all_sets(inter, *step) for step in steps]
    assert [ends(inter, *step) for step in steps] == due
    assert due != [wanted for _, wanted in steps]
    before = np.array([x for x, _ in steps]).T
    wanted = np.array([y for _, y in steps]).T
    after = settled(inter, before, wanted)
    assert after.T.tolist() == due
    paid = [miscoordinates(inter, x, y) for (x, _), y in zip(steps, due, strict=True)]
    assert miscoordinations(inter, before, after).tolist() == paid


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
