# Copyright 2026 The sparse_coord_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Joint-state Q-learning: what two robots learn that see each other always.

Each learns for itself, by Watkins' Q-learning, over the joint state. Q^C begins at the Q* of a
lone robot that pays as much (`learn.lone`) and bootstraps on itself, as the next joint state is
seen too:

    Q^C(x, z, a) = (1 - alpha) Q^C(x, z, a) + alpha (r + gamma max_b Q^C(y, z', b)).

Every step costs a question. COORDINATE stands above all moves in every cell.
"""

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from sparse_coord_ros.errors import SettingError
from sparse_coord_ros.game.actions import COORDINATE, PRIMITIVES
from sparse_coord_ros.game.links import UP
from sparse_coord_ros.game.scenario import Scenario
from sparse_coord_ros.learn import loops
from sparse_coord_ros.learn.agent import Memory, TableMinds, Tables, learn_entry, move_by_rows
from sparse_coord_ros.learn.algorithm import greatest, weighed
from sparse_coord_ros.learn.lone import lone_rows
from sparse_coord_ros.learn.rows import Rows

if TYPE_CHECKING:
    from sparse_coord_ros.learn.learners import Learner


def check_sight(scenario: Scenario, learner: str) -> None:
    """Raise `SettingError` unless there are two robots, which can always see each other."""
    sees = scenario.perception.kind == "always" and scenario.link == UP
    if len(scenario.robots) != 2 or scenario.sparse or not sees:
        raise SettingError(
            f"learner {learner}: scenario {scenario.name} has {len(scenario.robots)} robots, "
            f"{len(scenario.map.cells)} cells, perception {scenario.perception}, link "
            f"{scenario.link}; allowed: 2, at most 724, always, up; use another learner"
        )


class JointMinds(NamedTuple):
    """What two robots know; attributes as of `loops.Minds`, rows as of `TableMinds`."""

    q_star: np.ndarray
    star_updates: np.ndarray
    rows: Rows

    @staticmethod
    def roles() -> tuple[int, ...]:
        """No streams beside the game's."""
        return ()

    @classmethod
    def initial(cls, scenario: Scenario, learner: "Learner", block: int) -> "JointMinds":
        """Return what robots know before learning; as of `loops.Minds`."""
        q_star = np.stack([learner.tables(scenario, k).q_star for k in range(2)])
        updates = np.zeros(q_star.shape, np.int32)
        return cls(q_star, updates, lone_rows(q_star))

    def tables(self, scenario: Scenario, learner: "Learner") -> list[Tables]:
        """Return what each robot has learned."""
        return TableMinds(*self).tables(scenario, learner)

    def memory(self, k: int, scenario: Scenario) -> Memory:
        """Return what robot k has learned; a copy."""
        return TableMinds(*self).memory(k, scenario)

    def remember(self, memories: Sequence[Memory], scenario: Scenario) -> "JointMinds":
        """Return what robots know that remember all this."""
        TableMinds(*self).remember(memories, scenario)
        return self

    @staticmethod
    def begin_step(state: loops.State, minds: Any) -> None:
        """Note where both are, also a robot that has arrived, or explores and does not ask."""
        for k in range(2):
            state.choice.cells[k] = state.game.cells[k]

    @staticmethod
    def coordinate(state: loops.State, minds: Any, step: int, k: int, epsilon: float) -> int:
        """Turn COORDINATE into a move by the joint state's row."""
        return move_by_rows(state, minds, step, k)

    @staticmethod
    def bootstrap(state: loops.State, minds: "JointMinds", step: int, k: int, y: int) -> float:
        """Return max_b Q^C(y, z', b)."""
        row = y * minds.q_star.shape[1] + state.game.cells[1 - k]
        return greatest(minds.rows.values[k, row], PRIMITIVES)

    @staticmethod
    def learn(state: loops.State, minds: "JointMinds", now: loops.Transition) -> None:
        """Update Q^C of the joint state, by the next joint state."""
        step, k, y, reward, floor = now
        problem, x = state.problem, state.choice.cells[k]
        after = loops.worth_of(state, minds, step, k, y)
        total = weighed(reward, problem.weights) - problem.ask_cost
        row, move = x * minds.q_star.shape[1] + state.choice.cells[1 - k], state.choice.moves[k]
        values, updates = minds.rows.values[k, row], minds.rows.updates[k, row]
        learn_entry(problem, values, updates, move, total, after, floor)
        minds.star_updates[k, x, COORDINATE] += 1
