# Copyright 2026 The sparse_coord_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Batches: the loops, compiled or plain, learn and play what single runs do, to the last bit."""

import os
import signal
import threading
import time
from dataclasses import fields, replace

import numpy as np
import pytest
from teams import PROTOCOL

from sparse_coord_ros.engine import batch, kernels
from sparse_coord_ros.engine.batch import Batch, CompiledTeam, run_batch, run_batches, uses_numba
from sparse_coord_ros.engine.kernels import PLAIN
from sparse_coord_ros.errors import SettingError
from sparse_coord_ros.game.actions import COORDINATE
from sparse_coord_ros.game.scenario import load_scenario
from sparse_coord_ros.engine.evaluation import play
from sparse_coord_ros.learners.registry import Coop, NonCoop
from sparse_coord_ros.learn.rows import FREE_PLACE
from sparse_coord_ros.engine.run import Learning
from sparse_coord_ros.learners.tables import tables_equal

GIVEN = {**PROTOCOL, "steps": 1000, "penalty": -100, "q_star_init": 0}
"""Whatever the defaults are: robots that learn enough in so few steps to meet and to ask."""


def problem(name, **settings):
    return load_scenario(name).with_settings({**GIVEN, **settings})


def single(scenario, learner, seed, trials):
    """Return the run as the core makes it."""
    learning = Learning(scenario, learner, seed)
    learning.advance(scenario.steps)
    played = play(scenario, learning.tables, trials=trials, seed=seed)
    return replace(batch.result_of(learning, "python"), trials=played)


def assert_same_run(one, other):
    assert one.seed == other.seed
    assert tables_equal(one.tables, other.tables)
    assert one.visited.tolist() == other.visited.tolist()
    if len(one.history.length) and len(other.history.length):
        assert one.history.same_bits(other.history)
    assert_same_trials(one.trials, other.trials)


def assert_same_trials(one, other):
    for field in fields(one):
        mine, theirs = (getattr(trials, field.name) for trials in (one, other))
        assert mine.shape == theirs.shape and mine.dtype == theirs.dtype, field.name
        assert mine.tobytes() == theirs.tobytes(), field.name


CASES = [
    ("env1", "coop", {}),
    ("env1", "noncoop", {}),
    ("env1", "indiv", {}),
    ("env2-4r", "indiv", {"starts": "mixed:0.5"}),
    ("env2-4r", "noncoop", {"conflict": "any_doorway"}),
    ("env2-4r", "coop", {"conflict": "any_doorway", "max_steps": 9}),
    ("env1", "coop", {"perception": "never"}),
    ("env1", "coop", {"perception": "probability:0.7", "goal_value": 0, "starts": "fixed"}),
    ("env2-4r", "coop", {"perception": "line_of_sight"}),
    ("env2-4r", "coop", {"perception": "range:3", "move_success": 1}),
    (
        "env2-2r",
        "coop",
        {"starts": "exploring:1:0.1:0.8", "step_size": "floored:0.7:0.2:0.01", "horizon": 70},
    ),
    ("env2-4r", "coop", {"common_reward": "each:0:1:0.5:3"}),
    ("env2-2r", "coop", {"peers": "all", "perception": "probability:0.7"}),
    ("crowd-3r", "coop", {"peers": "all"}),
    ("crowd-3r", "coop", {"peers": "all", "perception": "probability:0.7", "max_steps": 30}),
    ("env1", "coop", {"link": "lost:0.3"}),
    ("env2-4r", "coop", {"link": "bursts:0.05:0.2", "perception": "probability:0.7"}),
    ("crowd-3r", "coop", {"peers": "all", "link": "dead:1000", "max_steps": 30}),
]


@pytest.mark.parametrize(("name", "learner", "settings"), CASES)
def test_compiled_loops_equal_a_single_run(name, learner, settings):
    scenario = problem(name, **settings)
    expected = single(scenario, learner, 7, 20)
    team = CompiledTeam(scenario, learner)
    assert_same_run(team.run(7, 20), expected)
    assert_same_run(team.run(7, 20, gathering=True), expected)
    if learner == "coop":
        assert (expected.visited.min() > 5) == (settings.get("perception") != "never")
        learners = team.learn(7)
        for asking in (learners.q_star, *(pair.q_star[None] for pair in expected.tables)):
            asking[:, ::3, COORDINATE] += 1000.0
        one, other = (
            team.play(learners, 8, 20),
            play(scenario, expected.tables, trials=20, seed=8),
        )
        assert_same_trials(one, other)
        assert one.asks.sum() > 100
        assert one.arrived.any()
        assert (one.stays >= one.asked).all()


def test_trials_meet_and_penalties_are_paid():
    """The cases above would say little if nobody ever met in a doorway."""
    scenario = problem("env2-4r", conflict="any_doorway", common_reward="each:0:1:0.5:3")
    run = CompiledTeam(scenario, "noncoop").run(7, 50)
    assert run.trials.miscoordinations.sum() > 0
    by_robot = run.trials.reward.mean(axis=0)
    assert by_robot.argmin() == 3 and by_robot.argmax() == 0


@pytest.mark.parametrize(
    ("name", "learner", "settings"),
    [
        ("env1", "coop", {"perception": "probability:0.7"}),
        ("env1", "indiv", {}),
        ("crowd-3r", "coop", {"peers": "all", "common_reward": "each:1:0:2"}),
    ],
)
def test_the_loops_as_plain_python(monkeypatch, name, learner, settings):
    monkeypatch.setattr(batch, "BLOCK", 64)
    scenario = problem(name, steps=300, **settings)
    expected = single(scenario, learner, 3, 4)
    assert_same_run(CompiledTeam(scenario, learner, loops=PLAIN).run(3, 4), expected)


