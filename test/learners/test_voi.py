# Copyright 2026 The sparse_coord_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The rule of learner voi, line by line, by numbers computed by hand.

The robot is robot 0 in cell `X`; its peer, robot 1, goes from `Z` to `Z2`. East of X is `Y`.
Models of moves and values are set by hand, whatever the map is.
"""

import numpy as np
import pytest
from teams import drawn, learn, memories_equal

from sparse_coord_ros.base.errors import SettingError
from sparse_coord_ros.core.game.actions import COORDINATE, EAST, NORTH, SOUTH, WEST
from sparse_coord_ros.core.game.draws import REPLAY, draw
from sparse_coord_ros.core.game.scenario import load_scenario
from sparse_coord_ros.core.game.world import Action, Reward
from sparse_coord_ros.core.learners import memory as memories
from sparse_coord_ros.core.learners import voi
from sparse_coord_ros.core.learners.agent import NOBODY, Agent, Choice, Decision
from sparse_coord_ros.core.learners.mind import memory_before
from sparse_coord_ros.core.learners.registry import learner_of
from sparse_coord_ros.core.learners.rules import NOT_PERCEIVED
from sparse_coord_ros.core.learners.table import find, met
from sparse_coord_ros.core.learners.voi import (
    ANSWERED,
    ASKED,
    CELLS,
    FELT,
    FORBIDDEN,
    NOT_FELT,
    Voi,
)

X, Y, Z, Z2 = 2, 3, 4, 5
G = 0.95
"""gamma"""
ALPHA = 0.25
COST = 1.5
BY_COUNT = 1.0 / np.maximum(1.0, np.arange(99.0))
"""alpha = 1 / n"""

PAIR = {"robot_1": (1, 2), "robot_2": (2, 1)}
THREE = {**PAIR, "robot_3": (3, 4)}


def agent(robots=PAIR, **settings):
    """Return robot 0 of a team on a tiny map, before learning; all U are 40."""
    grid = "1..D..2" if robots is PAIR else "1..D..2\n3.....4"
    chosen = {"step_size": f"constant:{ALPHA}", "q_coord_init": 40, "ask_cost": COST}
    scenario = drawn(grid, robots, **{**chosen, **settings})
    return Agent(learner_of("voi"), learner_of("voi").with_defaults(scenario), 0, 3)


def pair_row(one, x, z, peer=1):
    """Return the row of `pairs` of an own cell, a peer and its cell; a new one if need be."""
    return met(one.mind.pairs, one.task, 0, voi.pair_key(one.task, x, peer, z))


def set_rho(one, x, z, values, peer=1):
    """Set rho_j(x, z, .)."""
    one.mind.pairs.values[0, pair_row(one, x, z, peer), :4] = values


def rho(one, x, z, peer=1):
    """Return rho_j(x, z, .)."""
    return one.mind.pairs.values[0, pair_row(one, x, z, peer), :4].tolist()


def step_row(one, z=Z):
    """Return the row of a step of the peer to Z2, with the robot in X."""
    return met(one.mind.steps, one.task, 0, voi.step_key(one.task, X, 1, z, Z2))


def learn_from_peer(one, y, move, common, number=9):
    """Let a robot learn that it made a move from X to Y, and its peer from Z to Z2."""
    one.mind.last[0, : voi.PARTNERS] = [number - 1, X, move]
    one.mind.last[0, CELLS:] = [X, Z]
    now = transition(one, y, Z2, number)
    voi.learn_from_peer(one.mind, one.task, 0, now, 1, Z2, common)


def set_answers(one, x, z, asked, answered, peer=1):
    """Set how often it asked in x with a peer in z, and was answered."""
    row = pair_row(one, x, z, peer)
    one.mind.pairs.updates[0, row, [ASKED, ANSWERED]] = [asked, answered]


def set_moves(one, x, **moves):
    """Set the model of moves in a cell: (tries, how many of them led out, to which cell)."""
    for name, (tries, led, to) in moves.items():
        b = {"north": NORTH, "south": SOUTH, "east": EAST, "west": WEST}[name]
        one.mind.tries[0, x, b] = tries
        one.mind.led[0, x, b] = led
        one.mind.to[0, x, b] = to


def step(one, number, x, move, y, seen=None, **reward):
    """Let a robot learn from a step in which it asked; `seen`: its peers' cells, as answered."""
    parts = {"individual": 0.0, "common": 0.0, "ask_cost": -COST, **reward}
    partners = parts.pop("partners", 0)
    action = Action(move, True, NOBODY, seen is not None)
    choice = Choice(x, Decision(COORDINATE, one.peers), action, seen)
    one.learn(number, choice, Reward(**parts, total=0.0, partners=partners), y)


def transition(one, y, z_next, number=9):
    """Return a transition that begins in y, with the peer in z'."""
    return voi.Transition(
        step=number,
        cell=y,
        action=COORDINATE,
        move=0,
        answered=z_next != NOT_PERCEIVED,
        seen=0 if z_next == NOT_PERCEIVED else 2,
        cells=[y, z_next],
        next_cell=y,
        next_cells=[y, NOT_PERCEIVED],
        individual=0.0,
        common=0.0,
        asking=0.0,
        partners=0,
    )


# One robot: equation (1), and what it knows of its moves.


