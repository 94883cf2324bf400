# Copyright 2026 The sparse_coord_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Whether coordination will pay: loss, ratio and possible gain, and the words for them."""

import math
from dataclasses import replace

import pytest
from teams import drawn

from sparse_coord_ros.core.game.scenario import load_scenario
from sparse_coord_ros.core.solve.advice import (
    AVOIDABLE,
    LEAST_RELATIVE_GAIN,
    MAY_PAY,
    SURE_RELATIVE_GAIN,
    SURE_RELATIVE_GAIN_BY_BOUND,
    WILL_NOT_PAY,
    WILL_PAY,
    advice,
    in_questions,
    loss_of_ignoring,
    relative_gain,
)
from sparse_coord_ros.core.solve.optimum import independent_bound

MEETING = "1D2"
"""Both robots are in the doorway after the first step, for certain, and not again."""

HEAD_ON = {"penalty": -100, "move_success": 1.0, "discount": 0.9, "goal_reward": 1}


def test_the_loss_of_two_robots_that_meet_once():
    """The step is the first: its penalty of 100 is not discounted, and falls on both."""
    scenario = drawn(MEETING, **HEAD_ON)
    assert loss_of_ignoring(scenario) == pytest.approx(100.0)
    assert advice(scenario).ratio == pytest.approx(100.0)
    cheap = drawn(MEETING, **HEAD_ON, ask_cost=4)
    assert advice(cheap).ratio == pytest.approx(25.0)


def test_a_later_meeting_is_discounted():
    """After the second step both are in the doorway."""
    scenario = drawn("1.D.2", **HEAD_ON)
    assert loss_of_ignoring(scenario) == pytest.approx(90.0)


def test_the_loss_is_that_of_a_robot_on_average():
    scenario = drawn(MEETING, **HEAD_ON, common_reward="each:1:0")
    assert loss_of_ignoring(scenario) == pytest.approx(50.0)


def test_what_can_be_won_back_is_the_optimum_less_shortest_paths():
    """Alone each earns 0.9 / (1 - 0.9) = 9. At best one waits a step, and earns 9 * 0.9."""
    found = advice(drawn(MEETING, **HEAD_ON))
    assert found.loss == pytest.approx(100.0)
    assert found.gain == pytest.approx(100.0 - (9.0 - 9.0 * 0.9) / 2)


@pytest.mark.parametrize("cost", [0.5, 1.0])
def test_robots_that_never_meet_lose_nothing(cost):
    scenario = drawn("1.2", penalty=-100, ask_cost=cost)
    found = advice(scenario)
    assert (found.kind, found.loss, found.ratio) == (WILL_NOT_PAY, 0.0, 0.0)
    alone = independent_bound(scenario)
    assert found.text == (
        f"Asking will not pay: a robot alone in the world earns {alone:.2f}; "
        "robots that ignore each other earn as much."
    )


def test_free_questions():
    found = advice(load_scenario("env1", penalty=-100, ask_cost=0))
    assert found.ratio == math.inf and found.kind == WILL_PAY
    assert "win back 27.96 of that, and questions are free." in found.text
    assert advice(load_scenario("env1", penalty=0, ask_cost=0)).ratio == 0.0


def worth_in_env1(cost, **settings):
    """Return what env1 at -100 is found to be, and the worth of its gain."""
    scenario = load_scenario("env1", penalty=-100, ask_cost=cost, **settings)
    found = advice(scenario)
    return found.kind, relative_gain(found.gain, scenario)


def test_the_thresholds():
    """Up to 27.96 can be won back in env1."""
    gain = advice(load_scenario("env1", penalty=-100)).gain
    for worth, kind in (
        (0.99 * LEAST_RELATIVE_GAIN, WILL_NOT_PAY),
        (1.01 * LEAST_RELATIVE_GAIN, MAY_PAY),
        (0.99 * SURE_RELATIVE_GAIN, MAY_PAY),
        (1.01 * SURE_RELATIVE_GAIN, WILL_PAY),
    ):
        assert worth_in_env1(gain / worth) == (kind, pytest.approx(worth))


def test_answers_that_fail_count_twice():
    _, whole = worth_in_env1(1.0)
    assert worth_in_env1(1.0, perception="probability:0.2") == (
        MAY_PAY,
        pytest.approx(0.04 * whole),
    )
    assert worth_in_env1(1.0, perception="never") == (WILL_NOT_PAY, 0.0)
    assert worth_in_env1(1.0, perception="range:1")[1] == whole


def test_it_says_that_few_questions_are_answered():
    found = advice(load_scenario("env1", perception="probability:0.1"))
    assert found.kind == WILL_NOT_PAY
    assert found.text.endswith(
        "as much as 28.0 questions cost; but only 10 % of the questions are answered. It will pay "
        "at a penalty of -1000, or if a question costs at most 0.09, or if more questions are "
        "answered."
    )
    found = advice(load_scenario("env1", perception="never"))
    assert "; but no question is answered (perception never)." in found.text
    assert found.remedy.startswith("Asking needs a perception model that answers")


def test_what_it_says_would_make_asking_pay_does():
    scenario = load_scenario("env1", penalty=-20)
    found = advice(scenario)
    assert found.kind == MAY_PAY and found.remedy in found.text
    assert found.remedy == (
        "It will pay at a penalty of -50, or if a question costs at most 0.73."
    )
    for setting in ({"penalty": -50}, {"ask_cost": 0.73}):
        better = advice(scenario.with_settings(setting))
        assert (better.kind, better.remedy) == (WILL_PAY, "")


def test_larger_teams_are_measured_by_robots_alone():
    scenario = load_scenario("crowd-4r", penalty=-100)
    found = advice(scenario)
    assert found.gain == pytest.approx(found.loss) and "win back" not in found.text
    for worth, kind in (
        (0.99 * SURE_RELATIVE_GAIN_BY_BOUND, MAY_PAY),
        (1.01 * SURE_RELATIVE_GAIN_BY_BOUND, WILL_PAY),
    ):
        cost = found.loss / worth
        assert (
            advice(load_scenario("crowd-4r", penalty=-100, ask_cost=cost)).kind == kind
        )


def test_robots_that_can_avoid_each_other_need_not_ask():
    found = advice(load_scenario("unseen1-doors-2r-1"))
    assert found.kind == AVOIDABLE and found.ratio > 40
    assert found.text.startswith(
        "Asking will not pay, because robots can choose paths that"
    )


def test_one_robot_has_nobody_to_ask():
    pair = load_scenario("env1")
    found = advice(replace(pair, robots=pair.robots[:1]))
    assert (found.kind, found.loss) == (WILL_NOT_PAY, 0.0)
    assert found.text == "With one robot there is nobody to ask."


def test_in_questions():
    scenario = load_scenario("env1", ask_cost=0.5)
    assert in_questions(3.0, scenario) == 6.0
