# Copyright 2026 The sparse_coord_ros authors
# SPDX-License-Identifier: Apache-2.0
"""One agent: the lines of Algorithm 1, in the paper's order, with hand-computed numbers."""

import numpy as np
import pytest
from teams import tables_equal, tables_from_values

from sparse_coord_ros.core.game.actions import COORDINATE, EAST, SOUTH, WEST
from sparse_coord_ros.core.game.scenario import load_scenario
from sparse_coord_ros.core.game.world import Action, Reward
from sparse_coord_ros.core.learners.agent import NOBODY, Agent, Choice, Decision
from sparse_coord_ros.core.learners.coop import Coop
from sparse_coord_ros.core.learners.registry import learner_of

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
        memory = None if tables is None else tables.memory
        return Agent(learner_of(learner), scenario, number, seed, memory=memory)

    return maker


def filled(scenario, q_coord=()):
    """Return tables whose every entry is a number of its own, but for some of Q^C."""
    cells = len(scenario.map.cells)
    q_star = np.arange(cells * 5, dtype=float).reshape(cells, 5) + 1.0
    rows = 100.0 + np.arange(cells * cells * 4, dtype=float).reshape(cells, cells, 4)
    for entry, value in dict(q_coord).items():
        rows[entry] = value
    return tables_from_values(scenario, 0, q_star, rows)


@pytest.mark.parametrize("learner", ["coop", "noncoop", "indiv"])
def test_initial_tables(learner):
    scenario = load_scenario("env1").with_settings(
        {"q_star_init": 3, "q_coord_init": 150}
    )
    tables = Agent(learner_of(learner), scenario, 0, 0).tables
    assert tables.q_star.shape == (21, 5)
    assert tables.q_coord.shape == (21, 21, 4)
    assert tables.q_star.dtype == tables.q_coord.dtype == np.float64
    assert (tables.q_star[:, :4] == 3).all()
    assert (tables.q_coord == (150 if learner == "coop" else 3)).all()
    if learner == "coop":
        assert (tables.q_star[:, 4] == 3).all()
    else:
        assert np.isnan(tables.q_star[:, 4]).all()


# Line 4: pi_epsilon.


def test_with_peers_all_q_coord_is_over_the_whole_joint_state(make):
    """Own cell first, then the peers' by ascending robot; only the visited state gets a row."""
    robots = {"a": (1, 2), "b": (2, 1), "c": ([0, 1], 1)}
    scenario = make(robots=robots, peers="all", q_star_init=0, q_coord_init=100, **HALF)
    one = Agent(Coop(), scenario, 1, 0)
    decision = Decision(COORDINATE, (0, 2))
    for seen, move, reward in (
        ((5, 3), EAST, 165.0),
        ((2, 3), WEST, 165.0),
        ((3, 5), SOUTH, 165.0),
    ):
        cell = 5 if seen == (2, 3) else 2
        one.learn(
            1,
            Choice(cell, decision, Action(move, True, NOBODY, True), seen),
            paid(reward),
            3,
        )
    assert one.tables.q_coord[2, 5, 3].tolist() == [100, 100, 132.5, 100]
    action = one.act(1, 2, decision, (5, 3))
    assert action == Action(EAST, True, NOBODY, True)
    assert len(one.memory()["q_coord_keys"]) == 3
    failed = one.act(1, 2, decision, None)
    assert (failed.asked, failed.peer, failed.perceived) == (True, NOBODY, False)


def test_joint_states_are_counted_once(agent):
    one = agent()
    for move, cell in ((EAST, 5), (WEST, 5), (EAST, 4), (EAST, 5)):
        one.learn(1, Choice(2, ASK, Action(move, True, 1, True), (cell,)), paid(0.0), 3)
    one.learn(1, Choice(2, ASK, Action(EAST, True, 1, False), None), paid(0.0), 3)
    memory = one.memory()
    assert memory["q_coord_keys"].tolist() == [2 * 7 + 4, 2 * 7 + 5]
    assert memory["q_coord_updates"].tolist() == [[0, 0, 1, 0], [0, 0, 2, 1]]


def test_a_robot_alone_asks_no_other_robot(make):
    scenario = make(robots={"a": (1, 2)}, **HALF)
    alone = Agent(Coop(), scenario, 0, 0, memory=filled(scenario).memory)
    assert alone.decide(0, 0) == Decision(COORDINATE)
    assert alone.act(0, 0, Decision(COORDINATE), None) == Action(
        WEST, True, NOBODY, False
    )


# Lines 12 to 18.


def test_line_13_comes_before_line_18(agent, make):
    """Staying in the cell, the update of Q* would change what Q^C bootstraps on."""
    tables = filled(make(), {(2, 5, SOUTH): 40})
    tables.q_star[2] = [1, 2, 3, 4, 10]
    one = agent(tables=tables)
    one.learn(1, Choice(2, ASK, Action(SOUTH, True, 1, True), (5,)), paid(100.0), 2)
    bootstrap_before = 0.95 * 10
    after = one.tables
    assert after.q_coord[2, 5, SOUTH] == 0.5 * 40 + 0.5 * (100 + bootstrap_before)
    assert after.q_star[2, COORDINATE] == 0.5 * 10 + 0.5 * (100 + bootstrap_before)


def test_failed_percept_updates_coordinate_of_q_star_only(agent, make):
    """Line 18 credits COORDINATE, not the primitive action that it became."""
    before = filled(make())
    one = agent(tables=before)
    one.learn(1, Choice(2, ASK, Action(WEST, True, 1, False), None), paid(-1.0), 1)
    due = before.q_star.copy()
    due[2, COORDINATE] = 0.5 * 15 + 0.5 * (-1 + 0.95 * 10)
    assert one.tables.q_star == pytest.approx(due, rel=1e-15)
    assert (one.tables.q_coord == before.q_coord).all()


def test_without_learning_nothing_changes_and_no_action_is_explored(make):
    scenario = make(epsilon="constant:1")
    before = filled(scenario)
    one = Agent(Coop(), scenario, 0, 0, memory=before.memory, learning=False)
    assert one.epsilon(0) == 0.0
    assert {one.decide(t, 2) for t in range(30)} == {ASK}
    one.learn(1, Choice(2, ASK, Action(EAST, True, 1, True), (5,)), paid(99.0), 3)
    assert tables_equal([one.tables], [before])