def test_u_is_the_value_of_a_robot_alone():
    one = agent(goal_value=100)
    one.mind.u[0, X] = [1.0, 2.0, 8.0, 4.0]
    one.mind.u[0, Y] = [10.0, 30.0, 20.0, 5.0]
    set_moves(
        one, X, east=(5, 4, Y), north=(6, 0, 0), west=(2, 1, one.goal), south=(5, 0, 0)
    )
    voi.learn_alone(one.mind, one.task, 0, X)
    assert one.mind.u[0, X].tolist() == pytest.approx(
        [
            G * 8,  # a wall: it stays, and does its best there
            2.0,  # three tries are no wall yet: not known
            0.8 * G * 30 + 0.2 * G * 8,
            0.5 * (10 + G * 100) + 0.5 * G * 8,
        ]
    )


def test_before_learning_u_is_its_initial_value_and_asking_costs():
    one = agent()
    assert (one.mind.u[0] == 40).all() and (one.q_star[:, :4] == 40).all()
    assert (one.q_star[:, COORDINATE] == 40 - COST).all()
    assert agent(ask_cost=0).q_star[X, COORDINATE] == 40


def test_a_step_counts_a_try_and_where_it_led():
    one = agent()
    step(one, 1, X, EAST, Y)
    step(one, 3, X, EAST, X)
    step(one, 5, X, WEST, 1)
    mind = one.mind
    assert mind.updates[0, X].tolist() == [0, 0, 2, 1, 3]
    assert mind.tries[0, X].tolist() == [0, 0, 2, 1]
    assert mind.led[0, X].tolist() == [0, 0, 1, 1]
    assert mind.to[0, X].tolist() == [X, X, Y, 1]
    # a move without asking is no question
    action = Action(NORTH, False, NOBODY, False)
    one.learn(7, Choice(X, Decision(NORTH), action, None), Reward(0, 0, 0, 0), X)
    assert mind.updates[0, X].tolist() == [1, 0, 2, 1, 3]
    row = find(mind.pairs, 0, voi.pair_key(one.task, X, 1, NOT_PERCEIVED))
    assert mind.pairs.updates[0, row, [ASKED, ANSWERED]].tolist() == [3, 0]


def test_a_move_that_never_led_out_is_one_into_a_wall_after_six_tries():
    one = agent()
    for number in range(6):
        assert one.q_star[X, NORTH] == 40
        step(one, 1 + 2 * number, X, NORTH, X)
    assert one.q_star[X, NORTH] == FORBIDDEN
    # it leads nowhere for sure: its value is that of a wait
    one.mind.u[0, X] = 80.0
    voi.learn_alone(one.mind, one.task, 0, X)
    assert one.mind.u[0, X, NORTH] == G * 80
    # one that led out is none, and is known at once
    step(one, 13, X, EAST, Y)
    assert one.mind.u[0, X, EAST] == G * 40
    set_moves(one, X, east=(9, 1, Y))
    voi.refresh(one.mind, one.task, 0, X)
    assert one.q_star[X, EAST] == one.mind.u[0, X, EAST]


def test_each_cell_is_visited_once_and_one_is_learned_again_by_the_draw():
    one = agent()
    for number, x in enumerate([X, Y, X, 5, Y]):
        step(one, 1 + 2 * number, x, EAST, x + 1)
    assert one.mind.count[0, 0] == 3
    assert one.mind.visited[0, :4].tolist() == [X, Y, 5, 0]
    drawn_at = {n: int(3 * draw(one.task.keys[0], n, REPLAY)) for n in range(21, 99)}
    number = next(n for n, place in drawn_at.items() if place == 2)
    again = 5
    for x in (X, Y, 5):
        one.mind.u[0, x] = [0.0, 0.0, 0.0, 80.0]
        one.mind.gain[0, x] = -7.0
    before = one.q_star
    step(one, number, Y, EAST, 4)
    learned = {x for x in (X, Y, 5) if one.mind.u[0, x, EAST] != 0.0}
    fresh = {x for x in (X, Y, 5) if one.q_star[x, WEST] != before[x, WEST]}
    assert learned == fresh == {Y, again}


def test_who_knows_the_map_begins_with_its_values_and_its_moves():
    one = agent(q_coord_init=200, prior="map", move_success=0.7)
    mind = one.mind
    assert mind.tries[0, X].tolist() == [20] * 4 and not mind.updates.any()
    assert mind.led[0, X].tolist() == [0, 0, 14, 14]
    assert mind.to[0, X].tolist() == [X, X, Y, 1]
    assert mind.count[0, 0] == 7 and mind.visited[0].tolist() == list(range(7))
    before = mind.u[0].copy()
    for x in range(6):
        voi.learn_alone(mind, one.task, 0, x)
    assert mind.u[0] == pytest.approx(before)
    assert one.q_star[X, COORDINATE] == before[X].max() - COST
    # a first step adds no cell, and rare success leaves a way
    step(one, 1, X, EAST, Y)
    assert mind.count[0, 0] == 7
    rare = agent(q_coord_init=200, prior="map", move_success=0.01).mind
    assert rare.led[0, X].tolist() == [0, 0, 1, 1]


# Equations (2) to (4).


def test_q_c_is_u_and_the_correction_of_the_one_peer():
    one = agent()
    one.mind.u[0, X] = [1.0, 2.0, 3.0, 4.0]
    set_rho(one, X, Z, [-1.0, 5.0, -3.0, 0.0])
    assert one.values_asking(X, (Z,)) == [0.0, 7.0, 0.0, 4.0]
    assert one.values_asking(X, (Z2,)) == [1.0, 2.0, 3.0, 4.0]


