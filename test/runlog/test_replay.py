# Copyright 2026 The sparse_coord_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The agents that learned replay the log, from its start or from a step on."""

import numpy as np
import pytest

from sparse_coord_ros.game.streams import DRAWS, MOTION, POLICY, Stream
from sparse_coord_ros.game.world import RewardWeights
from sparse_coord_ros.learn.agent import Agent
from sparse_coord_ros.learn.learners import Coop, learner_of
from sparse_coord_ros.learn.simulation import tables_equal
from sparse_coord_ros.runlog import read_run, verify
from sparse_coord_ros.runlog.agents import first_tables
from sparse_coord_ros.runlog.draws import draws_at
from sparse_coord_ros.runlog.replay import Replay, fresh_agent
from sparse_coord_ros.runlog.trajectory import trajectory_of

HALF = {"perception": "probability:0.5"}


class OwnAgents(Coop):
    """A learner that makes its agents itself."""

    def agent(self, scenario, number, seed, **more):
        return Agent(scenario, number, seed, **more)


class Weighed(Coop):
    """What one robot causes all pay: weigh it by their number."""

    def weights(self, scenario):
        return RewardWeights(1.0, len(scenario.robots), 0.5)


BUSY = {"steps": 700, "max_steps": 20, "penalty": -60, "epsilon": "constant:0.8"}
BUSY |= {"q_coord_init": 20, "conflict": "any_doorway"}
RUNS = {
    "of one's own": ("env1", HALF, learner_of(OwnAgents)),
    "weighed": ("env1", HALF, learner_of(Weighed)),
    "links": ("env2-2r", {**BUSY, "perception": "range:3", "link": "lost:0.3"}, "factored"),
    "referee": ("env2-4r", {**BUSY, "perception": "probability:0.8"}, "factored"),
}


@pytest.mark.parametrize("name", RUNS)
def test_learners_verify(record, name):
    scenario, settings, learner = RUNS[name]
    found = verify(record(scenario, settings, values={"learner": learner}).bag)
    assert found.same, found.first
    assert found.updates > 400


def test_a_factored_run_that_goes_on_from_tables_verifies(record):
    settings = {**BUSY, **HALF}
    begun = record("env2-2r", settings, values={"learner": "factored"})
    tables = [robot.agent.tables for robot in begun.recording.robots]
    values = {"learner": "factored", "tables": "before", "seed": 8}
    assert verify(record("env2-2r", settings, values=values, tables=tables).bag).same


@pytest.mark.parametrize("learner", ["coop", "factored"])
def test_a_replay_begins_anywhere(record, learner):
    """With an agent that knows all from before: so can whoever has a checkpoint."""
    log = read_run(record(settings=HALF, values={"learner": learner}).bag)
    trajectory = trajectory_of(log, 1)
    begun, _ = first_tables(log, 1)
    first = Replay(log, trajectory, fresh_agent(log, 1, begun))
    assert first.advance(150) and first.reached == 150
    agent = fresh_agent(log, 1, begun)
    agent.go_on_from(first.agent.memory())
    rest = Replay(log, trajectory, agent, begin=150)
    assert first.advance(len(trajectory.step)) and rest.advance(len(trajectory.step))
    assert tables_equal([first.agent.tables], [rest.agent.tables])


@pytest.mark.parametrize("role", [POLICY, MOTION])
def test_draws_at_steps_are_those_of_the_stream(role):
    steps = np.array([0, 1, 5, 8191, 8192, 8193, 40_000, 10**9])
    stream = Stream(3, 1, role)
    found = draws_at(3, 1, role, steps)
    assert found.shape == (len(steps), DRAWS[role])
    assert found.tolist() == [stream.at(step) for step in steps.tolist()]
