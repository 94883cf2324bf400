# Copyright 2026 The sparse_coord_ros authors
# SPDX-License-Identifier: Apache-2.0
"""On large maps Q^C is sparse by itself, and the same is learned."""

from unittest.mock import Mock

import numpy as np
import pytest

from sparse_coord_ros.engine import batch
from sparse_coord_ros.engine.batch import CompiledLearning, CompiledTeam
from sparse_coord_ros.game import scenario as scenarios
from sparse_coord_ros.game.grid import GridMap
from sparse_coord_ros.game.scenario import load_scenario, scenario_from_dict
from sparse_coord_ros.learners.agent import initial_tables
from sparse_coord_ros.learn.factors import AdditiveTable
from sparse_coord_ros.engine.run import Learning
from sparse_coord_ros.learn.sparse import SparseTable
from sparse_coord_ros.learn.tables import pack_tables, unpack_saved
from sparse_coord_ros.solve.exact import evaluate_exact


def room(side):
    """Return a scenario of two robots in an empty room."""
    rows = ("." * side,) * side
    grid = GridMap("room", rows)
    end = [side - 1, side - 1]
    robots = {"a": {"start": [0, 0], "goal": end}, "b": {"start": end, "goal": [0, 0]}}
    said = {"name": "room", "text": grid.to_text()}
    return scenario_from_dict({"map": said, "robots": robots}, where="room", name="room")


@pytest.fixture
def small(monkeypatch):
    """Return a function that says from how many bytes on Q^C is sparse."""
    return lambda size: monkeypatch.setattr(scenarios, "LARGEST_DENSE", size)


@pytest.mark.parametrize(("side", "sparse"), [(26, False), (27, True), (100, True)])
def test_by_size(side, sparse):
    scenario = room(side)
    assert scenario.sparse == sparse
    table = initial_tables(scenario).q_coord
    assert isinstance(table, SparseTable) == sparse
    assert table.shape == (side * side, side * side, 4)
    assert table.nbytes <= scenarios.LARGEST_DENSE


@pytest.mark.parametrize("name", ["env1", "env2-4r"])
@pytest.mark.parametrize("learner", ["coop", "noncoop"])
def test_the_same_bits_sparse_and_dense(small, name, learner):
    """In both engines; and a run that was broken off goes on in the other form."""
    scenario = load_scenario(name, steps=1500, penalty=-100)

    def learned():
        plain, state = Learning(scenario, learner, 3), None
        plain.advance(700)
        state = plain.state()
        plain.advance(1500)
        team = CompiledTeam(scenario, learner)
        fast = CompiledLearning(team, 3, state)
        fast.advance(1500)
        assert (plain.visited > 0).all() == (learner == "coop")
        return plain.tables, fast.tables, state

    dense, dense_fast, _ = learned()
    small(0)
    assert scenario.sparse
    sparse, sparse_fast, state = learned()
    for one, *others in zip(dense, dense_fast, sparse, sparse_fast, strict=True):
        assert {type(other.q_coord) for other in others[1:]} == {SparseTable}
        arrays = [others[0].q_coord, *(np.asarray(other.q_coord) for other in others[1:])]
        assert {array.tobytes() for array in arrays} == {one.q_coord.tobytes()}
        assert {other.q_star.tobytes() for other in others} == {one.q_star.tobytes()}
    small(2**24)  # the state of the sparse run goes on in arrays
    again = Learning(scenario, learner, 3, state)
    again.advance(1500)
    for one, two in zip(again.tables, dense, strict=True):
        assert one.q_coord.tobytes() == two.q_coord.tobytes()


def test_a_factored_pair_acts_alike_from_an_array_and_from_factors(small):
    scenario = load_scenario("env1", steps=3000, penalty=-100)

    def learned():
        team = CompiledTeam(scenario, "factored")
        [*tables] = team.tables(team.learn(3))
        return tables, evaluate_exact(scenario, tables).to_dict()

    (dense, _), found = learned()
    small(0)
    tables, again = learned()
    assert again == found
    data = pack_tables(dict(enumerate(tables, 1)))
    [(table, *_), _] = unpack_saved(data, [1, 2], where="here")
    assert isinstance(table.q_coord, AdditiveTable)
    cells = range(len(dense.q_star))
    assert all((table.q_coord[x, z] == dense.q_coord[x, z]).all() for x in cells for z in cells)


@pytest.mark.parametrize("learner", ["coop", "factored"])
def test_compiling_plays_on_a_small_map(monkeypatch, learner):
    played = []
    monkeypatch.setattr(batch, "compile_once", lambda key, rule, warm_up: warm_up())
    monkeypatch.setattr(
        batch, "CompiledTeam", lambda scenario, rule: played.append(scenario) or Mock()
    )
    batch.prepare(learner, engine="auto")
    assert [len(scenario.map.cells) for scenario in played] == [21]