def test_of_several_peers_the_worst_one_counts_and_none_adds_value():
    one = agent(THREE)
    set_rho(one, X, Z, [-1.0, 5.0, -3.0, 0.0], peer=1)
    set_rho(one, X, Z2, [-4.0, 6.0, -2.0, 1.0], peer=2)
    assert one.values_asking(X, (Z, Z2)) == [36.0, 40.0, 37.0, 40.0]
    assert one.values_asking(X, (Z, Z)) == [39.0, 40.0, 37.0, 40.0]
    assert one.values_asking(X, (Z2, Z)) == [40.0] * 4


def test_values_are_set_whatever_they_were():
    one = agent(THREE)
    set_rho(one, X, Z, [-1.0, 1.0, -3.0, 0.0])
    for before in (-9.0, 9.0):
        values = [before] * 4
        one.learner.asking_values(one.mind, one.task, 0, X, 6, [X, Z, Z], values)
        assert values == [39.0, 40.0, 37.0, 40.0]


def test_without_an_answer_a_robot_moves_by_the_means_of_such_questions():
    one = agent()
    one.mind.u[0, X] = [1.0, 2.0, 3.0, 4.0]
    one.mind.blind[0, X] = [5.0, 0.0, -9.0, 1.0]
    set_moves(one, X, west=(6, 0, X))  # a wall: it does not wait there
    assert one.values_asking(X, None) == [6.0, 2.0, -6.0, FORBIDDEN]


def test_of_questions_without_an_answer_the_mean_counts_by_their_share():
    one = agent(peers_seen="while_learning", perception="probability:0.5")
    one.mind.u[0, X] = [1.0, 2.0, 3.0, 4.0]
    one.mind.blind[0, X] = [0.0, 8.0, 0.0, 0.0]
    set_rho(one, X, Z, [9.0, -4.0, 0.0, 4.0])
    set_answers(one, X, Z, 3, 0)  # one of four, with the one before the first
    voi.learn_means(one.mind, one.task, 0, transition(one, X, Z))
    size = 0.75 * ALPHA
    assert one.mind.blind[0, X].tolist() == [
        *(size * 9, 8 + size * (-4 - 8)),
        *(0.0, size * 4),
    ]
    # without an answer it goes south
    worth = 0.25 * 10.0 + 0.75 * (2 - 4) - 4.0
    assert one.mind.gain[0, X, COORDINATE] == ALPHA * worth


def test_means_move_toward_what_the_peers_cell_changes():
    one = agent()
    one.mind.u[0, X] = [1.0, 2.0, 3.0, 4.0]
    one.mind.gain[0, X] = 8.0
    set_rho(one, X, Z, [0.0, -4.0, 4.0, 8.0])
    voi.learn_means(one.mind, one.task, 0, transition(one, X, Z))
    best = 4 + 8
    assert one.mind.gain[0, X].tolist() == [
        *(8 + ALPHA * (0 - 8), 8 + ALPHA * (-4 - 8)),
        *(8 + ALPHA * (4 - 8), 8.0),
        8 + ALPHA * (best - 4 - 8),
    ]
    voi.refresh(one.mind, one.task, 0, X)
    assert one.q_star[X].tolist() == [
        *(1 + 6.0, 2 + 5.0, 3 + 7.0, 4 + 8.0),
        4 + (8 + ALPHA * (best - 4 - 8)) - COST,
    ]
    assert (one.mind.gain[0, Y] == 0).all()


@pytest.mark.parametrize("b", range(4))
def test_asking_is_worth_the_best_move_by_q_c(b):
    one = agent()
    one.mind.u[0, X] = [1.0, 2.0, 3.0, 4.0]
    set_rho(one, X, Z, [20.0 if b == other else 0.0 for other in range(4)])
    voi.learn_means(one.mind, one.task, 0, transition(one, X, Z))
    assert one.mind.gain[0, X, COORDINATE] == ALPHA * (1.0 + b + 20.0 - 4.0)


def test_the_first_mean_is_the_first_value_and_the_second_of_both():
    one = agent(step_size="floored:1:0:0")
    for cell, value in ((Z, -6.0), (Z2, -2.0)):
        set_rho(one, X, cell, [value] * 4)
        voi.learn_means(one.mind, one.task, 0, transition(one, X, cell))
    assert one.mind.gain[0, X].tolist() == [-4.0] * 5
    assert one.mind.arrivals[0, X] == 2


def test_means_count_arrivals_alone():
    one = agent()
    met_at = [X, X, Y, X, X]
    for number, x in enumerate(met_at):
        step(one, 1 + number, x, EAST, (met_at[1:] + [Y])[number], (Z,))
    assert one.mind.arrivals[0].tolist() == [0, 0, 2, 1, 0, 0, 0]
    one.begin_episode()
    step(one, 99, X, EAST, X, (Z,))
    assert one.mind.arrivals[0, X] == 3


def test_no_answer_is_learned_from_as_from_a_cell():
    one = agent(perception="probability:0.5")
    set_moves(one, X, east=(4, 3, Y))
    step(one, 1, X, EAST, Y, (Z,))
    step(one, 2, Y, EAST, X, None)
    assert one.mind.last[0, CELLS:].tolist() == [Y, NOT_PERCEIVED]
    step(one, 3, X, EAST, Y, None, common=-20.0, partners=0b10)
    step(one, 4, Y, EAST, Y, (Z2,))
    memory = one.memory()
    made = memory["pairs_updates"][:, voi.MADE : voi.TRIED].any(axis=1)
    assert memory["pairs_keys"][made].tolist() == sorted(
        voi.pair_key(one.task, x, 1, z)
        for x, z in ((X, Z), (Y, NOT_PERCEIVED), (X, NOT_PERCEIVED))
    )
    assert one.mind.arrivals[0, [X, Y]].tolist() == [2, 2]
    # r^C counts once, not for the team: it did not know where its peer was
    assert one.mind.steps.values[0, step_row(one, NOT_PERCEIVED), EAST] == -20.0


