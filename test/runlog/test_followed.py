# Copyright 2026 The sparse_coord_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Agents followed by the loop in plain Python, by the compiled loop and as objects: the same."""

import numpy as np
import pytest

from sparse_coord_ros.compiling import has_numba
from sparse_coord_ros.game.streams import DRAWS, MOTION, POLICY, Stream
from sparse_coord_ros.game.world import RewardWeights
from sparse_coord_ros.learn.agent import Agent
from sparse_coord_ros.learn.learners import Coop, learner_of
from sparse_coord_ros.learn.simulation import tables_equal
from sparse_coord_ros.runlog import read_run, verify
from sparse_coord_ros.runlog.agents import first_tables
from sparse_coord_ros.runlog.draws import draws_at
from sparse_coord_ros.runlog.follower import Follower
from sparse_coord_ros.runlog.story import tell

HALF = {"perception": "probability:0.5"}


class Objects(Coop):
    """Algorithm 1 by objects: a learner with an agent of its own has no compiled form."""

    def agent(self, scenario, number, seed, **more):
        return Agent(scenario, number, seed, **more)


class Weighed(Coop):
    """What one robot causes all pay: weigh it by their number."""

    def weights(self, scenario):
        return RewardWeights(1.0, len(scenario.robots), 0.5)


LOGS = ("env1", "all peers", "goes on", "noncoop", "weighed")
FACTORED = {
    "factored": ("env2-2r", {"perception": "range:3", "link": "lost:0.3"}),
    "factored, four robots": ("env2-4r", {"perception": "probability:0.8"}),
    "factored, its own tables": ("env2-2r", HALF),
}


@pytest.fixture(scope="module", params=[*LOGS, *FACTORED])
def log(request, record, good):
    """Return the log of a run of 400 steps or more."""
    if request.param in FACTORED:
        name, settings = FACTORED[request.param]
        busy = {"epsilon": "constant:0.8", "q_coord_init": 20, "conflict": "any_doorway"}
        settings = {"steps": 700, "max_steps": 20, "penalty": -60, **busy, **settings}
        values, tables = {"learner": "factored"}, None
        if "tables" in request.param:
            begun = record(name, settings, values=values)
            values, tables = {**values, "tables": "before", "seed": 8}, begun.recording.robots
            tables = [robot.agent.tables for robot in tables]
        return read_run(record(name, settings, values=values, tables=tables).bag)
    if request.param == "goes on":
        tables = [robot.agent.tables for robot in good.recording.robots]
        values = {"tables": "before", "seed": 8}
        return read_run(record(settings=HALF, values=values, tables=tables).bag)
    if request.param == "all peers":
        return read_run(record("crowd-3r", {**HALF, "peers": "all"}).bag)
    values = {}
    if request.param == "noncoop":
        values = {"learner": "noncoop"}
    if request.param == "weighed":
        values = {"learner": learner_of(Weighed)}
    return read_run(record(settings=HALF, values=values).bag)


def followed(log, k, **options):
    story = tell(log, k)
    begun, _ = first_tables(log, k)
    follower = Follower(log, k, story, begun, **options)
    shows = []
    for place in range(len(story.step) + 1):
        assert follower.advance(place)
        shows.append(follower.shows)
    return follower.tables(), shows


@pytest.mark.parametrize("k", [0, 1])
def test_the_same_tables(log, k, monkeypatch):
    plain, shown = followed(log, k, compiled=False)
    last = max((e for e in log.all_tables if e.robot == k), key=lambda entry: entry.step)
    assert tables_equal([plain], [last.tables])
    if has_numba():
        compiled, also = followed(log, k, compiled=True)
        assert tables_equal([plain], [compiled]) and also == shown
    monkeypatch.setattr(type(log.run.rule), "compiled", False, raising=False)
    objects, also = followed(log, k)
    assert tables_equal([plain], [objects]) and also == shown


@pytest.mark.parametrize("compiled", [False, None])
def test_a_learner_without_a_compiled_form_verifies(record, compiled):
    run = record(settings=HALF, values={"learner": learner_of(Objects)})
    found = verify(run.bag, compiled=compiled)
    assert found.same, found.first
    assert found.updates > 400


@pytest.mark.skipif(not has_numba(), reason="numba is not installed")
@pytest.mark.parametrize("learner", ["coop", "factored"])
def test_verify_by_compiled_loops_says_the_same(record, learner):
    bag = record(settings=HALF, values={"learner": learner}).bag
    plain, compiled = (verify(bag, compiled=how) for how in (False, True))
    assert plain.same and compiled.same
    assert (plain.choices, plain.updates) == (compiled.choices, compiled.updates)


@pytest.mark.parametrize("role", [POLICY, MOTION])
def test_draws_at_steps_are_those_of_the_stream(role):
    steps = np.array([0, 1, 5, 8191, 8192, 8193, 40_000, 10**9])
    stream = Stream(3, 1, role)
    found = draws_at(3, 1, role, steps)
    assert found.shape == (len(steps), DRAWS[role])
    assert found.tolist() == [stream.at(step) for step in steps.tolist()]
