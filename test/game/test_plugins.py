# Copyright 2026 The sparse_coord_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Learners and perception models of the user's own: how they are found, named and blamed."""

import sys

import numpy as np
import pytest
from teams import learn, tables_equal

import sparse_coord_ros as sc
from sparse_coord_ros.base.errors import PluginError
from sparse_coord_ros.core.engine.batch import run_batch
from sparse_coord_ros.core.game import plugins
from sparse_coord_ros.core.game.perception import MODELS
from sparse_coord_ros.core.learners.registry import LEARNERS, learner_of
from sparse_coord_ros.core.runs.run_config import make_run, run_from_yaml

MODULE = """
import numpy as np
import sparse_coord_ros as sc

coop_learn = sc.Coop.learn

class Team(sc.Coop):
    name = "team_of_tests"
    def weights(self, scenario):
        return 1, len(scenario.robots), 1

class Heir(Team):
    pass

class Parts:
    class Inner(sc.Coop):
        pass

class Twice(sc.Coop):
    @staticmethod
    def learn(mind, task, k, now, after):
        coop_learn(mind, task, k, now, after)
        coop_learn(mind, task, k, now, after)

class Broken(sc.Coop):
    @staticmethod
    def learn(mind, task, k, now, after):
        if now.step > 20:
            return {}["learned"]

class Weightless(sc.Coop):
    def weights(self, scenario):
        return {"common": 2}

class Empty(sc.Coop):
    @staticmethod
    def initial(scenario, robot):
        pass

class Odd(sc.Coop):
    @staticmethod
    def initial(scenario, robot):
        return scenario.no_such_setting

class Valueless(sc.Coop):
    @staticmethod
    def bootstrap(mind, task, k, cell, now):
        pass

class Needy(sc.Coop):
    def __init__(self, more):
        self._more = more

class Unchecked(sc.Coop):
    def check(self, scenario):
        return scenario["steps"]

class NoLearner:
    def __init__(self):
        raise SystemExit("made although it is no learner")

@sc.perception_model
def fog(grid, p):
    return np.full((len(grid.cells),) * 2, p)

@sc.perception_model
def divide(grid):
    return fog(grid, 1 / 0)

@sc.perception_model
def flat(grid):
    return np.ones(len(grid.cells))

sc.register_learner(Team)
sc.register_perception("fog_of_tests", fog)
number = 7
"""


def line(text):
    """Return where a text stands in the module."""
    return f"(their_code.py, line {MODULE[: MODULE.index(text)].count(chr(10)) + 1})"


@pytest.fixture
def module(tmp_path, monkeypatch):
    """Name of a module with code of the user's own, in the current directory."""
    monkeypatch.chdir(tmp_path)
    (tmp_path / "their_code.py").write_text(MODULE)
    (tmp_path / "their_package").mkdir()
    (tmp_path / "their_package/within.py").write_text(
        MODULE.replace("_of_tests", "_within")
    )
    plugins.allow_modules("their_code their_package their_fault nowhere")
    yield "their_code"
    for name in ("their_code", "their_package", "their_package.within"):
        sys.modules.pop(name, None)


@pytest.fixture
def small():
    return sc.load_scenario("env1", steps=60)


def refusal(function, *arguments, **more):
    """Return the one line with which a call is refused."""
    with pytest.raises(sc.SparseCoordError) as caught:
        function(*arguments, **more)
    assert "\n" not in str(caught.value)
    return str(caught.value)


def test_whoever_reads_a_run_later_finds_its_learner_and_its_model(module, small):
    learner = learner_of(f"{module}:Team")
    assert learner is learner_of("their_code:Team")
    assert type(learner) is type(learner_of("team_of_tests"))
    scenario = small.with_settings(perception="fog_of_tests:0.5")
    run = make_run(scenario, {"learner": "team_of_tests"})
    assert (run.learner, str(scenario.perception)) == (
        "their_code:Team",
        "their_code:fog:0.5",
    )
    assert scenario == small.with_settings(perception="their_code:fog:0.50")
    again = run_from_yaml(run.to_yaml(), where="run.yaml")
    assert again.scenario == scenario
    assert again.rule.weights(scenario) == (1, 2, 1)