def test_steps_of_two_episodes_and_steps_with_a_gap_are_no_step_of_a_peer():
    one = agent()
    step(one, 5, Y, EAST, X, (Z,))
    one.begin_episode()
    step(one, 8, X, EAST, Y, (Z,))
    step(one, 10, Y, EAST, Y, (Z2,))
    assert one.mind.steps.used[0] == 1
    step(one, 11, Y, EAST, Y, (Z2,))
    assert one.mind.steps.used[0] == 2
    # step 0, with nothing before it
    one = agent()
    step(one, 0, X, EAST, Y, (Z,))
    assert one.mind.steps.used[0] == 1 and one.mind.arrivals[0, X] == 1


# Equation (6).


def v(one, x=Y, z=Z2, peer=1):
    """Return V_j(x, z)."""
    return voi.value_of(one.mind, one.task, 0, x, pair_row(one, x, z, peer), z)


def test_v_is_what_it_will_do():
    one = agent()
    one.mind.u[0, Y] = [1.0, 2.0, 3.0, 4.0]
    set_rho(one, Y, Z2, [5.0, -4.0, 7.0, -9.0])
    one.mind.q_star[0, Y] = [10.0, 30.0, 20.0, 0.0, 30.5]
    assert v(one) == 3.0 + 7.0 - COST
    # the best move by Q*, not by U, and of equal ones the first
    for asking in (30.0, 29.0):
        one.mind.q_star[0, Y] = [10.0, 30.0, 30.0, 0.0, asking]
        assert v(one) == 2.0 - 4.0
    one.mind.q_star[0, Y, NORTH] = 30.0
    assert v(one) == 1.0 + 5.0
    one.mind.q_star[0, Y, WEST] = 31.0
    assert v(one) == 4.0 - 9.0


def test_in_larger_teams_v_is_that_of_each_peer_as_the_only_one():
    one = agent(THREE)
    set_rho(one, Y, Z, [-30.0] * 4, peer=1)
    one.mind.q_star[0, Y, COORDINATE] = 99.0
    assert v(one, peer=2) == 40.0 - COST


def test_where_questions_fail_the_share_of_answers_counts():
    one = agent(perception="probability:0.5")
    one.mind.u[0, Y] = [1.0, 2.0, 3.0, 4.0]
    one.mind.q_star[0, Y, COORDINATE] = 99.0
    set_rho(one, Y, Z2, [6.0, 0.5, 0.0, 0.0])
    one.mind.blind[0, Y] = [0.0, 9.0, 0.0, 0.0]
    set_answers(one, Y, Z2, 7, 1)
    assert v(one) == 0.25 * 7.0 + 0.75 * 2.5 - COST
    # all answered, whatever it would do without an answer
    set_answers(one, Y, Z2, 7, 7)
    assert v(one) == 7.0 - COST
    # where it does not know its peer's cell there was no answer
    set_rho(one, Y, NOT_PERCEIVED, [6.0, 0.5, 0.0, 0.0])
    assert v(one, z=NOT_PERCEIVED) == 2.5 - COST


def test_the_share_of_answers_is_that_of_both_cells():
    one = agent(peers_seen="while_learning", perception="probability:0.5")
    for number, (z, found) in enumerate(((Z, (Z,)), (Z, None), (Z2, None))):
        action = Action(EAST, True, NOBODY, found is not None)
        choice = Choice(X, Decision(COORDINATE, one.peers), action, found)
        one.learn(3 * number, choice, Reward(0, 0, 0, 0), X, ([X, z], [X, z]))
    shares = [
        voi.share_answered(one.mind, 0, pair_row(one, X, z), z) for z in (Z, Z2, Y)
    ]
    assert shares == [2 / 3, 1 / 2, 1.0]


# Equation (5).


def test_a_move_leaves_as_often_as_it_did_with_the_peer_there():
    one = agent()
    set_moves(one, X, east=(5, 4, Y))
    given = pair_row(one, X, Z2)
    assert voi.chance_to_leave(one.mind, 0, X, EAST, given) == 0.8
    one.mind.pairs.updates[0, given, [voi.TRIED + EAST, voi.LED + EAST]] = [6, 1]
    assert voi.chance_to_leave(one.mind, 0, X, EAST, given) == (1 + 2 * 0.8) / (6 + 2)


def counted(one, x=X, z_next=Z2):
    """Return how often moves were tried in x with the peer then in z', and led out."""
    counts = one.mind.pairs.updates[0, pair_row(one, x, z_next)].tolist()
    return counts[voi.TRIED : voi.LED], counts[voi.LED : ASKED]


def test_moves_are_counted_with_the_peer_where_it_went():
    one = agent()
    for number, (move, y) in enumerate([(EAST, Y), (EAST, X), (WEST, 1)]):
        step(one, 1 + 10 * number, X, move, y, (Z,))
        step(one, 2 + 10 * number, y, NORTH, y, (Z2,))
        one.begin_episode()
    assert counted(one) == ([0, 0, 2, 1], [0, 0, 1, 1])
    assert counted(one, z_next=Z) == ([0] * 4, [0] * 4)


