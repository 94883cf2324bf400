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
from tools.c_loop.loop import CLoop

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
