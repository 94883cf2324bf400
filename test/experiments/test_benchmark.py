# Copyright 2026 The sparse_coord_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The benchmark: its lists and bounds, and what it says of a learner."""

from dataclasses import replace

import numpy as np
import pytest
from made_up_results import made_up

import sparse_coord_ros as sc
from sparse_coord_ros.base.errors import SettingError
from sparse_coord_ros.base.share import shipped_json
from sparse_coord_ros.cli.benchmark import row_of
from sparse_coord_ros.core.game.scenario import load_scenario
from sparse_coord_ros.core.game.unseen import KINDS, SPLITS, TEAMS, split_of, team_of
from sparse_coord_ros.core.runs.measures import EXACT
from sparse_coord_ros.core.solve.optimum import independent_bound, joint_optimum
from sparse_coord_ros.core.solve.shipped import (
    game_digest,
    known_top,
    shipped_asking_team,
    unseen_buildings,
)
from sparse_coord_ros.core.solve.shortest_paths import shortest_paths
from sparse_coord_ros.studies.benchmark import pooled_share, standing
from sparse_coord_ros.studies.conditions import make_condition
from sparse_coord_ros.studies.lists import LISTS, PENALTY, SAMPLED

SHIPPED = shipped_json("unseen.json")["buildings"]
BUILDING = make_condition("unseen1-door-2r-0", "coop", {})
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
    paths = shortest_paths(scenario).mean("returns")
    optimum = joint_optimum(scenario).value
    assert said["shortest_paths"] == pytest.approx(paths, abs=1e-9)
    assert said["optimum"] == pytest.approx(optimum, abs=1e-7)
    assert optimum > paths + 1
    assert paths + 0.9 < known_top(scenario) == shipped_asking_team(scenario).value
    assert known_top(scenario) <= optimum + 1e-6


@pytest.mark.parametrize("name", [name for name in SHIPPED if team_of(name) > 2])
def test_more_are_too(name):
    scenario = load_scenario(name)
    said = SHIPPED[name]
    assert said["game"] == game_digest(scenario)
    assert shortest_paths(scenario).mean("returns") == pytest.approx(
        said["shortest_paths"]
    )
    assert said["shortest_paths"] + 1 < known_top(scenario)
    assert known_top(scenario) < independent_bound(scenario)


def test_a_list_is_what_it_says():
    assert [len(LISTS[f"unseen2-{size}"]) for size in ("pairs", "four", "eight")] == [
        36,
        24,
        12,
    ]
    assert {split_of(item.scenario) for item in LISTS["tuning-four"]} == {"tuning"}
    for name in ("swap-pairs", "block-pairs"):
        assert len(LISTS[name]) == 24 and name in SAMPLED
        own = {item.scenario for item in LISTS[name]}
        assert {split_of(one) for one in own} == {"test"}
        assert not own & set(unseen_buildings())
    assert not set(SAMPLED) & {"paper", "crowds", "percepts"}


@pytest.mark.parametrize("name", LISTS)
def test_every_scenario_of_a_list_has_a_gap(name):
    for item in LISTS[name][:: 6 if name in SAMPLED else 1]:
        scenario = load_scenario(item.scenario).with_settings(
            {"penalty": PENALTY, **item.settings, "perception": "always"}
        )
        paths = shortest_paths(scenario).mean("returns")
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
    """Lists of one or two scenarios."""
    lists = {
        "tuning-pairs": LISTS["tuning-pairs"][:2],
        "tuning-four": LISTS["tuning-four"][:1],
        "percepts": LISTS["percepts"][:1],
    }
    monkeypatch.setattr("sparse_coord_ros.studies.lists.LISTS", lists)


@pytest.mark.usefixtures("short_lists")
def test_learners_are_judged():
    found = sc.benchmark(["noncoop", "coop"], **FEW, epsilon="constant:0.5")
    [noncoop, coop] = found
    assert (noncoop["learner"], noncoop["teams"]) == ("noncoop", 4)
    assert noncoop["list"] == "tuning-pairs"
    assert row_of(coop)[:3] == ["tuning-pairs", "coop", "when_asked"]
    results = []
    for item in LISTS["tuning-pairs"][:2]:
        scenario = sc.load_scenario(item.scenario, steps=50, epsilon="constant:0.5")
        swept = sc.sweep(
            scenario,
            {"penalty": [PENALTY]},
            learner="noncoop",
            runs=2,
            trials=2,
            jobs=1,
            engine="python",
        )
        results += swept.values()
    low = np.array([one.shortest_paths.mean("returns") for one in results])
    high = np.array([known_top(one.scenario) for one in results])
    means = np.array([one.measures.mean("returns") for one in results])
    assert noncoop["share"] == pytest.approx((means - low).sum() / (high - low).sum())
    assert noncoop["error"] > 0 and coop["learner"] == "coop"


