# Copyright 2026 The sparse_coord_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Learners of later papers, compiled: the bits of their agents, whole, in parts and from files."""

import numpy as np
import pytest
from teams import drawn, in_parts, whole

from sparse_coord_ros.engine import batch
from sparse_coord_ros.engine.batch import CompiledTeam, make_problem, run_batch
from sparse_coord_ros.engine.kernels import PLAIN
from sparse_coord_ros.engine.training import train
from sparse_coord_ros.errors import SettingError
from sparse_coord_ros.learn import loops
from sparse_coord_ros.engine.evaluation import play
from sparse_coord_ros.learners.registry import learner_of
from sparse_coord_ros.learners.tables import tables_equal
from sparse_coord_ros.solve.exact import evaluate_exact

SETTINGS = {"steps": 1500, "max_steps": 30, "penalty": -50, "epsilon": "constant:0.3"}
CASES = [
    {"perception": "probability:0.7", "common_reward": "each:1:0.5", "credit": "team"},
    {"goal_value": 0, "step_size": "constant:0.2", "ask_cost": 0},
    {"robots": {"a": (1, 2), "b": (2, 1), "c": (1, 2)}, "link": "bursts:0.1:0.2"},
]
LIVE, CENTRAL = ("cq",), ("joint",)


def problem(**settings):
    return drawn("1.D.2", **{**SETTINGS, **settings})


@pytest.mark.parametrize("learner", LIVE)
@pytest.mark.parametrize("settings", CASES)
def test_compiled_loops_equal_the_agents(learner, settings):
    scenario = problem(**settings)
    expected = whole(scenario, learner, 7)
    assert all(expected.visited > 0), "joint states were marked, and learned"
    run = CompiledTeam(scenario, learner).run(7, 30, gathering=True)
    assert tables_equal(run.tables, expected.tables)
    assert run.history.same_bits(expected.history)
    assert np.array_equal(run.visited, expected.visited)
    for who in (learner, None):  # their tables are acted on as Algorithm 1's
        played = play(scenario, expected.tables, trials=30, seed=7, learner=who)
        for mine, theirs in zip(vars(played).values(), vars(run.trials).values(), strict=True):
            assert mine.tobytes() == theirs.tobytes()


@pytest.mark.parametrize("learner", LIVE)
def test_a_run_in_parts_through_files_is_the_unbroken_run(monkeypatch, tmp_path, learner):
    monkeypatch.setattr(batch, "BLOCK", 64)
    scenario, rule = problem(perception="probability:0.8"), learner_of(learner)
    expected = whole(scenario, rule, 5)
    learning = in_parts(scenario, rule, 5, (1, 63, 64, 901, scenario.steps), tmp_path)
    assert tables_equal(learning.tables, expected.tables)
    assert learning.history.same_bits(expected.history)


@pytest.mark.parametrize("learner", LIVE)
def test_the_loops_as_plain_python(learner):
    scenario = problem()
    team = CompiledTeam(scenario, learner, loops=PLAIN)
    assert tables_equal(team.tables(team.learn(3)), whole(scenario, learner, 3).tables)


@pytest.mark.parametrize("learner", CENTRAL)
def test_learners_that_see_everything(tmp_path, learner):
    """Plain Python and compiled, whole, in parts through files, and in trials."""
    scenario, rule = problem(common_reward="each:1:0.5"), learner_of(learner)
    plain, quick = (train(scenario, learner, 5, engine=one) for one in ("python", "numba"))
    assert (plain.engine, quick.engine) == ("python", "numba")
    assert tables_equal(plain.tables, quick.tables) and plain.history.same_bits(quick.history)
    assert all((tables.q_coord.std(axis=1) > 0).any() for tables in plain.tables)
    runs = [next(run_batch(scenario, rule, [5], trials=30, engine=e)) for e in ("python", "numba")]
    assert tables_equal(runs[0].tables, plain.tables)
    played = play(scenario, plain.tables, trials=30, seed=5, learner=learner)
    assert (played.asks == played.time_to_goal).all(), "they look in every step"
    for one in runs:
        assert one.trials.reward.tobytes() == played.reward.tobytes()
    file = tmp_path / "checkpoint.npz"
    train(scenario, learner, 5, engine="numba", checkpoint=file, until=701)
    on = train(scenario, learner, 5, engine="python", checkpoint=file, resume=True)
    assert tables_equal(on.tables, plain.tables) and on.history.same_bits(plain.history)


def transition(learner, cells, moves, after):
    """Let two robots learn from one transition; return the values before and after."""
    scenario, rule = problem(ask_cost=1), learner_of(learner)
    minds = rule.minds.initial(scenario, rule, 1)
    game = loops.GameState(np.zeros(5, np.int64), np.array(cells), np.array([0, 0], np.int8))
    state = loops.State(
        make_problem(scenario, rule, np.arange(2)),
        game,
        loops.Choices(np.zeros(2, np.int64), np.zeros(2, np.int64), np.array(moves), None),
        None,
    )
    before = minds.rows.values.copy()
    rule.minds.begin_step(state, minds)
    game.cells[:] = after
    for k in range(2):
        seen = loops.Transition(0, k, after[k], (0.0, -50.0, -1.0), 0.0)
        rule.minds.learn(state, minds, seen)
    return before, minds.rows.values


EAST, WEST = 2, 3


def test_joint_states_bootstrap_on_the_next_joint_state():
    before, after = transition("joint", (1, 3), (EAST, WEST), (2, 2))
    for k, (row, move) in enumerate([(1 * 5 + 3, EAST), (3 * 5 + 1, WEST)]):
        expected = -50.0 - 1.0 + 0.95 * before[k, 2 * 5 + 2].max()  # the first step size is 1
        assert after[k, row, move] == pytest.approx(expected, rel=1e-14)
        after[k, row, move] = before[k, row, move]
    assert (after == before).all()


@pytest.mark.parametrize(
    "settings", [CASES[2], {"perception": "probability:0.5"}, {"link": "dead:5"}]
)
def test_what_cannot_be_seen_always(settings):
    with pytest.raises(SettingError, match="allowed: 2, at most 724, always, up"):
        learner_of("joint").check(problem(**settings))


@pytest.mark.parametrize("learner", LIVE)
def test_exact_evaluation(learner):
    scenario = problem(perception="probability:0.5")
    tables = whole(scenario, learner, 1).tables
    exact = evaluate_exact(scenario, tables, learner=learner)
    assert exact.asks.mean > 0.1
    trials = play(scenario, tables, trials=1500, seed=3).reward.mean(axis=1)
    assert abs(exact.reward.mean - trials.mean()) < 5 * trials.std() / len(trials) ** 0.5
