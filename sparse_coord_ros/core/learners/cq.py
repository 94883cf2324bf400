# Copyright 2026 The sparse_coord_ros authors
# SPDX-License-Identifier: Apache-2.0
"""CQ-learning (De Hauwere, Vrancx & Nowe, AAMAS 2010): ask where rewards differ from those alone.

A robot begins with Q* of a robot alone (`core.learners.lone`), which never changes. It compares
the rewards of each own cell and move with those that it would get alone, by Student's t-test on
windows of `WINDOW` samples. Where they differ the cell is marked. In marked cells it looks at its
peer, here by COORDINATE, and compares the rewards of each joint state in the same way. A joint
state where they differ has a row of its own in Q^C, the augmented table, which begins at Q* and
learns

    Q^C(x, z, a) = (1 - alpha) Q^C(x, z, a) + alpha (r + gamma max_b Q*(y, b)).

Other joint states keep Q*, by which it also acts after a failed percept. The rewards that it
learns from leave out the price of asking: the paper has no such price, and marks, not values,
decide where the robot asks. In tables Q*(x, COORDINATE) shows them: it is `MARK` above the best
move in marked cells, `MARK` below it in others.

With `peers: all` it tests and marks the joint state with each peer by itself. The value of a move
is then the least of its values in these pairs: a choice of our own.
"""

from typing import Any, NamedTuple

import numpy as np

from sparse_coord_ros.base.compiling import jitable
from sparse_coord_ros.base.errors import SettingError
from sparse_coord_ros.core.game.actions import ACTIONS, COORDINATE, PRIMITIVES
from sparse_coord_ros.core.game.draws import (
    BLIND_ACTION,
    BLIND_EXPLORE,
    MOVE_TIE,
    draw,
)
from sparse_coord_ros.core.game.scenario import Scenario, is_sparse
from sparse_coord_ros.core.game.world import RewardWeights
from sparse_coord_ros.core.learners.learner import Learner
from sparse_coord_ros.core.learners.lone import lone_values
from sparse_coord_ros.core.learners.rules import (
    Task,
    Transition,
    Values,
    copy_moves,
    explores,
    greatest,
    greedy,
    ql_update,
    reward_of,
)
from sparse_coord_ros.core.learners.table import Table, find, met, table

MARK = 1.0
"""How far COORDINATE is above the best move in marked cells, and below it in others."""

WINDOW = 20
"""Samples of a test; the next test has new ones, so that a sample is judged once."""

T_CRITICAL = 2.093
"""Student's t of 19 degrees of freedom that chance exceeds once in twenty times."""

COUNT, SUM, SQUARES = range(3)
"""Entries of a window: how many samples there are, and their sums."""

MARKED = -1.0
"""In place of a count of samples: the joint state is marked, and not tested any more."""


