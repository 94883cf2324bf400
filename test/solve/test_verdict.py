# Copyright 2026 The sparse_coord_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The last word on a team: not arrived, worse, nothing to coordinate, learned, failing."""

from dataclasses import replace

import pytest
from teams import untrained, walking

from sparse_coord_ros.game.scenario import load_scenario
from sparse_coord_ros.learners.registry import learner_of
from sparse_coord_ros.solve.exact import evaluate_exact
from sparse_coord_ros.solve.optimum import independent_bound
from sparse_coord_ros.solve.reference import shortest_path_reference
from sparse_coord_ros.solve.shipped import known_optimum, unseen_buildings
from sparse_coord_ros.solve.verdict import (
    FAILING,
    LEARNED,
    LOST,
    NEEDLESS,
    SLIGHT,
    WORSE,
    last_word,
    needless,
)


def verdict(scenario, tables, learner="coop"):
    return last_word(scenario, learner_of(learner), evaluate_exact(scenario, tables))


def earning(scenario, reward, *, error=0.0, learner="coop"):
    """Return the last word on a team that earns so much and else is one of env1."""
    env1 = load_scenario("env1")
    found = evaluate_exact(env1, walking(env1))
    measure = replace(found.reward, mean=reward, standard_error=error)
    return last_word(scenario, learner_of(learner), replace(found, reward=measure))


@pytest.mark.parametrize(("penalty", "kind"), [(0, NEEDLESS), (-1, NEEDLESS), (-100, FAILING)])
def test_robots_that_ignore_each_other(penalty, kind):
    scenario = load_scenario("env1", penalty=penalty)
    assert verdict(scenario, walking(scenario)).kind == kind
    assert needless(scenario) == (kind == NEEDLESS)


def test_it_states_reward_share_and_loss():
    scenario = load_scenario("env1", penalty=-100)
    said = earning(scenario, 117.0).text
    assert said == (
        "The team learned to coordinate: a robot earns 117.00, robots that ignore each other "
        "92.60. This closes 94% of the gap to the best asking team found (118.51; loss 1.51). "
        "Miscoordinations per episode: 0.41 instead of 0.41."
    )


def test_what_to_try():
    scenario = load_scenario("env1", penalty=-100)
    said = [earning(scenario, 93.0, learner=name).text for name in ("coop", "factored", "noncoop")]
    assert all("hardly coordinates" in one and " 2% of the gap " in one for one in said)
    assert said[0].endswith("Try --learner factored or more steps.")
    assert said[1].endswith("0.41. Try more steps.") and said[2].endswith("0.41. Try more steps.")


@pytest.mark.parametrize(("reward", "kind"), [(105.5, FAILING), (105.6, LEARNED)])
def test_half_of_the_gap_is_learned(reward, kind):
    assert earning(load_scenario("env1", penalty=-100), reward).kind == kind


@pytest.mark.parametrize(("factor", "kind"), [(0.99, LEARNED), (1.01, FAILING)])
def test_a_slight_loss_is_no_failure_whatever_the_gap(factor, kind):
    """A gap of 0.88 of which nothing is closed: what counts is the loss."""
    scenario = load_scenario("cit", penalty=-150)
    slight = SLIGHT * independent_bound(scenario)
    best = known_optimum(scenario).value
    assert slight < best - earning_of_paths(scenario) < 2.5 * slight
    assert earning(scenario, best - factor * slight).kind == kind


def earning_of_paths(scenario):
    return shortest_path_reference(scenario).reward


@pytest.mark.parametrize("penalty", [-1, -100])
def test_a_team_that_is_worse_than_one_that_ignores_its_peers(penalty):
    """Also where coordination is not needed."""
    scenario = load_scenario("env1", penalty=penalty)
    paths, slight = earning_of_paths(scenario), SLIGHT * independent_bound(scenario)
    found = earning(scenario, paths - 1.01 * slight)
    assert found.kind == WORSE and f"{paths:.2f}" in found.text
    assert earning(scenario, paths - 0.99 * slight).kind != WORSE
    assert earning(scenario, paths - 2 * slight, error=slight).kind != WORSE, "it may be chance"


def test_larger_teams_have_yardsticks_that_say_what_they_are():
    [name] = [one for one in unseen_buildings() if one.startswith("unseen1-door-4r")][:1]
    for scenario, yardstick in (
        (load_scenario(name, penalty=-100), "route planner"),
        (load_scenario("crowd-4r", penalty=-100), "best learned team"),
        (load_scenario("crowd-4r", penalty=-90), "bound (robots alone)"),
    ):
        said = earning(scenario, earning_of_paths(scenario) + 5.0).text
        assert f"of the gap to the {yardstick} (" in said


def test_a_team_that_does_not_arrive_has_learned_nothing():
    scenario = load_scenario("env1")
    found = verdict(scenario, [untrained(scenario)] * 2)
    assert found.kind == LOST and found.text.endswith("Try --learner factored or more steps.")
