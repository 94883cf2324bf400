# Copyright 2026 The sparse_coord_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Links that fail on purpose: seeded, the same in every way of running."""

import numpy as np
import pytest

from sparse_coord_ros.base.errors import SettingError
from sparse_coord_ros.core.game.links import DOWN_DRAW, LINKS, PERIOD, link_of
from sparse_coord_ros.core.game.percepts import Percepts
from sparse_coord_ros.core.game.scenario import load_scenario
from sparse_coord_ros.core.game.streams import EVALUATION, PERCEPT, Stream
from sparse_coord_ros.core.runs.run import learn
from sparse_coord_ros.core.solve.exact import evaluate_exact

FAILING = ["lost:0.3", "bursts:0.05:0.2", "dead:150"]


@pytest.mark.parametrize("text", ["up", *FAILING])
def test_a_percept_is_lost_while_the_link_is_down(text):
    percepts = Percepts(load_scenario("env1", link=text), 3)
    plain = Stream(3, 1, PERCEPT)
    link = link_of(LINKS.parse(text), 3, 1)
    for step in (0, 700, 3, PERIOD + 5, 149, 150):  # in any order
        expected = DOWN_DRAW if link.down(step) else plain.at(step)[0]
        assert percepts.draw(step, 1) == expected


def test_how_often_links_are_down():
    assert link_of(LINKS.parse("lost:0.3"), 0, 0).pattern.mean() == pytest.approx(
        0.3, abs=0.01
    )
    bursts = link_of(LINKS.parse("bursts:0.05:0.2"), 0, 0).pattern
    assert bursts.mean() == pytest.approx(0.05 / 0.25, abs=0.02)
    ends = np.flatnonzero(bursts[:-1] & ~bursts[1:])
    assert bursts.sum() / len(ends) == pytest.approx(5.0, abs=0.3), "steps of a burst"
    dead = link_of(LINKS.parse("dead:7"), 0, 0)
    assert [dead.down(step) for step in range(6, 9)] == [False, True, True]


def test_a_pattern_comes_again_after_its_period():
    link = link_of(LINKS.parse("lost:0.5"), 3, 0)
    first = [link.down(step) for step in range(50)]
    assert first == [link.down(PERIOD + step) for step in range(50)]
    assert len(set(first)) == 2


def test_each_robot_and_phase_has_a_link_of_its_own():
    spec = LINKS.parse("lost:0.5")
    patterns = [
        link_of(spec, 4, k, phase).pattern for k in (0, 1) for phase in (0, EVALUATION)
    ]
    patterns.append(link_of(spec, 5, 0).pattern)
    for i, one in enumerate(patterns):
        for other in patterns[:i]:
            assert 0.45 < (one == other).mean() < 0.55


def test_exact_evaluation_knows_no_time():
    scenario = load_scenario("env1", link="lost:0.1", steps=10)
    with pytest.raises(SettingError, match="link is 'lost:0.1'"):
        evaluate_exact(scenario, learn(scenario, "coop", 0))