@pytest.mark.parametrize("loops", [PLAIN, None], ids=["plain", "compiled"])
def test_sparse_tables_grow_and_always_keep_a_free_place(monkeypatch, loops):
    monkeypatch.setattr(batch, "BLOCK", 32)
    scenario = problem("crowd-3r", peers="all", epsilon="constant:1", steps=2000)
    sizes = []

    def learn(state, minds, record):
        rows = minds.rows
        before = rows.keys.shape[1]
        assert before & (before - 1) == 0
        assert rows.used.max() + 32 <= before / 2
        team.loops.learn(state, minds, record)
        for k in range(3):
            assert (rows.keys[k] != FREE_PLACE).sum() == rows.used[k]
        assert rows.used.max() <= before / 2
        sizes.append(before)

    team = CompiledTeam(scenario, "coop", loops=loops)
    minds = CompiledTeam(scenario, "coop", loops=team.loops._replace(learn=learn)).learn(2)
    learners = minds.rows
    assert len(sizes) >= 4
    assert sizes == sorted(set(sizes))
    assert learners.used.min() > 64
    expected = single(scenario, "coop", 2, 2)
    assert tables_equal(team.tables(minds), expected.tables)
    assert [len(pair.q_coord) for pair in expected.tables] == learners.used.tolist()


def test_what_trials_look_at_is_not_saved():
    """Trials with hardly any learning before them perceive joint states without an update."""
    scenario = problem("crowd-3r", peers="all", steps=3)
    team = CompiledTeam(scenario, "coop")
    learners = team.with_room(team.learn(1))
    before = team.tables(learners)
    used = learners.rows.used.copy()
    trials = team.play(learners, 1, 20)
    assert trials.asks.sum() > 100
    assert (learners.rows.used > used).all()
    assert tables_equal(team.tables(learners), before)
    assert max(len(pair.q_coord) for pair in before) <= 3
    assert_same_run(team.run(1, 20), single(scenario, "coop", 1, 20))


def test_both_engines_give_the_same_runs_in_the_order_of_the_seeds():
    settings = {"peers": "all", "perception": "probability:0.8", "q_star_init": 250}
    scenario = problem("crowd-3r", steps=400, **settings)
    seeds = [11, 3, 8]
    plain, numba = (
        list(run_batch(scenario, "coop", seeds, trials=10, engine=engine, jobs=2, history=True))
        for engine in ("python", "numba")
    )
    assert [run.seed for run in numba] == seeds
    for one, other in zip(plain, numba, strict=True):
        assert one.history.episodes > 0 and one.history.same_bits(other.history)
        assert_same_run(one, other)
        assert other.trials.asks.sum() > 0
    assert not tables_equal(numba[0].tables, numba[1].tables)


def test_a_run_that_nobody_waits_for_ends_with_its_block(monkeypatch):
    stop, blocks = np.zeros(1, dtype=np.bool_), []
    begin_block = kernels.begin_block

    def begin_three_times(*arguments):
        blocks.append(begin_block(*arguments))
        stop[0] = len(blocks) == 3

    monkeypatch.setattr(batch, "BLOCK", 32)
    monkeypatch.setattr(kernels, "begin_block", begin_three_times)
    team = CompiledTeam(problem("env1", steps=10**5), "coop", stop, loops=PLAIN)
    with pytest.raises(batch.Stopped):
        team.learn(1)
    assert len(blocks) == 3
    learners = CompiledTeam(problem("env1", steps=10), "coop").learn(1)
    stop[0] = False
    blocks.clear()
    with pytest.raises(batch.Stopped):
        team.play(learners, 1, 10**5)
    assert len(blocks) == 3


def test_a_closed_batch_ends_soon():
    scenario = problem("crowd-8r", steps=10**7)
    list(run_batch(problem("crowd-8r", steps=10), "coop", [0], trials=0))
    runs = run_batch(scenario, "coop", range(50), trials=0, jobs=2)
    before = signal.signal(signal.SIGINT, signal.default_int_handler)
    timer = threading.Timer(1.0, os.kill, (os.getpid(), signal.SIGINT))
    timer.start()
    started = time.monotonic()
    try:
        with pytest.raises(KeyboardInterrupt):
            next(runs)
    finally:
        signal.signal(signal.SIGINT, before)
    assert time.monotonic() - started < 3


def test_numba_that_is_not_installed(monkeypatch):
    monkeypatch.setattr(batch, "has_numba", lambda: False)
    assert not uses_numba("auto")
    assert not uses_numba("python")
    with pytest.raises(SettingError, match="engine: value is 'numba'.* pip install numba"):
        uses_numba("numba")
    (run,) = run_batch(problem("env1", steps=20), "coop", [0], trials=0, jobs=1)
    assert run.seed == 0


def test_batches_come_one_after_the_other_whatever_computes_them():
    class Plain(Coop):
        """Without a compiled form, and in no module: it learns in this process."""

        name = "plain"
        minds = None

    rules = (Coop(), Plain(), NonCoop())
    asked = [
        Batch(problem("env1", steps=60 + k), rule, [k, k + 5]) for k, rule in enumerate(rules)
    ]
    found = list(run_batches(asked, trials=2, jobs=2))
    assert [run.seed for run in found] == [0, 5, 1, 6, 2, 7]
    alone = [run for one in asked for run in run_batch(*one, trials=2, jobs=1)]
    for one, other in zip(found, alone, strict=True):
        assert_same_run(one, other)
