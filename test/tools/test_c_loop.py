# Copyright 2026 The sparse_coord_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The plain C loop learns the same bits; its place beside the engine's figures."""

import json
import shutil
import time

import numpy as np
import pytest

from sparse_coord_ros.bench import batch
from sparse_coord_ros.compiling import has_numba
from sparse_coord_ros.engine.batch import make_problem
from sparse_coord_ros.errors import RunError
from sparse_coord_ros.game.scenario import load_scenario
from sparse_coord_ros.learn.learners import learner_of
from sparse_coord_ros.learn.simulation import learn, tables_equal
from tools.c_loop import loop
from tools.c_loop.__main__ import MEASURED, main
from tools.c_loop.loop import CLoop, FactoredCLoop

needs_compiler = pytest.mark.skipif(shutil.which("cc") is None, reason="there is no C compiler")
SHORT = ["--steps", "100", "--runs", "2", "--repeats", "1"]


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
def test_seeding_the_c_loop_is_on_the_clock_as_the_engine_s_is(monkeypatch):
    c_loop = CLoop(load_scenario("env1").with_settings({"steps": 10}))
    sources = c_loop.sources

    def slow(seed):
        time.sleep(0.1)
        return sources(seed)

    monkeypatch.setattr(c_loop, "sources", slow)
    assert c_loop.rate(3, 1) <= 3 * 2 * 10 / 0.3


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


@pytest.mark.long
@needs_compiler
@pytest.mark.skipif(not has_numba(), reason="numba is not installed")
def test_beside_the_engine(capsys):
    assert main([*SHORT, "--json"]) == 0
    data, *others = json.loads(capsys.readouterr().out)
    assert [one["learner"] for one in others] == [learner for _, learner, _ in MEASURED[1:]]
    medians = {(f["name"], f["threads"]): f["agent_steps_per_second"] for f in data["figures"]}
    cores = data["cores"]
    [engine], [c_loop] = medians[batch.ENGINE, cores], medians[CLoop.name, cores]
    assert data["engine_to_c"] == pytest.approx(engine / c_loop)
    assert set(medians) == {(n, k) for n in (batch.ENGINE, CLoop.name) for k in (cores, 1)} | {
        (batch.PYTHON, 1)
    }


def test_without_numba_and_compiler(capsys, monkeypatch):
    def measure(name, *, steps, runs, repeats, rivals, learner):
        return batch.measure_here(name, steps, runs, repeats, rivals, learner)

    monkeypatch.setattr(batch, "measure", measure)
    monkeypatch.setattr(batch, "has_numba", lambda: False)
    monkeypatch.setattr(loop, "COMPILER", "no_such_compiler")
    assert main(SHORT) == 0
    out = capsys.readouterr().out
    assert out.splitlines()[0].endswith("of the plain C loop")
    assert out.count("plain C loop: there is no C compiler (no_such_compiler)") == len(MEASURED)
    rows = [line for line in out.splitlines() if line.startswith("plain Python")]
    assert [row.split()[-1] for row in rows] == ["-"] * len(MEASURED)
    assert main(["--steps", "99"]) == 2
    assert "from 100 to" in capsys.readouterr().err
