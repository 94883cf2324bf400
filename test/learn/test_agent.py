# Copyright 2026 The sparse_coord_ros authors
# SPDX-License-Identifier: Apache-2.0
"""One agent: the lines of Algorithm 1, in the paper's order, with hand-computed numbers."""

import numpy as np
import pytest

from sparse_coord_ros.game.actions import COORDINATE, EAST, NORTH, SOUTH, WEST
from sparse_coord_ros.game.scenario import load_scenario
from sparse_coord_ros.game.world import Action, Reward
from sparse_coord_ros.learners.agent import NOBODY, Agent, Choice, Decision
from sparse_coord_ros.learners.tables import Tables
from sparse_coord_ros.learners.registry import learner_of

HALF = {"step_size": "constant:0.5", "epsilon": "constant:0"}
ASK = Decision(COORDINATE, (1,))


def paid(total):
    """Return a reward of one part."""
    return Reward(total, 0.0, 0.0, total)


@pytest.fixture
def agent(make):
    """Return a maker of agent 0 on the corridor 1..D..2 (cells 0 to 6, goal 6), alpha 0.5."""

    def maker(learner="coop", number=0, seed=0, tables=None, **settings):
        scenario = make(**{**HALF, **settings})
        return learner_of(learner).agent(scenario, number, seed, tables=tables)

    return maker


def filled(cells=7, baseline=False):
    """Return tables whose every entry is a number of its own."""
    q_star = np.arange(cells * 5, dtype=float).reshape(cells, 5) + 1.0
    if baseline:
        q_star[:, COORDINATE] = np.nan
    return Tables(
        q_star, 100.0 + np.arange(cells * cells * 4, dtype=float).reshape(cells, cells, 4)
    )


@pytest.mark.parametrize("learner", ["coop", "noncoop", "indiv"])
def test_initial_tables(learner):
    scenario = load_scenario("env1").with_settings({"q_star_init": 3, "q_coord_init": 150})
    tables = learner_of(learner).tables(scenario)
    assert tables.q_star.shape == (21, 5)
    assert tables.q_coord.shape == (21, 21, 4)
    assert tables.q_star.dtype == tables.q_coord.dtype == np.float64
    assert (tables.q_star[:, :4] == 3).all()
    assert (tables.q_coord == 150).all()
    if learner == "coop":
        assert (tables.q_star[:, 4] == 3).all()
    else:
        assert np.isnan(tables.q_star[:, 4]).all()


# Line 4: pi_epsilon.


def test_with_peers_all_q_coord_is_over_the_whole_joint_state(make):
    """Own cell first, then the peers' by ascending robot; only the visited state gets a row."""
    robots = {"a": (1, 2), "b": (2, 1), "c": ([0, 1], 1)}
    scenario = make(robots=robots, peers="all", q_star_init=0, q_coord_init=100, **HALF)
    one = Agent(scenario, 1, 0)
    one.tables.q_coord[2, 5, 3, EAST] = 130.0
    one.tables.q_coord[5, 2, 3, WEST] = 130.0
    one.tables.q_coord[2, 3, 5, SOUTH] = 130.0
    decision = Decision(COORDINATE, (0, 2))
    action = one.act(1, 2, decision, (5, 3))
    assert action == Action(EAST, True, NOBODY, True)
    one.learn(1, Choice(2, decision, action, (5, 3)), paid(-60.0), 3)
    assert one.tables.q_coord[2, 5, 3].tolist() == [100, 100, 0.5 * 130 - 0.5 * 60, 100]
    one.learn(1, Choice(2, decision, Action(NORTH, True, NOBODY, True), (4, 4)), paid(-60.0), 3)
    assert one.tables.q_coord[2, 4, 4].tolist() == [0.5 * 100 - 0.5 * 60, 100, 100, 100]
    assert len(one.tables.q_coord) == 4
    assert one.coord_visited == 2
    failed = one.act(1, 2, decision, None)
    assert (failed.asked, failed.peer, failed.perceived) == (True, NOBODY, False)


def test_joint_states_are_counted_once(agent):
    one = agent(tables=filled())
    for move, cell in ((EAST, 5), (WEST, 5), (EAST, 4), (EAST, 5)):
        one.learn(1, Choice(2, ASK, Action(move, True, 1, True), (cell,)), paid(0.0), 3)
    one.learn(1, Choice(2, ASK, Action(EAST, True, 1, False), None), paid(0.0), 3)
    assert one.coord_visited == 2


def test_a_robot_alone_asks_nobody(make):
    alone = Agent(make(robots={"a": (1, 2)}, **HALF), 0, 0, tables=filled())
    assert alone.decide(0, 0) == Decision(COORDINATE)
    assert alone.act(0, 0, Decision(COORDINATE), None) == Action(WEST, True, NOBODY, False)


# Lines 12 to 18.


def test_line_13_comes_before_line_18(agent):
    """Staying in the cell, the update of Q* would change what Q^C bootstraps on."""
    tables = filled()
    tables.q_star[2] = [1, 2, 3, 4, 10]
    tables.q_coord[2, 5, SOUTH] = 40
    one = agent(tables=tables)
    one.learn(1, Choice(2, ASK, Action(SOUTH, True, 1, True), (5,)), paid(100.0), 2)
    bootstrap_before = 0.95 * 10
    assert tables.q_coord[2, 5, SOUTH] == 0.5 * 40 + 0.5 * (100 + bootstrap_before)
    assert tables.q_star[2, COORDINATE] == 0.5 * 10 + 0.5 * (100 + bootstrap_before)


def test_failed_percept_updates_coordinate_of_q_star_only(agent):
    """Line 18 credits COORDINATE, not the primitive action that it became."""
    tables, before = filled(), filled()
    one = agent(tables=tables)
    one.learn(1, Choice(2, ASK, Action(WEST, True, 1, False), None), paid(-1.0), 1)
    before.q_star[2, COORDINATE] = 0.5 * 15 + 0.5 * (-1 + 0.95 * 10)
    assert tables.q_star == pytest.approx(before.q_star, rel=1e-15)
    assert (tables.q_coord == before.q_coord).all()


def test_without_learning_nothing_changes_and_nothing_is_explored(make):
    tables, before = filled(), filled()
    one = Agent(make(epsilon="constant:1"), 0, 0, tables=tables, learning=False)
    assert one.epsilon(0) == 0.0
    assert {one.decide(t, 2) for t in range(30)} == {ASK}
    one.learn(1, Choice(2, ASK, Action(EAST, True, 1, True), (5,)), paid(99.0), 3)
    assert (tables.q_star == before.q_star).all()
    assert (tables.q_coord == before.q_coord).all()
