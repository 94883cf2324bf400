# Copyright 2026 The sparse_coord_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The plain C loop learns the same bits."""

import shutil

import numpy as np
import pytest

from sparse_coord_ros.engine.batch import make_problem
from sparse_coord_ros.errors import RunError
from sparse_coord_ros.game.scenario import load_scenario
from sparse_coord_ros.learn.learners import learner_of
from sparse_coord_ros.learn.simulation import learn, tables_equal
from tools.c_loop import loop
from tools.c_loop.loop import CLoop, FactoredCLoop

needs_compiler = pytest.mark.skipif(shutil.which("cc") is None, reason="there is no C compiler")


@needs_compiler
@pytest.mark.parametrize(
    ("name", "settings"),
    [
        ("env1", {"steps": 3000}),
        ("env2-4r", {"steps": 2000}),
        (
            "env1",
            {
                "steps": 2000,
                "perception": "line_of_sight",
                "conflict": "any_doorway",
                "starts": "mixed:0.3",
                "step_size": "floored:0.6:0.2:0.01",
                "max_steps": 40,
            },
        ),
        ("env1", {"steps": 1500, "perception": "probability:0.7", "common_reward": "each:1:0.5"}),
    ],
)
def test_c_loop_learns_the_same_bits(name, settings):
    scenario = load_scenario(name).with_settings(settings)
    c_loop = CLoop(scenario)
    for seed in (0, 7):
        assert tables_equal(c_loop.learn(c_loop.sources(seed)), learn(scenario, "coop", seed))


@needs_compiler
@pytest.mark.parametrize(
    ("name", "settings", "learner"),
    [
        ("env1", {"steps": 2000}, "factored"),
        ("env2-4r", {"steps": 1200}, "tools.coordination.rules:FiveReplays"),
        ("env2-4r", {"steps": 1200}, "tools.coordination.rules:NoRightOfWay"),
        (
            "env2-4r",
            {"steps": 1200, "perception": "probability:0.7", "credit": "team", "referee": "off"},
            "factored",
        ),
        (
            "env2-2r",
            {"steps": 1500, "perception": "range:3", "conflict": "any_doorway"},
            "factored",
        ),
    ],
)
def test_the_c_loop_of_the_factored_learner_learns_the_same_bits(name, settings, learner):
    rule = learner_of(learner)
    scenario = rule.with_defaults(load_scenario(name).with_settings({"penalty": -50, **settings}))
    c_loop = FactoredCLoop(scenario, rule)
    assert tables_equal(c_loop.learn(c_loop.sources(7)), learn(scenario, rule, 7))


@needs_compiler
def test_the_c_loop_s_problem_is_the_engine_s(monkeypatch):
    scenario = load_scenario("env1").with_settings({"steps": 10})
    problem = make_problem(scenario, learner_of("coop"), np.arange(2))
    changed = problem._replace(goals=problem.goals[::-1], budget=7, move_success=0.5)
    monkeypatch.setattr(loop, "make_problem", lambda *_: changed)
    c_loop = CLoop(scenario)
    assert c_loop._arrays["goals"].tolist() == problem.goals[::-1].tolist()
    assert (c_loop._problem.budget, c_loop._problem.move_success) == (7, 0.5)


def test_compiler_that_fails(monkeypatch):
    monkeypatch.setattr(loop, "COMPILER", "false")
    with pytest.raises(RunError, match=r"false cannot compile .*loop.c: exit code 1$"):
        CLoop(load_scenario("env1"))