def test_names_are_not_inherited(module, small):
    heir = learner_of(f"{module}:Heir")
    parent = learner_of(f"{module}:Team")
    assert (heir.label, heir.name) == ("their_code:Heir", None)
    assert heir.weights(small) == parent.weights(small)

    class Mine(type(learner_of("coop"))):
        pass

    message = refusal(learner_of, Mine)
    assert "Mine: other processes cannot find it" in message
    Mine.name = "mine_of_tests"
    assert learner_of(Mine).label == "mine_of_tests"
    assert make_run(small, {"learner": "mine_of_tests"}).learner == "mine_of_tests"


@pytest.mark.parametrize(
    "path", ["their_package.within:Team", "their_code:Parts.Inner"]
)
def test_a_path_may_have_dots(module, path):
    assert learner_of(path).label == path


@pytest.mark.parametrize(
    ("name", "words"),
    [
        (
            "nowhere:Team",
            ["learner 'nowhere:Team' was not found", "nowhere", "PYTHONPATH"],
        ),
        ("their_code:Missing", ["was not found", "Missing"]),
        ("their_code:NoLearner", ["'their_code:NoLearner': is no learner", "subclass"]),
        ("their_code:number", ["is no learner"]),
        ("their code:Team", ["unknown learner", "coop, noncoop, indiv"]),
        ("team", ["unknown learner 'team'"]),
    ],
)
def test_what_is_no_learner_is_said_in_one_line(module, name, words):
    message = refusal(learner_of, name)
    assert [word for word in words if word not in message] == []


@pytest.mark.parametrize(
    ("code", "words"),
    [
        ("class Team(:\n", "SyntaxError: invalid syntax (their_fault.py, line 1)"),
        ("\n1 / 0\n", "ZeroDivisionError: division by zero (their_fault.py, line 2)"),
        (
            "import nowhere",
            "ModuleNotFoundError: No module named 'nowhere' (their_fault.py, line",
        ),
    ],
)
def test_a_module_that_fails_is_blamed(module, tmp_path, code, words):
    (tmp_path / "their_fault.py").write_text(code)
    message = refusal(learner_of, "their_fault:Team")
    assert message.startswith(f"learner 'their_fault:Team': its module failed: {words}")
    assert message.endswith("; mend it, and call again")
    assert "learner 'their_package.no:Team' was not found" in refusal(
        learner_of, "their_package.no:Team"
    )


SETTING = "perception: their_code:fog:0.5"


def foreign_scenario(folder):
    """Return the path of a scenario file that names a foreign perception model."""
    text = "map: env1\nrobots:\n  robot_1: {start: [0, 0], goal: [0, 4]}\n"
    (folder / "foreign.yaml").write_text(
        f"{text}  robot_2: {{start: [0, 4], goal: [0, 0]}}\n{SETTING}\n"
    )
    return folder / "foreign.yaml"


@pytest.mark.parametrize(
    ("allowed", "name"),
    [
        ("", "their_code:Team"),
        ("their_package their", "their_code:Team"),  # no package above it
        ("their_package.other", "their_package.within:Team"),
        ("", "sparse_coord_ros.core.learners.coop:Coop"),
    ],
)
def test_what_nobody_allowed_is_not_imported(
    module, monkeypatch, tmp_path, allowed, name
):
    monkeypatch.setenv(plugins.ALLOW_VARIABLE, allowed)
    message = refusal(learner_of, name)
    named = name.partition(":")[0]
    assert message.startswith(f"learner {name!r}: module {named} was not imported")
    assert (
        f"--allow {named}, a node's parameter allow, or allow={named!r} in Python"
        in message
    )
    scenario = sc.load_scenario(foreign_scenario(tmp_path), steps=60)
    assert str(scenario.perception) == "their_code:fog:0.5"
    assert "'their_code:fog': module their_code was not" in refusal(
        learn, scenario, "coop", 1
    )
    assert "'their_code:fog': module" in refusal(make_run, scenario, {})
    run = (
        make_run(sc.load_scenario("env1"), {})
        .to_yaml()
        .replace("learner: coop", "learner: their_code:Team")
    )
    read = run_from_yaml(run, where="run.yaml")
    assert (read.learner, read.title) == ("their_code:Team", "their_code:Team")
    assert "'their_code:Team': module" in refusal(read.check_code)
    assert "their_code" not in sys.modules


