# Copyright 2026 The sparse_coord_ros authors
# SPDX-License-Identifier: Apache-2.0
"""On large maps Q^C is sparse by itself, and the same is learned."""

import numpy as np
import pytest
from teams import learn

from sparse_coord_ros.core.game.grid import GridMap
from sparse_coord_ros.core.game.scenario import load_scenario, scenario_from_dict
from sparse_coord_ros.core.learners.agent import Agent
from sparse_coord_ros.core.learners.coop import Coop
from sparse_coord_ros.core.learners.registry import learner_of
from sparse_coord_ros.core.learners.tables import JointTable
from sparse_coord_ros.core.runs.run import LearningRun
from sparse_coord_ros.core.runs.team import Team

pytestmark = pytest.mark.usefixtures("compiled_loops")


def room(side):
    """Return a scenario of two robots in an empty room."""
    rows = ("." * side,) * side
    grid = GridMap("room", rows)
    end = [side - 1, side - 1]
    robots = {"a": {"start": [0, 0], "goal": end}, "b": {"start": end, "goal": [0, 0]}}
    said = {"name": "room", "text": grid.to_text()}
    return scenario_from_dict(
        {"map": said, "robots": robots}, where="room", name="room"
    )


def test_by_size():
    assert [room(side).sparse for side in (26, 27)] == [False, True]


@pytest.mark.parametrize(("side", "sparse"), [(5, False), (100, True)])
def test_its_form(side, sparse):
    scenario = room(side)
    table = Agent(Coop(), scenario, 0, 0).tables.q_coord
    assert isinstance(table, JointTable) == sparse
    assert table.shape == (side * side, side * side, 4)


@pytest.mark.parametrize("learner", ["coop", "voi"])
def test_the_whole_table_has_the_rows_that_are_read_one_by_one(learner):
    scenario = load_scenario("env1", steps=3000, penalty=-100)
    for one in learn(scenario, learner, 3):
        table = JointTable(one)
        rows = [[table[x, z] for z in range(21)] for x in range(21)]
        assert np.array_equal(one.q_coord, rows)


@pytest.mark.long
def test_eight_robots_in_a_large_hall_know_their_way():
    """What is kept grows with cells and steps, not with pairs of cells; it takes seconds."""
    side = 150
    grid = GridMap("hall", ("." * side,) * side)
    robots = {
        f"robot_{k}": {"start": [k, 0], "goal": [side - 1 - k, side - 1]}
        for k in range(8)
    }
    said = {"name": "hall", "text": grid.to_text()}
    plain = scenario_from_dict({"map": said, "robots": robots}, where="", name="hall")
    settings = {"prior": "map", "discount": 0.998, "perception": "line_of_sight"}
    scenario = plain.with_settings({**settings, "steps": 2000, "horizon": 500})
    learner = learner_of("voi")
    team = Team(learner.with_defaults(scenario), learner, compiled=True)
    run = LearningRun(team, 1)
    run.advance(2000)
    assert run.play(5).arrived.all()
    peers = len(robots) - 1
    for memory in run.memories:
        for name, array in memory.items():
            if name.startswith(("pairs_", "steps_")):
                assert len(array) <= 2 * 2000 * peers
            else:
                assert array.size <= 5 * side**2
