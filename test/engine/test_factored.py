# Copyright 2026 The sparse_coord_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The factored learner compiled: the bits of its agents, whole, in parts and from files."""

import numpy as np
import pytest
from teams import in_parts, whole

from sparse_coord_ros.engine import batch
from sparse_coord_ros.engine.batch import CompiledTeam, run_batch
from sparse_coord_ros.engine.kernels import PLAIN
from sparse_coord_ros.game.scenario import load_scenario
from sparse_coord_ros.learn import factored
from sparse_coord_ros.engine.evaluation import play
from sparse_coord_ros.learn.factors import FactorRule
from sparse_coord_ros.learners.registry import Factored, learner_of
from sparse_coord_ros.learners.tables import tables_equal
from sparse_coord_ros.solve.exact import evaluate_exact

SETTINGS = {"steps": 1600, "max_steps": 30, "penalty": -50, "q_coord_init": 60}
CASES = [
    ("env1", {"perception": "probability:0.7", "common_reward": "each:1:0.5", "credit": "team"}),
    ("env2-2r", {"perception": "line_of_sight", "goal_value": 0, "step_size": "constant:0.2"}),
    ("env2-4r", {"perception": "range:4", "credit": "weight:2"}),
    ("env2-4r", {"referee": False, "starts": "fixed", "conflict": "any_doorway"}),
]


class NoReplays(Factored):
    factors = FactorRule(replays=0)


class Many(Factored):
    factors = FactorRule(percept_update=False, replays=3)


class Forward(Factored):
    factors = FactorRule(look_back=False)


class Polite(Factored):
    factors = FactorRule(right_of_way=False)


def problem(name, **settings):
    chosen = load_scenario(name).with_settings({"epsilon": "constant:0.5", **SETTINGS, **settings})
    return learner_of("factored").with_defaults(chosen)


@pytest.fixture(params=[factored.DENSE_ROWS, 0], ids=["dense", "sparse"])
def rho(request, monkeypatch):
    """How rho is kept: whole, or only the rows that were learned."""
    monkeypatch.setattr(factored, "DENSE_ROWS", request.param)


@pytest.mark.parametrize(("name", "settings"), CASES)
def test_compiled_loops_equal_the_agents(rho, name, settings):
    scenario = problem(name, **settings)
    expected = whole(scenario, "factored", 7)
    assert any((tables.factors.corrections < 0).any() for tables in expected.tables)
    team = CompiledTeam(scenario, "factored")
    run = team.run(7, 30, gathering=True)
    assert tables_equal(run.tables, expected.tables)
    assert tables_equal(team.run(7, 0).tables, expected.tables)
    assert run.history.same_bits(expected.history)
    assert np.array_equal(run.visited, expected.visited)
    for learner in ("factored", None):  # the tables say whose they are
        played = play(scenario, expected.tables, trials=30, seed=7, learner=learner)
        for mine, theirs in zip(vars(played).values(), vars(run.trials).values(), strict=True):
            assert mine.tobytes() == theirs.tobytes()


def test_failed_percepts_are_acted_on_in_trials_as_learned():
    scenario = problem("env1", perception="probability:0.5", ask_cost=0)
    learning = whole(scenario, "factored", 1)
    tables = [t._replace(q_star=t.q_star + [0, 0, 0, 0, 1000.0]) for t in learning.tables]
    played = play(scenario, tables, trials=40, seed=3)
    assert played.asks.sum() > 500
    team = CompiledTeam(scenario, "factored")
    learners = team.learn(1)
    learners.q_star[:, :, 4] += 1000.0
    assert played.reward.tobytes() == team.play(learners, 3, 40).reward.tobytes()


def test_exact_evaluation_knows_failed_percepts():
    scenario = problem("env1", perception="probability:0.5", ask_cost=0, credit="own")
    tables = whole(scenario, "factored", 2).tables
    tables = [t._replace(q_star=t.q_star + [0, 0, 0, 0, 1000.0]) for t in tables]
    exact = evaluate_exact(scenario, tables)
    trials = play(scenario, tables, trials=1500, seed=3).reward.mean(axis=1)
    assert abs(exact.reward.mean - trials.mean()) < 5 * trials.std() / len(trials) ** 0.5
    coop = [t._replace(factors=None) for t in tables]
    assert evaluate_exact(scenario, coop).reward.mean != exact.reward.mean


@pytest.mark.parametrize(
    ("learner", "name"),
    [(NoReplays, "env2-2r"), (Many, "env2-2r"), (Polite, "env2-4r")] + [(Forward, "env2-4r")],
)
def test_rules_with_a_part_turned_off(learner, name):
    scenario = problem(name, perception="probability:0.8")
    [run] = run_batch(scenario, learner, [4], trials=0, engine="numba", jobs=1)
    assert tables_equal(run.tables, whole(scenario, learner, 4).tables)
    assert not tables_equal(run.tables, whole(scenario, "factored", 4).tables)


@pytest.mark.parametrize(("name", "settings"), [CASES[0], CASES[2]])
def test_a_run_in_parts_through_files_is_the_unbroken_run(
    rho, monkeypatch, tmp_path, name, settings
):
    monkeypatch.setattr(batch, "BLOCK", 64)
    scenario, rule = problem(name, **settings), learner_of("factored")
    expected = whole(scenario, rule, 5)
    learning = in_parts(scenario, rule, 5, (1, 63, 64, 700, 1501, scenario.steps), tmp_path)
    assert tables_equal(learning.tables, expected.tables)
    assert learning.history.same_bits(expected.history)
    assert np.array_equal(learning.visited, expected.visited)


def test_the_loops_as_plain_python(monkeypatch):
    monkeypatch.setattr(batch, "BLOCK", 64)
    scenario = problem("env2-4r", steps=400, perception="probability:0.7")
    team = CompiledTeam(scenario, "factored", loops=PLAIN)
    assert tables_equal(team.tables(team.learn(3)), whole(scenario, "factored", 3).tables)
