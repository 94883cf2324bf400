# Copyright 2026 The sparse_coord_ros authors
# SPDX-License-Identifier: Apache-2.0
"""`sparse_coord bench`: the C loop learns the same bits; tables, JSON, what is missing."""

import json
import shutil
import sys
import time

import numpy as np
import pytest

import sparse_coord_ros.bench as package
from sparse_coord_ros.bench import batch
from sparse_coord_ros.cli import bench
from sparse_coord_ros.core.learners import learner_of
from sparse_coord_ros.core.scenario import load_scenario
from sparse_coord_ros.core.simulation import learn, tables_equal
from sparse_coord_ros.engine.batch import make_problem
from sparse_coord_ros.engine.compiled import has_numba
from sparse_coord_ros.errors import RunError

needs_compiler = pytest.mark.skipif(shutil.which("cc") is None, reason="there is no C compiler")
SHORT = ("--steps", 100, "--runs", 2, "--repeats", 1)


@pytest.fixture
def in_this_process(monkeypatch):
    """Measure batches here, where tests can change things, and without compiling numba's loops."""

    def measure(name, *, steps, runs, repeats):
        return batch._measure(name, steps, runs, repeats)

    monkeypatch.setattr(batch, "measure", measure)
    monkeypatch.setattr(batch, "has_numba", lambda: False)


@pytest.fixture
def live(monkeypatch):
    """Replace the live measurement by known figures."""
    names = [
        f"{where}, {what}"
        for where in ("one process", "processes")
        for what in ("bare rclpy nodes", "learning", "learning and recording")
    ]
    found = {name: [100.0 * (i + 1), 300.0] for i, name in enumerate(names)}
    monkeypatch.setattr(bench, "_measure_live", lambda steps, repeats: (found, 240 * steps))
    return found


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
    loop = batch.CLoop(scenario)
    for seed in (0, 7):
        assert tables_equal(loop.learn(loop.sources(seed)), learn(scenario, "coop", seed))


@needs_compiler
def test_seeding_the_c_loop_is_on_the_clock_as_the_engine_s_is(monkeypatch):
    loop = batch.CLoop(load_scenario("env1").with_settings({"steps": 10}))
    sources = loop.sources

    def slow(seed):
        time.sleep(0.1)
        return sources(seed)

    monkeypatch.setattr(loop, "sources", slow)
    assert batch._c_rate(loop, 3, 1) <= 3 * 2 * 10 / 0.3


@needs_compiler
def test_the_c_loop_s_problem_is_the_engine_s(monkeypatch):
    scenario = load_scenario("env1").with_settings({"steps": 10})
    problem = make_problem(scenario, learner_of("coop"), np.arange(2))
    changed = problem._replace(goals=problem.goals[::-1], budget=7, move_success=0.5)
    monkeypatch.setattr(batch, "make_problem", lambda *_: changed)
    loop = batch.CLoop(scenario)
    assert loop._arrays["goals"].tolist() == problem.goals[::-1].tolist()
    assert (loop._problem.budget, loop._problem.move_success) == (7, 0.5)


def test_compiler_that_fails(monkeypatch):
    monkeypatch.setattr(batch, "COMPILER", "false")
    with pytest.raises(RunError, match=r"false cannot compile .*loop.c: exit code 1$"):
        batch.CLoop(load_scenario("env1"))


@needs_compiler
@pytest.mark.skipif(not has_numba(), reason="numba is not installed")
def test_batch_in_its_own_process(sparse_coord):
    code, out, err = sparse_coord("bench", "batch", *SHORT, "--json")
    data = json.loads(out)
    assert (code, err, data["steps"]) == (0, "", 100)
    assert "steps_per_second" not in data
    found = data["batch"]
    assert found["compile_seconds"] > 0
    assert 10e6 < found["peak_memory"] < 10e9
    assert found["engine_to_c"] > 0
    names = {figure["name"] for figure in found["figures"]}
    assert names == {batch.ENGINE, batch.C_LOOP, batch.PYTHON}
    for figure in found["figures"]:
        assert figure["missing"] == ""
        assert len(figure["agent_steps_per_second"]) == 1
        assert figure["agent_steps_per_second"][0] > 0


def test_batch_without_numba_and_compiler(sparse_coord, in_this_process, monkeypatch):
    monkeypatch.setattr(batch, "COMPILER", "no_such_compiler")
    code, out, err = sparse_coord("bench", "batch", *SHORT)
    assert (code, err) == (0, "")
    assert "env1, Coop., 2 runs of 100 steps" in out
    assert out.count("engine (numba): numba is not installed\n") == 1
    assert out.count("plain C loop: there is no C compiler (no_such_compiler)") == 1
    (row,) = [line for line in out.splitlines() if line.startswith("plain Python")]
    assert row.split()[-1] == "-"
    assert "peak memory" not in out
    data = json.loads(sparse_coord("bench", "batch", *SHORT, "--json")[1])["batch"]
    assert data["engine_to_c"] is data["compile_seconds"] is data["peak_memory"] is None


def test_all_prints_both_tables(sparse_coord, live, in_this_process):
    code, out, err = sparse_coord("bench", *SHORT)
    assert (code, err) == (0, "")
    first, second = out.split("\n\n")
    assert "of bare nodes" in first
    assert "processes, learning" in first
    assert "M agent-steps/s" in second
    data = json.loads(sparse_coord("bench", *SHORT, "--json")[1])
    assert data["steps_per_second"] == live
    assert set(data) == {"scenario", "steps", "steps_per_second", "bag_bytes", "batch"}


def test_live_only(sparse_coord, live, monkeypatch):
    monkeypatch.setattr(batch, "measure", None)
    code, out, err = sparse_coord("bench", "live")
    assert (code, err) == (0, "")
    assert "M agent-steps/s" not in out
    last = out.splitlines()[-1]  # medians are (100 i + 300) / 2 with i from 1
    assert last.startswith("with recording 120% of the speed without in one process, 112% in many")
    assert last.endswith("240 bytes a time step")


def test_live_without_ros(refused, monkeypatch):
    monkeypatch.setitem(sys.modules, "sparse_coord_ros.bench.ceiling", None)
    monkeypatch.delattr(package, "ceiling", raising=False)
    message = refused("bench", "live")
    assert "ROS 2 is not there" in message
    assert "sparse_coord bench batch" in message


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (["--steps", "99"], ["steps", "from 100 to"]),
        (["batch", "--runs", "0"], ["runs", "from 1 to"]),
        (["live", "--repeats", "many"], ["repeats", "'many'"]),
    ],
)
def test_bad_input(refused, arguments, words):
    message = refused("bench", *arguments)
    assert [word for word in words if word not in message] == []
