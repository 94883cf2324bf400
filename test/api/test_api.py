# Copyright 2026 The sparse_coord_ros authors
# SPDX-License-Identifier: Apache-2.0
"""`import sparse_coord_ros as sc`: what is there, what it costs, what the verbs say."""

import inspect
import json
from dataclasses import replace
from functools import cached_property

import numpy as np
import pytest
from teams import same_bits

import sparse_coord_ros as sc
from sparse_coord_ros.cli.main import main
from sparse_coord_ros.core.runs.history import blank_history


@pytest.fixture
def printed(tmp_path, monkeypatch, capsys):
    """Return what `sparse_coord ... --json` prints in an empty folder."""
    monkeypatch.chdir(tmp_path)

    def run(*arguments):
        capsys.readouterr()
        assert main([*map(str, arguments), "--json"]) == 0
        return json.loads(capsys.readouterr().out)

    return run


@pytest.fixture(scope="module")
def scenario():
    return sc.load_scenario("env1", penalty=-100, steps=2000)


@pytest.fixture(scope="module")
def training(scenario):
    return sc.train(scenario, "coop", seed=3)


@pytest.mark.parametrize("name", sc.__all__)
def test_every_name_is_there_documented_and_typed(name):
    thing = getattr(sc, name)
    assert name in dir(sc)
    assert inspect.getdoc(thing)
    if inspect.ismodule(thing):
        functions = inspect.getmembers(thing, inspect.isfunction)
        assert functions and all(inspect.getdoc(function) for _, function in functions)
        return
    if not inspect.isclass(thing):
        given = inspect.signature(thing).parameters
        assert {*given, "return"} <= set(thing.__annotations__)
        return
    assert thing.__module__.startswith("sparse_coord_ros")
    public = [member for key, member in vars(thing).items() if key[0] != "_"]
    for member in public:
        if inspect.isfunction(member) or isinstance(member, property | cached_property):
            assert inspect.getdoc(member), member


def test_an_unknown_name():
    with pytest.raises(AttributeError, match="'tarin'"):
        sc.tarin  # noqa: B018
    assert not hasattr(sc, "__path_of__")


def test_importing_it_imports_nothing_else(python):
    out = python(
        "-c",
        "import sys; before = set(sys.modules)\n"
        "import sparse_coord_ros as sc\n"
        "from sparse_coord_ros.base import palette\n"
        "new = {n.partition(chr(46))[0] for n in set(sys.modules) - before}\n"
        "print(sorted(new - sys.stdlib_module_names), 'sparse_coord_ros.api' in sys.modules)\n",
    ).stdout
    assert out == "['sparse_coord_ros'] False\n"


def test_scenarios(tmp_path):
    assert "env1" in sc.scenario_names()
    base = sc.load_scenario("env1")
    assert sc.load_scenario("env1", penalty=-5) == base.with_settings(penalty=-5)
    assert base.with_settings({"penalty": "-5"}, steps=7).steps == 7
    path = tmp_path / "mine.yaml"
    path.write_text("map: env1\nrobots: {x: {start: 1, goal: 2}}\n")
    assert sc.load_scenario(path).name == sc.load_scenario(str(path)).name == "mine"


def test_training_is_what_train_computes(printed, scenario, training):
    directory = printed(
        "train", "env1", "--penalty", -100, "--steps", 2000, "--seed", 3
    )
    run = sc.load_run(directory["directory"])
    assert (run.scenario, run.learner.label, run.seed) == (scenario, "coop", 3)
    assert same_bits(run.history, training.history)
    evaluated = printed("evaluate", run.directory, "--trials", 20, "--seed", 5)
    for learned in (run, training):
        ours = sc.evaluate(learned, trials=20, seed=5)
        assert evaluated.items() >= ours.to_dict().items()
    ours = sc.evaluate(run.tables, scenario=scenario, learner="coop", trials=20, seed=5)
    assert evaluated.items() >= ours.to_dict().items()


