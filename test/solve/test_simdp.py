# Copyright 2026 The sparse_coord_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The planners with given places of interaction: games solved by hand, and what bounds them."""

import numpy as np
import pytest
from teams import drawn

from sparse_coord_ros.game.scenario import load_scenario
from sparse_coord_ros.solve import simdp
from sparse_coord_ros.solve.optimum import joint_optimum
from sparse_coord_ros.solve.simdp import LAPSI, MPSI, alpha_vectors, sparse_plan

ENV1 = load_scenario("env1", penalty=-100)


def surely(grid="1.D.2", **settings):
    return drawn(grid, penalty=-100, move_success=1, horizon=30, **settings)


def test_who_looks_ahead_lets_one_wait_and_who_does_not_waits_for_ever():
    # Of the cells 0 to 4 the middle one is the doorway. One robot waits for a step, at its start.
    # The first looks in steps 1, 2, 3 (cells 1, 2, 3 or back), the other in 2, 3, 4.
    plan = sparse_plan(surely(), LAPSI)
    assert plan.value == pytest.approx(100 * (0.95**3 + 0.95**4))
    assert plan.value - plan.priced == pytest.approx(0.95 / 2 + 0.95**2 + 0.95**3 + 0.95**4 / 2)
    assert plan.standard_error == pytest.approx(0.0)
    assert plan.miscoordinations == 0.0
    # Each takes the other for one that goes on, and waits for it.
    assert sparse_plan(surely(), MPSI).value == 0.0


def test_robots_that_never_interact_walk_straight():
    plan = sparse_plan(surely("1..3\n###.\n2..4", robots={"a": (1, 3), "b": (2, 4)}), MPSI)
    assert plan.value == plan.priced == pytest.approx(200 * 0.95**2)


def test_with_full_sight_looking_ahead_is_the_joint_optimum():
    for model in simdp._models(ENV1, LAPSI):
        start = [robot.start for robot in ENV1.robots]
        start = start if model.home[0] == ENV1.robots[0].goal else start[::-1]
        full = alpha_vectors(ENV1, model._replace(seen=np.ones_like(model.seen)))
        assert full[tuple(start)].max() == pytest.approx(joint_optimum(ENV1).value)
        assert (alpha_vectors(ENV1, model) <= full + 1e-6).all()


def test_the_alpha_vectors_promise_no_less_than_a_myopic_peer_lets_happen():
    models = simdp._models(ENV1, MPSI)
    alphas = [alpha_vectors(ENV1, model) for model in models]
    promised = alphas[0][tuple(robot.start for robot in ENV1.robots)].max()
    peer = models[1]
    far = ENV1.map.distances_to(peer.home[0])[peer.lead].T  # walks on, whoever is there
    alphas[1] = np.repeat(-far[:, None, :].astype(float), len(far), axis=1)
    rewards = simdp._play(ENV1, models, alphas, np.random.default_rng(0))[:, 0]
    error = rewards.std() / len(rewards) ** 0.5
    assert promised - 1.5 < rewards.mean() < promised + 3 * error


def test_a_belief_that_is_refuted_begins_anew():
    scenario = surely()
    [model, _] = simdp._models(scenario, MPSI)
    beliefs = np.array([[0.0, 0, 0, 1, 0], [0, 0, 0, 0, 1.0]])  # at 3, and walks to 2; at 4
    own, peer = np.array([0, 2]), np.array([4, 3])
    after = simdp._filtered(model, beliefs, own, own, peer)
    assert after[0].tolist() == [0, 0, 1, 0, 0]  # from cell 0 nothing is seen
    assert after[1].tolist() == [0, 0, 0, 1, 0]
    # Cells 1 to 3 are seen from the doorway: the peer is in none of them.
    [again] = simdp._filtered(model, beliefs[:1], own[1:], own[1:], np.array([4]))
    assert again.tolist() == [0.5, 0, 0, 0, 0.5]
