# Copyright 2026 The sparse_coord_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Logs of the learner voi: computed again, and explained."""

import struct

import numpy as np
import pytest
from teams import learn, tables_equal

from sparse_coord_ros.core.game.actions import ACTIONS
from sparse_coord_ros.core.learners.mind import memory_before
from sparse_coord_ros.log.runlog import read_run, verify
from sparse_coord_ros.log.runlog.explain import (
    ASKS_TO_LEARN,
    coordinations,
    explained,
    in_words,
)
from sparse_coord_ros.log.runlog.replay import Replay, agent_with, trajectory_of

EXPLORING = {
    "steps": 250,
    "penalty": -60,
    "epsilon": "constant:0.5",
    "max_steps": 20,
    "interactions": "together:any_doorway",
}
SEEN = {"peers_seen": "while_learning"}


def stamp(nanoseconds):
    """Return the beginning of a message of that time, after its encapsulation."""
    return struct.pack("<iI", *divmod(nanoseconds, 10**9))


@pytest.fixture(scope="module")
def logged(record):
    """Return logs of two robots, and of four, by their number."""
    made = {}
    for name, success in (("env2-2r", 0.6), ("env2-4r", 0.85)):
        settings = {**EXPLORING, "perception": f"probability:{success}"}
        one = record(name, settings, values={"learner": "voi"})
        made[len(one.names)] = one
    return made


@pytest.mark.parametrize("robots", [2, 4])
def test_verified(logged, robots):
    one = logged[robots]
    found = verify(one.bag)
    assert found.same, found.first
    learned = learn(one.run.scenario, "voi", one.run.seed)
    assert any(len(tables.memory["steps_keys"]) for tables in learned)
    log = read_run(one.bag)
    final = [log.all_tables[-robots + k].tables for k in range(robots)]
    assert tables_equal(final, learned)


@pytest.mark.parametrize("robots", [2, 4])
def test_a_robot_that_asks_only_to_learn_moves_by_its_policy(logged, robots):
    """It asks in every step; where its policy asks, too, it makes the greedy move."""
    log = read_run(logged[robots].bag)
    acted = ~np.isnan(log.rewards[:, 0, 0])
    assert coordinations(log, 0) == log.step[acted].tolist()
    told = {True: 0, False: 0}
    for one in explained(log, 0, coordinations(log, 0)):
        assert one.agrees and one.doubt is None
        lines = list(in_words(log, one))
        assert (f"  {ASKS_TO_LEARN}" in lines) == one.reason.by_policy
        row = f"Q^C[{one.cell}, no answer]"
        if one.perceived is not None:
            row = f"Q^C[{', '.join(map(str, (one.cell, *one.perceived)))}]"
        moved = f"  goes {ACTIONS[one.move]} by {row}: north "
        if one.reason.by_policy:
            moved = f"  goes {ACTIONS[one.move]} by its policy, not by {row}: north "
        else:
            assert one.move == one.reason.move
        assert sum(line.startswith(moved) for line in lines) == 1
        told[one.reason.by_policy] += 1
    assert min(told.values()) > 10


def test_explain_says_why_it_asked_and_what_it_learned_a_step_later(logged):
    log = read_run(logged[2].bag)
    changed = 0
    steps = coordinations(log, 0)[:60]
    questions = list(explained(log, 0, steps))
    memory = memory_before(log.run.rule, log.run.scenario, 0)
    replay = Replay(log, trajectory_of(log, 0), agent_with(log, 0, memory))
    for place, one in enumerate(questions):
        lines = list(in_words(log, one))
        assert lines[1].startswith(f"  Q*[{one.cell}]: north ")
        assert ", coordinate " in lines[1]
        assert lines[2].startswith(f"  U[{one.cell}], alone: north ")
        if one.update is None or one.update.later is None:
            continue
        (cell, *_), before, after = one.update.later
        assert replay.advance(place + 2)
        assert replay.agent.values_asking(cell, one.perceived) == after
        assert f"    east {before[2]!r} -> {after[2]!r}" == lines[-2]
        changed += before != after
    assert changed > 30


def test_who_sees_its_peers_learns_of_them_without_an_answer(record):
    """As Algorithm 1 with peers seen while learning: Q^C of the joint state."""
    settings = {**EXPLORING, **SEEN, "perception": "probability:0.5"}
    log = read_run(record("env1", settings, values={"learner": "coop"}).bag)
    unanswered = [
        one
        for one in explained(log, 0, coordinations(log, 0))
        if one.perceived is None and one.update is not None
    ]
    changed = 0
    for one in unanswered:
        state, before, after = one.update.coord
        assert len(state) == 3
        changed += before != after
        assert any(f"{before!r} -> {after!r}" in line for line in in_words(log, one))
    assert changed > 10


def test_robots_that_see_their_peers_ask_only_where_that_pays(record):
    settings = {**EXPLORING, **SEEN, "penalty": -100, "steps": 500}
    log = read_run(record("env2-2r", settings, values={"learner": "voi"}).bag)
    steps = coordinations(log, 0)
    assert 0 < len(steps) < 0.5 * len(log.step)
    for one in explained(log, 0, steps):
        assert one.agrees and not one.reason.by_policy
        assert one.move == one.reason.move


def test_a_run_that_goes_on_from_tables(record, logged):
    tables = [robot.agent.tables for robot in logged[2].recording.robots]
    values = {"learner": "voi", "tables": "before", "seed": 8}
    settings = {**EXPLORING, "steps": 200}
    assert verify(record("env2-2r", settings, values=values, tables=tables).bag).same


def test_other_partners_in_the_log_differ(logged, rewritten, tmp_path):
    log = read_run(logged[4].bag)
    together = log.rewards[..., -1] > 0
    assert (
        together.sum() > 4
        and (log.rewards[..., -1][log.rewards[..., 1] == 0] == 0).all()
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
