# Copyright 2026 The sparse_coord_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The benchmark: its lists and bounds, and what it says of a learner."""

import re
from dataclasses import replace

import numpy as np
import pytest
from sparse_coord_ros.studies.standings import (
    Standing,
    failed_teams,
    pooled_share,
    standing,
)

import sparse_coord_ros as sc
from sparse_coord_ros.base.errors import ResultsError, SettingError
from sparse_coord_ros.base.share import shipped_json
from sparse_coord_ros.core.game.scenario import load_scenario
from sparse_coord_ros.core.game.unseen import KINDS, SPLITS, TEAMS, split_of, team_of
from sparse_coord_ros.core.runs.evaluation import Measure
from sparse_coord_ros.core.solve.optimum import independent_bound, joint_optimum
from sparse_coord_ros.core.solve.reference import shortest_path_reference
from sparse_coord_ros.core.solve.shipped import (
    game_digest,
    known_best,
    known_top,
    shipped_asking_team,
    shipped_bound,
    shipped_routes,
    unseen_buildings,
    yardsticks,
)
from sparse_coord_ros.studies.benchmark import Entry, read_entries
from sparse_coord_ros.studies.catalogue import experiment, unseen_conditions
from sparse_coord_ros.studies.checked_json import to_text
from sparse_coord_ros.studies.condition_result import ConditionResult
from sparse_coord_ros.studies.lists import ABOUT, LISTS, PENALTY, SAMPLED

SHIPPED = shipped_json("unseen.json")["buildings"]
FEW = {
    "runs": 2,
    "trials": 2,
    "steps": 50,
    "lists": ["tuning-pairs"],
    "jobs": 1,
    "engine": "python",
}


def test_a_split_has_as_many_buildings_of_each_kind():
    counts = {}
    for name in unseen_buildings():
        place = name.split("-")[1], split_of(name), team_of(name)
        counts[place] = counts.get(place, 0) + 1
    few = {2: 4, 4: 2, 8: 1}
    wanted = {"tuning": few, "validation": few, "test": {2: 6, 4: 4, 8: 2}}
    assert counts == {
        (kind, split, team): wanted[split][team]
        for kind in KINDS
        for split in SPLITS
        for team in TEAMS
    }


@pytest.mark.parametrize("name", [name for name in SHIPPED if team_of(name) == 2])
def test_two_robots_are_in_one_anothers_way(name):
    scenario = load_scenario(name)
    said = SHIPPED[name]
    assert said["game"] == game_digest(scenario)
    paths = shortest_path_reference(scenario).returns
    optimum = joint_optimum(scenario).value
    assert said["shortest_paths"] == pytest.approx(paths, abs=1e-9)
    assert said["optimum"] == pytest.approx(optimum, abs=1e-7)
    assert optimum > paths + 1
    assert paths + 0.9 < known_best(scenario) == shipped_asking_team(scenario).value
    assert known_best(scenario) <= optimum + 1e-6


@pytest.mark.parametrize("name", [name for name in SHIPPED if team_of(name) > 2])
def test_more_are_too(name):
    scenario = load_scenario(name)
    said = SHIPPED[name]
    assert said["game"] == game_digest(scenario)
    plan = shipped_routes(scenario)
    assert shortest_path_reference(scenario).returns == pytest.approx(
        said["shortest_paths"]
    )
    assert said["shortest_paths"] + 1 < plan.value < independent_bound(scenario)


def test_the_planner_is_a_yardstick():
    scenario = load_scenario("unseen1-door-4r-0")
    names, values = zip(*yardsticks(scenario), strict=True)
    assert names == ("route planner", "bound (robots alone)")
    assert values[0] == shipped_routes(scenario).value
    assert shipped_routes(scenario.with_settings({"penalty": -20})) is None


def test_the_experiment_unseen_opens_the_buildings_for_validation_alone():
    opened = {one.name for one in experiment("unseen").conditions}
    assert opened == {name for name in SHIPPED if split_of(name) == "validation"}


@pytest.mark.parametrize("split", SPLITS)
def test_a_split_is_its_buildings(split):
    conditions = unseen_conditions("coop", split, {"steps": 10})
    found = {one.name for one in conditions}
    assert found == {name for name in SHIPPED if split_of(name) == split}


@pytest.mark.parametrize("name", [name for name in SHIPPED if team_of(name) > 2])
def test_larger_teams_have_a_bound(name):
    scenario = load_scenario(name)
    bound = shipped_bound(scenario)
    team = len(scenario.robots)
    assert sorted(k for group in bound.groups for k in group) == list(range(team))
    plan = shipped_routes(scenario)
    assert plan.value - 4 * plan.standard_error < bound.value
    assert bound.value < independent_bound(scenario)
    assert known_top(scenario) == bound.value


