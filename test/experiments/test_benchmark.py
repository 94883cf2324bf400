# Copyright 2026 The sparse_coord_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The benchmark of unseen buildings: its buildings, its bounds, and what it says of a learner."""

import json
from dataclasses import replace

import numpy as np
import pytest

import sparse_coord_ros as sc
from sparse_coord_ros.base.errors import SettingError
from sparse_coord_ros.base.share import shipped_json
from sparse_coord_ros.core.game.scenario import load_scenario
from sparse_coord_ros.core.game.unseen import KINDS, SPLITS, TEAMS, split_of, team_of
from sparse_coord_ros.core.runs.evaluation import Measure
from sparse_coord_ros.core.solve.optimum import independent_bound, joint_optimum
from sparse_coord_ros.core.solve.reference import shortest_path_reference
from sparse_coord_ros.core.solve.shipped import (
    game_digest,
    known_best,
    shipped_asking_team,
    shipped_routes,
    unseen_buildings,
    yardsticks,
)
from sparse_coord_ros.studies.catalogue import experiment, unseen_conditions
from sparse_coord_ros.studies.standings import (
    Standing,
    failed_teams,
    pooled_share,
    standing,
)
from sparse_coord_ros.studies.store import ConditionResult

SHIPPED = shipped_json("unseen.json")["buildings"]
FEW = {
    "runs": 2,
    "trials": 2,
    "steps": 50,
    "robots": [2],
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
    paths = shortest_path_reference(scenario).reward
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
    assert shortest_path_reference(scenario).reward == pytest.approx(
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


@pytest.mark.parametrize(
    ("given", "words"),
    [
        ({"split": "both"}, "split: value is 'both'"),
        ({"robots": [3]}, "robots: value is 3"),
        ({"robots": []}, "robots: value is none"),
        ({"penalty": -20}, "penalty"),
        ({"runs": 1}, "runs"),
        ({"epsilonn": 1}, "epsilonn"),
    ],
)
def test_what_it_refuses(given, words):
    with pytest.raises(SettingError, match=words):
        sc.benchmark("coop", **{**FEW, **given})


def test_a_learner_is_judged(monkeypatch):
    names = unseen_buildings()[:3]
    monkeypatch.setattr(
        "sparse_coord_ros.studies.catalogue.unseen_buildings", lambda: names
    )
    found = sc.benchmark("noncoop", **FEW)
    assert (found.learner, found.split) == ("noncoop", "tuning")
    assert {one.condition.name for one in found.results.values()} == {
        name for name in names if split_of(name) == "tuning"
    }
    [(where, one)] = found.standings().items()
    assert (where, one.buildings, one.teams) == ("2r", 2, 4)
    assert list(found.standings(by_kind=True)) == ["2r door"]
    said = found.to_dict()["standings"]["2r"]
    gap = said["best_known"] - said["paths"]
    assert said["share"] == pytest.approx((said["reward"] - said["paths"]) / gap)
    assert len(found.to_pandas()) == 2
    json.dumps(found.to_dict())


def test_how_teams_stand():
    reward = Measure(115.0, 1.0, 0.5)
    share = Measure(0.75, float("nan"), 0.025)
    one = Standing(2, 60, 100.0, 120.0, reward, share, 0.5, 1.0, 0.0, 0, 3)
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
    low = shortest_path_reference(load_scenario("unseen1-door-2r-0")).reward
    result = result_in(
        "unseen1-door-2r-0", rewards=[low - 1.0, low, low + 8.0], failing=[0, 5, 0]
    )
    one = standing([result, result])
    assert (one.buildings, one.teams, one.below, one.failed) == (2, 6, 2, 2)
    assert one.reward.mean == pytest.approx(low + 7.0 / 3.0)
    assert one.worst == pytest.approx(one.share.mean)
    assert one.reward.standard_error == pytest.approx(
        result.best("reward").standard_error / 2**0.5
    )


def test_what_is_exact_decides_who_fails(result_in):
    rewards = [140.0, 140.0, 140.0]
    result = result_in("unseen1-door-2r-0", rewards, failing=[0, 0, 1000])
    exact = {"reward": rewards, "arrived": [0.5, 0.9995, 1.0]}
    assert failed_teams(replace(result, exact=exact)) == 1
    assert failed_teams(result) == 1


@pytest.fixture
def result_in():
    """Return a function that makes up a result in a building, with the rewards of its runs."""

    def made(name, rewards, failing):
        [condition] = [
            c for c in unseen_conditions("coop", "tuning", {}) if c.name == name
        ]
        return ConditionResult(
            condition=condition,
            trials=1000,
            optimum=200.0,
            optimum_exact=True,
            reference={"reward": shortest_path_reference(condition.scenario).reward},
            means={
                name: list(rewards) for name in ("reward", "asks", "miscoordinations")
            },
            variances={
                name: [1.0] * len(rewards)
                for name in ("reward", "asks", "miscoordinations")
            },
            robot_means={},
            not_arrived=failing,
            visited=[],
            asked=[],
            stays=[],
        )

    return made


def test_the_verb(monkeypatch, capsys):
    from sparse_coord_ros.cli.main import main

    names = unseen_buildings()[:2]
    monkeypatch.setattr(
        "sparse_coord_ros.studies.catalogue.unseen_buildings", lambda: names
    )
    words = "benchmark noncoop --robots 2 --runs 2 --steps 200 --kinds --engine python"
    assert main(words.split()) == 0
    out = capsys.readouterr().out
    assert [line.split()[:2] for line in out.splitlines()[2:4]] == [
        ["noncoop", "2r"]
    ] * 2
