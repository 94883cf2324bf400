# Copyright 2026 The sparse_coord_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Learners of later papers, compiled: the bits of their agents, whole, in parts and from files."""

import numpy as np
import pytest
from teams import drawn

from sparse_coord_ros.engine import batch
from sparse_coord_ros.engine.batch import CompiledLearning, CompiledTeam
from sparse_coord_ros.engine.kernels import PLAIN
from sparse_coord_ros.learn.checkpoint import Checkpoint, load_checkpoint
from sparse_coord_ros.learn.evaluation import play
from sparse_coord_ros.learn.learners import learner_of
from sparse_coord_ros.learn.simulation import Learning, tables_equal
from sparse_coord_ros.solve.exact import evaluate_exact

SETTINGS = {"steps": 1500, "max_steps": 30, "penalty": -50, "epsilon": "constant:0.3"}
CASES = [
    {"perception": "probability:0.7", "common_reward": "each:1:0.5", "credit": "team"},
    {"goal_value": 0, "step_size": "constant:0.2", "ask_cost": 0},
    {"robots": {"a": (1, 2), "b": (2, 1), "c": (1, 2)}, "link": "bursts:0.1:0.2"},
]
LIVE = ("cq", "fcq")


def problem(**settings):
    return drawn("1.D.2", **{**SETTINGS, **settings})


def whole(scenario, learner, seed):
    learning = Learning(scenario, learner, seed)
    learning.advance(scenario.steps)
    return learning


@pytest.mark.parametrize("learner", LIVE)
@pytest.mark.parametrize("settings", CASES)
def test_compiled_loops_equal_the_agents(learner, settings):
    scenario = problem(**settings)
    expected = whole(scenario, learner, 7)
    assert all(expected.visited > 0), "joint states were marked, and learned"
    run = CompiledTeam(scenario, learner).run(7, 30, gathering=True)
    assert tables_equal(run.tables, expected.tables)
    assert run.history.same_bits(expected.history)
    assert np.array_equal(run.visited, expected.visited)
    for who in (learner, None):  # their tables are acted on as Algorithm 1's
        played = play(scenario, expected.tables, trials=30, seed=7, learner=who)
        for mine, theirs in zip(vars(played).values(), vars(run.trials).values(), strict=True):
            assert mine.tobytes() == theirs.tobytes()


@pytest.mark.parametrize("learner", LIVE)
def test_a_run_in_parts_through_files_is_the_unbroken_run(monkeypatch, tmp_path, learner):
    monkeypatch.setattr(batch, "BLOCK", 64)
    scenario, rule = problem(perception="probability:0.8"), learner_of(learner)
    expected = whole(scenario, rule, 5)
    team = CompiledTeam(scenario, rule)
    learning = CompiledLearning(team, 5)
    for part, until in enumerate((1, 63, 64, 901, scenario.steps)):
        learning.advance(until)
        path = tmp_path / f"{part}.npz"
        Checkpoint(learning.state(), (), 0, 0).save(path, scenario, rule, 5)
        state = load_checkpoint(path, scenario, rule, 5).state
        plain = part % 2 == 0
        learning = (Learning if plain else CompiledLearning)(
            *((scenario, rule) if plain else (team,)), 5, state
        )
    assert tables_equal(learning.tables, expected.tables)
    assert learning.history.same_bits(expected.history)


@pytest.mark.parametrize("learner", LIVE)
def test_the_loops_as_plain_python(learner):
    scenario = problem()
    team = CompiledTeam(scenario, learner, loops=PLAIN)
    assert tables_equal(team.tables(team.learn(3)), whole(scenario, learner, 3).tables)


@pytest.mark.parametrize("learner", LIVE)
def test_exact_evaluation(learner):
    scenario = problem(perception="probability:0.5")
    tables = whole(scenario, learner, 1).tables
    exact = evaluate_exact(scenario, tables, learner=learner)
    assert exact.asks.mean > 0.1
    trials = play(scenario, tables, trials=1500, seed=3).reward.mean(axis=1)
    assert abs(exact.reward.mean - trials.mean()) < 5 * trials.std() / len(trials) ** 0.5
