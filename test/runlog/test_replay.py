# Copyright 2026 The sparse_coord_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The agents that learned replay the log, from its start or from a step on."""

import pytest

from sparse_coord_ros.game.world import RewardWeights
from sparse_coord_ros.learn.agent import Agent
from sparse_coord_ros.learn.learners import Coop, learner_of
from sparse_coord_ros.learn.simulation import tables_equal
from sparse_coord_ros.runlog import read_run, verify
from sparse_coord_ros.runlog.agents import first_tables
from sparse_coord_ros.runlog.replay import Replay, fresh_agent, trajectory_of

HALF = {"perception": "probability:0.5"}


class OwnAgents(Coop):
    """A learner that makes its agents itself."""

    def agent(self, scenario, number, seed, **more):
        return Agent(scenario, number, seed, **more)


class Weighed(Coop):
    """What one robot causes all pay: weigh it by their number."""

    def weights(self, scenario):
        return RewardWeights(1.0, len(scenario.robots), 0.5)


@pytest.mark.parametrize("learner", [OwnAgents, Weighed])
def test_learners_of_ones_own_verify(record, learner):
    settings = {**HALF, "steps": 250}
    found = verify(record(settings=settings, values={"learner": learner_of(learner)}).bag)
    assert found.same, found.first
    assert found.updates > 250


@pytest.mark.parametrize("learner", ["coop", "factored"])
def test_a_replay_begins_anywhere(record, learner):
    """With an agent that knows all from before: so can whoever has a checkpoint."""
    settings = {**HALF, "steps": 250}
    log = read_run(record(settings=settings, values={"learner": learner}).bag)
    trajectory = trajectory_of(log, 1)
    begun, _ = first_tables(log, 1)
    first = Replay(log, trajectory, fresh_agent(log, 1, begun))
    assert first.advance(150) and first.reached == 150
    agent = fresh_agent(log, 1, begun)
    agent.go_on_from(first.agent.memory())
    rest = Replay(log, trajectory, agent, begin=150)
    assert first.advance(len(trajectory.step)) and rest.advance(len(trajectory.step))
    assert tables_equal([first.agent.tables], [rest.agent.tables])
