# Copyright 2026 The sparse_coord_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Scenarios: the shipped ones are those of the study; what a scenario is by its settings."""

from pathlib import Path

import pytest
import yaml

from sparse_coord_ros.base.errors import ScenarioError
from sparse_coord_ros.core.game.scenario import (
    SETTINGS,
    load_scenario,
    scenario_from_dict,
    scenario_names,
)
from sparse_coord_ros.core.game.specs import Spec

# name: map, shortest path from start to goal, learning steps, goals of robot_1, robot_2, ...
SCENARIOS = {
    "env1": ("env1", 8, 10_000, [(4, 4), (4, 0)]),
    "env2-2r": ("env2", 10, 10_000, [(6, 5), (6, 1)]),
    "env2-4r": ("env2", 10, 10_000, [(6, 5), (6, 1), (0, 1), (0, 5)]),
    "isr": ("isr", 6, 100_000, [(7, 6), (7, 0)]),
    "pentagon": ("pentagon", 4, 100_000, [(4, 10), (3, 7)]),
    "mit": ("mit", 18, 100_000, [(2, 16), (2, 0)]),
    "cit": ("cit", 10, 100_000, [(5, 8), (0, 3)]),
    "suny": ("suny", 10, 100_000, [(8, 17), (3, 22)]),
    "cmu": ("cmu", 31, 100_000, [(6, 32), (6, 3)]),
}

# Goals of robot_1, robot_2, ..., and robots of each scenario, all on one map.
CROWD_GOALS = [(6, 6), (6, 0), (6, 8), (0, 2), (0, 8), (0, 0), (0, 6), (6, 2)]
CROWD = {
    f"crowd-{n}r": ("crowd", None, 100_000, CROWD_GOALS[:n]) for n in (2, 3, 4, 6, 8)
}

# As above, of scenarios that teach the kinds of interaction.
TEACHING = {
    "aisle": ("aisle", 8, 100_000, [(0, 8), (0, 0)]),
    "lane": ("lane", 10, 100_000, [(0, 8), (0, 0)]),
    "floor-4r": ("floor", 10, 100_000, [(3, 7), (3, 0), (0, 7), (0, 0)]),
}
SHIPPED = SCENARIOS | CROWD | TEACHING


def test_every_shipped_scenario_is_in_the_list():
    assert scenario_names() == sorted(SHIPPED)


@pytest.mark.parametrize("name", SHIPPED)
def test_shipped_scenario(name):
    grid, length, steps, goals = SHIPPED[name]
    scenario = load_scenario(name)
    cells = scenario.map.cells
    assert scenario.name == name
    assert scenario.map.name == grid
    assert [robot.name for robot in scenario.robots] == [
        f"robot_{k + 1}" for k in range(len(goals))
    ]
    assert [cells[robot.goal] for robot in scenario.robots] == goals
    for k, robot in enumerate(scenario.robots, start=1):
        assert robot.start == scenario.map.starts[k]
        assert length in (None, scenario.map.distances_to(robot.goal)[robot.start])
    assert scenario.steps == steps


@pytest.mark.parametrize("name", [*SCENARIOS, *CROWD])
def test_the_game_is_the_paper_s_but_for_a_larger_penalty(name):
    scenario = load_scenario(name)
    assert scenario.discount == 0.95
    assert scenario.move_success == 0.8
    assert scenario.goal_reward == 10.0
    assert scenario.penalty == -100.0
    assert scenario.ask_cost == 1.0
    assert scenario.interactions == "together"
    assert scenario.peers == "one"
    assert scenario.penalties == (-100.0,) * len(scenario.robots)
    assert scenario.goal_value == pytest.approx(
        scenario.goal_reward / (1 - scenario.discount)
    )


