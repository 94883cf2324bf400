# Copyright 2026 The sparse_coord_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Joint-state Q-learning of two robots that always see each other.

Each learns for itself, by Watkins' Q-learning, over the joint state. Q^C begins at the Q* of a
lone robot that pays as much (`core.learners.lone`). It bootstraps on itself, as the robot also
sees the next joint state:

    Q^C(x, z, a) = (1 - alpha) Q^C(x, z, a) + alpha (r + gamma max_b Q^C(y, z', b)).

Every step costs a question. COORDINATE stands above all moves in every cell.
"""

from types import MappingProxyType
from typing import Any, NamedTuple

import numpy as np

from sparse_coord_ros.base.errors import SettingError
from sparse_coord_ros.core.game.actions import ACTIONS, COORDINATE, PRIMITIVES
from sparse_coord_ros.core.game.scenario import WHILE_LEARNING, Scenario
from sparse_coord_ros.core.game.world import RewardWeights
from sparse_coord_ros.core.learners.coop import Coop
from sparse_coord_ros.core.learners.learner import Learner
from sparse_coord_ros.core.learners.lone import lone_values
from sparse_coord_ros.core.learners.rules import (
    Task,
    Transition,
    greatest,
    joint_state,
    ql_update,
    reward_of,
)
from sparse_coord_ros.core.learners.table import Table, find, met, table

MARK = 1.0
"""How far COORDINATE is above the best move."""


class Joint(Learner):
    """Joint-state Q-learning."""

    name = "joint"
    summary = "Q-learning of two robots on the joint state, which both always know"
    needs_map = True
    defaults = MappingProxyType({"peers_seen": WHILE_LEARNING})

    class Mind(NamedTuple):
        """The learned tables of a robot.

        Attributes:
            q_star: Q* of a lone robot that asks everywhere [k, x, action].
            updates: how often it has learned in each cell, in the column of COORDINATE.
            q_coord: Q^C: a row [move] for each joint state.
        """

        q_star: Any
        updates: Any
        q_coord: Table

    def check(self, scenario: Scenario) -> None:
        """Raise `SettingError` unless two robots know their map and can always see each other."""
        super().check(scenario)
        if scenario.peers_seen != WHILE_LEARNING:
            raise SettingError(
                f"setting peers_seen: value is {scenario.peers_seen!r}, allowed with learner "
                f"{self.label}: {WHILE_LEARNING}, as it learns from joint states; leave "
                "peers_seen out"
            )
        sees = scenario.perception.kind == "always"
        if len(scenario.robots) != 2 or not sees:
            raise SettingError(
                f"learner {self.label}: scenario {scenario.name} has {len(scenario.robots)} "
                f"robots, perception {scenario.perception}; allowed: 2, always; "
                "use another learner"
            )

    def weights(self, scenario: Scenario) -> RewardWeights:
        """Return how much each part of R_k(t) counts: each step costs a question anyway."""
        return super().weights(scenario)._replace(ask_cost=0.0)

    @staticmethod
    def initial(scenario: Scenario, robot: int) -> Any:
        """Return tables without knowledge."""
        cells = len(scenario.map.cells)
        q_star = np.zeros((cells, len(ACTIONS)))
        return Joint.Mind(
            q_star=q_star,
            updates=np.zeros(q_star.shape, dtype=np.int64),
            q_coord=table(cells * cells, np.zeros((1, PRIMITIVES))),
        )

    @staticmethod
    def informed(
        mind: Any, scenario: Scenario, robot: int, weights: RewardWeights
    ) -> Any:
        """Return the tables of a robot that knows its map: values of one that asks everywhere."""
        alone = lone_values(
            scenario, robot, scenario.ask_cost, weight=weights.individual
        )
        return mind._replace(
            q_star=np.column_stack([alone, alone.max(axis=1) + MARK]),
            q_coord=table(mind.q_coord.most, alone),
        )

    asking_values = staticmethod(Coop.asking_values)
    """As Algorithm 1: by Q^C after an answer, else by Q*."""

    @staticmethod
    def bootstrap(mind: Any, task: Task, k: int, cell: int, now: Transition) -> float:
        """Return max_b Q^C(y, z', b)."""
        state = joint_state(task, k, cell, now.seen, now.next_cells)
        row = find(mind.q_coord, k, state)
        return greatest(mind.q_coord.values[k, row], PRIMITIVES)

    @staticmethod
    def learn(mind: Any, task: Task, k: int, now: Transition, after: float) -> None:
        """Update Q^C of the joint state, by the next joint state; each step costs a question."""
        state = joint_state(task, k, now.cell, now.seen, now.cells)
        row = met(mind.q_coord, task, k, state)
        values = mind.q_coord.values[k, row]
        updates = mind.q_coord.updates[k, row]
        reward = reward_of(task, now) - task.ask_cost
        ql_update(values, updates, now.move, task, now.step, reward, after)
        mind.updates[k, now.cell, COORDINATE] += 1
