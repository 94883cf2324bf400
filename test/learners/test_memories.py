# Copyright 2026 The sparse_coord_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Memories of robots must be those of the scenario and learner that they are used with."""

import numpy as np
import pytest
from teams import plain_run

from sparse_coord_ros.base.errors import TablesError
from sparse_coord_ros.core.game.scenario import load_scenario
from sparse_coord_ros.core.learners.memory import check_memory
from sparse_coord_ros.core.learners.registry import learner_of

LEARNERS = ("coop", "indiv", "noncoop", "hysteretic", "voi", "cq")


def learned(learner, name="env1", **settings):
    """Return (scenario, learner, the memory of robot 1 after 60 steps)."""
    rule = learner_of(learner)
    scenario = rule.with_defaults(load_scenario(name, steps=100, **settings))
    run = plain_run(scenario, rule, 0)
    run.advance(60)
    return scenario, rule, run.memories[0]


@pytest.mark.parametrize("learner", LEARNERS)
def test_what_a_run_made_is_accepted(learner):
    scenario, rule, memory = learned(learner)
    assert check_memory(scenario, rule, 0, memory) == memory


@pytest.mark.parametrize(
    ("change", "words"),
    [
        (lambda m: {n: a for n, a in m.items() if n != "updates"}, "has no updates"),
        (lambda m: {**m, "q_star": m["q_star"][:-1]}, "q_star is float64 of shape"),
        (lambda m: {**m, "q_star": m["q_star"] * np.nan}, "q_star has values that are"),
        (lambda m: {**m, "q_coord_values": np.zeros((0, 4))}, "q_coord_values is"),
    ],
)
def test_arrays_of_another_form_are_refused(change, words):
    scenario, rule, memory = learned("coop", q_star_init=100, ask_cost=0)
    with pytest.raises(TablesError, match=f"tables do not match robot 1.*{words}"):
        check_memory(scenario, rule, 0, change(memory))


def test_tables_of_a_learner_that_asks_are_not_of_one_that_does_not():
    scenario, _, memory = learned("coop")
    with pytest.raises(TablesError, match="q_star has values of coordinate"):
        check_memory(scenario, learner_of("noncoop"), 0, memory)


def test_joint_states_with_all_peers_are_not_those_with_one():
    scenario, rule, memory = learned(
        "coop", "crowd-3r", peers="all", q_star_init=100, ask_cost=0
    )
    with pytest.raises(TablesError, match="q_coord_keys are not those of joint states"):
        check_memory(scenario.with_settings({"peers": "one"}), rule, 0, memory)


@pytest.mark.parametrize(
    ("learner", "other"),
    [("coop", "voi"), ("voi", "coop"), ("noncoop", "voi"), ("voi", "noncoop")],
)
def test_tables_of_another_learner_are_refused(learner, other):
    scenario, _, memory = learned(learner)
    with pytest.raises(TablesError, match="tables do not match robot 1 of scenario"):
        check_memory(scenario, learner_of(other), 0, memory)
