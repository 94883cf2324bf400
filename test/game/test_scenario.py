# Copyright 2026 The sparse_coord_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Scenarios: the shipped ones are those of the study, malformed ones are refused with a reason."""

import hashlib
import json
from pathlib import Path

import pytest
import yaml

from sparse_coord_ros.base.errors import MapError, ScenarioError, SettingError
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


ROBOTS = "map: env1\nrobots:\n  {}: {{start: 1, goal: 2}}\n"


@pytest.fixture
def data():
    """Return the plain data of a good scenario, to be spoiled."""
    return load_scenario("env1").to_dict()


def refusal(data, error=ScenarioError):
    """Return the one line with which a scenario's data is refused."""
    with pytest.raises(error) as refused:
        scenario_from_dict(data, where="f.yaml", name="f")
    assert "\n" not in str(refused.value)
    return str(refused.value)


def test_every_shipped_scenario_is_in_the_list():
    assert scenario_names() == sorted([*SCENARIOS, *CROWD])


@pytest.mark.parametrize("name", [*SCENARIOS, *CROWD])
def test_shipped_scenario(name):
    grid, length, steps, goals = (SCENARIOS | CROWD)[name]
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


def test_paper_rows():
    """Tables 1 to 3, compared with the paper once: no number has changed since."""
    rows = {name: load_scenario(name).paper for name in SCENARIOS}
    said = json.dumps(rows, sort_keys=True, default=list).encode()
    assert hashlib.sha256(said).hexdigest()[:16] == "4230f12a41b8c205"


@pytest.mark.parametrize("name", [*SCENARIOS, *CROWD])
def test_the_game_is_the_paper_s(name):
    scenario = load_scenario(name)
    assert scenario.discount == 0.95
    assert scenario.move_success == 0.8
    assert scenario.goal_reward == 10.0
    assert scenario.penalty == -20.0
    assert scenario.ask_cost == 1.0
    assert scenario.conflict == "same_cell"
    assert scenario.peers == "one"
    assert scenario.penalties == (-20.0,) * len(scenario.robots)
    assert scenario.goal_value == pytest.approx(
        scenario.goal_reward / (1 - scenario.discount)
    )


@pytest.mark.parametrize("name", [*SCENARIOS, *CROWD])
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
    assert again.paper == scenario.paper
    assert again.perception.numbers == (0.123456789012345,)


def test_the_documentation_lists_the_settings():
    rows = [
        f"| {name} | {setting.default} | {setting.allowed} | {setting.help} |"
        for name, setting in SETTINGS.items()
    ]
    text = (Path(__file__).parents[2] / "docs" / "interface.md").read_text()
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
        {"penalty": "-100", "perception": "range:2", "steps": 5}
    )
    assert (changed.penalty, changed.perception, changed.steps) == (
        -100.0,
        Spec("range", (2.0,)),
        5,
    )
    assert scenario.penalty == -20.0
    assert (
        changed.with_settings({"penalty": -20, "perception": "always", "steps": 10_000})
        == scenario
    )


@pytest.mark.parametrize(
    ("values", "words"),
    [
        (
            {"penalti": "-5"},
            ["unknown setting 'penalti'", "did you mean 'penalty'", "goal_value"],
        ),
        (
            {"perception": "lineofsight"},
            ["setting perception", "did you mean 'line_of_sight'"],
        ),
        (
            {"common_reward": "each:1"},
            [
                "setting common_reward: 'each:1' has 1 factor, scenario env1",
                "2 robots and needs 2",
            ],
        ),
    ],
)
def test_bad_settings(values, words):
    with pytest.raises(SettingError) as error:
        load_scenario("env1").with_settings(values)
    message = str(error.value)
    assert "\n" not in message
    assert [word for word in words if word not in message] == []