def test_a_move_that_leads_home_is_not_counted_as_arrivals_are_not():
    one = agent()
    before = one.goal - 1
    set_moves(one, before, east=(5, 4, one.goal))
    step(one, 1, before, EAST, before, (Z,))
    step(one, 2, before, WEST, before, (Z2,))
    step(one, 3, before, WEST, before, (Z2,))
    assert counted(one, before) == ([0, 0, 0, 1], [0] * 4)


def test_an_arrival_is_no_step_of_a_peer_that_does_not_answer():
    one = agent(perception="probability:0.5")
    before = one.goal - 1
    step(one, 1, before, EAST, one.goal, None)
    counts = one.memory()["steps_updates"].sum(axis=0)
    assert counts.tolist() == [0, 0, 1, 0]
    key = voi.step_key(one.task, before, 1, NOT_PERCEIVED, NOT_PERCEIVED)
    assert key not in one.memory()["steps_keys"]


def test_r_c_is_that_of_the_step_or_of_the_cells_where_it_ends():
    one = agent(goal_value=100)
    set_moves(one, X, east=(5, 4, Y), west=(5, 4, one.goal))
    one.mind.q_star[0, Y] = [0.0, 0.0, 1.0, 0.0, 0.0]
    set_rho(one, Y, Z2, [0.0, 0.0, -4.0, 0.0])
    peer = step_row(one)
    one.mind.pairs.values[0, pair_row(one, Y, Z2), FELT] = -20.0

    def after(b):
        one.mind.last[0, CELLS:] = [X, Z]
        one.mind.last[0, voi.CELL] = X
        return voi.after_leaving(one.mind, one.task, 0, 1, b, Z2, peer)

    assert after(EAST) == -20 + G * (40 - 4)  # never made
    one.mind.steps.updates[0, peer, EAST] = 1  # it slipped
    assert after(EAST) == -20 + G * (40 - 4)
    one.mind.steps.values[0, peer, EAST] = -7.0
    assert after(EAST) == -7 + G * (40 - 4)
    assert after(WEST) == 10 + G * 100  # nothing was felt at the goal
    step(one, 1, X, WEST, one.goal, (Z,), common=-3.0, partners=0b10)
    assert after(WEST) == -2 * 3 + 10 + G * 100


def test_r_c_is_the_mean_of_what_was_felt():
    row = [NOT_FELT] * 4
    for common, mean in ((-20.0, -20.0), (-20.0, -20.0), (0.0, -15.0)):
        voi.feel(row, EAST, common, 0.25)
        assert row == [NOT_FELT, NOT_FELT, mean, NOT_FELT]


def test_a_move_that_was_not_made_counts_by_the_probability_of_the_peers_step():
    made = [3, 1, 0, 7]
    went = [3, 0, 0, 1]
    share = 4 / 11
    chance = [(3 + share) / 4, share / 2, share, (1 + share) / 8]
    for move in range(4):
        weights = [voi.weight_of(made, went, share, b, move) for b in range(4)]
        assert weights == pytest.approx([min(2.0, p / chance[move]) for p in chance])
        assert weights[move] == 1.0


def taught(common=0.0):
    """Return a robot before it learns from a peer, and the numbers of its moves.

    North is a wall, south not known; east leads to Y, where it asks, west to 1, where it goes
    south without asking.
    """
    one = agent()
    one.mind.u[0, X] = [10.0, 20.0, 30.0, 40.0]
    one.mind.u[0, Y] = [50.0, 60.0, 70.0, 80.0]
    set_moves(one, X, north=(6, 0, 0), south=(5, 0, 0), east=(4, 3, Y), west=(2, 1, 1))
    one.mind.q_star[0, Y] = [0.0, 0.0, 0.0, 1.0, 2.0]
    one.mind.q_star[0, 1] = [0.0, 3.0, 0.0, 0.0, 2.0]
    one.mind.q_star[0, X] = [0.0, 0.0, 5.0, 0.0, 0.0]
    set_rho(one, Y, Z2, [0.0, 30.0, 0.0, -9.0])
    set_rho(one, 1, Z2, [0.0, -8.0, 0.0, 0.0])
    set_rho(one, X, Z2, [0.0, 0.0, -3.0, 2.0])
    set_rho(one, X, Z, [-2.0, -2.0, -2.0, -2.0])
    return one


def test_a_step_of_a_peer_teaches_all_known_moves():
    one = taught()
    # It went east to Y, the peer from Z to Z2, and both paid.
    learn_from_peer(one, Y, EAST, -20.0)
    # With the peer in Z2 east led out 1 of 1 time, and 2 times 3 of 4; west 2 times 1 of 2.
    leaves = {NORTH: 0.0, EAST: (1 + 1.5) / 3, WEST: 1 / 2}
    after = {NORTH: 0.0, EAST: -20 + G * (90 - COST), WEST: G * (40 - 8)}
    stays = G * (30 - 3)  # what it would do in X: go east
    # All that is known of the peer's step: it followed one move east.
    weight = {NORTH: 1.0, EAST: 1.0, WEST: 1.0}
    u = one.mind.u[0, X]
    expected = [-2.0] * 4
    for b, out in leaves.items():
        size = ALPHA * weight[b]
        target = out * after[b] + (1 - out) * stays - u[b]
        expected[b] += size * (target - expected[b])
    assert rho(one, X, Z) == pytest.approx(expected)
    # South is not known: nothing was learned of it.
    assert expected[SOUTH] == -2
    # Where it would ask in X, staying is worth the best move after the answer.
    one = taught()
    one.mind.q_star[0, X, COORDINATE] = 6.0
    learn_from_peer(one, Y, EAST, -20.0)
    target = G * (42 - COST) - u[NORTH]
    assert rho(one, X, Z)[NORTH] == pytest.approx(-2 + ALPHA * (target + 2))


