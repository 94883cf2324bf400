# Copyright 2026 The sparse_coord_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Algorithm 1 of Melo & Veloso (AAMAS 2009): Q* over the own cell, Q^C over joint states.

The lines are those of Algorithm 1. Line 4 is the hook `decide` of the base class. Lines 2, 3, 5,
11, 16, 19 and 20 are the caller's: percepts, moves and time (`core.runs.loop`, or the robot's
node).
"""

from typing import Any, NamedTuple

import numpy as np

from sparse_coord_ros.base.errors import SettingError
from sparse_coord_ros.core.game.actions import ACTIONS, PRIMITIVES
from sparse_coord_ros.core.game.scenario import WHILE_LEARNING, Scenario
from sparse_coord_ros.core.game.world import RewardWeights
from sparse_coord_ros.core.learners.learner import Learner
from sparse_coord_ros.core.learners.lone import known_q_star
from sparse_coord_ros.core.learners.rules import (
    Task,
    Transition,
    copy_moves,
    greatest,
    joint_state,
    ql_update,
    reward_of,
)
from sparse_coord_ros.core.learners.table import Table, find, met, table

MOST_JOINT_STATES = 2**63
"""Joint states are numbered by 64-bit integers."""


class Coop(Learner):
    """Algorithm 1 of the paper."""

    name = "coop"
    summary = "Algorithm 1"

    class Mind(NamedTuple):
        """The learned tables; k is a robot, x its cell.

        Attributes:
            q_star: Q*_k(x, a) [k, x, action].
            updates: how often each entry of it was updated.
            q_coord: Q^C_k: a row [move] for each joint state that was perceived.
        """

        q_star: Any
        updates: Any
        q_coord: Table

    def check(self, scenario: Scenario) -> None:
        """Raise `SettingError` where joint states have no number, or too many."""
        super().check(scenario)
        peers = len(scenario.robots) - 1
        if scenario.peers_seen == WHILE_LEARNING and scenario.perceived - 1 < peers:
            raise SettingError(
                f"setting peers: value is 'one', allowed with learner {self.label}, "
                f"peers_seen={WHILE_LEARNING} and {peers} peers: all, as it learns from the "
                "joint states of all robots; set peers=all"
            )
        cells = len(scenario.map.cells)
        if cells**scenario.perceived >= MOST_JOINT_STATES:
            raise SettingError(
                "setting peers: value is 'all', allowed with this learner below 2^63 joint "
                f"states; scenario {scenario.name} has {cells}^{scenario.perceived}; use 'one', "
                "fewer robots, or learner voi"
            )

    @staticmethod
    def initial(scenario: Scenario, robot: int) -> Any:
        """Return a robot's tables before learning (line 1)."""
        cells = len(scenario.map.cells)
        first = np.full((1, PRIMITIVES), scenario.q_coord_init)
        return Coop.Mind(
            q_star=np.full((cells, len(ACTIONS)), scenario.q_star_init),
            updates=np.zeros((cells, len(ACTIONS)), dtype=np.int64),
            q_coord=table(cells**scenario.perceived, first),
        )

    @staticmethod
    def informed(
        mind: Any, scenario: Scenario, robot: int, weights: RewardWeights
    ) -> Any:
        """Return the tables of a robot that knows its map: rows of Q^C begin there, too."""
        q_star = known_q_star(scenario, robot, weights, mind.q_star)
        q_coord = table(mind.q_coord.most, q_star[:, :PRIMITIVES])
        return mind._replace(q_star=q_star, q_coord=q_coord)

    @staticmethod
    def asking_values(
        mind: Any, task: Task, k: int, cell: int, seen: int, cells: Any, values: Any
    ) -> None:
        """Set the values by which COORDINATE chooses a move."""
        if seen == 0:
            copy_moves(mind.q_star[k, cell], values)  # line 9
            return
        state = joint_state(task, k, cell, seen, cells)
        row = find(mind.q_coord, k, state)
        copy_moves(mind.q_coord.values[k, row], values)  # line 7

    @staticmethod
    def bootstrap(mind: Any, task: Task, k: int, cell: int, now: Transition) -> float:
        """Return max_b Q*(cell, b)."""
        return greatest(mind.q_star[k, cell], task.actions)

    @staticmethod
    def learn(mind: Any, task: Task, k: int, now: Transition, after: float) -> None:
        """Update Q^C if it knows a peer's cell, then Q*."""
        reward = reward_of(task, now)
        if now.seen != 0:  # line 12
            state = joint_state(task, k, now.cell, now.seen, now.cells)
            row = met(mind.q_coord, task, k, state)
            values = mind.q_coord.values[k, row]
            updates = mind.q_coord.updates[k, row]
            # line 13
            ql_update(values, updates, now.move, task, now.step, reward, after)
        values = mind.q_star[k, now.cell]
        updates = mind.updates[k, now.cell]
        # line 18
        ql_update(values, updates, now.action, task, now.step, reward, after)