@pytest.mark.parametrize("name", SHIPPED)
def test_round_trip_through_yaml(name):
    factors = [f"{k / 7!r}" for k in range(len(load_scenario(name).robots))]
    scenario = load_scenario(name).with_settings(
        {
            "perception": "probability:0.123456789012345",
            "penalty": -1e-7,
            "starts": "mixed:0.1",
            "common_reward": ":".join(["each", *factors]),
            "peers": "all",
        }
    )
    text = yaml.safe_dump(scenario.to_dict())
    again = scenario_from_dict(yaml.safe_load(text), where="text", name="other")
    assert again == scenario
    assert again.perception.numbers == (0.123456789012345,)


def test_the_documentation_lists_the_settings():
    rows = [
        f"| {name} | {setting.default} | {setting.allowed} | {setting.help} |"
        for name, setting in SETTINGS.items()
    ]
    text = (Path(__file__).parents[2] / "docs" / "commands.md").read_text()
    assert "\n".join(["|---|---|---|---|", *rows, ""]) in text, "\n".join(rows)


@pytest.mark.parametrize(
    ("common_reward", "penalties"),
    [
        ("same", (-30.0, -30.0, -30.0)),
        ("each:1:1:1", (-30.0, -30.0, -30.0)),
        ("each:0:0.5:2", (0.0, -15.0, -60.0)),
    ],
)
def test_each_robot_has_its_own_penalty(common_reward, penalties):
    settings = {"penalty": -30, "common_reward": common_reward}
    assert load_scenario("crowd-3r").with_settings(settings).penalties == penalties


@pytest.mark.parametrize(
    ("name", "peers", "perceived"),
    [
        ("env1", "one", 2),
        ("env1", "all", 2),
        ("crowd-8r", "one", 2),
        ("crowd-3r", "all", 3),
        ("crowd-8r", "all", 8),
    ],
)
def test_how_many_local_states_q_coord_is_over(name, peers, perceived):
    scenario = load_scenario(name).with_settings({"peers": peers})
    assert scenario.perceived == perceived
    assert scenario.sparse == (perceived > 2)


def test_a_robot_alone_still_has_a_table_over_pairs(make):
    scenario = make(robots={"a": (1, 2)}, peers="all")
    assert (scenario.perceived, scenario.sparse) == (2, False)


def test_settings_change_a_copy_only():
    scenario = load_scenario("env1")
    changed = scenario.with_settings(
        {"penalty": "-20", "perception": "range:2", "steps": 5}
    )
    assert (changed.penalty, changed.perception, changed.steps) == (
        -20.0,
        Spec("range", (2.0,)),
        5,
    )
    assert scenario.penalty == -100.0
    assert (
        changed.with_settings(
            {"penalty": -100, "perception": "always", "steps": 10_000}
        )
        == scenario
    )


def test_scenario_file_names_itself_and_finds_the_map_beside_it(tmp_path):
    (tmp_path / "mine.txt").write_text("title: mine\n---\n1.2\n")
    (tmp_path / "both.yaml").write_text(
        "map: mine.txt\nrobots: {a: {start: 1, goal: 2}}\nperception: range:1\n"
    )
    scenario = load_scenario(str(tmp_path / "both.yaml"))
    assert scenario.name == "both"
    assert scenario.map.title == "mine"
    assert scenario.perception == Spec("range", (1.0,))
    assert scenario.steps == SETTINGS["steps"].default


def test_more_robots_than_a_reward_can_name():
    data = load_scenario("env1").to_dict()
    robot = data["robots"]["robot_1"]
    team = {f"robot_{k}": robot for k in range(1, 54)}
    scenario = scenario_from_dict({**data, "robots": team}, where="", name="f")
    assert len(scenario.robots) == 53
    refused = {**data, "robots": {**team, "robot_54": robot}}
    with pytest.raises(ScenarioError) as error:
        scenario_from_dict(refused, where="f.yaml", name="f")
    assert str(error.value) == (
        "f.yaml: field 'robots' has 54 robots, allowed: up to 53; leave some out"
    )
