# Copyright 2026 The sparse_coord_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The last word on a team: not arrived, nothing to coordinate, learned, failing."""

from dataclasses import replace

import pytest
from teams import walking

from sparse_coord_ros.game.scenario import load_scenario
from sparse_coord_ros.learn.agent import initial_tables
from sparse_coord_ros.learn.learners import learner_of
from sparse_coord_ros.solve.exact import evaluate_exact
from sparse_coord_ros.solve.verdict import FAILING, LEARNED, LOST, NEEDLESS, last_word, needless


def verdict(scenario, tables, learner="coop"):
    return last_word(scenario, learner_of(learner), evaluate_exact(scenario, tables))


@pytest.mark.parametrize(("penalty", "kind"), [(0, NEEDLESS), (-1, NEEDLESS), (-100, FAILING)])
def test_robots_that_mind_nobody(penalty, kind):
    scenario = load_scenario("env1", penalty=penalty)
    assert verdict(scenario, walking(scenario)).kind == kind
    assert needless(scenario) == (kind == NEEDLESS)


def test_what_to_try():
    scenario = load_scenario("env1", penalty=-100)
    names = ("coop", "factored", "noncoop")
    said = [verdict(scenario, walking(scenario), name).text for name in names]
    assert "0.41 miscoordinations an episode are left" in said[0]
    assert said[0].endswith("worth 92.60 of up to 118.51. Try --learner factored or more steps.")
    assert said[1].endswith("Try more steps.") and said[2].endswith("Try more steps.")


@pytest.mark.parametrize(("reward", "kind"), [(105.5, FAILING), (105.6, LEARNED)])
def test_half_of_what_can_be_gained_is_learned(reward, kind):
    scenario = load_scenario("env1", penalty=-100)
    found = evaluate_exact(scenario, walking(scenario))
    found = replace(found, reward=replace(found.reward, mean=reward))
    assert last_word(scenario, learner_of("coop"), found).kind == kind


def test_who_does_not_arrive_has_learned_nothing():
    scenario = load_scenario("env1")
    found = verdict(scenario, [initial_tables(scenario)] * 2)
    assert found.kind == LOST and found.text.endswith("Try --learner factored or more steps.")
