# Copyright 2026 The sparse_coord_ros authors
# SPDX-License-Identifier: Apache-2.0
"""What is no hook of a learner is refused: it would change nothing, and nobody would know."""

import inspect

import numpy as np
import pytest
from teams import learn

import sparse_coord_ros as sc
from sparse_coord_ros.base.compiling import has_numba
from sparse_coord_ros.base.errors import PluginError, SettingError
from sparse_coord_ros.cli.main import main
from sparse_coord_ros.core.engine.batch import run_batch
from sparse_coord_ros.core.game.scenario import load_scenario
from sparse_coord_ros.core.game.world import RewardWeights
from sparse_coord_ros.core.learners.agent import Agent, Decision
from sparse_coord_ros.core.learners.coop import Coop
from sparse_coord_ros.core.learners.learner import HOOKS, Learner
from sparse_coord_ros.core.learners.registry import learner_of


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


def test_a_hook_draws_no_random_numbers_of_its_own():
    """They would differ from run to run."""
    with pytest.raises(TypeError, match="decide uses random, allowed: sc.rules.draw"):

        class Mine(Coop):
            @staticmethod
            def decide(mind, task, k, step, cell):
                return int(np.random.randint(4))


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


MISTAKES = {
    "lern(mind, task, k, now, after)": "'lern' is nothing that a learner has (did you mean "
    "'learn'?); its functions are initial, informed, begin_episode, decide,",
    "learn(mind, task, now, after)": "learn takes (mind, task, now, after), allowed: (mind, task, "
    "k, now, after)",
}


@pytest.mark.parametrize("signature", MISTAKES)
def test_in_one_line_on_the_command_line(tmp_path, monkeypatch, capsys, signature):
    (tmp_path / "mistaken.py").write_text(
        "import sparse_coord_ros as sc\n"
        "class Mine(sc.Coop):\n"
        "    @staticmethod\n"
        f"    def {signature}:\n"
        "        mind.q_star[k, now.cell, now.action] = 0\n"
    )
    monkeypatch.chdir(tmp_path)
    for verb in ("train", "run"):
        assert main([verb, "env1", "--learner", "mistaken:Mine", "--steps", "100"]) == 2
        said = capsys.readouterr().err
        assert said.startswith("error: learner 'mistaken:Mine': its module failed: ")
        assert f"class Mine: {MISTAKES[signature]}" in said
        assert "(mistaken.py, line 2)" in said
        assert said.count("\n") == 1


# What hooks return.


class Strange(Coop):
    """It chooses an action that no robot has, but not in the step in which it is compiled."""

    @staticmethod
    def decide(mind, task, k, step, cell):
        return 4 if step < 3 else 700


class Stray(Coop):
    """It moves in a direction that no robot has, likewise."""

    @staticmethod
    def decide(mind, task, k, step, cell):
        return 4

    @staticmethod
    def move_after_asking(mind, task, k, step, cell, seen, cells, values):
        return 0 if step < 3 else 4


class Beside(Coop):
    """It counts beside its arrays, likewise."""

    @staticmethod
    def decide(mind, task, k, step, cell):
        mind.updates[k, cell, 0 if step < 3 else 5] += 1
        return 0


NO_ACTION = "it chose an action that it does not have"

needs_numba = pytest.mark.skipif(not has_numba(), reason="numba is not installed")


BESIDE = [(Strange, NO_ACTION), (Stray, NO_ACTION), (Beside, "IndexError: ind")]
COMPILED = [
    pytest.param(*one, "numba", marks=[needs_numba, pytest.mark.long]) for one in BESIDE
]


@pytest.mark.parametrize(
    ("learner", "words", "engine"),
    [*((*one, "python") for one in BESIDE), *COMPILED],
)
def test_nothing_is_written_beside_arrays(learner, words, engine):
    scenario = load_scenario("env1", steps=100)
    with pytest.raises(PluginError, match=words):
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
