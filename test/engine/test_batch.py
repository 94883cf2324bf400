# Copyright 2026 The sparse_coord_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Batches: the loops, compiled or plain, learn and play what single runs do, to the last bit."""

import os
import signal
import threading
import time

import numpy as np
import pytest
from teams import PROTOCOL, by_agents, memories_equal, same_bits, tables_equal

from sparse_coord_ros.base.errors import SettingError
from sparse_coord_ros.core.engine import batch
from sparse_coord_ros.core.engine.batch import Batch, run_batch, run_batches, uses_numba
from sparse_coord_ros.core.game.scenario import load_scenario
from sparse_coord_ros.core.learners import table
from sparse_coord_ros.core.learners.baselines import NonCoop
from sparse_coord_ros.core.learners.coop import Coop
from sparse_coord_ros.core.learners.registry import learner_of
from sparse_coord_ros.core.learners.rules import of_run
from sparse_coord_ros.core.runs.history import FIRST_EPISODES
from sparse_coord_ros.core.runs.run import LearningRun
from sparse_coord_ros.core.runs.team import Stopped, Team

pytestmark = pytest.mark.usefixtures("compiled_loops")

GIVEN = {**PROTOCOL, "steps": 1000, "penalty": -100, "q_star_init": 0}
"""Whatever the defaults are: robots that learn enough in so few steps to meet and to ask."""


def problem(name, **settings):
    return load_scenario(name).with_settings({**GIVEN, **settings})


def assert_same_run(one, other):
    assert one.seed == other.seed
    assert tables_equal(one.tables, other.tables)
    assert one.visited.tolist() == other.visited.tolist()
    if len(one.history.length) and len(other.history.length):
        assert same_bits(one.history, other.history)
    assert one.measures == other.measures


def test_penalties_are_paid_by_their_factors():
    scenario = problem(
        "env2-4r", interactions="together:any_doorway", common_reward="each:0:1:0.5:3"
    )
    [run] = run_batch(scenario, "coop", [7], trials=50)
    by_robot = run.measures.returns.mean(axis=0)
    assert by_robot.argmin() == 3 and by_robot.argmax() == 0


@pytest.mark.parametrize(
    ("worth", "engine", "used"),
    [(1000, "auto", "python"), (800, "auto", "numba"), (1000, "numba", "numba")],
)
def test_a_batch_is_compiled_if_that_pays(monkeypatch, worth, engine, used):
    """Here two runs of two robots, 200 steps each. The exact evaluation counts nothing."""
    monkeypatch.setattr(batch, "is_prepared", lambda **_: False)
    monkeypatch.setattr(batch, "is_loaded", lambda **_: False)
    monkeypatch.setattr(batch, "WORTH_COMPILING", worth)
    batches = [Batch(problem("env1", steps=200), learner_of("coop"), [1, 2])]
    runs = run_batches(batches, trials=10, engine=engine, jobs=2)
    assert {run.engine for run in runs} == {used}


def test_a_learner_is_compiled_when_its_turn_comes(monkeypatch):
    """The first results do not wait for the learners after them."""
    prepared = []
    monkeypatch.setattr(batch, "prepare", lambda rule: prepared.append(rule.label))
    small = problem("env1", steps=5)
    batches = [Batch(small, learner_of(name), [1, 2, 3]) for name in ("coop", "voi")]
    runs = run_batches(batches, trials=2, engine="numba", jobs=1)
    next(runs)
    assert prepared == ["coop"]
    assert len(list(runs)) == 5 and prepared == ["coop", "voi"]


CROWDS = {
    "coop": problem("crowd-3r", steps=500, peers="all", epsilon="constant:1"),
    "voi": problem(
        "env2-4r", steps=500, peers="all", epsilon="constant:0.5", max_steps=60
    ),
}
"""Teams whose tables get many rows."""


@pytest.mark.parametrize("learner", CROWDS)
@pytest.mark.parametrize("compiled", [False, True])
def test_tables_that_grow_on_the_way_learn_the_same(monkeypatch, learner, compiled):
    scenario = CROWDS[learner]
    team = Team(scenario, learner_of(learner), compiled=compiled)
    roomy = LearningRun(team, 2)
    roomy.advance(500)
    monkeypatch.setattr(table, "FIRST_ROWS", 2)
    run = LearningRun(team, 2)
    sizes = set()
    for until in range(25, 501, 25):
        run.advance(until)
        rows = run.minds[0].q_coord if learner == "coop" else run.minds[0].pairs
        assert rows.used.max() < rows.values.shape[1] <= rows.index.shape[1] / 2
        sizes.add(rows.values.shape[1])
    assert len(sizes) >= 3
    assert all(map(memories_equal, run.memories, roomy.memories))
    assert same_bits(run.history, roomy.history)


@pytest.mark.parametrize("learner", CROWDS)
def test_tables_of_agents_grow_on_the_way_too(monkeypatch, learner):
    rule = learner_of(learner)
    scenario = CROWDS[learner]
    roomy = LearningRun(Team(scenario, rule, compiled=False), 2)
    roomy.advance(500)
    monkeypatch.setattr(table, "FIRST_ROWS", 2)
    memories, history = by_agents(scenario, rule, 2)
    assert all(map(memories_equal, memories, roomy.memories))
    assert same_bits(history, roomy.history)