def test_steps_that_other_moves_make_unlikely_count_less():
    one = taught()
    one.mind.steps.updates[0, step_row(one)] = [2, 1, 2, 1]
    one.mind.pairs.updates[0, pair_row(one, X, Z), :4] = [5, 3, 2, 1]
    before = np.array(rho(one, X, Z))
    learn_from_peer(one, Y, EAST, 0.0)
    share = 7 / 12
    chance = [(2 + share) / 6, None, (3 + share) / 4, (1 + share) / 2]
    for b, target in (
        (NORTH, G * 27 - 10),
        (WEST, 0.5 * G * 32 + 0.5 * G * 27 - 40),
    ):
        size = ALPHA * chance[b] / chance[EAST]
        expected = before[b] + size * (target - before[b])
        assert rho(one, X, Z)[b] == pytest.approx(expected)


def test_the_step_size_is_that_of_the_next_step_of_the_peer_and_at_most_1():
    one = taught()
    one.task = one.task._replace(step_sizes=memoryview(BY_COUNT))
    one.task = one.task._replace(floors=memoryview(np.zeros(99)))
    target = G * 27 - 10
    expected = -2.0
    for n in (2, 3):
        learn_from_peer(one, Y, EAST, 0.0)
        share = 1.0
        weight = min(2.0, share / ((n - 1 + share) / n))
        expected += weight / n * (target - expected)
        assert rho(one, X, Z)[NORTH] == pytest.approx(expected)
    one = taught()
    one.task = one.task._replace(floors=memoryview(np.ones(99)))
    one.mind.pairs.updates[0, pair_row(one, X, Z), :4] = [1, 0, 9, 0]
    one.mind.steps.updates[0, step_row(one), NORTH] = 1
    learn_from_peer(one, Y, EAST, 0.0)
    # the peer's step was rare after east: north would count twice, but not more than all
    assert rho(one, X, Z)[NORTH] == pytest.approx(target)


def test_r_c_counts_as_often_as_credit_says_with_the_peers_that_were_there():
    for credit, weight in (("team", 3), ("own", 1)):
        one = agent(THREE, credit=credit)
        set_moves(one, X, east=(4, 4, Y))
        step(one, 1, X, EAST, Y, (Z, Z), common=-20.0, partners=0b100)
        step(one, 2, Y, NORTH, Y, (Z2, Z2))
        u = one.mind.u[0]
        assert rho(one, X, Z, peer=1)[EAST] == pytest.approx(
            ALPHA * (G * (u[Y].max()) - u[X, EAST])
        )
        assert rho(one, X, Z, peer=2)[EAST] == pytest.approx(
            ALPHA * (-20 * weight + G * (u[Y].max()) - u[X, EAST])
        )


def test_a_step_that_stays_tells_what_is_felt_there_not_what_the_move_brings():
    one = agent()
    step(one, 1, X, EAST, X, (Z,), common=-20.0, partners=0b10)
    step(one, 2, X, EAST, X, (Z2,))
    peer = step_row(one)
    assert one.mind.steps.updates[0, peer].tolist() == [0, 0, 1, 0]
    assert one.mind.steps.values[0, peer].tolist() == [NOT_FELT] * 4
    assert one.mind.pairs.values[0, pair_row(one, X, Z2), FELT] == -40.0


# What it does.


def test_while_it_learns_it_asks_in_every_step_and_explores_its_moves():
    one = agent(epsilon="constant:1")
    asked = Decision(COORDINATE, (1,))
    assert {one.decide(number, X) for number in range(40)} == {asked}
    moves = [one.act(number, X, asked, (Z,)).move for number in range(200)]
    assert set(moves) == {0, 1, 2, 3}
    # Of five actions it explored one is to ask: then it is greedy by Q^C.
    set_rho(one, X, Z, [0.0, 0.0, 90.0, 0.0])
    east = [one.act(number, X, asked, (Z,)).move == EAST for number in range(200)]
    assert 0.3 < np.mean(east) < 0.5


def test_without_exploring_it_moves_as_it_would_without_asking():
    one = agent(epsilon="constant:0")
    one.mind.q_star[0, X] = [0.0, 9.0, 0.0, 0.0, 5.0]
    set_rho(one, X, Z, [0.0, 0.0, 90.0, 0.0])
    asked = Decision(COORDINATE, (1,))
    assert one.act(1, X, asked, (Z,)).move == SOUTH
    one.mind.q_star[0, X, COORDINATE] = 10.0
    assert one.act(1, X, asked, (Z,)).move == EAST


def test_where_it_sees_its_peers_it_asks_only_where_its_policy_does():
    one = agent(epsilon="constant:0", peers_seen="while_learning")
    one.mind.q_star[0, X] = [0.0, 9.0, 0.0, 0.0, 5.0]
    set_rho(one, X, Z, [0.0, 0.0, 90.0, 0.0])
    assert one.decide(1, X) == Decision(SOUTH)
    asked = Decision(COORDINATE, (1,))
    assert one.act(1, X, asked, (Z,)).move == EAST
    one.mind.q_star[0, X, COORDINATE] = 10.0
    assert one.decide(1, X) == asked


# Patience.