class CQ(Learner):
    """CQ-learning."""

    name = "cq"
    summary = "CQ-learning; asks in cells marked by a statistical test (De Hauwere et al., 2010)"
    needs_map = True

    class Mind(NamedTuple):
        """The learned tables; k is a robot, x its cell, z that of a peer.

        Attributes:
            q_star: Q* [k, x, action].
            updates: how often each action was chosen [k, x, action].
            q_coord: Q^C: a row [move] for each joint state with a peer (`pair_key`).
            samples: windows of the moves and of the joint states [k, x, move or 4 + z, COUNT...];
                with `peers: all` of those with peer j [k, x, 4 + j cells + z, COUNT...].
        """

        q_star: Any
        updates: Any
        q_coord: Table
        samples: Any

    def check(self, scenario: Scenario) -> None:
        """Raise `SettingError` unless the robot knows the map and the map is small."""
        super().check(scenario)
        if is_sparse(len(scenario.map.cells), 2):
            raise SettingError(
                f"learner {self.label}: scenario {scenario.name} has {len(scenario.map.cells)} "
                "cells, allowed: 724; use a smaller map, or learner coop or voi"
            )

    def rows_of_a_cell(self, scenario: Scenario) -> int:
        """Return the largest number of joint states with a peer for each own cell."""
        cells = len(scenario.map.cells)
        return cells if scenario.perceived == 2 else cells * len(scenario.robots)

    def weights(self, scenario: Scenario) -> RewardWeights:
        """Return how much each part of R_k(t) counts: the price of asking does not."""
        return super().weights(scenario)._replace(ask_cost=0.0)

    @staticmethod
    def initial(scenario: Scenario, robot: int) -> Any:
        """Return tables without knowledge; no cell is marked."""
        cells = len(scenario.map.cells)
        pairs = CQ().rows_of_a_cell(scenario)
        seen = scenario.perceived - 1
        q_star = np.zeros((cells, len(ACTIONS)))
        return CQ.Mind(
            q_star=q_star,
            updates=np.zeros(q_star.shape, dtype=np.int64),
            q_coord=table(cells * pairs, np.zeros((1, PRIMITIVES)), seen),
            samples=np.zeros((cells, PRIMITIVES + pairs, 3)),
        )

    @staticmethod
    def informed(
        mind: Any, scenario: Scenario, robot: int, weights: RewardWeights
    ) -> Any:
        """Return the tables of a robot that knows its map: Q* of a robot alone."""
        alone = lone_values(scenario, robot, weight=weights.individual)
        return mind._replace(
            q_star=np.column_stack([alone, alone.max(axis=1) - MARK]),
            q_coord=table(mind.q_coord.most, alone, mind.q_coord.a_step),
        )

    @staticmethod
    def asking_values(
        mind: Any, task: Task, k: int, cell: int, seen: int, cells: Any, values: Any
    ) -> None:
        """Set the values of Q^C, the least of all peers that are perceived, else those of Q*."""
        if seen == 0:
            copy_moves(mind.q_star[k, cell], values)
            return
        first = True
        for j in range(task.robots):
            if (seen >> j) & 1:
                row = find(mind.q_coord, k, pair_key(mind, task, cell, j, cells))
                for b in range(PRIMITIVES):
                    value = mind.q_coord.values[k, row, b]
                    if first or value < values[b]:
                        values[b] = value
                first = False

    @staticmethod
    def move_after_asking(
        mind: Any,
        task: Task,
        k: int,
        step: int,
        cell: int,
        seen: int,
        cells: Any,
        values: Values,
    ) -> int:
        """Return the move that COORDINATE becomes, which is explored as any other."""
        key = task.keys[k]
        if explores(task, k, step, BLIND_EXPLORE):
            return int(draw(key, step, BLIND_ACTION) * PRIMITIVES)
        return greedy(values, PRIMITIVES, key, step, MOVE_TIE)

    @staticmethod
    def bootstrap(mind: Any, task: Task, k: int, cell: int, now: Transition) -> float:
        """Return the maximum of Q*(cell, .) over the moves."""
        return greatest(mind.q_star[k, cell], PRIMITIVES)

    @staticmethod
    def learn(mind: Any, task: Task, k: int, now: Transition, after: float) -> None:
        """Sample the reward; learn Q^C in joint states that are marked."""
        cell = now.cell
        mind.updates[k, cell, now.action] += 1
        values = mind.q_star[k, cell]
        common = task.weights.common * now.common
        if now.action != COORDINATE:
            if not is_marked(values) and differs(
                mind.samples[k, cell, now.move], common
            ):
                values[COORDINATE] = greatest(values, PRIMITIVES) + MARK
            return
        pairs = mind.samples.shape[2] - PRIMITIVES
        for j in range(task.robots):
            if (now.seen >> j) & 1:
                key = pair_key(mind, task, cell, j, now.cells)
                if differs(mind.samples[k, cell, PRIMITIVES + key % pairs], common):
                    row = met(mind.q_coord, task, k, key)
                    values = mind.q_coord.values[k, row]
                    updates = mind.q_coord.updates[k, row]
                    reward = reward_of(task, now)
                    ql_update(values, updates, now.move, task, now.step, reward, after)


@jitable
def pair_key(mind: Any, task: Task, cell: int, peer: int, cells: Any) -> int:
    """Return the number of the joint state with a peer, of all own cells.

    Args:
        mind: the team's mind.
        task: its task.
        cell: the robot's own cell.
        peer: the peer, which is told apart from others with `peers: all`.
        cells: the cells of all robots.
    """
    pairs = mind.samples.shape[2] - PRIMITIVES
    key = cell * pairs + cells[peer]
    if pairs > task.cells:
        key += peer * task.cells
    return key


@jitable
def is_marked(values: Values) -> bool:
    """Return whether a cell is marked, by its row of Q*."""
    return bool(values[COORDINATE] > greatest(values, PRIMITIVES))


@jitable
def differs(sample: Any, value: float) -> bool:
    """Add a sample; return whether the mean is not 0 by the test of this window, or one before.

    Args:
        sample: the window: [COUNT, SUM, SQUARES]; it begins anew when it is full.
        value: the reward minus that of a lone robot with the same transition.
    """
    if sample[COUNT] < 0.0:
        return True
    sample[COUNT] += 1.0
    sample[SUM] += value
    sample[SQUARES] += value * value
    if sample[COUNT] < WINDOW:
        return False
    square = sample[SUM] * sample[SUM]
    spread = WINDOW * sample[SQUARES] - square
    significant = bool(square * (WINDOW - 1) > T_CRITICAL * T_CRITICAL * spread)
    sample[COUNT] = MARKED if significant else 0.0
    sample[SUM] = 0.0
    sample[SQUARES] = 0.0
    return significant