def test_a_list_is_what_it_says():
    assert [len(LISTS[f"unseen2-{size}"]) for size in ("pairs", "four", "eight")] == [
        36,
        24,
        12,
    ]
    assert {split_of(item.scenario) for item in LISTS["tuning-four"]} == {"tuning"}
    for name in ("swap-pairs", "block-pairs", "help-pairs"):
        assert len(LISTS[name]) == 24 and name in SAMPLED
        own = {item.scenario for item in LISTS[name]}
        assert {split_of(one) for one in own} == {"test"}
        assert not own & set(unseen_buildings())
    assert set(ABOUT) <= set(LISTS)
    assert not set(SAMPLED) & {"paper", "crowds", "percepts"}


@pytest.mark.parametrize("item", LISTS["help-pairs"], ids=lambda item: item.scenario)
def test_help_is_worth_coordination(item):
    scenario = load_scenario(item.scenario).with_settings(item.settings)
    assert scenario.interactions == load_scenario(item.scenario).interactions
    paths = shortest_path_reference(scenario).returns
    optimum = joint_optimum(scenario).value
    assert optimum > paths + 3
    assert paths < known_top(scenario) <= optimum + 1e-6


def test_the_joint_optimum_of_a_building_with_help_places():
    """Value iteration over the joint MDP finds it, and its team arrives."""
    scenario = load_scenario("unseen2-door-2r-2h-1002")
    mdp = sc.joint_mdp(scenario)
    value = np.zeros(len(mdp.R))
    for _ in range(600):
        of_actions = np.stack(
            [mdp.R[:, a] + mdp.discount * (P @ value) for a, P in enumerate(mdp.P)]
        )
        value = of_actions.max(axis=0)
    assert value[mdp.start] == pytest.approx(joint_optimum(scenario).value, abs=1e-6)
    chosen = of_actions.argmax(axis=0)
    there = np.zeros(len(value))
    there[mdp.start] = 1.0
    for _ in range(scenario.horizon):
        there = sum(
            P.T @ np.where(chosen == a, there, 0.0) for a, P in enumerate(mdp.P)
        )
    assert there[mdp.goal] > 0.999


@pytest.mark.parametrize("name", LISTS)
def test_every_scenario_of_a_list_has_a_gap(name):
    for item in LISTS[name]:
        scenario = load_scenario(item.scenario).with_settings(
            {"penalty": PENALTY, **item.settings, "perception": "always"}
        )
        paths = shortest_path_reference(scenario).returns
        assert known_top(scenario) > paths, item


@pytest.mark.parametrize(
    ("given", "words"),
    [
        ({"lists": ["both"]}, "lists: value is both"),
        ({"lists": []}, "lists: value is none"),
        ({"lists": "paper"}, "lists: value is 'paper'"),
        ({"penalty": -20}, "penalty"),
        ({"perception": "never"}, "perception"),
        ({"runs": 1}, "runs"),
        ({"epsilonn": 1}, "epsilonn"),
    ],
)
def test_what_it_refuses(given, words):
    with pytest.raises(SettingError, match=words):
        sc.benchmark("coop", **{**FEW, **given})


@pytest.fixture
def short_lists(monkeypatch):
    """Lists of one or two scenarios, and few budgets."""
    lists = {
        "tuning-pairs": LISTS["tuning-pairs"][:2],
        "tuning-four": LISTS["tuning-four"][:1],
        "percepts": LISTS["percepts"][:1],
    }
    monkeypatch.setattr("sparse_coord_ros.studies.lists.LISTS", lists)
    monkeypatch.setattr("sparse_coord_ros.studies.benchmark.BUDGETS", (20,))


@pytest.mark.usefixtures("short_lists")
def test_learners_are_judged(tmp_path):
    slow = sc.Entry("slow", "noncoop", {"epsilon": "constant:0.5"})
    found = sc.benchmark(["noncoop", slow, "joint"], **FEW)
    [noncoop, own, joint] = found.places
    assert (noncoop.title, noncoop.list, noncoop.teams) == (
        "noncoop",
        "tuning-pairs",
        4,
    )
    assert (own.learner, own.settings) == ("noncoop", {"epsilon": "constant:0.5"})
    assert [one.scenario for one in joint.judged] == [
        item.scenario for item in LISTS["tuning-pairs"][:2]
    ]
    low = np.array([one.paths for one in noncoop.judged])
    high = np.array([one.top for one in noncoop.judged])
    means = np.array([np.mean(one.returns) for one in noncoop.judged])
    share, error = noncoop.share
    assert share == pytest.approx((means - low).sum() / (high - low).sum())
    assert error > 0
    assert noncoop.seconds > 0
    file = tmp_path / "board.json"
    found.save(file)
    assert sc.load_leaderboard(file) == found
    assert len(found.to_pandas()) == 3
    shares = [float(row["share of the gap"].split()[0]) for row in found.rows()]
    assert shares == sorted(shares, reverse=True)


