# Copyright 2026 The sparse_coord_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The exact joint optimum: the study's values, maps solved by hand, bounds."""

import itertools

import pytest

from sparse_coord_ros.core.game.interactions import (
    interactions_of,
    miscoordinates,
    settle,
)
from sparse_coord_ros.core.game.scenario import load_scenario
from sparse_coord_ros.core.solve.optimum import (
    SOLVED,
    independent_bound,
    joint_optimum,
)
from sparse_coord_ros.core.solve.shortest_paths import shortest_paths

GAMMA = 0.95

# Exact joint optimum at penalty -20, joint states.
EXACT = {
    "env1": (121.89, 21**2),
    "env2-2r": (111.02, 36**2),
    "isr": (143.56, 43**2),
    "pentagon": (161.31, 52**2),
    "cit": (111.21, 70**2),
    "mit": (66.87, 49**2),
    "suny": (111.32, 74**2),
    "cmu": (28.36, 133**2),
}


@pytest.mark.parametrize("name", EXACT)
def test_exact_values(name):
    value, states = EXACT[name]
    optimum = joint_optimum(load_scenario(name, penalty=-20))
    assert optimum.exact
    assert optimum.joint_states == states
    assert optimum.value == pytest.approx(value, abs=0.01)


def test_it_is_computed_once_for_what_differs_only_in_learning():
    scenario = load_scenario("env1").with_settings({"penalty": -33})
    same = [{}, {"steps": 7}, {"ask_cost": 9}, {"perception": "never"}]
    other = [
        {"penalty": -34},
        {"discount": 0.9},
        {"move_success": 1},
        {"goal_reward": 9},
    ]
    known = len(SOLVED)
    found = [joint_optimum(scenario.with_settings(one)).value for one in same + other]
    assert len(SOLVED) - known == 1 + len(other)
    assert len(set(found[: len(same)])) == 1
    assert len(set(found)) == 1 + len(other)


@pytest.mark.parametrize("name", ["env1", "mit"])
def test_without_penalty_it_is_the_bound(name):
    scenario = load_scenario(name).with_settings({"penalty": 0})
    assert joint_optimum(scenario).value == pytest.approx(
        independent_bound(scenario), abs=1e-6
    )


def test_too_many_joint_states_give_the_bound():
    scenario = load_scenario("env2-4r")
    optimum = joint_optimum(scenario)
    assert not optimum.exact
    assert optimum.joint_states == 36**4
    assert (
        optimum.value == independent_bound(scenario) == pytest.approx(111.32, abs=0.01)
    )


@pytest.mark.parametrize(
    ("penalty", "value"),
    [
        (0, 200 * GAMMA),
        (-1, 200 * GAMMA - 1),  # cheaper to meet in the doorway of 1D2 than to wait
        (-20, 100 * (GAMMA + GAMMA**2)),  # one robot waits a step
        (-1000, 100 * (GAMMA + GAMMA**2)),
    ],
)
def test_one_doorway_by_hand(make, penalty, value):
    optimum = joint_optimum(make("1D2", move_success=1, penalty=penalty))
    assert optimum.value == pytest.approx(value, abs=1e-6)
    assert optimum.exact


@pytest.mark.parametrize(
    ("penalty", "factors", "value"),
    [
        (-20, "0:0", 200 * GAMMA),
        (-1, "3:1", 200 * GAMMA - 2),  # what the two pay together, a robot
        (-2, "0:1", 200 * GAMMA - 1),
        (-20, "0:1", 100 * (GAMMA + GAMMA**2)),
    ],
)
def test_robots_that_pay_differently_by_hand(make, penalty, factors, value):
    scenario = make(
        "1D2", move_success=1, penalty=penalty, common_reward=f"each:{factors}"
    )
    assert joint_optimum(scenario).value == pytest.approx(value, abs=1e-6)


@pytest.mark.parametrize(
    ("interactions", "value"),
    [
        ("together", 200 * GAMMA**2),  # they pass each other between two doorways
        (
            "together:any_doorway",
            100 * (GAMMA**2 + GAMMA**4),
        ),  # one waits until the other is through
    ],
)
def test_two_doorways_by_hand(make, interactions, value):
    scenario = make("1DD2", move_success=1, interactions=interactions)
    assert joint_optimum(scenario).value == pytest.approx(value, abs=1e-6)


def test_three_robots_by_hand(make):
    """An arrived robot pays the penalty too, so the two others do not meet."""
    robots = {"a": ([0, 0], [0, 2]), "b": ([0, 2], [0, 0]), "c": ([1, 0], [1, 1])}
    scenario = make(".D.\n..#", robots, move_success=1)
    expected = (200 * GAMMA + 200 * GAMMA**2 + 200) / 3
    assert joint_optimum(scenario).value == pytest.approx(expected, abs=1e-6)


@pytest.mark.parametrize(
    ("interactions", "grid", "goals"),
    [
        ("together", "1D2", ([0, 1], [0, 1])),
        ("together:any_doorway", "1DD2", ([0, 2], [0, 1])),
    ],
)
@pytest.mark.parametrize("move_success", [1, 0.8])
def test_robots_that_have_all_arrived_in_a_doorway_pay_no_more(
    make, interactions, grid, goals, move_success
):
    robots = {"a": (1, goals[0]), "b": (2, goals[1])}
    scenario = make(grid, robots, interactions=interactions, move_success=move_success)
    optimum = joint_optimum(scenario)
    reference = shortest_paths(scenario)
    assert optimum.value >= reference.mean("returns") - 1e-9
    if move_success == 1 and interactions == "together":
        # one step ends with both in there
        assert reference.mean("returns") == pytest.approx(200 - 20)
        # Better: the second comes later, and the penalty then is worth less; it is paid once.
        later = max(100 + (100 - 20) * GAMMA**wait for wait in range(400))
        assert optimum.value == pytest.approx(max(later, 180), abs=1e-6)


