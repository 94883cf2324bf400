# Copyright 2026 The sparse_coord_ros authors
# SPDX-License-Identifier: Apache-2.0
"""CQ-learning against computations by hand, and where they begin."""

import numpy as np
import pytest

from sparse_coord_ros.base.errors import SettingError
from sparse_coord_ros.core.game.actions import COORDINATE
from sparse_coord_ros.core.game.grid import GridMap
from sparse_coord_ros.core.game.scenario import load_scenario, scenario_from_dict
from sparse_coord_ros.core.game.schedules import step_sizes
from sparse_coord_ros.core.game.world import Action, Reward
from sparse_coord_ros.core.learners.agent import Agent, Choice, Decision
from sparse_coord_ros.core.learners.cq import (
    COUNT,
    CQ,
    MARKED,
    WINDOW,
    differs,
    is_marked,
)
from sparse_coord_ros.core.learners.lone import lone_values
from sparse_coord_ros.core.learners.registry import learner_of
from sparse_coord_ros.core.solve.optimum import independent_bound

EAST = 2


def problem(**settings):
    return load_scenario("env1").with_settings(
        {"steps": 1000, "penalty": -30, "prior": "map", **settings}
    )


def agent_of(scenario, **more):
    return Agent(CQ(), scenario, 0, 1, **more)


def step(agent, x, move, y, common, *, peer=None, asked=False):
    """Let an agent learn from one transition."""
    action = Action(move, asked, 1 if asked else -1, peer is not None)
    decision = Decision(COORDINATE if asked else move, (1,) if asked else ())
    cost = -1.0 if asked else 0.0
    reward = Reward(0.0, common, cost, common + cost)
    agent.learn(
        5, Choice(x, decision, action, None if peer is None else (peer,)), reward, y
    )


def test_a_lone_robot_is_worth_its_shortest_path():
    scenario = problem(move_success=0.7)
    worth = [
        lone_values(scenario, k)[r.start].max() for k, r in enumerate(scenario.robots)
    ]
    assert np.mean(worth) == pytest.approx(independent_bound(scenario), rel=1e-12)


def test_a_lone_robot_that_pays_in_every_step():
    scenario = problem()
    goal = scenario.robots[0].goal
    next_cell = scenario.map.next_cell
    q = lone_values(scenario, 0, 2.0)
    after = 0.95 * q.max(axis=1)
    after[goal] = 10 + 0.95 * 200
    assert q == pytest.approx(
        0.8 * after[next_cell] + 0.2 * after[:, None] - 2.0, rel=1e-9
    )


@pytest.mark.parametrize(
    ("hits", "found"), [(0, False), (3, False), (4, True), (20, True)]
)
def test_students_test(hits, found):
    """t of h times -c in 20 is (19 h / (20 - h))^(1/2), critical 2.093: 1.83 for 3, 2.18 for 4."""
    sample = np.zeros(3)
    judged = [differs(sample, -7.0 if i < hits else 0.0) for i in range(WINDOW)]
    assert judged == [False] * (WINDOW - 1) + [found]
    assert sample.tolist() == [MARKED if found else 0.0, 0.0, 0.0]
    assert differs(sample, 0.0) == found, "once found it is known"


def test_begins_at_the_lone_values_with_no_mark():
    scenario = problem()
    for k in range(2):
        tables = Agent(CQ(), scenario, k, 0).tables
        q = lone_values(scenario, k)
        assert (tables.q_star[:, :4] == q).all() and (
            tables.q_coord == q[:, None]
        ).all()
        assert not any(map(is_marked, tables.q_star))
    begun = [CQ().begun(scenario, k).q_star for k in range(2)]
    assert not np.array_equal(*begun)


def test_cq_marks_asks_and_learns_on_the_lone_values():
    scenario = problem()
    agent = agent_of(scenario)
    q = lone_values(scenario, 0)
    x = scenario.robots[0].start
    y = scenario.robots[0].start + 1
    z = 7
    for _ in range(WINDOW):
        assert not is_marked(agent.values(x))
        step(agent, x, EAST, y, -30.0)
    assert is_marked(agent.values(x)) and agent.decide(900, x).peers == (1,)
    assert (agent.tables.q_star[:, :4] == q).all(), "Q* never changes"
    for _ in range(WINDOW - 1):
        step(agent, x, EAST, y, -30.0, peer=z, asked=True)
    assert (agent.tables.q_coord[x, z] == q[x]).all()
    for n in (1, 2):
        before = agent.tables.q_coord[x, z, EAST]
        step(agent, x, EAST, y, -30.0, peer=z, asked=True)
        alpha = max(n**-0.5, step_sizes(scenario.step_size, scenario.steps).by_step[5])
        expected = (1 - alpha) * before + alpha * (-30.0 + 0.95 * q[y].max())
        assert agent.tables.q_coord[x, z, EAST] == pytest.approx(expected, rel=1e-14)
    memory = agent.memory()
    assert len(memory["q_coord_keys"]) == 1
    samples = agent_of(scenario, memory=memory).memory()["samples"]
    assert samples[x, 4 + z, COUNT] == MARKED
    assert (samples < 0).sum() == 2, "the move without asking, and the joint state"


def test_cq_learns_nothing_from_failed_percepts():
    scenario = problem()
    agent = agent_of(scenario)
    x = scenario.robots[0].start
    for _ in range(3 * WINDOW):
        step(agent, x, EAST, x + 1, -30.0, asked=True)
    assert not is_marked(agent.values(x)) and not agent.memory()["samples"].any()
    assert agent.asked_in[x] == 3 * WINDOW


def test_what_it_cannot_learn():
    hall = {"name": "hall", "text": GridMap("hall", ("." * 27,) * 27).to_text()}
    robots = {
        "a": {"start": [0, 0], "goal": [5, 5]},
        "b": {"start": [5, 5], "goal": [0, 0]},
    }
    large = scenario_from_dict(
        {"map": hall, "robots": robots}, where="hall", name="hall"
    )
    with pytest.raises(SettingError, match="729 cells"):
        learner_of("cq").check(large.with_settings(prior="map"))