@pytest.mark.usefixtures("short_lists")
def test_who_cannot_learn_a_list_has_no_share_there():
    found = sc.benchmark("joint", **{**FEW, "lists": ["tuning-four"]})
    assert found.places[0].judged == ()
    assert found.rows()[0]["share of the gap"] == "-"


@pytest.mark.usefixtures("short_lists")
def test_failing_percepts_have_the_top_of_sure_ones():
    [place] = sc.benchmark("coop", **{**FEW, "lists": ["percepts"]}).places
    sure = load_scenario("env1").with_settings(penalty=PENALTY)
    assert place.judged[0].top == known_top(sure)
    assert place.judged[0].scenario == "env1, perception=probability:0.5"


@pytest.mark.usefixtures("short_lists")
def test_the_least_budget_that_closes_nearly_all(monkeypatch):
    monkeypatch.setattr("sparse_coord_ros.studies.benchmark.NEARLY_ALL", -1e9)
    assert sc.benchmark("noncoop", **FEW).places[0].steps_to_90 == 20
    monkeypatch.setattr("sparse_coord_ros.studies.benchmark.NEARLY_ALL", 1e9)
    found = sc.benchmark("noncoop", **FEW)
    assert found.places[0].steps_to_90 is None
    assert found.rows()[0]["steps to 90 %"] == "> 50"


@pytest.mark.usefixtures("short_lists")
def test_teams_that_have_learned_elsewhere(tmp_path):
    """They are worth what the same learner's teams are worth that learn here."""
    for item in LISTS["tuning-pairs"][:2]:
        for seed in range(2):
            scenario = sc.load_scenario(item.scenario, steps=50)
            training = sc.train(scenario, "noncoop", seed=seed)
            training.save(tmp_path / f"{item.scenario}-{seed}")
    here = sc.benchmark("noncoop", **FEW).places[0]
    there = sc.benchmark(sc.Entry("there", runs=str(tmp_path)), **FEW).places[0]
    assert there.judged == here.judged
    assert there.seconds is None
    empty = tmp_path / "empty"
    empty.mkdir()
    with pytest.raises(SettingError, match="no run directories"):
        sc.benchmark(sc.Entry("none", runs=str(empty)), **FEW)


@pytest.mark.usefixtures("short_lists")
@pytest.mark.parametrize("change", [("20", "21"), ('"steps"', '"step"')])
def test_a_file_that_was_edited_is_refused(tmp_path, change):
    file = tmp_path / "board.json"
    sc.benchmark("noncoop", **FEW).save(file)
    text = file.read_text()
    file.write_text(text.replace(*change, 1))
    with pytest.raises(ResultsError, match=re.escape(str(file))):
        sc.load_leaderboard(file)


def test_a_file_of_another_form_is_refused(tmp_path):
    file = tmp_path / "board.json"
    place = {"title": "x"}
    file.write_text(
        to_text({"version": "1", "seed": 0, "trials": 2, "places": [place]})
    )
    with pytest.raises(ResultsError, match="'learner' is missing in places"):
        sc.load_leaderboard(file)


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("entries: []", "add a learner"),
        ("learners: [coop]", "add a learner"),
        ("entries: [coop]", "entry 1"),
        ("entries: [{learner: coop, runs: r}]", "entry 1"),
        ("entries: [{learner: coop, settings: 5}]", "settings are 5"),
    ],
)
def test_entries_that_are_refused(tmp_path, text, words):
    file = tmp_path / "entries.yaml"
    file.write_text(text)
    with pytest.raises(SettingError, match=words):
        read_entries(file)


def test_entries_are_read(tmp_path):
    file = tmp_path / "entries.yaml"
    file.write_text(
        "entries: [{title: plain, learner: noncoop, settings: {q_star_init: 0}}, {runs: r}]"
    )
    assert read_entries(file) == [
        sc.Entry("plain", "noncoop", {"q_star_init": 0}),
        sc.Entry("r", settings={}, runs="r"),
    ]


def test_how_teams_stand():
    returns = Measure(115.0, 1.0, 0.5)
    share = Measure(0.75, float("nan"), 0.025)
    one = Standing(2, 60, 100.0, 120.0, returns, share, 0.5, 1.0, 0.0, 0, 3)
    assert one.of_teams(one.failed) == "3 of 60"
    assert one.of_teams(one.below) == "0 of 60 (< 4.9 %)"
    assert one.share_and_failed() == "75.0 % (2.5); 3 of 60 fail"