def test_a_training_that_cannot_be_saved_leaves_nothing(
    training, tmp_path, monkeypatch
):
    def full(*_):
        raise OSError(28, "No space left on device")

    monkeypatch.setattr("sparse_coord_ros.core.engine.trained.save_team", full)
    with pytest.raises(sc.SparseCoordError, match="saved: .*No space left"):
        training.save(tmp_path / "saved")
    assert list(tmp_path.iterdir()) == []


def test_a_directory_without_history(training, tmp_path):
    directory = training.save(tmp_path / "saved")
    (directory / "history.npz").unlink()
    with pytest.raises(sc.SparseCoordError, match="history"):
        sc.load_run(directory).history  # noqa: B018
    with pytest.raises(sc.SparseCoordError, match="exists already"):
        training.save(directory)


def test_many_runs_are_the_single_ones(scenario, training):
    seen = []
    many = sc.train_many(
        scenario, runs=3, seed=2, trials=4, progress=lambda *two: seen.append(two)
    )
    assert seen == [(1, 3), (2, 3), (3, 3)]
    assert [run.seed for run in many] == [2, 3, 4]
    assert same_bits(many[1].history, training.history)
    assert (
        sc.evaluate(many[1], trials=9).to_dict()
        == sc.evaluate(training, trials=9).to_dict()
    )
    assert many[1].measures == sc.evaluate_exact(training)
    teams = sc.by_run(run.measures for run in many)
    assert many.measures == teams
    assert teams.to_dict()["source"] == "exact" and len(teams) == 3
    [bare] = sc.train_many(scenario, runs=1, trials=0, history=False)
    assert (bare.measures, bare.history.episodes) == (None, 0)
    four = sc.load_scenario("env2-4r", steps=200)
    [large] = sc.train_many(four, runs=1, seed=2, trials=4)
    assert large.measures == sc.evaluate(large, trials=4, seed=2)


def test_many_runs_have_a_mean_learning_curve():
    """Hand-made histories: two runs, one of which asks twice as often."""
    scenario = sc.load_scenario("env1", steps=1000)
    runs = sc.train_many(scenario, "noncoop", runs=2, trials=0, progress=False)
    episodes = 99
    for k, run in enumerate(runs, start=1):
        history = blank_history(episodes, 2)
        history.length[:] = 10
        history.asks[:] = k
        history.arrived[:] = True
        history.present[:] = True
        runs[k - 1] = replace(run, history=history)
    curves = runs.history
    assert curves["steps"].tolist() == [20.0 * part for part in range(1, 51)]
    assert set(curves["length"]) == {10.0} and set(curves["length_error"]) == {0.0}
    assert set(curves["asks"]) == {1.5} and set(curves["asks_error"]) == {0.5}
    figure = runs.plot(["asks", "length"])
    assert [axes.get_xlabel() for axes in figure.axes] == ["learning step"] * 2
    band = figure.axes[0].collections[0].get_paths()[0].vertices[:, 1]
    assert (band.min(), band.max()) == (1.0, 2.0)
    with pytest.raises(sc.SparseCoordError, match="curve is 'speed', allowed: length"):
        runs.plot(["speed"])


def test_learners_that_differ_in_no_setting_are_bars():
    names = ["noncoop", "coop"]
    few = {"runs": 2, "trials": 2, "progress": False}
    scenario = sc.load_scenario("env1", steps=200)
    figure = sc.plot(sc.sweep(scenario, {"learner": names}, **few))
    [axes] = figure.axes
    assert sorted(one.get_text() for one in axes.get_xticklabels()) == sorted(names)
    assert len(axes.patches) == 2 and axes.get_ylim()[0] <= 0.0


