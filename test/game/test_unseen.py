# Copyright 2026 The sparse_coord_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The unseen buildings: they never change, are sound, and have unambiguous names."""

import hashlib
import json

import pytest

from sparse_coord_ros.base.errors import ScenarioError
from sparse_coord_ros.core.game.scenario import load_scenario
from sparse_coord_ros.core.game.unseen import (
    KINDS,
    TEAMS,
    VERSIONS,
    split_of,
    team_of,
    unseen,
)


def test_version_1_is_what_it_was():
    names = [
        f"{VERSIONS[0]}-{kind}-{team}r-{seed}"
        for kind in KINDS
        for team in TEAMS
        for seed in (0, 9)
    ]
    games = [load_scenario(name).computation() for name in names]
    said = json.dumps([[game["map"], game["robots"]] for game in games])
    assert hashlib.sha256(said.encode()).hexdigest()[:16] == "7f99b5fb5cdb6af8"


@pytest.mark.parametrize("team", TEAMS)
@pytest.mark.parametrize("kind", KINDS)
def test_every_robot_gets_to_its_goal_through_a_doorway(kind, team):
    for seed in range(12):
        scenario = load_scenario(f"{VERSIONS[0]}-{kind}-{team}r-{seed}", ask_cost=2)
        grid = scenario.map
        robots = scenario.robots
        assert (scenario.penalty, scenario.steps, scenario.ask_cost) == (
            -100,
            100_000,
            2,
        )
        assert len(robots) == team_of(scenario.name) == team
        for places in ([r.start for r in robots], [r.goal for r in robots]):
            assert len(set(places)) == team
            assert not grid.doorways & set(places)
        for robot in robots:
            assert 1 <= grid.distances_to(robot.goal)[robot.start] < 40
            assert _needs_a_doorway(grid, robot.start, robot.goal)


def _needs_a_doorway(grid, start, goal):
    seen = {start}
    front = [start]
    while front:
        front = [
            int(y) for x in front for y in grid.next_cell[x] if y not in grid.doorways
        ]
        front = list(set(front) - seen)
        seen |= set(front)
    return goal not in seen


@pytest.mark.parametrize(
    ("name", "split"),
    [
        ("unseen1-loop-2r-0", "tuning"),
        ("unseen1-loop-2r-1", "validation"),
        ("unseen1-loop-2r-10", "tuning"),
        ("unseen2-loop-2r-0", "test"),
        ("unseen2-loop-2r-1", "test"),
    ],
)
def test_what_buildings_are_for(name, split):
    assert split_of(name) == split
    assert unseen(name) is not None


@pytest.mark.parametrize(
    "name",
    ["unseen1-door-2r", "unseen1-door-3r-1", "unseen1-hall-2r-1", "unseen3-door-2r-1"],
)
def test_there_is_no_such_building(name):
    with pytest.raises(ScenarioError, match=name):
        load_scenario(name)
    assert unseen(f"{VERSIONS[0]}-door-2r-01") is None
