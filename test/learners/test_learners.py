# Copyright 2026 The sparse_coord_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Learners as objects: what each of them says of itself, and the user's own."""

import inspect

import numpy as np
import pytest
from teams import tables_equal

import sparse_coord_ros as sc
from sparse_coord_ros.base.compiling import has_numba
from sparse_coord_ros.base.errors import PluginError, SettingError
from sparse_coord_ros.core.engine import batch
from sparse_coord_ros.core.engine.batch import run_batch, uses_numba
from sparse_coord_ros.core.game.scenario import load_scenario
from sparse_coord_ros.core.game.world import RewardWeights
from sparse_coord_ros.core.learners.agent import Agent, Decision
from sparse_coord_ros.core.learners.coop import Coop
from sparse_coord_ros.core.learners.learner import HOOKS, Learner
from sparse_coord_ros.core.learners.registry import LEARNERS, learner_of
from sparse_coord_ros.core.runs.run import learn
from sparse_coord_ros.core.runs.run_config import make_run, run_from_yaml

SHORT = {"steps": 3000, "penalty": -40}

needs_numba = pytest.mark.skipif(not has_numba(), reason="numba is not installed")


class Heavy(Coop):
    """Weighs r^C five times."""

    title = "Heavy"

    def weights(self, scenario):
        return RewardWeights(1.0, 5.0, 1.0)


class Wordy(Coop):
    """It cannot be compiled: it makes a dictionary of texts."""

    @staticmethod
    def bootstrap(mind, task, k, cell, now):
        values = sorted(map(float, mind.q_star[k, cell]), key=str)
        return {"best": min(values)}["best"]


class Eager(Coop):
    """A learner with defaults of its own."""

    defaults = {"epsilon": "constant:0.5", "steps": 123}


class Strange(Coop):
    """It chooses an action that no robot has."""

    @staticmethod
    def decide(mind, task, k, step, cell):
        return 4 if step < 3 else 700


class Stray(Coop):
    """It moves in a direction that no robot has."""

    @staticmethod
    def decide(mind, task, k, step, cell):
        return 4

    @staticmethod
    def move_after_asking(mind, task, k, step, cell, seen, cells, values):
        return 4


def test_the_papers_three_and_the_factored_one():
    expected = {
        "coop": ("Coop.", True, False),
        "noncoop": ("Non-coop.", False, False),
        "indiv": ("Indiv.", False, True),
        "factored": ("Factored", True, False),
    }
    # tests register others
    shipped = {name: LEARNERS.registered[name] for name in expected}
    assert expected == {
        n: (one.title, one.asks, one.alone) for n, one in shipped.items()
    }
    for name, one in shipped.items():
        assert one.label == name
        assert one.weights(load_scenario("env1")) == RewardWeights(1, 1, 1)


@pytest.mark.parametrize("engine", [pytest.param("numba", marks=needs_numba), "python"])
def test_weights_count_in_every_engine(engine):
    scenario = load_scenario("env1").with_settings(SHORT)
    [run] = run_batch(scenario, Heavy, [3], trials=0, engine=engine, jobs=1)
    # r^C that weighs five times is a penalty that is five times as high.
    five = scenario.with_settings({"penalty": 5 * scenario.penalty})
    assert tables_equal(run.tables, learn(five, "coop", 3))
    assert not tables_equal(run.tables, learn(scenario, "coop", 3))


@needs_numba
def test_a_learner_that_cannot_be_compiled_runs_in_plain_python(capsys):
    scenario = load_scenario("env1").with_settings(SHORT)
    rule = learner_of(Wordy)
    assert not uses_numba("auto", rule)
    said = capsys.readouterr().err.splitlines()[-1]
    assert f"learner {rule.label}: runs in plain Python" in said
    assert "numba cannot compile it" in said
    [run] = run_batch(scenario, rule, [3], trials=5, jobs=1)
    assert run.engine == "python"
    assert capsys.readouterr().err == "", "it says so once"
    with pytest.raises(SettingError, match="setting engine: value is 'numba', but"):
        list(run_batch(scenario, rule, [3], trials=0, engine="numba"))


# A learner is its hooks: what would never be called is refused.


@pytest.mark.parametrize("name", ["choose", "epsilon", "lern", "memory"])
@pytest.mark.parametrize(
    "value", [lambda mind, task, k: 0, 0.3], ids=["method", "attribute"]
)
def test_what_no_learner_has_is_refused_with_the_names_of_the_hooks(name, value):
    with pytest.raises(TypeError) as error:
        type("Mine", (Coop,), {name: value})
    message = str(error.value)
    assert message.startswith(f"class Mine: {name!r} is nothing that a learner has")
    assert ", ".join(HOOKS) in message and "\n" not in message


def test_what_begins_with_an_underscore_is_ones_own():
    class Mine(Coop):
        name = "mine_of_tests"
        _share = 0.5

        def _weight(self):
            return self._share

        def weights(self, scenario):
            return RewardWeights(1.0, self._weight(), 1.0)

    weights = sc.register_learner(Mine).weights(load_scenario("env1"))
    assert weights.common == 0.5