def test_unsure_moves_by_hand(make):
    """One move of one robot: 200 p / (1 - gamma (1 - p))."""
    scenario = make("12", {"a": (1, 2)}, move_success=0.8)
    expected = 200 * 0.8 / (1 - GAMMA * 0.2)
    assert joint_optimum(scenario).value == pytest.approx(expected, abs=1e-6)
    assert independent_bound(scenario) == pytest.approx(expected, rel=1e-12)


def test_the_goal_is_absorbing_where_no_wall_holds_the_robot(make):
    scenario = make("...\n...\n...", {"a": ([0, 1], [1, 1])}, move_success=1)
    assert joint_optimum(scenario).value == pytest.approx(200, abs=1e-6)


@pytest.mark.parametrize(("grid", "value"), [("12", 8.0), ("1.2", 0.0)])
def test_discount_zero(make, grid, value):
    """Only the first step counts: 10 p where the goal is one move away."""
    scenario = make(grid, discount=0)
    assert joint_optimum(scenario).value == pytest.approx(value)
    assert independent_bound(scenario) == pytest.approx(value)


@pytest.mark.parametrize(
    ("grid", "interactions", "penalty", "value"),
    [
        # One robot goes first; the other one enters when it has left.
        ("1D2", "block", -20, 100 * (GAMMA + GAMMA**3)),
        ("1D2", "block:anywhere", -20, 100 * (GAMMA + GAMMA**3)),
        ("1D2", "together+block", -20, 100 * (GAMMA + GAMMA**3)),
        # They meet in the doorway, and exchange no cells.
        ("1D2", "swap", -20, 200 * GAMMA),
        # They exchange the two cells between the goals, or one waits and they meet in a cell.
        ("1..2", "swap", -1, 200 * GAMMA**2 - GAMMA),
        ("1..2", "swap", -20, 100 * (GAMMA**2 + GAMMA**3)),
        ("1..2", "block:anywhere", -20, 100 * (GAMMA**2 + GAMMA**5)),
        ("1..2", "together:anywhere", -20, 200 * GAMMA**2),
        ("1..2", "together:anywhere+swap", -1, 200 * GAMMA**2 - GAMMA),
    ],
)
def test_kinds_of_interaction_by_hand(make, grid, interactions, penalty, value):
    scenario = make(grid, move_success=1, interactions=interactions, penalty=penalty)
    optimum = joint_optimum(scenario)
    assert optimum.value == pytest.approx(value, abs=1e-6)
    assert optimum.exact


SOME = ["together:anywhere+swap+block"]
OTHERS = [
    "together",
    "block:anywhere",
    "together:anywhere",
    "together:any_doorway",
    "swap",
    "block",
    "together+swap",
    "together+swap+block:anywhere",
]
KINDS = [*SOME, *(pytest.param(kind, marks=pytest.mark.long) for kind in OTHERS)]


@pytest.mark.parametrize("interactions", KINDS)
def test_it_is_what_brute_force_finds(make, interactions):
    """Three robots; each step by the rules of teams in plain Python."""
    robots = {"a": ([0, 0], [0, 3]), "b": ([0, 3], [0, 0]), "c": ([1, 1], [0, 2])}
    scenario = make(
        "..D.\n#.##",
        robots,
        interactions=interactions,
        move_success=0.7,
        discount=0.6,
        common_reward="each:1:0.5:2",
    )
    assert joint_optimum(scenario).value == pytest.approx(
        brute_force(scenario), abs=1e-6
    )


def brute_force(scenario, sweeps=50):
    """Return the optimum by value iteration over dictionaries."""
    inter = interactions_of(scenario)
    lead = scenario.map.next_cell.tolist()
    cells = range(len(lead))
    goals = tuple(robot.goal for robot in scenario.robots)
    p = scenario.move_success
    outcomes = {}
    for state in itertools.product(cells, repeat=len(goals)):
        choices = [
            [x] if x == goal else sorted({x, *lead[x]})
            for x, goal in zip(state, goals, strict=True)
        ]
        for wanted in itertools.product(*choices):
            ends = list(wanted)
            settle(inter, state, ends)
            paid = sum(y == goal for y, goal in zip(ends, goals, strict=True))
            paid *= scenario.goal_reward
            if miscoordinates(inter, state, ends):
                paid += sum(scenario.penalties)
            outcomes[state, wanted] = tuple(ends), paid / len(goals)
    value = dict.fromkeys(itertools.product(cells, repeat=len(goals)), 0.0)
    home = scenario.goal_reward / (1 - scenario.discount)
    for _ in range(sweeps):
        worth = {
            key: paid + scenario.discount * value[after]
            for key, (after, paid) in outcomes.items()
        }
        for state in value:
            if state == goals:
                value[state] = home
                continue
            ways = [
                [(x,)] if x == goal else [(x, y) for y in lead[x]]
                for x, goal in zip(state, goals, strict=True)
            ]
            value[state] = max(
                expected_worth(worth, state, joint, p)
                for joint in itertools.product(*ways)
            )
    return value[tuple(robot.start for robot in scenario.robots)]


def expected_worth(worth, state, joint, p):
    """Return the mean of a joint action; `joint` has (own cell, cell that it leads to)."""
    total = 0.0
    for wanted in itertools.product(*[set(way) for way in joint]):
        chance = 1.0
        for way, y in zip(joint, wanted, strict=True):
            if len(set(way)) == 2:
                chance *= p if y == way[1] else 1 - p
        total += chance * worth[state, wanted]
    return total
