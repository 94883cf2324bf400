# Copyright 2026 The sparse_coord_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The setting prior: what robots know that know their map, and how they learn from there."""

import numpy as np
import pytest

from sparse_coord_ros.base.errors import SettingError
from sparse_coord_ros.core.engine.batch import run_batch
from sparse_coord_ros.core.game.actions import COORDINATE, PRIMITIVES
from sparse_coord_ros.core.game.scenario import load_scenario
from sparse_coord_ros.core.learners.agent import Agent
from sparse_coord_ros.core.learners.lone import lone_values
from sparse_coord_ros.core.learners.memory import check_memory
from sparse_coord_ros.core.learners.registry import learner_of
from sparse_coord_ros.core.learners.voi import MAP_TRIES
from sparse_coord_ros.core.runs.run import LearningRun
from sparse_coord_ros.core.runs.team import Team

BLENDS = ("coop", "noncoop", "indiv", "voi")
"""Learners that can begin without the map, too."""


def known(name="env1", learner="voi", **settings):
    """Return a scenario, with the learner's defaults, in which robots know their map."""
    chosen = load_scenario(name).with_settings({"prior": "map", **settings})
    return learner_of(learner).with_defaults(chosen)


def swept(scenario, robot, price):
    """Return what `lone_values` returns, by sweeps over all cells at once."""
    goal = scenario.robots[robot].goal
    p = scenario.move_success
    for_ever = price / (1.0 - scenario.discount)
    after_goal = scenario.goal_value + for_ever
    arrival = scenario.goal_reward + scenario.discount * after_goal
    value = np.zeros(len(scenario.map.cells))
    while True:
        after = scenario.discount * value
        after[goal] = arrival
        q = p * after[scenario.map.next_cell] + (1.0 - p) * after[:, None]
        if np.array_equal(q.max(axis=1), value):
            return q - for_ever
        value = q.max(axis=1)


@pytest.mark.parametrize("name", ["env1", "env2-4r", "cit", "unseen1-rooms-8r-3"])
def test_values_of_a_robot_alone_have_the_bits_of_plain_sweeps(name):
    scenario = load_scenario(name)
    for robot in range(len(scenario.robots)):
        for price in (0.0, 0.37):
            found = lone_values(scenario, robot, price)
            assert found.tobytes() == swept(scenario, robot, price).tobytes()


def test_values_of_a_robot_alone_fall_by_the_same_factor_with_each_move():
    """V(d) = p gamma / (1 - (1 - p) gamma) V(d - 1): the closed form on a grid."""
    scenario = load_scenario("cmu")
    p = scenario.move_success
    gamma = scenario.discount
    waits = 1.0 - (1.0 - p) * gamma
    first = p * (scenario.goal_reward + gamma * scenario.goal_value) / waits
    moves = scenario.map.distances_to(scenario.robots[0].goal)
    value = lone_values(scenario, 0).max(axis=1)
    away = moves > 0
    expected = first * (p * gamma / waits) ** (moves[away] - 1)
    np.testing.assert_allclose(value[away], expected, rtol=1e-12)


@pytest.mark.parametrize("learner", BLENDS)
def test_what_a_robot_knows_of_its_own_way_begins_at_the_values_of_a_robot_alone(
    learner,
):
    scenario = known(learner=learner, ask_cost=3)
    rule = learner_of(learner)
    for robot in (0, 1):
        alone = lone_values(scenario, robot)
        mind = rule.begun(scenario, robot)
        np.testing.assert_array_equal(mind.q_star[:, :PRIMITIVES], alone)
        asking = mind.q_star[:, COORDINATE]
        if rule.asks:
            np.testing.assert_array_equal(asking, alone.max(axis=1) - 3)
        else:
            assert np.isnan(asking).all()
        tables = Agent(rule, scenario, robot, 0).tables
        if rule.asks:
            seen = np.asarray(tables.q_coord)
            np.testing.assert_array_equal(
                seen, np.broadcast_to(alone[:, None], seen.shape)
            )


def test_rows_that_were_not_met_depend_on_the_cell_where_q_coord_is_sparse():
    scenario = known("env2-4r", "coop", peers="all")
    table = Agent(learner_of("coop"), scenario, 2, 0).tables.q_coord
    alone = lone_values(scenario, 2)
    for cell in (0, 7, 20):
        assert table[cell, 3, 4, 5].tolist() == alone[cell].tolist()


def test_moves_succeed_as_often_as_the_prior_says():
    given = known(prior_success=0.95)
    same = known(move_success=0.95)
    assert given.known_success == 0.95
    assert lone_values(given, 0).tobytes() == lone_values(same, 0).tobytes()
    led = learner_of("voi").begun(given, 0).led
    assert set(np.unique(led)) == {0, round(0.95 * MAP_TRIES)}


def test_moves_that_hardly_ever_succeed_lead_somewhere_in_the_model_too():
    scenario = known(prior_success=0.001, steps=50)
    learner = learner_of("voi")
    run = LearningRun(Team(scenario, learner, compiled=False), 1)
    run.advance(50)
    for k, memory in enumerate(run.memories):
        check_memory(scenario, learner, k, memory)


@pytest.mark.parametrize("learner", ["cq", "joint"])
def test_learners_that_need_the_map_have_it_and_refuse_none(learner):
    rule = learner_of(learner)
    scenario = load_scenario("env1")
    assert rule.with_defaults(scenario).prior == "map"
    with pytest.raises(SettingError, match="setting prior: value is 'none'"):
        rule.check(rule.with_defaults(scenario.with_settings({"prior": "none"})))


@pytest.mark.parametrize("name", ["q_star_init", "q_coord_init"])
def test_initial_values_have_no_meaning_beside_the_map(name):
    with pytest.raises(SettingError, match=f"setting {name}: value is 50"):
        load_scenario("env1").with_settings({"prior": "map", name: 50})


def test_a_success_of_the_prior_has_no_meaning_without_the_map():
    chosen = load_scenario("env1").with_settings({"prior_success": 0.9})
    for name in ("coop", "noncoop", "indiv", "voi"):
        rule = learner_of(name)
        with pytest.raises(SettingError, match="prior_success: value is 0.9"):
            rule.check(rule.with_defaults(chosen))
        rule.check(rule.with_defaults(chosen.with_settings({"prior": "map"})))
    for name in ("cq", "joint"):  # they know the map
        rule = learner_of(name)
        scenario = rule.with_defaults(chosen)
        rule.check(scenario)
        assert (scenario.prior, scenario.known_success) == ("map", 0.9)


@pytest.mark.long
def test_two_thousand_steps_are_enough_for_robots_that_know_their_map():
    """In cmu robots without the map do not arrive so soon; 22.6 (0.5) was measured with it."""
    rewards = {}
    for prior in ("none", "map"):
        scenario = learner_of("voi").with_defaults(
            load_scenario("cmu").with_settings(
                {"prior": prior, "steps": 2000, "penalty": -100}
            )
        )
        runs = run_batch(scenario, "voi", range(2), trials=20, engine="python")
        rewards[prior] = np.mean([run.measures.mean("returns") for run in runs])
    assert rewards["none"] < 5.0
    assert rewards["map"] > 15.0