@pytest.mark.parametrize("hook", HOOKS)
def test_a_hook_with_other_parameters_is_refused_with_the_right_ones(hook):
    right = list(inspect.signature(getattr(Learner, hook)).parameters)
    turned = right[1::-1] + right[2:]
    for wrong in (["self", *right], right[:-1], turned):
        function = eval(f"lambda {', '.join(wrong)}: 0")
        with pytest.raises(TypeError) as error:
            type("Mine", (Coop,), {hook: staticmethod(function)})
        assert str(error.value) == (
            f"class Mine: {hook} takes ({', '.join(wrong)}), allowed: "
            f"({', '.join(right)})"
        )


@pytest.mark.parametrize(
    "value", [3, None, classmethod(lambda cls, scenario, robot: 0)]
)
def test_a_hook_is_a_plain_function(value):
    with pytest.raises(TypeError, match=r"no plain function; allowed: \(scenario, ro"):
        type("Mine", (Coop,), {"initial": value})


class FirstMove:
    """A way to choose, for several learners."""

    @staticmethod
    def decide(mind, task, k, step, cell):
        return 0


class CoopFirst(FirstMove, Coop):
    pass


def test_a_hook_may_be_of_a_class_that_is_no_learner():
    rule = learner_of(CoopFirst)
    assert rule.rule is CoopFirst
    scenario = load_scenario("env1", steps=100)
    updates = learn(scenario, rule, 1)[0].memory["updates"]
    assert updates[:, 0].sum() > 0 and not updates[:, 1:].any()
    with pytest.raises(TypeError, match="class Mine: 'lern' is nothing"):
        type("Mine", (type("Others", (), {"lern": 0}), Coop), {})


@pytest.mark.parametrize(
    ("name", "value", "words"),
    [
        ("epsilon", 0.3, "'epsilon' is nothing that a learner has"),
        ("decide", lambda *_: 0, "decide was set in an instance; set it in the class"),
        ("partners", True, "partners was set in an instance"),
    ],
)
def test_an_instance_has_nothing_that_its_loop_would_not_use(name, value, words):
    class Mine(Coop):
        def __init__(self):
            self.name = "mine_of_tests"
            setattr(self, name, value)

    for use in (learner_of, sc.register_learner):
        with pytest.raises(SettingError, match=f"class Mine: {words}"):
            use(Mine)


@pytest.mark.parametrize("learner", [Strange, Stray])
@pytest.mark.parametrize("engine", [pytest.param("numba", marks=needs_numba), "python"])
def test_an_action_that_does_not_exist_is_refused(learner, engine, monkeypatch):
    """A compiled loop would write beside its arrays."""
    # the learner fails already where it is compiled
    monkeypatch.setattr(batch, "_compiles", lambda rule: True)
    monkeypatch.setattr(batch, "prepare", lambda rule: None)
    scenario = load_scenario("env1", steps=100)
    with pytest.raises(PluginError, match="it chose an action that it does not have"):
        list(run_batch(scenario, learner, [3], trials=0, engine=engine))


def test_an_agent_refuses_an_action_that_does_not_exist():
    scenario = load_scenario("env1")
    with pytest.raises(PluginError, match="while deciding: .*chose an action"):
        Agent(learner_of(Strange), scenario, 0, 1).decide(5, 2)
    with pytest.raises(PluginError, match="while acting: .*chose an action"):
        Agent(learner_of(Stray), scenario, 0, 1).act(5, 2, Decision(4, (1,)), None)


@pytest.mark.parametrize("made", [None, {"q_star": np.zeros((21, 5))}, ()])
def test_a_learner_begins_with_its_mind(made):
    class Mine(Coop):
        name = "mine_of_tests"

        @staticmethod
        def initial(scenario, robot):
            return made

    with pytest.raises(PluginError, match="initial returned .*, allowed: .* Mind"):
        learn(load_scenario("env1", steps=9), sc.register_learner(Mine), 1)


# Settings.


def test_with_defaults_of_ones_own_that_fails():
    class Wrong(Coop):
        name = "wrong"

        def with_defaults(self, scenario):
            return 1 / 0 if scenario.penalty < -50 else None

    scenario = load_scenario("env1")
    with pytest.raises(SettingError, match="with_defaults returned None"):
        Wrong().with_defaults(scenario)
    with pytest.raises(PluginError, match="with_defaults: ZeroDivision"):
        Wrong().with_defaults(scenario.with_settings(penalty=-100))


def test_defaults_of_a_learner_hold_where_nobody_chose():
    scenario = load_scenario("env1").with_settings({"steps": 50})
    run = make_run(scenario, {"learner": learner_of(Eager)})
    assert (str(run.scenario.epsilon), run.scenario.steps) == ("constant:0.5", 50)
    assert "epsilon: constant:0.5" in run.to_yaml()
    assert str(make_run(scenario, {}).scenario.epsilon) == "linear:0.15:0.02:0.8"
    again = run_from_yaml(
        run.to_yaml().replace("constant:0.5", "constant:0.25"), where="here"
    )
    assert str(again.scenario.epsilon) == "constant:0.25"
