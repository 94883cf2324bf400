# Copyright 2026 The sparse_coord_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The joint finite MDP of a scenario as arrays P and R, for planners that others wrote.

One controller sees the joint state, chooses every robot's move and pays nothing for asking: the
problem whose value `optimum` computes.
"""

import functools
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import product
from typing import Any

import numpy as np

from sparse_coord_ros.base.errors import SettingError
from sparse_coord_ros.core.game.actions import OUTCOMES, PRIMITIVES, STAY
from sparse_coord_ros.core.game.interactions import interactions_of, only_together
from sparse_coord_ros.core.game.scenario import Scenario, ScenarioLike, loaded
from sparse_coord_ros.core.solve.optimum import (
    MOST_JOINT_OUTCOMES,
    MOST_JOINT_STATES,
    is_too_large,
    joint_outcomes,
    payment,
    successors,
)

Moves = Sequence[tuple[int, ...]]
"""The moves of each joint action, one a robot."""


@dataclass(frozen=True)
class JointMDP:
    """A finite MDP.

    Attributes:
        P: for each joint action a sparse matrix of SciPy, shape (states, states): the probability
            of the next state [s, s'].
        R: expected reward, averaged over the robots, shape (states, actions).
        discount: gamma.
        start: number of the scenario's joint start.
        goal: number of the state in which all have arrived; it is absorbing and pays goal_reward a
            step.
        shape: (cells,) * robots: `numpy.unravel_index` gives a state's cells by it.
        actions: the moves of each joint action, shape (actions, robots), as of
            `core.game.actions`.
    """

    P: tuple[Any, ...]
    R: np.ndarray
    discount: float
    start: int
    goal: int
    shape: tuple[int, ...]
    actions: np.ndarray

    def __repr__(self) -> str:
        """Return a one-line description."""
        return "<JointMDP of {} states and {} actions>".format(*self.R.shape)


def joint_mdp(scenario: ScenarioLike) -> JointMDP:
    """Return the finite MDP whose value `optimum` computes, as arrays for planners.

    One controller sees every robot's cell, chooses every robot's move, and pays nothing for
    asking: `P[a]` holds the probabilities of the next joint state, `R` the expected rewards.

    Raises:
        SettingError: it has more than 100,000 joint states, or with swap or block more
            than 33,554,432 outcomes of joint steps.
    """
    scenario = loaded(scenario)
    cells = len(scenario.map.cells)
    team = range(len(scenario.robots))
    states = cells ** len(team)
    if is_too_large(scenario):
        what = f"{states:,} joint states"
        allowed = f"{MOST_JOINT_STATES:,}"
        if states <= MOST_JOINT_STATES:
            what = f"{states * OUTCOMES ** len(team):,} outcomes of joint steps"
            allowed = f"{MOST_JOINT_OUTCOMES:,}"
        raise SettingError(
            f"scenario {scenario.name}: has {what}, allowed for a joint MDP: up to {allowed}; "
            "choose fewer robots or a smaller map"
        )
    shape = (cells,) * len(team)
    starts, goals = zip(
        *((robot.start, robot.goal) for robot in scenario.robots), strict=True
    )
    goal = int(np.ravel_multi_index(goals, shape))
    chosen = list(product(range(PRIMITIVES), repeat=len(team)))
    if only_together(interactions_of(scenario)):
        transitions, rewards = _independent(scenario, chosen)
    else:
        transitions, rewards = _by_outcomes(scenario, chosen)
    rewards[goal] = scenario.goal_reward
    return JointMDP(
        tuple(transitions),
        rewards,
        scenario.discount,
        int(np.ravel_multi_index(starts, shape)),
        goal,
        shape,
        np.array(chosen),
    )


def _independent(scenario: Scenario, actions: Moves) -> tuple[list[Any], np.ndarray]:
    """Return P and R of robots that move independently."""
    from scipy import sparse

    p = scenario.move_success
    # row x is cell x: stays[to] leads to `to`
    stays = sparse.identity(len(scenario.map.cells), format="csr")
    own = [
        [p * stays[to] + (1.0 - p) * stays for to in successors(scenario, k)]
        for k in range(len(scenario.robots))
    ]
    both = functools.partial(sparse.kron, format="csr")
    transitions = [
        sparse.csr_array(
            functools.reduce(both, [own[k][move] for k, move in enumerate(moves)])
        )
        for moves in actions
    ]
    paid = payment(scenario).ravel()
    return transitions, np.column_stack([matrix @ paid for matrix in transitions])


def _by_outcomes(scenario: Scenario, actions: Moves) -> tuple[list[Any], np.ndarray]:
    """Return P and R of robots that swap or block."""
    from scipy import sparse

    p = scenario.move_success
    after, paid = joint_outcomes(scenario)
    states = after.shape[-1]
    rows = np.arange(states)
    transitions = []
    rewards = np.zeros((states, len(actions)))
    for number, moves in enumerate(actions):
        total = sparse.csr_array((states, states))
        for succeeds in product((True, False), repeat=len(moves)):
            outcome = tuple(np.where(succeeds, moves, STAY))
            probability = float(np.prod(np.where(succeeds, p, 1.0 - p)))
            likely = np.full(states, probability)
            total += sparse.csr_array((likely, (rows, after[outcome])), total.shape)
            rewards[:, number] += probability * paid[outcome]
        transitions.append(total)
    return transitions, rewards