def test_what_is_shown_is_short(scenario, training, tmp_path):
    """One line a thing; a notebook shows pictures too."""
    saved = sc.load_run(training.save(tmp_path / "saved"))
    result = sc.run_experiment(IDS[0], runs=2, trials=3)[IDS[0]]
    bound = sc.shipped_asking_team(scenario)
    for thing in (
        scenario,
        training,
        saved,
        training.tables,
        training.history,
        result,
    ):
        assert "\n" not in repr(thing) and len(repr(thing)) < 200, thing
    assert repr(scenario) == "<Scenario env1, steps=2000; 2 robots, 21 cells>"
    cheap = sc.load_scenario("env1", penalty=-20)
    assert repr(cheap) == "<Scenario env1, penalty=-20; 2 robots, 21 cells>"
    assert repr(sc.load_scenario("env1")) == "<Scenario env1; 2 robots, 21 cells>"
    assert "env1, steps=2000; coop, seed 3;" in repr(training)
    assert repr(saved).endswith(f"coop, seed 3; in {saved.directory}>")
    assert len(repr(bound)) < 500
    pictures = [thing._repr_html_().count("<img") for thing in (training, saved)]
    assert pictures == [2, 2]
    assert "&lt;Training env1" in training._repr_html_()


def test_a_learner_keeps_its_defaults_where_the_scenario_is_named_again(tmp_path):
    scenario = sc.load_scenario("crowd-3r", steps=300)
    training = sc.train(scenario, "voi")
    ours = sc.evaluate(training, trials=20).to_dict()
    assert sc.evaluate(training, scenario=scenario, trials=20).to_dict() == ours
    tables = sc.evaluate(training.tables, scenario=scenario, learner="voi", trials=20)
    assert tables.to_dict() == ours
    assert sc.evaluate(training.save(tmp_path / "saved"), trials=20).to_dict() == ours


def test_references_are_those_of_optimum(printed, scenario):
    found = printed("optimum", "env1", "--penalty", -100)
    optimum = sc.optimum(scenario)
    paths = sc.shortest_paths(scenario)
    assert (found["value"], found["exact"]) == (optimum.value, optimum.exact)
    assert found["shortest_paths"]["returns"] == paths.mean("returns")


IDS = ("env1/coop/penalty=-20,steps=500", "env1/indiv/penalty=-20,ask_cost=2,steps=500")


def test_experiments_are_those_of_reproduce(printed, tmp_path):
    found = printed("reproduce", *IDS, "--runs", 2, "--trials", 3, "--out", "r")
    seen = []
    few = {"runs": 2, "trials": 3}
    ours = sc.run_experiment(
        IDS,
        **few,
        out=tmp_path / "o",
        progress=lambda *all: seen.append(all),
    )
    assert found == {"conditions": [one.to_dict() for one in ours.values()]}
    assert [(name, done) for name, done, _ in seen] == [
        (IDS[0], 0),
        (IDS[0], 1000),
        (IDS[0], 2000),
        (IDS[1], 3000),
        (IDS[1], 4000),
    ]
    assert {total for *_, total in seen} == {4000}
    seen.clear()
    again = sc.run_experiment(IDS[1], **few, out=tmp_path / "o", progress=seen.append)
    assert (list(again), seen) == ([IDS[1]], [])
    assert again[IDS[1]] == ours[IDS[1]]
    assert sc.run_experiment(IDS[1], **few)[IDS[1]] == ours[IDS[1]]
    with pytest.raises(sc.SparseCoordError, match="runs"):
        sc.run_experiment(IDS[1], runs=3, trials=3, out=tmp_path / "o")


def test_frames_of_experiments():
    """Each number has its error and its source."""
    done = sc.run_experiment(IDS, runs=2, trials=3, seed=5)
    frame = sc.to_pandas(done)
    assert list(frame.condition) == list(IDS) == list(done)
    assert (frame.ask_cost == [1, 2]).all() and (frame.source == "exact").all()
    result = done[IDS[0]]
    measures = result.measures
    assert frame.returns[0] == measures.mean("returns")
    assert frame.returns_error[0] == measures.error("returns")
    assert frame.returns_spread[0] == measures.spread("returns")
    assert sc.to_pandas([result]).returns[0] == frame.returns[0]
    by_run = sc.to_pandas(done, by_run=True)
    assert list(by_run.seed) == [5, 6, 5, 6]
    assert list(by_run.run) == [0, 1, 0, 1]
    assert list(by_run.returns[:2]) == measures.each("returns").tolist()
    assert (by_run.returns_error == 0).all()
    many = sc.run_experiment("env2-4r/noncoop/penalty=-20,steps=300", runs=2, trials=3)
    by_run = sc.to_pandas(many, by_run=True)
    [result] = many.values()
    errors = np.sqrt(result.measures.variances["time_to_goal"] / 3)
    assert (by_run.source == "trials").all()
    assert by_run.time_to_goal_error.tolist() == errors.tolist()
    once = sc.to_pandas(sc.run_experiment(IDS[0], runs=1, trials=1))
    assert np.isnan(once.returns_error[0])