@pytest.mark.parametrize(
    "given", ["their_code", ["", "their_code"], ["their_package", "their_code"]]
)
def test_what_is_allowed_is_imported(module, monkeypatch, tmp_path, given):
    monkeypatch.setenv(plugins.ALLOW_VARIABLE, "")
    scenario = sc.load_scenario(foreign_scenario(tmp_path), steps=60, allow=given)
    learn(scenario, "coop", 1)
    assert type(learner_of("their_code:Team")).__name__ == "Team"


def test_who_names_code_in_python_allows_it(module, small, monkeypatch):
    monkeypatch.setenv(plugins.ALLOW_VARIABLE, "")
    learned = sc.train(
        small.with_settings(perception="their_code:fog:0.5"), "their_code:Team"
    )
    assert plugins.allowed() == ("their_code",)
    assert sc.evaluate(learned, trials=2).trials == 2
    with pytest.raises(sc.SparseCoordError, match="allow: .*'my team.py'"):
        plugins.allow_modules(["my team.py"])


class Own(sc.Coop):
    """A learner that is handed over as it is."""


def test_who_hands_over_a_class_allows_its_module_in_other_processes():
    assert learner_of(Own).label == f"{__name__}:Own"
    assert plugins.allowed() == (__name__,)


def haze(grid):
    """Let half of the questions be answered."""
    return np.full((len(grid.cells),) * 2, 0.5)


def mist(grid, p, q=1.0):
    return np.full((len(grid.cells),) * 2, p * q)


def same(one, other):
    return tables_equal(learn(one, "coop", 1), learn(other, "coop", 1))


def test_a_function_is_a_perception_model(small, tmp_path):
    """Its name in files is that of its module, as of a learner's class."""
    scenario = small.with_settings(perception=haze)
    assert str(scenario.perception) == f"{__name__}:haze"
    assert plugins.allowed() == (__name__,)
    assert same(scenario, small.with_settings(perception="probability:0.5"))
    assert sc.load_scenario("env1", perception=haze, steps=60) == scenario
    assert f"perception: {__name__}:haze\n" in make_run(scenario, {}).to_yaml()
    run = sc.train(scenario)
    assert sc.load_run(run.save(tmp_path / "run")).scenario == scenario
    assert sc.evaluate(run, trials=2).trials == 2


def test_a_function_has_its_numbers_beside_it(small):
    scenario = small.with_settings(perception=(mist, 0.5, 1))
    assert str(scenario.perception) == f"{__name__}:mist:0.5:1"
    assert same(scenario, small.with_settings(perception="probability:0.5"))
    swept = sc.sweep(
        small, {"perception": [(mist, 0.5, 1), (mist, 1, 1)]}, runs=1, trials=1
    )
    assert len(swept) == 2
    message = refusal(small.with_settings, perception=mist)
    assert f"'{__name__}:mist' has 0 numbers, '{__name__}:mist' takes 2" in message
    assert "p is 'x'" in refusal(
        small.with_settings, perception=(MODELS.find("probability"), "x")
    )


def made_here(p):
    """Return a function that no other process can find."""

    def fog(grid):
        return np.full((len(grid.cells),) * 2, p)

    return fog