def waiting(team=THREE, **settings):
    """Return a greedy robot in X: its way is east, west a way back, north a wall; it waits."""
    one = agent(team, **settings)
    one.learning = False
    one.task = one.task._replace(learning=False)
    one.mind.u[0, X] = [80.0, 0.0, 100.0, 60.0]
    set_moves(one, X, north=(9, 0, 0), east=(9, 9, Y), west=(9, 9, 1))
    set_rho(one, X, Y, [0.0, 0.0, -90.0, 0.0], peer=1)
    set_rho(one, X, Z, [0.0, 0.0, -50.0, 0.0], peer=2)
    one.begin_episode()
    return one


def moves_of(one, answers, x=X):
    """Return the moves after these answers: the peers' cells."""
    asked = Decision(COORDINATE, one.peers)
    return [one.act(n, x, asked, cells).move for n, cells in enumerate(answers)]


def test_waiting_loses_value_with_each_answer_in_which_nobody_moved():
    # 80 * 0.95^6 < 60: the first answer finds nobody that stood, four more are for nothing
    moves = moves_of(waiting(), [(Y, Z)] * 20)
    assert moves == [NORTH] * 10 + [WEST] * 10


def test_a_step_of_the_peer_in_the_way_begins_the_count_again_no_other_one():
    one = waiting()
    assert moves_of(one, [(Y, Z)] * 9) == [NORTH] * 9
    assert moves_of(one, [(Y, Z2)] * 2) == [NORTH, WEST]
    # The peer in its way is now the one in Z; when it moves, all begins again.
    one = waiting()
    set_rho(one, X, Y, [0.0, 0.0, -40.0, 0.0], peer=1)
    assert moves_of(one, [(Y, Z)] * 11)[-1] == WEST
    set_rho(one, X, Z2, [0.0, 0.0, -50.0, 0.0], peer=2)
    assert moves_of(one, [(Y, Z2)] * 10) == [NORTH] * 10
    assert moves_of(one, [(Y, Z2)]) == [WEST]


def test_an_own_step_and_a_new_episode_begin_the_count_again():
    one = waiting()
    assert moves_of(one, [(Y, Z)] * 11)[-1] == WEST
    moves_of(one, [(Y, Z)], x=1)
    assert moves_of(one, [(Y, Z)] * 11) == [NORTH] * 10 + [WEST]
    one.begin_episode()
    assert moves_of(one, [(Y, Z)] * 11) == [NORTH] * 10 + [WEST]


def test_of_peers_that_are_as_bad_the_first_one_is_in_the_way():
    one = waiting()
    set_rho(one, X, Z, [0.0, 0.0, -90.0, 0.0], peer=2)
    set_rho(one, X, Z2, [0.0, 0.0, -90.0, 0.0], peer=2)
    assert moves_of(one, [(Y, Z), (Y, Z2)] * 10)[-1] == WEST
    # also where no peer is in the way
    one = waiting()
    one.mind.u[0, X, EAST] = 70.0
    set_rho(one, X, Y, [9.0, 9.0, 9.0, 9.0], peer=1)
    set_rho(one, X, Z, [9.5, 9.5, 9.5, 9.5], peer=2)
    set_rho(one, X, Z2, [9.5, 9.5, 9.5, 9.5], peer=2)
    assert moves_of(one, [(Y, Z), (Y, Z2)] * 10)[-1] == EAST


def test_of_moves_that_are_as_good_alone_the_first_one_is_its_way():
    one = waiting()
    one.mind.u[0, X] = [80.0, 100.0, 100.0, 60.0]
    set_rho(one, X, Y, [0.0, -90.0, 0.0, 0.0], peer=1)
    for cell in (Z, Z2):
        set_rho(one, X, cell, [0.0, 0.0, -90.0, 0.0], peer=2)
    assert moves_of(one, [(Y, Z), (Y, Z2)] * 6)[9:] == [NORTH, WEST, WEST]


def test_its_way_may_be_north():
    one = waiting()
    one.mind.u[0, X] = [100.0, 100.0, 80.0, 60.0]
    set_moves(one, X, north=(9, 9, 0), east=(9, 0, 0))
    set_rho(one, X, Y, [-90.0, 0.0, 0.0, 0.0], peer=1)
    for cell in (Z, Z2):
        set_rho(one, X, cell, [0.0, -90.0, 0.0, 0.0], peer=2)
    assert moves_of(one, [(Y, Z), (Y, Z2)] * 6)[9:] == [EAST, WEST, WEST]


def test_robot_0_may_be_in_the_way_too():
    one = Agent(learner_of("voi"), agent(THREE).scenario, 1, 3, learning=False)
    mind = one.mind
    mind.u[1, X] = [80.0, 0.0, 100.0, 60.0]
    mind.tries[1, X] = 9
    mind.led[1, X] = [0, 0, 9, 9]
    for peer, cell, value in ((0, Y, -90.0), (2, Z, -50.0), (2, Z2, -50.0)):
        key = voi.pair_key(one.task, X, peer, cell)
        mind.pairs.values[1, met(mind.pairs, one.task, 1, key), EAST] = value
    one.begin_episode()
    assert moves_of(one, [(Y, Z), (Y, Z2)] * 6)[9:] == [NORTH, WEST, WEST]


def test_a_pair_waits_and_without_an_answer_no_robot_does():
    one = waiting(PAIR)
    assert moves_of(one, [(Y,)] * 30) == [NORTH] * 30
    one = waiting()
    one.mind.u[0, X] = [9.0, 0.0, 10.0, 20.0]
    assert moves_of(one, [None] * 30) == [WEST] * 30