OVER = {"penalty": [-20, -100], "ask_cost": (1.0,), "learner": ["indiv", "noncoop"]}


def test_a_sweep_is_the_conditions_that_it_names(tmp_path):
    few = {"runs": 2, "trials": 3}
    scenario = sc.load_scenario("env1", steps=200)
    swept = sc.sweep(scenario, OVER, out=tmp_path / "r", **few)
    ids = [
        f"env1/{who}/penalty={p},steps=200"
        for who in ("indiv", "noncoop")
        for p in (-20, -100)
    ]
    assert list(swept) == ids
    assert dict(sc.run_experiment(ids, **few)) == dict(swept)
    frame = sc.to_pandas(swept, by_run=True)
    head = ["condition", "scenario", "learner", "robots", *scenario.plain_settings]
    assert list(frame)[: len(head) + 3] == [*head, "run", "seed", "returns"]
    assert len(frame) == 8
    seen = []
    again = sc.sweep(scenario, OVER, out=tmp_path / "r", progress=seen.append, **few)
    assert (seen, dict(again)) == ([], dict(swept))
    figure = sc.plot(swept)
    assert [axes.get_xlabel() for axes in figure.axes] == ["penalty (log scale)"]
    assert figure._repr_png_().startswith(b"\x89PNG")
    assert len(sc.plot(swept, "penalty", ("returns", "asks")).axes) == 2
    with pytest.raises(sc.SparseCoordError, match="'ask_cost'.*penalty"):
        sc.plot(swept, "ask_cost")


def test_a_sweep_of_a_scenario_of_ones_own(tmp_path):
    path = tmp_path / "mine.yaml"
    path.write_text("map: env1\nsteps: 100\nrobots: {x: {start: 1, goal: 2}}\n")
    few = {"runs": 1, "trials": 2, "out": tmp_path / "r", "jobs": "2"}
    swept = sc.sweep(sc.load_scenario(path, penalty=-3), {"ask_cost": [1, 2]}, **few)
    assert list(swept) == ["mine/coop/penalty=-3", "mine/coop/penalty=-3,ask_cost=2"]
    assert (
        list(sc.sweep(path, {"penalty": [-3], "ask_cost": [2]}, **few))
        == list(swept)[1:]
    )
    path.write_text("name: env1\nmap: env1\nrobots: {x: {start: 1, goal: 2}}\n")
    with pytest.raises(sc.SparseCoordError, match="'env1'"):
        sc.sweep(path, {})


def test_exact_evaluation_is_what_trials_tend_to(training, scenario):
    found = sc.evaluate_exact(training)
    trials = sc.evaluate(training, trials=2000, seed=1)
    assert abs(found.mean("returns") - trials.mean("returns")) < 4 * trials.error(
        "returns"
    )
    same = sc.evaluate_exact(training.tables, scenario=scenario, learner="coop")
    assert same.to_dict() == found.to_dict()
    assert isinstance(found, sc.Measures)
    with pytest.raises(sc.SparseCoordError, match="scenario"):
        sc.evaluate_exact(training.tables)


@pytest.mark.long
def test_asking_teams(scenario, printed, tmp_path):
    assert sc.shipped_asking_team(scenario).value == pytest.approx(118.5092, abs=1e-4)
    file = tmp_path / "search.json"
    found = sc.find_asking_team("pentagon", restarts=1, seed=2, file=file)
    said = printed("optimum", "pentagon", "--class", "--restarts", 1, "--seed", 2)
    assert (said["value"], said["game"]) == (found.value, found.game)
    assert said["robots"] == [vars(robot) for robot in found.robots]
    assert file.exists()