@pytest.mark.parametrize(
    ("change", "words"),
    [
        (
            {"penaltyy": 3},
            ["f.yaml", "unknown field 'penaltyy'", "did you mean 'penalty'"],
        ),
        ({"penalty": 3}, ["f.yaml", "setting penalty", "from -1e+09 to 0"]),
        (
            {"common_reward": "each:1:2:3"},
            ["f.yaml: setting common_reward", "needs 2; give each"],
        ),
        ({"map": 5}, ["f.yaml", "field 'map' is 5", "name or path"]),
        ({"robots": {}}, ["f.yaml", "no robot", "e.g. robot_1"]),
        (
            {"robots": [{"a": 1}]},
            ["'robots' is list, not a mapping", "one line a robot"],
        ),
        (
            {"robots": {"r": {"start": 1}}},
            ["robot r", "must be {start: ..., goal: ...}"],
        ),
        ({"robots": {"r 1": {"start": 1, "goal": 2}}}, ["robot name 'r 1'", "letters"]),
        ({"robots": {"r": {"start": 7, "goal": 1}}}, ["robot r: start is 7", "[1, 2]"]),
        (
            {"robots": {"r": {"start": [0, 2], "goal": 1}}},
            ["start is [0, 2], allowed", "free"],
        ),
        (
            {"robots": {"r": {"start": 1, "goal": [0, 5]}}},
            ["robot r: goal is [0, 5]", "of its 5 x 5 grid"],
        ),
        (
            {"robots": {"r": {"start": [-1, 0], "goal": 1}}},
            ["start is [-1, 0], allowed"],
        ),
        (
            {"robots": {"r": {"start": "a", "goal": 1}}},
            ["start is 'a', allowed: a start"],
        ),
        (
            {"robots": {"r": {"start": True, "goal": 1}}},
            ["start is True, allowed: a start"],
        ),
        (
            {"robots": {"r": {"start": 1, "goal": [0, 0]}}},
            ["start and goal are the same cell, [0, 0]"],
        ),
        ({"robots": {"r" * 101: {"start": 1, "goal": 2}}}, ["up to 100 letters"]),
        (
            {"paper": {"best": {"reward": [1, 2]}}},
            ["paper: best", "indiv, noncoop, coop"],
        ),
        (
            {"paper": {"coop": {"speed": [1, 2]}}},
            ["paper: coop: speed", "time_to_goal"],
        ),
        ({"paper": 3}, ["f.yaml: paper is 3; allowed: for each of indiv"]),
        ({"paper": {"coop": {"reward": 3}}}, ["reward is 3", "[mean, spread]"]),
    ],
)
def test_bad_fields(data, change, words):
    message = refusal({**data, **change})
    assert [word for word in words if word not in message] == []


def test_more_robots_than_a_reward_can_name(data):
    robot = data["robots"]["robot_1"]
    team = {f"robot_{k}": robot for k in range(1, 54)}
    assert (
        len(scenario_from_dict({**data, "robots": team}, where="", name="f").robots)
        == 53
    )
    message = refusal({**data, "robots": {**team, "robot_54": robot}})
    assert message == (
        "f.yaml: field 'robots' has 54 robots, allowed: up to 53; leave some out"
    )


def test_unknown_map(data):
    message = refusal({**data, "map": "env3"}, MapError)
    assert "f.yaml: map 'env3'" in message
    assert "did you mean 'env2'" in message


def test_unreachable_goal(make):
    with pytest.raises(ScenarioError) as error:
        make("1#2\n.#.")
    for words in (
        "drawn.yaml",
        "robot robot_1",
        "goal 2",
        "start 1",
        "cannot be reached",
    ):
        assert words in str(error.value)


@pytest.mark.parametrize(
    ("name", "near"), [("env11", "env1"), ("env2-3r", "env2-"), ("pentagn", "pentagon")]
)
def test_unknown_scenario_names_the_nearest(name, near):
    with pytest.raises(ScenarioError) as error:
        load_scenario(name)
    for words in (
        f"scenario '{name}'",
        f"did you mean '{near}",
        "one of: cit, cmu",
        "path",
    ):
        assert words in str(error.value)


@pytest.mark.parametrize(
    ("text", "words"),
    [
        (
            "map: env1\nrobots: {r: {start: 1\nsteps: 3\n",
            ["f.yaml, line 3", "not readable as YAML", "mend"],
        ),
        (
            "map: env1\n\tsteps: 3\n",
            ["f.yaml, line 2, column 1", "not readable as YAML"],
        ),
        (
            "map: !!python/object:os.system x\n",
            ["f.yaml, line 1", "not readable as YAML"],
        ),
        ("name: 2020-13-45\n", ["f.yaml: field 'map' is missing"]),
        ("- 1\n", ["f.yaml", "must be 'key: value' lines", "list"]),
        ("", ["f.yaml", "must be 'key: value' lines"]),
        (
            "map: " + "[" * 600,
            ["f.yaml, line 1", "not readable as YAML", "nested too deeply"],
        ),
        (
            "map: env1\nsteps: 5\nsteps: 6\n",
            ["f.yaml, line 3", "'steps' is there twice"],
        ),
        (ROBOTS.format("r") + "  r: {start: 2, goal: 1}\n", ["'r' is there twice"]),
        (
            ROBOTS.format("recorder"),
            ["robot name 'recorder'", "not world_simulator, recorder"],
        ),
        (ROBOTS.format("r") + "name: ../x\n", ["field 'name' is '../x'", "rename"]),
        (
            ROBOTS.format("r") + "paper: {coop: {reward: [a, b]}}\n",
            ["reward is ['a', 'b']"],
        ),
    ],
)
def test_malformed_files(tmp_path, text, words):
    path = tmp_path / "f.yaml"
    path.write_text(text)
    with pytest.raises(ScenarioError) as error:
        load_scenario(str(path))
    message = str(error.value)
    assert "\n" not in message
    assert [word for word in words if word not in message] == []


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