@pytest.mark.parametrize("compiled", [False, True])
def test_the_record_of_episodes_grows(compiled):
    scenario = problem("env1", max_steps=3)
    run = LearningRun(Team(scenario, Coop(), compiled=compiled), 2)
    run.advance(1000)
    memories, history = by_agents(scenario, Coop(), 2)
    assert history.episodes > 4 * FIRST_EPISODES
    assert history.length.sum() == 1000
    assert same_bits(run.history, history)
    assert all(map(memories_equal, run.memories, memories))


PLAIN = [(name, False) for name in (*CROWDS, "noncoop", "indiv")]


@pytest.mark.parametrize(
    ("learner", "compiled"), [*PLAIN, ("coop", True), ("voi", True)]
)
def test_trials_on_the_way_change_nothing(learner, compiled):
    """They perceive joint states that were not met, lose patience, and begin episodes."""
    scenario = CROWDS.get(learner, problem("env2-4r"))
    team = Team(scenario, learner_of(learner), compiled=compiled)
    run = LearningRun(team, 1)
    for until in (3, 250, 500):  # two of them in the middle of an episode
        run.advance(until)
        before = run.memories
        again, same = (run.play(5) for _ in range(2))
        assert again == same
        assert all(map(memories_equal, run.memories, before))
    unbroken = LearningRun(team, 1)
    unbroken.advance(500)
    assert all(map(memories_equal, run.memories, unbroken.memories))
    assert same_bits(run.history, unbroken.history)


def test_runs_side_by_side_learn_what_they_learn_one_after_the_other():
    """Threads share a team: what a run writes to is its own."""
    scenario = problem("cmu", steps=100_000, epsilon="constant:0.4")
    how = {"trials": 0, "engine": "numba", "history": True}
    alone = list(run_batch(scenario, "coop", range(4), jobs=1, **how))
    together = list(run_batch(scenario, "coop", range(4), jobs=4, **how))
    for one, other in zip(alone, together, strict=True):
        assert_same_run(one, other)


def test_two_runs_of_a_task_write_to_no_common_array():
    task = Coop().task(load_scenario("env1"))
    one = of_run(task, task.keys)
    other = of_run(task, task.keys)
    assert not np.shares_memory(one.full, other.full)


@pytest.mark.parametrize("compiled", [False, True])
def test_a_run_that_is_not_wanted_ends(compiled):
    stop = np.zeros(1, dtype=np.bool_)
    endless = problem("env1", steps=10**7, step_size="constant:0.1")
    team = Team(endless, Coop(), compiled=compiled, stop=stop)
    run = LearningRun(team, 1)
    run.advance(100)
    trials = 10**6 if compiled else 10**5
    for work in (lambda: run.advance(10**7), lambda: run.play(trials)):
        stop[0] = False
        timer = threading.Timer(0.05, stop.__setitem__, (0, True))
        timer.start()
        with pytest.raises(Stopped):
            work()
        timer.join()


def test_a_closed_batch_ends_soon():
    scenario = problem("crowd-8r", steps=10**7, step_size="constant:0.1")
    list(run_batch(problem("crowd-8r", steps=10), "coop", [0], trials=0))
    runs = run_batch(scenario, "coop", range(50), trials=0, jobs=2)
    before = signal.signal(signal.SIGINT, signal.default_int_handler)
    sent = []

    def interrupt():
        sent.append(time.process_time())
        os.kill(os.getpid(), signal.SIGINT)

    timer = threading.Timer(0.3, interrupt)
    timer.start()
    try:
        with pytest.raises(KeyboardInterrupt):
            next(runs)
    finally:
        signal.signal(signal.SIGINT, before)
    assert time.process_time() - sent[0] < 2, "the threads compute no further"


def test_numba_that_is_not_installed(monkeypatch):
    monkeypatch.setattr(batch, "has_numba", lambda: False)
    assert not uses_numba("auto")
    assert not uses_numba("python")
    with pytest.raises(SettingError, match="setting engine"):
        uses_numba("numba")
    (run,) = run_batch(problem("env1", steps=20), "coop", [0], trials=0, jobs=1)
    assert run.seed == 0


def test_batches_come_one_after_the_other_whatever_computes_them():
    class Plain(Coop):
        """In no module: it learns in this process."""

        name = "plain"

    rules = (Coop(), Plain(), NonCoop())
    asked = [
        Batch(problem("env1", steps=60 + k), rule, [k, k + 5])
        for k, rule in enumerate(rules)
    ]
    found = list(run_batches(asked, trials=2, jobs=2))
    assert [run.seed for run in found] == [0, 5, 1, 6, 2, 7]
    alone = [run for one in asked for run in run_batch(*one, trials=2, jobs=1)]
    for one, other in zip(found, alone, strict=True):
        assert_same_run(one, other)
