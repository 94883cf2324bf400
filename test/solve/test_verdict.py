# Copyright 2026 The sparse_coord_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The last word on a team: not arrived, worse, not needed, in vain, silent, learned, failing."""

from dataclasses import replace

import numpy as np
import pytest
from teams import untrained, walking

from sparse_coord_ros.base.percents import percent
from sparse_coord_ros.core.game.scenario import load_scenario
from sparse_coord_ros.core.learners.registry import learner_of
from sparse_coord_ros.core.runs.measures import TRIALS
from sparse_coord_ros.core.solve.exact import evaluate_exact
from sparse_coord_ros.core.solve.optimum import independent_bound
from sparse_coord_ros.core.solve.shipped import known_optimum
from sparse_coord_ros.core.solve.shortest_paths import shortest_paths
from sparse_coord_ros.core.solve.verdict import (
    FAILING,
    IN_VAIN,
    LEARNED,
    LOST,
    NEEDLESS,
    RARE,
    SILENT,
    SLIGHT,
    WORSE,
    verdict_on,
)


def verdict(scenario, tables, learner="coop"):
    return verdict_on(scenario, learner_of(learner), evaluate_exact(scenario, tables))


def earning(scenario, value, *, error=0.0, learner="coop", asks=1.0):
    """Return the last word on a team that earns and asks so much and else is one of env1."""
    env1 = load_scenario("env1")
    found = evaluate_exact(env1, walking(env1))
    # two trials, the mean of which has this error
    trials = {"source": TRIALS, "trials": 2} if error else {}
    returns = np.array([[value - error] * 2, [value + error] * 2])
    found = replace(found, returns=returns, asks=np.full((2, 2), asks), **trials)
    return verdict_on(scenario, learner_of(learner), found)


@pytest.mark.parametrize(
    ("penalty", "kind"), [(0, NEEDLESS), (-1, NEEDLESS), (-100, SILENT)]
)
def test_robots_that_ignore_each_other(penalty, kind):
    scenario = load_scenario("env1", penalty=penalty)
    assert verdict(scenario, walking(scenario)).kind == kind


def test_it_states_reward_share_and_loss():
    scenario = load_scenario("env1")
    said = earning(scenario, 117.0).text
    assert said == (
        "The team learned to coordinate: a robot earns 117.00, robots that ignore each other "
        "92.60. This closes 94 % of the gap to the best asking team found (118.51; loss 1.51). "
        "Miscoordinations per episode: 0.41 instead of 0.41."
    )


@pytest.mark.parametrize(
    ("learner", "advice"),
    [("coop", "Try --learner voi."), ("voi", "Try more steps.")],
)
def test_what_to_try(learner, advice):
    """Coop. settles on not asking: more steps do not help it."""
    found = earning(load_scenario("env1"), 93.0, learner=learner)
    assert found.kind == FAILING and " 2 % of the gap " in found.text
    assert found.text.endswith(f"of that, as much as 28.0 questions cost. {advice}")


def test_where_asking_is_not_worth_its_price_it_says_what_would_be():
    """The paper's penalty: its learner earns as much as robots that ignore each other."""
    scenario = load_scenario("env1", penalty=-20)
    found = earning(scenario, 119.68, asks=0.0)
    assert found.kind == SILENT
    assert found.text.endswith(
        "Coordination may pay: a robot alone in the world earns 126.45; robots that ignore each "
        "other lose 6.77 of it each; a team can win back 2.20 of that, as much as 2.2 questions "
        "cost. It will pay at a penalty of -50, or if a question costs at most 0.73. "
        "Try --learner voi."
    )


def test_a_team_that_earns_as_much_as_the_best_need_try_nothing():
    for learner in ("coop", "voi"):
        found = earning(load_scenario("env1"), 118.4, learner=learner, asks=0.0)
        assert found.kind == SILENT and "Try" not in found.text


def test_one_paragraph_does_not_contradict_itself():
    """Where coordination is not needed, the sentences on asking say what would change that."""
    scenario = load_scenario("env1", penalty=-5)
    said = verdict(scenario, walking(scenario)).text
    assert said.startswith("Coordination is not needed here: ")
    assert said.endswith(" It will pay at a penalty of -50.")


@pytest.mark.parametrize("learner", ["indiv", "noncoop"])
def test_robots_that_cannot_ask_have_not_learned_to_coordinate(learner):
    """Equally short paths, or a detour, may still earn more than ties broken at random."""
    found = earning(load_scenario("env1"), 117.0, learner=learner, asks=0.0)
    assert found.kind == SILENT
    assert found.text == (
        "The team does not coordinate by asking: the learner "
        f"{learner} cannot ask. In this team a robot earns 117.00, robots that "
        "ignore each other 92.60, the best asking team found 118.51. Coordination will pay: "
        "a robot alone in the world earns 126.45; robots that ignore each other lose 33.86 of it "
        "each; a team can win back 27.96 of that, as much as 28.0 questions cost. "
        "Try --learner voi."
    )