def test_a_function_of_this_process_alone_learns_here_and_never_goes_elsewhere(
    small, tmp_path
):
    often, never = (small.with_settings(perception=made_here(p)) for p in (0.5, 0.0))
    # two games
    assert [str(one.perception) for one in (often, never)] == [
        "fog",
        "fog_2",
    ]
    assert same(often, small.with_settings(perception="probability:0.5"))
    assert same(never, small.with_settings(perception="never"))
    again = make_run(often, {}).scenario
    assert again == often and same(again, often)
    lone = small.with_settings(perception=lambda grid: haze(grid))
    assert str(lone.perception) == "model"
    assert same(lone, often)
    # Runs of plain Python stay in this process, as those of a notebook's learner do.
    runs = sc.train_many(often, runs=2, trials=2, engine="python", jobs=2)
    assert tables_equal(runs[0].tables, learn(often, "coop", 0))
    swept = sc.sweep(
        often, {"penalty": [-1, -2]}, runs=1, trials=1, engine="python", jobs=2
    )
    assert len(swept) == 2
    words = "perception model 'fog': other processes, and later calls, cannot find this function"
    assert words in refusal(runs[0].save, tmp_path / "run")
    assert words in refusal(sc.sweep, often, {"penalty": [-1]}, out=tmp_path / "r")
    assert words in refusal(make_run(often, {}).to_yaml)
    assert list(tmp_path.iterdir()) == []


def test_a_function_that_is_no_longer_where_it_was_has_a_name_of_its_own(
    small, monkeypatch
):
    """Other processes would find the new one by its path."""
    old = haze
    monkeypatch.setattr(sys.modules[__name__], "haze", lambda grid: None)
    assert str(small.with_settings(perception=old).perception) == "haze"


def test_a_registered_function_keeps_its_name(small):
    sc.register_perception("dusk", lambda grid: haze(grid))
    known = MODELS.registered["dusk"]
    assert str(small.with_settings(perception=known).perception) == "dusk"
    always = MODELS.registered["always"]
    assert str(small.with_settings(perception=always).perception) == "always"


@pytest.mark.parametrize(
    "value", [print, int, 7, None, (), (3, 4), ("fog", 4), object()]
)
def test_what_is_no_function_of_ones_own_is_refused(small, value):
    assert "perception" in refusal(small.with_settings, perception=value)


def test_what_is_no_model_is_never_called(module, small):
    plugins.allow_modules("builtins os sparse_coord_ros unittest")
    ours = "sparse_coord_ros.cli.main:main"
    for name in (
        "builtins:input",
        "os:system",
        ours,
        "os:path.join",
        "unittest.mock:call",
    ):
        message = refusal(small.with_settings, perception=name)
        assert (
            f"{name!r}: is not marked as a perception model and was not called"
            in message
        )


def test_a_shipped_model_is_no_module(small):
    assert "cells is 'x'" in refusal(small.with_settings, perception="range:x")


def test_names_that_collide(module):
    class Mine(sc.Coop):
        name = "coop"

    assert "'coop': is taken" in refusal(sc.register_learner, Mine)
    message = refusal(sc.register_perception, "range", lambda grid: None)
    assert "'range': is taken" in message
    assert "must be a subclass" in refusal(sc.register_learner, "coop")
    assert "'a b'" in refusal(sc.register_perception, "a b", lambda grid: None)
    assert "is no function" in refusal(sc.register_perception, "seven", 7)
    assert type(learner_of("coop")) is sc.Coop

    class Other(sc.Coop):
        name = "mine_of_tests"

    class Another(sc.Coop):
        name = "mine_of_tests"

    for own in (Other, Another):  # as a notebook's cell does that is run twice
        assert type(learner_of(own)) is own
        assert sc.register_learner(own) is learner_of("mine_of_tests")


