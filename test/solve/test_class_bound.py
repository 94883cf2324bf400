# Copyright 2026 The sparse_coord_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The class bounds that are shipped: for whom, and that they are worth what they say."""

import json

import pytest

from sparse_coord_ros.game.scenario import load_scenario
from sparse_coord_ros.share import share_file
from sparse_coord_ros.solve.class_bound import (
    class_bound_from_dict,
    class_tables,
    game_digest,
    shipped_class_bound,
)
from sparse_coord_ros.solve.exact import evaluate_exact
from sparse_coord_ros.solve.optimum import independent_bound, joint_optimum
from sparse_coord_ros.solve.reference import shortest_path_reference

SHIPPED = json.loads(share_file("config", "class_bounds.json").read_text(encoding="utf-8"))
PENALTIES = (0, -0.1, -1, -10, -20, -100)


def scenario_of(title):
    name, _, penalty = title.partition(", penalty ")
    return load_scenario(name).with_settings({"penalty": penalty})


@pytest.mark.parametrize("title", SHIPPED["bounds"])
def test_the_team_is_worth_what_is_said(title):
    scenario = scenario_of(title)
    bound = shipped_class_bound(scenario)
    assert bound.game == game_digest(scenario)
    found = evaluate_exact(scenario, class_tables(scenario, bound.robots))
    # Trials end at the horizon; what comes later is worth less than this.
    late = (1 - found.all_arrived) * 2 * scenario.goal_reward / (1 - scenario.discount)
    assert abs(found.reward.mean - bound.value) < 1e-6 + late
    assert bound.value <= joint_optimum(scenario).value + 1e-6
    assert bound.value >= shortest_path_reference(scenario).reward - 1e-6
    assert 1 <= bound.agreed <= bound.restarts
    assert all(gain >= 0 for gain in bound.gains)


@pytest.mark.parametrize("name", ["env1", "env2-2r", "pentagon", "isr", "cit"])
def test_every_penalty_of_figure_4_is_there(name):
    values = []
    for penalty in PENALTIES:
        scenario = load_scenario(name).with_settings({"penalty": penalty})
        bound = shipped_class_bound(scenario)
        assert bound.restarts >= 30
        values.append(bound.value)
    assert values == sorted(values, reverse=True)
    assert values[0] == pytest.approx(independent_bound(load_scenario(name)), abs=1e-6)


@pytest.mark.parametrize(
    ("name", "penalty", "value"),
    [
        ("env1", -20, 121.196),
        ("env1", -100, 118.509),
        ("pentagon", -20, 160.982),
        ("pentagon", -100, 158.850),
    ],
)
def test_known_values(name, penalty, value):
    scenario = load_scenario(name).with_settings({"penalty": penalty})
    assert shipped_class_bound(scenario).value == pytest.approx(value, abs=5e-4)


def test_it_is_of_the_game_and_not_of_the_learning():
    scenario = load_scenario("env1")
    bound = shipped_class_bound(scenario)
    other = {"steps": 5, "horizon": 7, "epsilon": "constant:0.5", "goal_value": 0, "peers": "all"}
    assert shipped_class_bound(scenario.with_settings(other)) == bound
    for name, value in {
        "penalty": -21,
        "ask_cost": 2,
        "discount": 0.9,
        "move_success": 0.9,
        "goal_reward": 9,
        "conflict": "any_doorway",
        "perception": "range:2",
        "common_reward": "each:1:2",
    }.items():
        assert shipped_class_bound(scenario.with_settings({name: value})) is None, name
    assert shipped_class_bound(load_scenario("env2-4r")) is None


def test_plain_data_reads_back():
    bound = shipped_class_bound(load_scenario("env1"))
    assert class_bound_from_dict(json.loads(json.dumps(bound.to_dict()))) == bound
