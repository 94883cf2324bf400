# Copyright 2026 The sparse_coord_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Learners of the leaderboard that the package itself does not have. docs/leaderboard.md.

PYTHONPATH=studies sparse_coord benchmark entries:Always entries:Gate entries:GPCQ --lists paper

Each is a learner of one's own: a class with some hooks of Algorithm 1 changed.
"""

from types import MappingProxyType

import sparse_coord_ros as sc
from sparse_coord_ros.base.errors import SettingError
from sparse_coord_ros.core.game.actions import COORDINATE, PRIMITIVES
from sparse_coord_ros.core.learners.cq import COUNT
from sparse_coord_ros.core.learners.rules import (
    FREE,
    draw,
    explores,
    find,
    greatest,
    greedy,
    jitable,
    joint_state,
    met,
    step_size,
    toward,
)

DECIDED, EXPLORED, EXPLORED_MOVE, GREEDY_MOVE = range(FREE, FREE + 4)
"""Columns of random draws."""

NEVER = -1e9
"""The value of a move that is never taken without a question."""


@jitable
def epsilon_greedy_move(values, task, k, step):
    """Return the move that COORDINATE becomes, which is explored as any other."""
    if explores(task, k, step, EXPLORED):
        return int(draw(task.keys[k], step, EXPLORED_MOVE) * PRIMITIVES)
    return greedy(values, PRIMITIVES, task.keys[k], step, GREEDY_MOVE)


def check_seen_pair(learner, scenario):
    """Raise `SettingError` unless two robots see each other while they learn."""
    if scenario.peers_seen != "while_learning":
        raise SettingError(
            f"setting peers_seen: value is {scenario.peers_seen!r}, allowed with learner "
            f"{learner.label}: while_learning; leave peers_seen out"
        )
    if len(scenario.robots) != 2:
        raise SettingError(
            f"learner {learner.label}: scenario {scenario.name} has {len(scenario.robots)} "
            "robots, allowed: 2; use another learner"
        )


class Always(sc.Coop):
    """Algorithm 1, but line 4 chooses COORDINATE in each step, in learning and in play.

    So each move comes from Q^C, and is explored there. Q^C still bootstraps on Q*, which now has
    one action. (`joint` asks as often, but is no Algorithm 1: its Q^C bootstraps on itself, and
    begins at the values of a robot alone.)
    """

    summary = "Algorithm 1 that asks in each step"

    def check(self, scenario):
        """Raise `SettingError` where a question can fail: it has no move without an answer."""
        super().check(scenario)
        if scenario.perception.kind != "always":
            raise SettingError(
                f"learner {self.label}: perception is {scenario.perception}, allowed: always; "
                "use another learner"
            )

    @staticmethod
    def initial(scenario, robot):
        """Return the tables of Algorithm 1; a move without a question is never the best."""
        mind = sc.Coop.initial(scenario, robot)
        mind.q_star[:, :PRIMITIVES] = NEVER
        return mind

    @staticmethod
    def informed(mind, scenario, robot, weights):
        """Return the same for a robot that knows its map."""
        mind = sc.Coop.informed(mind, scenario, robot, weights)
        mind.q_star[:, :PRIMITIVES] = NEVER
        return mind

    @staticmethod
    def decide(mind, task, k, step, cell):
        """Return COORDINATE."""
        return COORDINATE

    @staticmethod
    def move_after_asking(mind, task, k, step, cell, seen, cells, values):
        """Return the move."""
        return epsilon_greedy_move(values, task, k, step)


class Gate(sc.Coop):
    """Joint-state Q-learning with a gate: two robots ask only where the answer is worth it.

    Peers are seen while learning. x, y are a robot's cell and its next one, z and z' the peer's:

        V(y, z')     =  max_b Q^C(y, z', b) - cost   if it asks in y, else
                        Q^C(y, z', m(y)), where m(y) is its best move without a question
        Q^C(x, z, b) <- r + gamma V(y, z')
        Q*(x, b)     <- Q^C(x, z, b)                 for each b: a mean over the peers met in x
        Q*(x, ask)   <- max_b Q^C(x, z, b) - cost    likewise
    """

    summary = "joint-state Q-learning that asks where the answer is worth its cost"
    needs_map = True
    defaults = MappingProxyType(
        {
            "epsilon": "linear:0.3:0.02:0.8",
            "starts": "exploring:1:0:0.5",
            "step_size": "floored:0.6:0.1:0.01",
            "credit": "team",
            "peers_seen": "while_learning",
        }
    )

    def check(self, scenario):
        """Raise `SettingError` unless two robots see each other while they learn."""
        super().check(scenario)
        check_seen_pair(self, scenario)

    @staticmethod
    def move_after_asking(mind, task, k, step, cell, seen, cells, values):
        """Return the move."""
        return epsilon_greedy_move(values, task, k, step)

    @staticmethod
    def bootstrap(mind, task, k, cell, now):
        """Return V(y, z')."""
        state = joint_state(task, k, cell, now.seen, now.next_cells)
        values = mind.q_coord.values[k, find(mind.q_coord, k, state)]
        q_star = mind.q_star[k, cell]
        best = 0
        for b in range(1, PRIMITIVES):
            if q_star[b] > q_star[best]:
                best = b
        if q_star[COORDINATE] > q_star[best]:
            return greatest(values, PRIMITIVES) - task.ask_cost
        return values[best]

    @staticmethod
    def learn(mind, task, k, now, after):
        """Update Q^C, then Q*. A value before learning counts as one sample."""
        reward = task.weights[0] * now.individual + task.weights[1] * now.common
        state = joint_state(task, k, now.cell, now.seen, now.cells)
        row = met(mind.q_coord, task, k, state)
        values = mind.q_coord.values[k, row]
        updates = mind.q_coord.updates[k, row]
        updates[now.move] += 1
        alpha = step_size(task, updates[now.move] + 1, now.step)
        target = reward + task.discount * after
        values[now.move] = toward(values[now.move], alpha, target)

        q_star = mind.q_star[k, now.cell]
        visits = mind.updates[k, now.cell]
        visits[COORDINATE] += 1
        alpha = step_size(task, visits[COORDINATE] + 1, now.step)
        for b in range(PRIMITIVES):
            q_star[b] = toward(q_star[b], alpha, values[b])
        asking = greatest(values, PRIMITIVES) - task.ask_cost
        q_star[COORDINATE] = toward(q_star[COORDINATE], alpha, asking)


class GPCQ(sc.CQ):
    """GPCQ-learning of two robots (Kujirai & Yokota, SICE JCMSI 12, 2019).

    It differs from CQ-learning in two ways:

    - greedy: a robot explores in marked joint states only;
    - pessimistic: Q^C(x, z, a) bootstraps on Q^C(y, z', .) where (y, z') is marked, too, and only
      elsewhere on Q*(y, .). A row that was never learned equals Q*.

    Peers are seen while learning, as by the authors' program (github.com/tkujiraski/MARL), whose
    greedy moves and updates are these, bit for bit. Windows and marks are those of our `cq`.
    """

    summary = (
        "CQ-learning that bootstraps on marked joint states (Kujirai & Yokota, 2019)"
    )
    defaults = MappingProxyType({"peers_seen": "while_learning"})

    def check(self, scenario):
        """Raise `SettingError` unless two robots see each other while they learn."""
        super().check(scenario)
        check_seen_pair(self, scenario)

    @staticmethod
    def decide(mind, task, k, step, cell):
        """Return the greedy action: COORDINATE in marked cells."""
        return greedy(mind.q_star[k, cell], task.actions, task.keys[k], step, DECIDED)

    @staticmethod
    def move_after_asking(mind, task, k, step, cell, seen, cells, values):
        """Return the move, which is explored in marked joint states."""
        if seen != 0 and mind.samples[k, cell, PRIMITIVES + cells[1 - k], COUNT] < 0:
            return epsilon_greedy_move(values, task, k, step)
        return greedy(values, PRIMITIVES, task.keys[k], step, GREEDY_MOVE)

    @staticmethod
    def bootstrap(mind, task, k, cell, now):
        """Return the maximum of Q^C(y, z', .)."""
        state = joint_state(task, k, cell, now.seen, now.next_cells)
        return greatest(
            mind.q_coord.values[k, find(mind.q_coord, k, state)], PRIMITIVES
        )
