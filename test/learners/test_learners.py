# Copyright 2026 The sparse_coord_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Learners as objects: what each of them says of itself, and the user's own."""

import pytest
from teams import by_agents, learn, memories_equal, tables_equal

from sparse_coord_ros.base.compiling import has_numba
from sparse_coord_ros.base.errors import PluginError, SettingError, SparseCoordError
from sparse_coord_ros.core.engine.batch import run_batch, uses_numba
from sparse_coord_ros.core.game.scenario import load_scenario
from sparse_coord_ros.core.game.world import RewardWeights
from sparse_coord_ros.core.learners.coop import Coop
from sparse_coord_ros.core.learners.registry import LEARNERS, learner_of
from sparse_coord_ros.core.learners.rules import NOT_PERCEIVED
from sparse_coord_ros.core.runs.run_config import make_run, run_from_yaml

SHORT = {"steps": 3000, "penalty": -40}

needs_numba = pytest.mark.skipif(not has_numba(), reason="numba is not installed")


class Heavy(Coop):
    """Weighs r^C five times."""

    def weights(self, scenario):
        return RewardWeights(1.0, 5.0, 1.0)


class Wordy(Coop):
    """It cannot be compiled: it makes a dictionary of texts."""

    @staticmethod
    def decide(mind, task, k, step, cell):
        return {str(step): 2}[str(step)]


class Eager(Coop):
    """A learner with defaults of its own."""

    defaults = {"epsilon": "constant:0.5", "steps": 123}


class Looks(Coop):
    """It notes the cells that it is given, in Q*."""

    @staticmethod
    def asking_values(mind, task, k, cell, seen, cells, values):
        for b in range(4):
            values[b] = cells[b % task.robots]

    @staticmethod
    def learn(mind, task, k, now, after):
        for j in range(task.robots):
            mind.q_star[k, now.cell, j] = now.cells[j]
            mind.q_star[k, now.next_cell, j] = now.next_cells[j]
            mind.updates[k, now.cell, j] += 1


def test_the_papers_three_and_ours():
    expected = {
        "coop": (True, False),
        "noncoop": (False, False),
        "indiv": (False, True),
        "voi": (True, False),
    }
    # tests register others
    shipped = {name: LEARNERS.registered[name] for name in expected}
    assert expected == {n: (one.asks, one.alone) for n, one in shipped.items()}
    for name, one in shipped.items():
        assert one.label == name
        assert one.weights(load_scenario("env1")) == RewardWeights(1, 1, 1)


@pytest.mark.parametrize("seen", ["when_asked", "while_learning"])
def test_cells_that_a_robot_does_not_see_are_unknown_in_loops_as_in_nodes(seen):
    settings = {"perception": "probability:0.5", "peers_seen": seen, "peers": "all"}
    scenario = load_scenario("crowd-3r", steps=200).with_settings(settings)
    memories, _ = by_agents(scenario, Looks(), 5)
    for one, memory in zip(learn(scenario, Looks(), 5), memories, strict=True):
        assert memories_equal(one.memory, memory)
        unknown = (memory["q_star"] == NOT_PERCEIVED).any()
        assert unknown == (seen == "when_asked")


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
    assert "numba cannot compile it (its decide, line " in said
    [run] = run_batch(scenario, rule, [3], trials=5, jobs=1)
    assert run.engine == "python"
    assert capsys.readouterr().err == "", "it says so once"
    with pytest.raises(SettingError, match="setting engine: value is 'numba', but"):
        list(run_batch(scenario, rule, [3], trials=0, engine="numba"))


def test_with_defaults_of_ones_own_that_fails():
    class Wrong(Coop):
        name = "wrong"

        def with_defaults(self, scenario):
            return 1 / 0 if scenario.penalty < -50 else None

    scenario = load_scenario("env1", penalty=-20)
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


@pytest.mark.parametrize(
    ("name", "settings", "weight"),
    [
        ("env1", {}, 1),
        ("env1", {"credit": "team"}, 2),
        ("env2-4r", {"credit": "team"}, 4),
        ("env2-4r", {"credit": "team", "common_reward": "each:1:0:2:1"}, 3),
        ("env2-4r", {"credit": "weight:2.5"}, 2.5),
        ("env2-4r", {"credit": "weight:0"}, 0),
    ],
)
@pytest.mark.parametrize("learner", ["coop", "noncoop", "voi"])
def test_credit_of_every_learner(name, settings, weight, learner):
    chosen = load_scenario(name).with_settings(settings)
    assert learner_of(learner).weights(chosen) == RewardWeights(1.0, weight, 1.0)


class NoAction(Coop):
    """Its decide returns nothing."""

    @staticmethod
    def decide(mind, task, k, step, cell):
        pass


class NoNumber(Coop):
    """Its bootstrap returns a row."""

    @staticmethod
    def bootstrap(mind, task, k, cell, now):
        return mind.q_star[k, cell]


class NoShape(Coop):
    """Its initial returns a row too few."""

    @staticmethod
    def initial(scenario, robot):
        mind = Coop.initial(scenario, robot)
        return mind._replace(q_star=mind.q_star[1:])


@pytest.mark.parametrize(
    ("learner", "words"),
    [
        (NoAction, "decide returned None, allowed: an action, 0 to 4"),
        (NoNumber, "bootstrap returned array"),
        (NoShape, "initial returned q_star of shape (20, 5)"),
    ],
)
def test_a_hook_that_returns_what_it_must_not_is_named(learner, words):
    scenario = load_scenario("env1").with_settings(SHORT)
    with pytest.raises(SparseCoordError) as refused:
        list(run_batch(scenario, learner, [3], trials=0, engine="python"))
    assert words in str(refused.value) and "\n" not in str(refused.value)
