# Copyright 2026 The sparse_coord_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The joint MDP as arrays: its value by value iteration is the joint optimum."""

import numpy as np
import pytest

import sparse_coord_ros as sc
from sparse_coord_ros.core.game.scenario import load_scenario
from sparse_coord_ros.core.solve.joint_mdp import JointMDP, joint_mdp
from sparse_coord_ros.core.solve.optimum import joint_optimum


@pytest.mark.parametrize(
    "settings",
    [
        {},
        {"penalty": -100},
        {"interactions": "together:any_doorway"},
        {"interactions": "swap"},
        {"interactions": "block"},
        {"interactions": "together+swap+block:anywhere"},
    ],
)
def test_value_iteration_finds_the_optimum(settings):
    scenario = load_scenario("env1", **settings)
    mdp = joint_mdp(scenario)
    assert mdp.R.shape == (441, 16)
    assert mdp.actions.shape == (16, 2)
    for matrix in mdp.P:
        assert np.allclose(matrix.sum(axis=1), 1.0)
    values = np.zeros(441)
    for _ in range(700):
        values = np.max(
            [mdp.R[:, a] + mdp.discount * (p @ values) for a, p in enumerate(mdp.P)], 0
        )
    assert values[mdp.start] == pytest.approx(joint_optimum(scenario).value, abs=1e-9)
    assert values[mdp.goal] == pytest.approx(200.0)


def test_in_the_api():
    mdp = sc.joint_mdp("env1")
    assert isinstance(mdp, JointMDP)
    assert (sc.JointMDP, mdp.shape) == (JointMDP, (21, 21))