def test_only_the_value_of_waiting_is_lost_and_no_loss_gets_smaller():
    one = waiting()
    set_moves(one, X, north=(9, 1, 0))
    assert moves_of(one, [(Y, Z)] * 30) == [NORTH] * 30
    one = waiting()
    one.mind.u[0, X] = [-50.0, -60.0, -55.0, -60.0]
    values = [-50.0, -60.0, -145.0, -60.0]
    for _ in range(30):
        voi.patience(one.mind, one.task, 0, X, [X, Y, Z], values)
    assert values == [-50.0, -60.0, -145.0, -60.0]


# Files, sizes, and what it refuses.


def test_another_run_begins_with_its_values_without_its_counts():
    one = agent()
    set_moves(one, X, east=(4, 3, Y))
    for number in range(4):
        step(one, 1 + number, X, EAST, X, (Z,), common=-20.0, partners=0b10)
    one.begin_episode()
    step(one, 9, X, EAST, X, (Z,))
    memory = one.memory()
    assert "row" not in memory
    begun = memories.taught(one.scenario, one.learner, 0, memory)
    for name in ("q_star", "u", "gain", "pairs_keys", "pairs_values"):
        assert memory[name].any() and np.array_equal(memory[name], begun[name])
    for name in ("updates", "arrivals", "pairs_updates"):
        assert memory[name].any() and not begun[name].any()


def test_tables_grow_with_what_was_met_not_with_joint_states():
    scenario = learner_of("voi").with_defaults(load_scenario("building-3x2x4-32r-0"))
    begun = memory_before(learner_of("voi"), scenario, 0)
    cells = len(scenario.map.cells)
    assert max(array.size for array in begun.values()) <= 5 * cells
    for name in ("pairs", "steps"):
        assert len(begun[f"{name}_keys"]) == 0
    one = Agent(learner_of("voi"), scenario, 0, 3)
    peers = len(one.peers)
    place = one.mind.steps.values.shape[1]
    seen = tuple(range(40, 40 + peers))
    for number in range(40):
        step(one, 1 + number, number, EAST, number + 1, seen)
    assert one.mind.steps.used[0] == peers * 39 + 1
    assert one.mind.pairs.used[0] == peers * 40 + 1
    assert (
        place < one.mind.steps.values.shape[1] < 2 * one.mind.steps.used[0] + 2 * place
    )
    assert learner_of("voi").rows_of_a_cell(scenario) == peers * cells


def test_keys_of_cells_and_peers_are_different():
    task = agent(THREE).task
    keys = {
        voi.pair_key(task, x, j, z)
        for x in range(task.cells)
        for j in range(task.robots)
        for z in (NOT_PERCEIVED, *range(task.cells))
    }
    assert keys == set(range(task.cells * task.robots * (task.cells + 1)))
    mind = agent(THREE).mind
    assert mind.pairs.most == len(keys)
    assert mind.steps.most == len(keys) * (task.cells + 2)


def test_several_peers_are_asked_at_once():
    assert agent(THREE).scenario.peers == "all"
    with pytest.raises(SettingError, match="peers: value is 'one', allowed with learn"):
        learner_of("voi").check(agent(THREE, peers="one").scenario)
    learner_of("voi").check(agent(THREE).scenario)
    learner_of("voi").check(agent(PAIR, peers="one").scenario)
    with pytest.raises(SettingError, match="setting prior_success"):
        learner_of("voi").check(agent(prior_success=0.5).scenario)


@pytest.mark.parametrize(
    ("name", "settings", "weight"),
    [
        ("env1", {}, 2),
        ("crowd-8r", {}, 8),
        ("building-3x2x4-16r-0", {}, 8),
        ("building-3x2x4-16r-0", {"credit": "team"}, 16),
    ],
)
def test_r_c_counts_for_the_team_up_to_eight_times(name, settings, weight):
    chosen = load_scenario(name).with_settings(settings)
    scenario = learner_of("voi").with_defaults(chosen)
    assert Voi().weights(scenario).common == weight


def test_where_answers_always_come_it_learns_the_same_with_and_without_seeing():
    """What it knows of its peers is the same then; where they fail it is not."""
    tables = {}
    for perception in ("always", "probability:0.5"):
        for seen in ("when_asked", "while_learning"):
            scenario = load_scenario("env1", steps=600, penalty=-100).with_settings(
                perception=perception, peers_seen=seen
            )
            tables[perception, seen] = [
                dict(one.memory) for one in learn(scenario, "voi", 5)
            ]
    asked = tables["always", "when_asked"]
    saw = tables["always", "while_learning"]
    for one, other in zip(asked, saw, strict=True):
        assert one["pairs_values"].any() and one["gain"].any()
        # it asks in every step, or where its policy does
        asks = [m["pairs_updates"][:, ASKED].sum() for m in (one, other)]
        assert asks[0] > asks[1] > 0
        for m in (one, other):
            counts = np.delete(m["pairs_updates"], [ASKED, ANSWERED], axis=1)
            learned = counts.any(axis=1)
            m["pairs_updates"] = counts
            for name in ("pairs_keys", "pairs_values", "pairs_updates"):
                m[name] = m[name][learned]
        one["updates"] = one["updates"][:, :COORDINATE]
        other["updates"] = other["updates"][:, :COORDINATE]
        assert memories_equal(one, other)
    one, _ = tables["probability:0.5", "when_asked"]
    other, _ = tables["probability:0.5", "while_learning"]
    assert not memories_equal(one, other)