@pytest.mark.parametrize(("asks", "kind"), [(0.99 * RARE, SILENT), (RARE, LEARNED)])
def test_robots_that_do_not_ask_have_not_learned_to_coordinate(asks, kind):
    found = earning(load_scenario("env1"), 117.0, asks=asks)
    assert found.kind == kind
    assert ("a robot asks 0.05 times an episode" in found.text) == (kind == SILENT)


@pytest.mark.parametrize(
    "setting",
    [{"perception": "never"}, {"perception": "probability:0"}],
    ids=str,
)
@pytest.mark.parametrize("learner", ["coop", "noncoop", "voi"])
def test_where_no_percept_can_succeed_asking_is_no_advice(setting, learner):
    scenario = load_scenario("env1", **setting)
    for value, kind in ((80.0, WORSE), (93.0, IN_VAIN), (117.0, IN_VAIN)):
        found = earning(scenario, value, learner=learner)
        assert found.kind == kind
        assert "no question can be answered" in found.text and "Try" not in found.text


@pytest.mark.parametrize(("value", "kind"), [(105.5, FAILING), (105.6, LEARNED)])
def test_half_of_the_gap_is_learned(value, kind):
    assert earning(load_scenario("env1"), value).kind == kind


def test_a_slight_loss_alone_is_not_learned():
    """A gap of 0.96 of which 43 % is closed."""
    scenario = load_scenario("cit", penalty=-150)
    best = known_optimum(scenario).value
    gap = best - earning_of_paths(scenario)
    found = earning(scenario, best - 0.57 * gap)
    assert 0.57 * gap < SLIGHT * independent_bound(scenario) < gap
    assert found.kind == FAILING and " 43 % of the gap " in found.text


def earning_of_paths(scenario):
    return shortest_paths(scenario).mean("returns")


@pytest.mark.parametrize("penalty", [-1, -100])
def test_a_team_that_is_worse_than_one_that_ignores_its_peers(penalty):
    """Also where coordination is not needed."""
    scenario = load_scenario("env1", penalty=penalty)
    paths = earning_of_paths(scenario)
    slight = SLIGHT * independent_bound(scenario)
    found = earning(scenario, paths - 1.01 * slight)
    assert found.kind == WORSE and f"{paths:.2f}" in found.text
    assert earning(scenario, paths - 0.99 * slight).kind != WORSE
    assert earning(scenario, paths - 2 * slight, error=slight).kind != WORSE, (
        "it may be chance"
    )


def test_larger_teams_have_yardsticks_that_say_what_they_are():
    for scenario, yardstick in (
        (load_scenario("crowd-4r", penalty=-100), "best learned team"),
        (load_scenario("crowd-4r", penalty=-90), "bound (robots alone)"),
    ):
        said = earning(scenario, earning_of_paths(scenario) + 5.0).text
        assert f"of the gap to the {yardstick} (" in said


def test_nothing_is_to_be_tried_where_asking_will_not_pay():
    """Each robot of this building can take a door of its own."""
    scenario = load_scenario("unseen1-doors-2r-1")
    found = earning(scenario, earning_of_paths(scenario) + 20.0, asks=0.0)
    assert found.kind == SILENT
    assert "Asking will not pay, because robots can choose paths that" in found.text
    assert "Try" not in found.text


def test_a_team_that_does_not_arrive_has_learned_nothing():
    scenario = load_scenario("env1")
    found = verdict(scenario, [untrained(scenario)] * 2)
    assert found.kind == LOST and found.text.endswith(
        "Try more steps, or --learner voi."
    )
    unanswered = scenario.with_settings(perception="never")
    found = verdict(unanswered, [untrained(scenario)] * 2)
    assert found.kind == LOST and found.text.endswith("Try more steps.")


def test_robots_that_stand_in_each_other_s_way_lose_time():
    """With block alone there are no miscoordinations to compare."""
    scenario = load_scenario("isr", interactions="block:anywhere")
    ignoring = shortest_paths(scenario)
    best = known_optimum(scenario).value
    said = earning(scenario, 0.5 * (ignoring.mean("returns") + best) + 1.0)
    assert said.kind == LEARNED
    assert f"instead of {ignoring.mean('time_to_goal'):.3g}." in said.text
    assert f"all arrive in {percent(ignoring.mean('arrived'))}" in said.text
    assert "Miscoordinations" not in said.text