@pytest.mark.usefixtures("short_lists")
def test_who_cannot_learn_a_list_has_no_share_there():
    [found] = sc.benchmark("joint", **{**FEW, "lists": ["tuning-four"]})
    assert found["share"] is None
    assert row_of(found) == ["tuning-four", "joint", *["-"] * 4]


@pytest.mark.usefixtures("short_lists")
def test_a_setting_that_does_not_fit_is_named(capsys):
    from sparse_coord_ros.cli.main import main

    words = "benchmark coop --lists tuning-pairs --set prior_success=0.5"
    assert main(words.split()) == 2
    assert "error: setting prior_success: value is 0.5" in capsys.readouterr().err


@pytest.mark.usefixtures("short_lists")
def test_failing_percepts_have_the_top_of_sure_ones():
    """The standing is that of the same returns in the game with sure percepts."""
    sure = make_condition("env1", "coop", {"penalty": PENALTY})
    failing = make_condition(
        "env1", "coop", {"penalty": PENALTY, "perception": "probability:0.5"}
    )
    shares = [
        standing("percepts", "coop", [result_of_teams(one, [100.0, 110.0])])["share"]
        for one in (sure, failing)
    ]
    assert shares[0] == shares[1]


def test_the_error_of_a_share_is_that_of_other_buildings_and_teams():
    """Alike teams: of the buildings. One building, or alike ones: of the teams."""
    low = np.zeros(40)
    high = np.full(40, 10.0)
    shares = np.linspace(0.2, 1.0, 40)
    alike = [np.full(5, 10.0 * one) for one in shares]
    share, error = pooled_share(alike, low, high)
    assert share == pytest.approx(0.6)
    assert error == pytest.approx(shares.std() / 40**0.5, rel=0.05)
    teams = np.linspace(0.0, 10.0, 25)
    share, of_one = pooled_share([teams], low[:1], high[:1])
    assert share == pytest.approx(0.5)
    assert of_one == pytest.approx(teams.std() / 10 / 25**0.5, rel=0.05)
    _, error = pooled_share([teams] * 40, low, high)
    assert error == pytest.approx(of_one / 40**0.5, rel=0.05)


def test_a_share_is_of_the_pooled_gap():
    """A building with hardly a gap does not count as much as another."""
    learned = [np.array([5.0, 7.0]), np.array([-1.0, -3.0])]
    share, _ = pooled_share(learned, np.array([0.0, 0.0]), np.array([10.0, 0.1]))
    assert share == pytest.approx((6.0 - 2.0) / 10.1)


def test_what_is_exact_decides_who_fails():
    result = result_of_teams(BUILDING, [140.0] * 3, arrived=[1.0, 1.0, 0.0])
    assert standing("tuning-pairs", "coop", [result])["failed"] == 1
    arrived = np.array([0.5, 0.9995, 0.3])
    exact = replace(result.measures, source=EXACT, trials=0, arrived=arrived)
    known = replace(result, measures=exact)
    assert standing("tuning-pairs", "coop", [known])["failed"] == 2


def result_of_teams(condition, returns, arrived=None):
    """Return a made-up result of a condition, with these returns of its teams."""
    ones = [1.0] * len(returns)
    measures = {name: ones for name in ("asks", "time_to_goal", "miscoordinations")}
    return made_up(condition, **measures, returns=returns, arrived=arrived or ones)


@pytest.mark.usefixtures("short_lists")
def test_the_verb(capsys):
    from sparse_coord_ros.cli.main import main

    words = (
        "benchmark noncoop coop --lists percepts --runs 2 --steps 50 --engine python"
    )
    assert main(words.split()) == 0
    out = capsys.readouterr().out
    assert [line.split()[1] for line in out.splitlines()[2:4]] == ["noncoop", "coop"]