@pytest.mark.parametrize(
    ("name", "words"),
    [
        ("Broken", ["failed while learning: KeyError: 'learned'", line('["learned"]')]),
        ("Weightless", ["its weights are {'common': 2}, allowed: three numbers"]),
        ("Empty", ["making what a robot remembers: TypeError: initial returned None"]),
        ("Valueless", ["failed while learning: TypeError"]),
        ("Needy", ["failed while being made: TypeError", "'more'"]),
        (
            "Odd",
            ["failed while making what a robot remembers: Attribute", line("no_such")],
        ),
    ],
)
def test_a_learner_that_fails_is_blamed(module, small, name, words):
    message = refusal(learn, small, f"their_code:{name}", 1)
    assert f"learner 'their_code:{name}'" in message
    assert [word for word in words if word not in message] == []


def test_a_function_may_call_that_of_its_base_class(module, small):
    """In plain Python; compiled: test/engine/test_same_run.py."""
    updates = learn(small, "their_code:Twice", 1)[0].memory["updates"]
    assert updates.any() and not (updates % 2).any()


def test_a_check_that_fails_is_blamed(module, small):
    message = refusal(make_run, small, {"learner": "their_code:Unchecked"})
    assert (
        "learner 'their_code:Unchecked' failed while making its check: TypeError"
        in message
    )


def test_the_traceback_stays_available(module, small):
    with pytest.raises(PluginError) as caught:
        learn(small, "their_code:Broken", 1)
    assert isinstance(caught.value.__cause__, KeyError)
    with pytest.raises(PluginError) as caught:
        list(
            run_batch(
                small, "their_code:Broken", [1, 2], trials=0, engine="python", jobs=2
            )
        )
    assert 'return {}["learned"]' in str(caught.value.__cause__)


@pytest.mark.parametrize(
    ("model", "words"),
    [
        (
            "their_code:divide",
            ["failed while it looked at map env1: ZeroDivisionError", line("1 / 0")],
        ),
        ("their_code:flat", ["returned array([1., 1.", "shape (21, 21)"]),
        ("their_code:fog:2", ["returned array([[2., 2.", "from 0 to 1"]),
        ("their_code:number", ["is no function"]),
        ("their_code:fog", ["has 0 numbers, 'their_code:fog' takes 1"]),
        ("nowhere:fog", ["perception model 'nowhere:fog' was not found"]),
    ],
)
def test_a_model_that_fails_is_blamed(module, small, model, words):
    def use():
        learn(small.with_settings(perception=model), "coop", 1)

    message = refusal(use)
    assert model.removesuffix(":2") in message
    assert [word for word in words if word not in message] == []


@pytest.mark.parametrize("here", [False, True])
@pytest.mark.parametrize("kind", ["-1.0.dist-info", ".egg-info"])
def test_entry_points_of_installed_packages(
    module, small, monkeypatch, tmp_path, kind, here
):
    monkeypatch.delenv(plugins.ALLOW_VARIABLE)
    place = tmp_path / "site"
    place.mkdir()
    (tmp_path / "their_code.py").rename(place / "their_code.py")
    offered = (
        "[sparse_coord_ros.learners]\nalert = their_code:Heir\nlost = nowhere:Team\n"
        "team_of_tests = their_code:Team\n"
        "[sparse_coord_ros.perception]\nmist = their_code:fog\n"
    )
    (place / f"theirs{kind}").mkdir()
    (place / f"theirs{kind}/entry_points.txt").write_text(offered)
    if here:  # whoever sends the folder offers them: nothing is installed
        monkeypatch.chdir(place)
        monkeypatch.setattr(sys, "path", ["", str(place), *sys.path])
        assert "alert" not in LEARNERS.names
        assert "unknown learner 'alert'" in refusal(learner_of, "alert")
        return
    monkeypatch.setattr(sys, "path", [*sys.path, str(place)])
    assert "alert" in LEARNERS.names
    assert type(learner_of("alert")).__name__ == "Heir"
    assert learner_of("team_of_tests").label == "team_of_tests"
    scenario = small.with_settings(perception="mist:0.25")
    assert str(scenario.perception) == "mist:0.25"
    # in the current directory, not installed
    (tmp_path / "nowhere.py").write_text(MODULE)
    assert "learner 'lost' was not found" in refusal(learner_of, "lost")
