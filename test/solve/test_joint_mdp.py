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
    ("name", "settings"),
    [
        ("env1", {}),
        ("env1", {"penalty": -100}),
        ("env1", {"interactions": "together:any_doorway"}),
        ("env1", {"interactions": "swap"}),
        ("env1", {"interactions": "block"}),
        ("env1", {"interactions": "together+swap+block:anywhere"}),
    ],
)
def test_value_iteration_finds_the_optimum(name, settings):
    scenario = load_scenario(name, **settings)
    mdp = joint_mdp(scenario)
    states = len(scenario.map.cells) ** 2
    assert mdp.R.shape == (states, 16)
    assert mdp.actions.shape == (16, 2)
    for matrix in mdp.P:
        assert np.allclose(matrix.sum(axis=1), 1.0)
    values = np.zeros(states)
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
