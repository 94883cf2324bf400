# Copyright 2026 The sparse_coord_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The learners of studies/entries.py against computations by hand."""

from importlib import import_module
from pathlib import Path

import numpy as np
import pytest

import sparse_coord_ros as sc
from sparse_coord_ros.base.errors import SettingError
from sparse_coord_ros.core.game.actions import COORDINATE, PRIMITIVES
from sparse_coord_ros.core.learners.cq import COUNT, MARKED
from sparse_coord_ros.core.learners.mind import team_mind
from sparse_coord_ros.core.learners.registry import learner_of
from sparse_coord_ros.core.learners.rules import Transition, joint_state, met

STUDIES = Path(__file__).parents[2] / "studies"
X, Y, PEER, PEER_NEXT = 3, 4, 10, 11
SEES_PEER = 0b10


@pytest.fixture
def entries(monkeypatch):
    monkeypatch.syspath_prepend(STUDIES)
    return import_module("entries")


def begun(learner, **settings):
    """Return a learner, its task and a team's mind before learning, in env1."""
    rule = learner_of(learner)
    scenario = sc.load_scenario(
        "env1", penalty=-100, step_size="constant:0.5", **settings
    )
    scenario = rule.with_defaults(scenario)
    task = rule.task(scenario, learning=True)
    return rule, task, team_mind(rule, scenario, [0, 1])


def transition(move, action=COORDINATE, common=0.0):
    asking = -1.0 if action == COORDINATE else 0.0
    return Transition(
        step=0,
        cell=X,
        action=action,
        move=move,
        answered=True,
        seen=SEES_PEER,
        cells=np.array([X, PEER]),
        next_cell=Y,
        next_cells=np.array([Y, PEER_NEXT]),
        individual=0.0,
        common=common,
        asking=asking,
        partners=-1,
    )


def row_of(mind, task, cell, peer):
    """Return the row of Q^C in a joint state, which is added."""
    state = joint_state(task, 0, cell, SEES_PEER, np.array([cell, peer]))
    return mind.q_coord.values[0, met(mind.q_coord, task, 0, state)]


def learn(rule, mind, task, now):
    after = rule.bootstrap(mind, task, 0, now.next_cell, now)
    rule.learn(mind, task, 0, now, after)
    return after


@pytest.mark.parametrize("prior", ["none", "map"])
def test_always_asks_in_each_step(entries, prior):
    scenario = sc.load_scenario("env1", penalty=-100, steps=2000, prior=prior)
    training = sc.train(scenario, entries.Always, seed=1, engine="python")
    visits = training.tables[0].memory["updates"]
    assert visits[:, COORDINATE].sum() > 100 and not visits[:, :PRIMITIVES].any()
    team = sc.evaluate_exact(training)
    assert team.mean("asks") == pytest.approx(team.mean("time_to_goal"))


def test_always_learns_as_algorithm_1(entries):
    rule, task, mind = begun(entries.Always)
    mind.q_star[0, X, COORDINATE] = 50.0
    mind.q_star[0, Y, COORDINATE] = 60.0
    row_of(mind, task, X, PEER)[1] = 40.0
    learn(rule, mind, task, transition(1, common=-100.0))
    target = -100.0 - 1.0 + 0.95 * 60.0
    assert row_of(mind, task, X, PEER)[1] == pytest.approx((40.0 + target) / 2)
    assert mind.q_star[0, X, COORDINATE] == pytest.approx((50.0 + target) / 2)


def test_always_refuses_questions_that_fail(entries):
    scenario = sc.load_scenario("env1", perception="probability:0.5")
    with pytest.raises(SettingError, match="entries:Always: perception is"):
        sc.train(scenario, entries.Always)


@pytest.mark.parametrize("name", ["Gate", "GPCQ"])
def test_those_for_pairs_refuse_other_teams_and_blind_learning(entries, name):
    learner = getattr(entries, name)
    four = sc.load_scenario("env2-4r", peers="all")
    with pytest.raises(SettingError, match="has 4 robots, allowed: 2"):
        sc.train(four, learner)
    with pytest.raises(SettingError, match="peers_seen: value is 'when_asked'"):
        sc.train(sc.load_scenario("env1", peers_seen="when_asked"), learner)


@pytest.mark.parametrize(
    ("asking", "after"), [(101.0, 90.0 - 1.0), (99.0, 70.0)], ids=["asks", "does not"]
)
def test_a_gate_learns_from_what_it_will_do(entries, asking, after):
    rule, task, mind = begun(entries.Gate)
    mind.q_star[0, Y] = [80.0, 100.0, 60.0, 60.0, asking]
    row_of(mind, task, Y, PEER_NEXT)[:] = [90.0, 70.0, 10.0, 10.0]
    mind.q_star[0, X] = [10.0, 20.0, 30.0, 40.0, 50.0]
    row_of(mind, task, X, PEER)[:] = [11.0, 22.0, 33.0, 44.0]
    assert learn(rule, mind, task, transition(2, action=0, common=-1.0)) == after
    # r^C counts for both robots; a question that it asked while learning costs nothing.
    learned = [11.0, 22.0, (33.0 - 2.0 + 0.95 * after) / 2, 44.0]
    assert row_of(mind, task, X, PEER) == pytest.approx(learned)
    means = (np.array([10.0, 20.0, 30.0, 40.0]) + learned) / 2
    assert mind.q_star[0, X, :PRIMITIVES] == pytest.approx(means)
    asked = (50.0 + max(learned) - 1.0) / 2
    assert mind.q_star[0, X, COORDINATE] == pytest.approx(asked)


def test_gpcq_bootstraps_on_a_marked_joint_state(entries):
    rule, task, mind = begun(entries.GPCQ)
    alone = mind.q_star[0, Y, :PRIMITIVES].max()
    now = transition(1, common=-100.0)
    assert rule.bootstrap(mind, task, 0, Y, now) == alone
    row_of(mind, task, Y, PEER_NEXT)[:] = [1.0, 7.0, 2.0, 3.0]
    assert rule.bootstrap(mind, task, 0, Y, now) == 7.0
    assert learner_of("cq").bootstrap(mind, task, 0, Y, now) == alone
    mind.samples[0, X, PRIMITIVES + PEER, COUNT] = MARKED
    before = mind.q_star[0, X, 1]
    learn(rule, mind, task, now)
    # The cost of a question does not count.
    learned = (before - 100.0 + 0.95 * 7.0) / 2
    assert row_of(mind, task, X, PEER)[1] == pytest.approx(learned)


def test_gpcq_explores_in_marked_joint_states_only(entries):
    rule, task, mind = begun(entries.GPCQ, epsilon="constant:1")
    cells = np.array([X, PEER])
    values = np.array([1.0, 5.0, 2.0, 3.0])

    def moves():
        return {
            rule.move_after_asking(mind, task, 0, step, X, SEES_PEER, cells, values)
            for step in range(100)
        }

    best = int(mind.q_star[0, X].argmax())
    assert {rule.decide(mind, task, 0, step, X) for step in range(100)} == {best}
    assert moves() == {1}
    mind.samples[0, X, PRIMITIVES + PEER, COUNT] = MARKED
    assert moves() == {0, 1, 2, 3}
