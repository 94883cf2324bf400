# Copyright 2026 The sparse_coord_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Bodies between the barrier and the step."""

import pytest

from sparse_coord_ros.core.game.actions import SOUTH
from sparse_coord_ros.core.game.scenario import load_scenario
from sparse_coord_ros.core.game.world import Action
from sparse_coord_ros.protocol.lockstep.bodies import (
    BEGIN,
    NO_CELL,
    BodiesSide,
    BodyGoal,
    BodyWorld,
    GoalReport,
    Goals,
    waves,
)


class Port:
    """Keeps the goals."""

    def __init__(self):
        self.goals = []

    def send(self, goals):
        self.goals.append(goals)


def go(move):
    return Action(move, False, -1, False)


SOUTHWARD = (go(SOUTH), go(SOUTH))


@pytest.fixture
def made():
    """Return a world with sure moves and fixed starts, its side of the bodies, and the port."""
    scenario = load_scenario("env1").with_settings(
        {"move_success": 1.0, "starts": "fixed"}
    )
    world = BodyWorld(scenario, 1)
    port = Port()
    return world, BodiesSide(world, port.send), port


def arrive(side, goals, **cells):
    """Let the bodies of goals report; `robot_K`: another cell in which one ends."""
    for goal in goals.bodies:
        cell = cells.get(f"robot_{goal.robot + 1}", goal.end)
        side.reached(
            GoalReport(goal.robot, goals.number, cell, cell == goal.end, 1.5, 2.5)
        )


@pytest.fixture
def placed(made):
    """Return the same with the bodies placed, and sent south."""
    _, side, port = made
    side.made(SOUTHWARD)
    arrive(side, port.goals[0])
    return made


def test_bodies_are_placed_first_and_then_sent_and_then_the_step_is_made(made):
    world, side, port = made
    starts = list(world.cells)
    assert not side.made(SOUTHWARD) and not side.made(SOUTHWARD)
    (placed,) = port.goals
    assert placed == Goals(
        1, 1, True, BEGIN, tuple(BodyGoal(k, c, c) for k, c in enumerate(starts))
    )
    assert side.placing and side.waiting == [0, 1]
    assert not side.reached(GoalReport(0, 1, starts[0], True, 0.0, 0.0))
    # now they are sent
    assert not side.reached(GoalReport(1, 1, starts[1], True, 0.0, 0.0))
    sent = port.goals[1]
    south = [int(world.scenario.map.next_cell[c, SOUTH]) for c in starts]
    assert sent.bodies == tuple(BodyGoal(k, starts[k], south[k]) for k in (0, 1))
    assert not sent.placing and not side.made(SOUTHWARD) and sent.since == BEGIN
    arrive(side, sent)
    assert side.made(SOUTHWARD) and side.seconds == 1.5
    world.advance(SOUTHWARD)
    assert world.cells == south
    assert not side.made(SOUTHWARD)
    assert len(port.goals) == 3 and not port.goals[2].placing  # the same episode
    assert port.goals[2].since == 2.5


def test_where_the_poses_say_it_is_counts(placed):
    world, side, port = placed
    arrive(side, port.goals[1], robot_1=world.cells[0], robot_2=NO_CELL)
    before = list(world.cells)
    assert side.made(SOUTHWARD)
    world.advance(SOUTHWARD)
    assert world.cells == before
    assert (side.failed, side.lost) == (2, 1)


def test_who_does_not_report_has_not_moved(placed):
    world, side, port = placed
    before = list(world.cells)
    side.reached(GoalReport(0, 2, NO_CELL, False, 9.0, 0.0))
    assert side.waiting == [1]
    side.give_up()
    assert side.made(SOUTHWARD)
    world.advance(SOUTHWARD)
    assert world.cells == before and side.lost == 2


