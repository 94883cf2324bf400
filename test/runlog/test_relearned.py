# Copyright 2026 The sparse_coord_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The tables of any time step, learned again from a log, are those of the run at that step."""

import numpy as np
import pytest
from teams import Traces, plain_run, tables_equal

from sparse_coord_ros.log.runlog import read_run, relearned, verify
from sparse_coord_ros.log.runlog.growing import GrowingLog
from sparse_coord_ros.log.runlog.relearned import Relearned
from sparse_coord_ros.protocol.wire.messages import Messages


@pytest.fixture(params=["coop", "voi", Traces()], ids=["coop", "voi", "traces"])
def bag(record, request):
    settings = {"steps": 500, "perception": "probability:0.6", "max_steps": 40}
    values = {"checkpoint": 250, "learner": request.param}
    return record(settings=settings, values=values).bag


def check(bag, count):
    """Compare the tables of so many random steps with those of `train`, stopped there."""
    log = GrowingLog(bag)
    whole = read_run(bag)
    rng = np.random.default_rng(3)
    steps = [*rng.integers(0, log.last_step + 1, count).tolist(), 0, log.last_step]
    steps += [333, 334, 340, 333, 335]  # back and on again
    done = np.searchsorted(
        whole.step[~np.isnan(whole.rewards[:, :, 0]).all(axis=1)], steps
    )
    again = Relearned(log)
    found = {}
    for step in steps:  # in any order
        tables = again.tables(step)
        assert {at for at, _ in tables.values()} == {step}
        found[step] = {k: one for k, (_, one) in tables.items()}
    training = plain_run(log.run.scenario, log.run.learner, log.run.seed)
    for step, transitions in sorted(zip(steps, done.tolist(), strict=True)):
        training.advance(transitions)
        assert tables_equal(list(found[step].values()), training.tables), step


def test_tables_of_any_step_are_those_of_train_stopped_there(bag, monkeypatch):
    monkeypatch.setattr(relearned, "AT_ONCE", 150)
    check(bag, 6)


@pytest.mark.long
@pytest.mark.parametrize("learner", ["coop", "voi"])
@pytest.mark.parametrize("kept", [1, 10**9])
def test_tables_of_50_random_steps(record, monkeypatch, learner, kept):
    monkeypatch.setattr(relearned, "MOST_BYTES", kept)
    check(record(settings={"steps": 20_000}, values={"learner": learner}).bag, 50)


def test_what_nobody_wants_any_more_gives_the_recorded_tables(bag):
    log = GrowingLog(bag)
    at = log.so_far.table_steps()[0][1]
    recorded = log.so_far.tables_before(0, at).tables
    found = Relearned(log).tables(at + 50, lambda: False)
    assert found[0][0] == at and tables_equal([found[0][1]], [recorded])


def test_behind_a_loss_the_recorded_tables_are_given(record, rewritten, tmp_path):
    run = record(settings={"steps": 800}, values={"checkpoint": 250})
    lost = [(300 + n) * Messages(run.run).period for n in range(5)]
    directory = rewritten(
        run.bag,
        tmp_path / "bag",
        lambda messages: [one for one in messages if one.log_time_ns not in lost],
    )
    log = GrowingLog(directory)
    again = Relearned(log)
    before, behind = [at for at in log.so_far.table_steps()[0] if 0 < at][:2]
    assert again.tables(320)[0][0] == before < 300 < behind
    assert again.tables(behind + 10)[0][0] == behind + 10


def test_a_log_of_a_learner_with_a_memory_of_its_own(record, tmp_path):
    """It begins each episode anew, live and in the log, also where a part of the log is lost."""
    values = {"checkpoint": 40, "learner": Traces()}
    settings = {"steps": 400, "max_steps": 15}
    run = record(settings=settings, values=values)
    found = verify(run.bag)
    assert found.same and found.tables > 10
    learned = plain_run(run.run.scenario, run.run.learner, run.run.seed)
    learned.advance(400)
    mine = [robot.agent.tables for robot in run.recording.robots]
    assert tables_equal(mine, learned.tables)
