# Copyright 2026 The sparse_coord_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Learners as objects: what each of them says of itself, and the user's own."""

import pytest

from sparse_coord_ros.engine.batch import run_batch
from sparse_coord_ros.engine.run import learn
from sparse_coord_ros.errors import PluginError, SettingError
from sparse_coord_ros.game.scenario import load_scenario
from sparse_coord_ros.game.world import SUM_OF_PARTS, RewardWeights
from sparse_coord_ros.learn.run_config import make_run, run_from_yaml
from sparse_coord_ros.learners.agent import Agent
from sparse_coord_ros.learners.learner import Learner
from sparse_coord_ros.learners.registry import LEARNERS, learner_of
from sparse_coord_ros.learners.tables import tables_equal

SHORT = {"steps": 3000, "penalty": -40}


class Heavy(Learner):
    """Weighs r^C five times."""

    title = "Heavy"

    def weights(self, scenario):
        return RewardWeights(1.0, 5.0, 1.0)


class Plain(Learner):
    """Algorithm 1 by agents of its own: it has no compiled form."""

    def agent(self, *arguments, **settings):
        return Slow(*arguments, **settings)


class Slow(Agent):
    """An agent that learns from nothing but penalties."""

    def learn(self, step, choice, reward, next_cell):
        if reward.common:
            super().learn(step, choice, reward, next_cell)


class Eager(Learner):
    """A learner with defaults of its own."""

    defaults = {"epsilon": "constant:0.5", "steps": 123}


@pytest.fixture(autouse=True)
def forget():
    """Forget what a test has registered."""
    before = dict(LEARNERS._known)
    yield
    LEARNERS._known.clear()
    LEARNERS._known.update(before)


def test_the_papers_three_and_the_factored_one():
    expected = {
        "coop": ("Coop.", True, False),
        "noncoop": ("Non-coop.", False, False),
        "indiv": ("Indiv.", False, True),
        "factored": ("Factored", True, False),
    }
    shipped = {name: LEARNERS.registered[name] for name in expected}  # tests register others
    assert expected == {n: (one.title, one.asks, one.alone) for n, one in shipped.items()}
    for name, one in shipped.items():
        assert one.label == name
        assert one.compiled
        assert one.weights(load_scenario("env1")) == SUM_OF_PARTS


@pytest.mark.parametrize("engine", ["numba", "python"])
def test_weights_count_in_every_engine(engine):
    scenario = load_scenario("env1").with_settings(SHORT)
    [run] = run_batch(scenario, Heavy, [3], trials=0, engine=engine, jobs=1)
    # r^C that weighs five times is a penalty that is five times as high.
    five = scenario.with_settings({"penalty": 5 * scenario.penalty})
    assert tables_equal(run.tables, learn(five, "coop", 3))
    assert not tables_equal(run.tables, learn(scenario, "coop", 3))


def test_a_learner_with_agents_of_its_own_is_never_compiled():
    scenario = load_scenario("env1").with_settings(SHORT)
    assert not Plain().compiled
    [run] = run_batch(scenario, Plain, [3], trials=5, jobs=1)
    assert tables_equal(run.tables, learn(scenario, Plain, 3))
    assert not tables_equal(run.tables, learn(scenario, "coop", 3))
    with pytest.raises(SettingError, match="no compiled form"):
        list(run_batch(scenario, Plain, [3], trials=0, engine="numba"))


def test_with_defaults_of_ones_own_that_fails():
    class Wrong(Learner):
        name = "wrong"

        def with_defaults(self, scenario):
            return 1 / 0 if scenario.penalty < -50 else None

    scenario = load_scenario("env1")
    with pytest.raises(SettingError, match="its with_defaults returned None, allowed: a Scenario"):
        Wrong().with_defaults(scenario)
    with pytest.raises(PluginError, match="failed while making its with_defaults: ZeroDivision"):
        Wrong().with_defaults(scenario.with_settings(penalty=-100))


def test_defaults_of_a_learner_hold_where_nobody_chose():
    scenario = load_scenario("env1").with_settings({"steps": 50})
    run = make_run(scenario, {"learner": learner_of(Eager)})
    assert (str(run.scenario.epsilon), run.scenario.steps) == ("constant:0.5", 50)
    assert "epsilon: constant:0.5" in run.to_yaml()
    assert str(make_run(scenario, {}).scenario.epsilon) == "linear:0.15:0.02:0.8"
    again = run_from_yaml(run.to_yaml().replace("constant:0.5", "constant:0.25"), where="here")
    assert str(again.scenario.epsilon) == "constant:0.25"