def test_the_error_of_a_share_is_that_of_other_buildings_and_teams():
    """Alike teams: of the buildings. One building, or alike ones: of the teams."""
    low = np.zeros(40)
    high = np.full(40, 10.0)
    shares = np.linspace(0.2, 1.0, 40)
    alike = [np.full(5, 10.0 * one) for one in shares]
    found = pooled_share(alike, low, high)
    assert found.mean == pytest.approx(0.6)
    assert found.standard_error == pytest.approx(shares.std() / 40**0.5, rel=0.05)
    teams = np.linspace(0.0, 10.0, 25)
    one = pooled_share([teams], low[:1], high[:1])
    assert one.mean == pytest.approx(0.5)
    assert one.standard_error == pytest.approx(teams.std() / 10 / 25**0.5, rel=0.05)
    many = pooled_share([teams] * 40, low, high)
    assert many.standard_error == pytest.approx(one.standard_error / 40**0.5, rel=0.05)


def test_a_share_is_of_the_pooled_gap():
    """A building with hardly a gap does not count as much as another."""
    learned = [np.array([5.0, 7.0]), np.array([-1.0, -3.0])]
    found = pooled_share(learned, np.array([0.0, 0.0]), np.array([10.0, 0.1]))
    assert found.mean == pytest.approx((6.0 - 2.0) / 10.1)


def test_teams_below_shortest_paths_and_failed_ones_are_counted(result_in):
    low = shortest_path_reference(load_scenario("unseen1-door-2r-0")).returns
    result = result_in(
        "unseen1-door-2r-0", returns=[low - 1.0, low, low + 8.0], failing=[0, 5, 0]
    )
    one = standing([result, result])
    assert (one.buildings, one.teams, one.below, one.failed) == (2, 6, 2, 2)
    assert one.returns.mean == pytest.approx(low + 7.0 / 3.0)
    assert one.worst == pytest.approx(one.share.mean)
    assert one.returns.standard_error == pytest.approx(
        result.best("returns").standard_error / 2**0.5
    )


def test_what_is_exact_decides_who_fails(result_in):
    returns = [140.0, 140.0, 140.0]
    result = result_in("unseen1-door-2r-0", returns, failing=[0, 0, 1000])
    exact = {"returns": returns, "arrived": [0.5, 0.9995, 1.0]}
    assert failed_teams(replace(result, exact=exact)) == 1
    assert failed_teams(result) == 1


def test_a_team_that_misses_one_trial_of_a_thousand_has_not_failed(result_in):
    result = result_in("unseen1-door-2r-0", [140.0] * 3, failing=[0, 1, 2])
    assert failed_teams(result) == 1
    assert result.failed_teams == 1


@pytest.fixture
def result_in():
    """Return a function that makes up a result in a building, with the returns of its runs."""

    def made(name, returns, failing):
        [condition] = [
            c for c in unseen_conditions("coop", "tuning", {}) if c.name == name
        ]
        return ConditionResult(
            condition=condition,
            trials=1000,
            optimum=200.0,
            optimum_exact=True,
            reference={"returns": shortest_path_reference(condition.scenario).returns},
            means={
                name: list(returns) for name in ("returns", "asks", "miscoordinations")
            },
            variances={
                name: [1.0] * len(returns)
                for name in ("returns", "asks", "miscoordinations")
            },
            robot_means={},
            not_arrived=failing,
            visited=[],
            asked=[],
            stays=[],
        )

    return made


@pytest.mark.usefixtures("short_lists")
def test_the_verb(tmp_path, capsys):
    from sparse_coord_ros.cli.main import main

    entries = tmp_path / "entries.yaml"
    entries.write_text(
        "entries: [{title: plain, learner: noncoop, settings: {q_star_init: 0}}]"
    )
    file = tmp_path / "board.json"
    words = f"benchmark noncoop {entries} --lists tuning-pairs --runs 2 --steps 50 --engine python"
    assert main([*words.split(), "--save", str(file)]) == 0
    out = capsys.readouterr().out
    assert {line.split()[1] for line in out.splitlines()[2:4]} == {"noncoop", "plain"}
    assert len(sc.load_leaderboard(file).places) == 2


def test_an_entry_is_given_once():
    once = "'coop' is given 2 times, allowed: once"
    with pytest.raises(SettingError, match=once):
        sc.benchmark(["coop", "factored", "coop"])
    entries = [Entry("mine", "coop"), Entry("mine", "factored")]
    with pytest.raises(SettingError, match="'mine' is given 2 times"):
        sc.benchmark(entries)