def test_reports_of_older_goals_count_for_nothing(placed):
    _, side, port = placed
    assert not side.reached(GoalReport(0, 1, 3, True, 1.0, 0.0))
    assert not side.reached(GoalReport(5, 2, 3, True, 1.0, 0.0))
    assert side.waiting == [0, 1]


def test_a_new_episode_places_them_again_even_in_the_middle_of_a_move(made):
    world, side, port = made
    side.made(SOUTHWARD)
    arrive(side, port.goals[0])
    arrive(side, port.goals[1])
    side.made(SOUTHWARD)
    world.advance(SOUTHWARD)
    side.made(SOUTHWARD)
    world.begin_episode()
    assert not side.made(SOUTHWARD)
    assert port.goals[-1].placing
    assert [goal.end for goal in port.goals[-1].bodies] == world.cells


def test_who_slips_is_sent_nowhere():
    scenario = load_scenario("env1").with_settings(
        {"move_success": 0.01, "starts": "fixed"}
    )
    world = BodyWorld(scenario, 1)
    port = Port()
    side = BodiesSide(world, port.send)
    side.made(SOUTHWARD)
    arrive(side, port.goals[0])
    assert len(port.goals) == 1 and side.made(SOUTHWARD)
    assert BodyWorld(scenario, 1, slips=False).wanted(0, SOUTH) != world.cells[0]


def test_a_body_whose_robot_is_stopped_is_sent_nowhere():
    scenario = load_scenario("lane").with_settings(
        {"move_success": 1, "starts": "fixed"}
    )
    world = BodyWorld(scenario, 1)
    first, second = scenario.robots
    way = scenario.map.distances_to(first.goal)
    lead = scenario.map.next_cell
    cell = first.start
    while way[cell] > 2:
        cell = min(lead[cell].tolist(), key=lambda y: way[y])
    move = min(range(4), key=lambda one: way[lead[cell, one]])
    ahead = int(lead[cell, move])
    back = lead[ahead].tolist().index(cell)
    assert not {cell, ahead} & {first.goal, second.goal}
    world.cells = [cell, ahead]
    assert world.told((go(move), go(back))) == [cell, ahead]  # they come towards
    assert world.told((go(move), None)) == [cell, ahead]  # one stands in the way
    assert world.told((None, go(back))) == [cell, ahead]


A = 1
B = 2
C = 3
DOOR = 9


@pytest.mark.parametrize(
    ("goals", "order"),
    [
        ([(A, A), (B, B)], []),
        ([(A, B), (B, C)], [[1], [0]]),  # one behind the other
        ([(A, DOOR), (DOOR, B)], [[1], [0]]),
        (
            [(A, DOOR), (DOOR, A)],
            [[1], [0]],
        ),  # past each other: out of the doorway first
        ([(A, B), (B, A)], [[0, 1]]),
        ([(A, DOOR), (B, DOOR)], [[0], [1]]),  # they meet: nothing keeps them from it
        ([(A, C), (DOOR, C)], [[1], [0]]),
        ([(A, DOOR), (DOOR, DOOR)], [[0]]),  # who stays is no reason to wait
        ([(A, B), (B, C), (C, A)], [[0, 1, 2]]),
    ],
)
def test_the_order_in_which_bodies_set_out(goals, order):
    found = waves(
        [BodyGoal(k, *ends) for k, ends in enumerate(goals)], frozenset({DOOR})
    )
    assert [[goal.robot for goal in wave] for wave in found] == order


@pytest.mark.parametrize("seconds", [(1.5, 0.5), (0.5, 1.5)])
def test_a_step_takes_as_long_as_its_slowest_body(placed, seconds):
    world, side, port = placed
    for k, lasted in enumerate(seconds):
        goal = port.goals[1].bodies[k]
        side.reached(GoalReport(k, 2, goal.end, True, lasted, 2.5))
    assert side.seconds == 1.5
    world.advance(SOUTHWARD)
    side.made(SOUTHWARD)
    arrive(side, port.goals[2])
    assert side.seconds == 3.0
