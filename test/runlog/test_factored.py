# Copyright 2026 The sparse_coord_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Logs of the factored learner: computed again and explained."""

import struct

import pytest
from teams import tables_equal

from sparse_coord_ros.core.learners.rules import NOT_PERCEIVED
from sparse_coord_ros.core.runs.run import learn
from sparse_coord_ros.log.runlog import read_run, verify
from sparse_coord_ros.log.runlog.explain import coordinations, explained

EXPLORING = {
    "steps": 400,
    "penalty": -60,
    "q_coord_init": 20,
    "epsilon": "constant:0.8",
    "max_steps": 20,
    "interactions": "together:any_doorway",
}


def stamp(nanoseconds):
    """Return the beginning of a message of that time, after its encapsulation."""
    return struct.pack("<iI", *divmod(nanoseconds, 10**9))


@pytest.fixture(scope="module")
def logged(record):
    """Return logs of two robots, and of four, by their number."""
    made = {}
    for name, success in (("env2-2r", 0.6), ("env2-4r", 0.85)):
        settings = {**EXPLORING, "perception": f"probability:{success}"}
        one = record(name, settings, values={"learner": "factored"})
        made[len(one.names)] = one
    return made


@pytest.mark.parametrize("robots", [2, 4])
def test_verified(logged, robots):
    one = logged[robots]
    found = verify(one.bag)
    assert found.same, found.first
    learned = learn(one.run.scenario, "factored", one.run.seed)
    assert any(len(tables.memory["rho_keys"]) for tables in learned)
    log = read_run(one.bag)
    final = [log.all_tables[-robots + k].tables for k in range(robots)]
    assert tables_equal(final, learned)


@pytest.mark.parametrize("robots", [2, 4])
def test_explained(logged, robots):
    log = read_run(logged[robots].bag)
    changed = failed = 0
    for one in explained(log, 0, coordinations(log, 0)):
        assert one.agrees and one.doubt is None
        if one.update is None:
            continue
        rows = {
            (peer, place): (before, after)
            for peer, place, before, after in one.update[-1]
        }
        if one.perceived is None:
            assert list(rows) == [(NOT_PERCEIVED, NOT_PERCEIVED)]
            failed += 1
        else:
            assert list(rows) == list(zip(one.peers, one.perceived, strict=True))
            assert one.update.coord[0] == (one.cell, *one.perceived, one.move)
        changed += any(before != after for before, after in rows.values())
    assert changed > 0 and failed > 0


def test_a_run_that_goes_on_from_tables(record, logged):
    tables = [robot.agent.tables for robot in logged[2].recording.robots]
    values = {"learner": "factored", "tables": "before", "seed": 8}
    settings = {**EXPLORING, "steps": 200}
    assert verify(record("env2-2r", settings, values=values, tables=tables).bag).same


def test_other_partners_in_the_log_differ(logged, rewritten, tmp_path):
    log = read_run(logged[4].bag)
    together = log.rewards[..., -1] > 0
    assert (
        together.sum() > 4
        and (log.rewards[..., -1][log.reward[..., 1] == 0] == 0).all()
    )
    row, k = (int(n) for n in next(zip(*together.nonzero(), strict=True)))
    topic = f"/{log.names[k]}/reward"

    def change(messages):
        at = round(log.run.step_period * 1e9) * int(log.step[row])
        of = [place for place, one in enumerate(messages) if one.topic == topic]
        [place] = [place for place in of if messages[place].data[4:12] == stamp(at)]
        said = struct.pack("<d", float(log.rewards[row, k, -1]))
        data = messages[place].data
        assert data.count(said) == 1
        other = struct.pack("<d", float(1 << k ^ 0b1111) - log.rewards[row, k, -1])
        messages[place] = messages[place]._replace(data=data.replace(said, other))
        return messages

    found = verify(rewritten(logged[4].bag, tmp_path / "bag", change))
    assert found.first.quantity == "reward" and found.first.robot == log.names[k]
    assert found.first.step == log.step[row]
    assert "partners" in found.first.logged
