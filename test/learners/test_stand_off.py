# Copyright 2026 The sparse_coord_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Rules against jams: teams leave stand-offs, share a surplus, keep some value."""

import numpy as np
import pytest
from teams import drawn

from sparse_coord_ros.core.game.actions import COORDINATE, EAST, WEST
from sparse_coord_ros.core.game.scenario import load_scenario
from sparse_coord_ros.core.learners import factored
from sparse_coord_ros.core.learners.agent import Agent, Decision
from sparse_coord_ros.core.learners.corrections import rho_key
from sparse_coord_ros.core.learners.factored import Factored, leaves_stand_offs
from sparse_coord_ros.core.learners.looking_back import in_the_way, share_of_surplus
from sparse_coord_ros.core.learners.own_moves import LEAST_VALUE_SHARE, cell_value
from sparse_coord_ros.core.learners.registry import learner_of
from sparse_coord_ros.core.learners.table import met
from sparse_coord_ros.core.runs.evaluation import play

HERE = 2
"""The second cell of the corridor 1..D..2; east of it is the doorway."""

WALL = 0
"""A move (north) that leads nowhere."""


@pytest.fixture(autouse=True)
def surely(monkeypatch):
    """Robots that can leave a stand-off do so."""
    monkeypatch.setattr(factored, "LEAVING", 1.0)


def agent(*, leaves=True):
    """Return a greedy robot for which waiting is worth 100, the way back 80 and the rest 10."""
    scenario = drawn(peers="all", prior="map")
    one = Agent(learner_of("factored"), scenario, 0, 3, learning=False)
    one.mind.leaves[0] = leaves
    one.mind.u[0, HERE] = 10.0
    one.mind.u[0, HERE, WALL] = 100.0
    one.mind.u[0, HERE, WEST] = 80.0
    one.begin_episode()
    return one


def asks(one, step, peer_cell, cell=HERE):
    perceived = None if peer_cell is None else (peer_cell,)
    return one.act(step, cell, Decision(COORDINATE, (1,)), perceived).move


def test_a_robot_that_asked_twice_and_saw_no_robot_move_leaves():
    one = agent()
    assert asks(one, 10, 4) == WALL
    assert asks(one, 11, 4) == WEST


@pytest.mark.parametrize(
    ("first", "second"),
    [
        ((10, 4), (11, 5)),  # the peer has moved
        ((10, 4), (12, 4)),  # it did not ask in between
        ((10, None), (11, 4)),  # the first question was not answered
        ((10, 4), (11, None)),  # the second one was not
    ],
)
def test_else_it_does_what_its_values_say(first, second):
    one = agent()
    assert asks(one, *first) == WALL
    assert asks(one, *second) == WALL


def test_it_does_not_leave_after_it_has_moved_itself_or_a_new_episode_began():
    one = agent()
    asks(one, 10, 4, cell=1)
    assert asks(one, 11, 4) == WALL
    one.begin_episode()
    assert asks(one, 12, 4) == WALL


@pytest.mark.parametrize(
    ("leaving", "share", "expected"),
    [
        (1.0, 0.25, WEST),  # west is worth 20 % less
        (1.0, 0.15, WALL),
        (0.0, 0.25, WALL),
    ],
)
def test_it_leaves_only_where_that_is_worth_nearly_as_much_and_at_random(
    monkeypatch, leaving, share, expected
):
    monkeypatch.setattr(factored, "LEAVING", leaving)
    monkeypatch.setattr(factored, "LEAVING_SHARE", share)
    one = agent()
    asks(one, 10, 4)
    assert asks(one, 11, 4) == expected


def test_a_robot_that_leaves_no_stand_offs_waits():
    one = agent(leaves=False)
    asks(one, 10, 4)
    assert asks(one, 11, 4) == WALL


def test_it_does_not_leave_where_its_best_move_leads_somewhere():
    one = agent()
    one.mind.u[0, HERE, EAST] = 101.0
    asks(one, 10, 4)
    assert asks(one, 11, 4) == EAST


def test_teams_of_more_than_two_leave_unless_percepts_depend_on_places():
    four = load_scenario("env2-4r")
    near = four.with_settings({"perception": "range:1"})
    assert leaves_stand_offs(four)
    assert not leaves_stand_offs(near)
    assert not leaves_stand_offs(load_scenario("env1"))
    assert Factored.initial(four, 0).leaves


def test_a_team_in_a_frozen_stand_off_arrives_if_it_leaves(monkeypatch):
    """Two robots head-on before a doorway, whose values tell both to wait for ever."""
    monkeypatch.setattr(factored, "LEAVING", 0.5)
    monkeypatch.setattr(factored, "LEAVING_SHARE", 0.9)
    arrived = {}
    for leaves in (False, True):
        monkeypatch.setattr(factored, "leaves_stand_offs", lambda _, it=leaves: it)
        scenario = drawn(
            "1....\n##D##\n....2",
            {"robot_1": (1, 2), "robot_2": (2, 1)},
            prior="map",
            horizon=200,
        )
        rule = learner_of("factored")
        tables = []
        for k, before in ((0, 2), (1, 8)):
            one = Agent(rule, scenario, k, 0)
            beside = 8 if k == 0 else 2
            key = rho_key(before, 1 - k, beside, one.task.cells, 2)
            row = met(one.mind.rho, one.task, k, key)
            way = int(np.argmax(one.mind.u[k, before]))
            one.mind.rho.values[k, row, way] = -100.0
            one.mind.q_star[k, before, COORDINATE] = 300.0
            one.mind.value[k, before] = 300.0
            tables.append(one.tables)
        trials = play(scenario, tables, trials=40, seed=1)
        arrived[leaves] = trials.mean("arrived")
    assert arrived[False] < 0.6
    assert arrived[True] > arrived[False] + 0.3


def crowd():
    return learner_of("factored").with_defaults(load_scenario("env2-4r"))


def test_a_surplus_of_waiting_is_shared_by_the_peers_in_the_way():
    one = Agent(learner_of("factored"), crowd(), 0, 0)
    mind = one.mind
    task = one.task
    mind.last[0, 2:] = [5, 6, 7, 8]
    mind.u[0, 5] = [1.0, 2.0, 0.0, 0.0]
    assert in_the_way(mind, task, 0, 5) == 0
    assert share_of_surplus(mind, task, 0, 5, 6.0) == 6.0
    for peer, value in ((1, -3.0), (2, -1.0), (3, 4.0)):
        key = rho_key(5, peer, mind.last[0, 2 + peer], task.cells, task.robots)
        row = met(mind.rho, task, 0, key)
        mind.rho.values[0, row, 1] = value
    assert in_the_way(mind, task, 0, 5) == 2
    assert share_of_surplus(mind, task, 0, 5, 6.0) == 3.0
    assert share_of_surplus(mind, task, 0, 5, -6.0) == -6.0


def test_cells_keep_a_share_of_their_worth_to_a_robot_alone_in_larger_teams():
    for scenario, least in ((crowd(), LEAST_VALUE_SHARE * 50.0), (drawn(), -7.0)):
        one = Agent(Factored(), learner_of("factored").with_defaults(scenario), 0, 0)
        one.mind.alone[0, 4] = [50.0, 10.0, 0.0, 0.0]
        one.mind.q_star[0, 4] = [-9.0, -7.0, -8.0, -9.0, -9.0]
        assert cell_value(one.mind, one.task, 0, 4) == least
