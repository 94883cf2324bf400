# Copyright 2026 The sparse_coord_ros authors
# SPDX-License-Identifier: Apache-2.0
"""What a learner is made of: a team's task, a transition, policies, updates, tables, draws.

The functions run in plain Python and in compiled loops, on the same arrays. `__all__` names what a
learner of one's own needs; after `import sparse_coord_ros as sc` it is `sc.rules`.

`COORDINATE` is the action that asks where peers are, 4; the moves are 0 to 3. `FREE` is the first
column of random draws that no learner of this package uses; see `draw`.
"""

from collections.abc import Sequence
from typing import Any, NamedTuple, TypeAlias

import numpy as np

from sparse_coord_ros.base.compiling import jitable
from sparse_coord_ros.core.game.actions import ACTIONS, COORDINATE, PRIMITIVES
from sparse_coord_ros.core.game.draws import (
    EXPLORE,
    EXPLORED_ACTION,
    FREE,
    TIE,
    draw,
)
from sparse_coord_ros.core.game.world import RewardWeights
from sparse_coord_ros.core.learners.table import Table, find, met, table

__all__ = ["Task", "Transition", "COORDINATE"]
# Policies and draws
__all__ += ["greatest", "greedy", "epsilon_greedy", "explores", "draw", "FREE"]
# Updates
__all__ += ["ql_update", "step_size", "scheduled", "toward", "reward_of", "copy_moves"]
# Joint states and their tables
__all__ += ["joint_state", "Table", "table", "find", "met"]
# Functions that compiled loops may call
__all__ += ["jitable"]

Values: TypeAlias = Sequence[float] | np.ndarray
"""A row of a table: the values of the actions, in their order."""

NOT_PERCEIVED = -1
"""In place of a peer's cell, or of a peer: the percept failed."""


class Task(NamedTuple):
    """What the robots of a team know of their task; k is a robot, from 0.

    Attributes:
        robots: number of robots.
        cells: free cells of the map.
        goals: the cell that ends robot k's episodes [k].
        actions: number of a robot's actions: all five, or only the moves.
        discount: gamma.
        goal_value: value of being at the goal while learning.
        goal_reward: r^I on arrival.
        ask_cost: the cost of asking.
        weights: how much each part of a reward counts in learning.
        epsilon: probability of an explored action [time step]; after its end the last one holds.
        step_sizes: the step size of the n-th update of an entry, without the floor [n].
        floors: least step size [time step]; likewise.
        learning: whether the robots learn; if not, they act greedily.
        sees_all: whether a robot learns from the cells of all peers in every step, asked or not:
            the setting `peers_seen`.
        keys: robot k's key for `draw` [k].
        full: set where a table needs room [0].
    """

    robots: int
    cells: int
    goals: Any
    actions: int
    discount: float
    goal_value: float
    goal_reward: float
    ask_cost: float
    weights: RewardWeights
    epsilon: Any
    step_sizes: Any
    floors: Any
    learning: bool
    sees_all: bool
    keys: Any
    full: Any


def of_run(task: Task, keys: np.ndarray) -> Task:
    """Return the task of one run: what a run writes to is its own.

    Args:
        task: the task of a team, which several threads may share.
        keys: robot k's key for `draw` [k].
    """
    return task._replace(keys=keys, full=np.zeros(1, dtype=np.bool_))


class Transition(NamedTuple):
    """A transition, from which a robot learns: a time step t and its result.

    Attributes:
        step: the time step t.
        cell: X_k(t).
        action: A_k(t): a move, or COORDINATE.
        move: the primitive action that it became.
        answered: whether it asked, and the percept succeeded.
        seen: the peers whose cells it knows, the sum of 2^j; 0: none. They are those that it
            perceived; with `task.sees_all` all peers.
        cells: the cells of all robots at t; `NOT_PERCEIVED` in place of those that it does not
            know.
        next_cell: X_k(t+1).
        next_cells: the cells of all robots at t+1, likewise: it knows its own, and with
            `task.sees_all` all of them.
        individual: r^I_k.
        common: r^C.
        asking: minus the cost of asking; or 0.
        partners: the peers with which it interacted, the sum of 2^j; -1: not known.
    """

    step: int
    cell: int
    action: int
    move: int
    answered: bool
    seen: int
    cells: Any
    next_cell: int
    next_cells: Any
    individual: float
    common: float
    asking: float
    partners: int


# Policies.


@jitable
def greatest(values: Values, count: int) -> float:
    """Return the maximum of the first `count` values: max_b Q(y, b).

    Args:
        values: a row of a table.
        count: how many actions compete: `task.actions`, or 4 for the moves alone.
    """
    best = float(values[0])
    for action in range(1, count):
        value = float(values[action])
        if value > best:
            best = value
    return best


@jitable
def greedy(values: Values, count: int, key: int, step: int, column: int) -> int:
    """Return the greedy action pi_g of the first `count`: uniform among exact maxima.

    Args:
        values: a row of a table; NaN is never chosen.
        count: how many actions compete.
        key: the robot's key, `task.keys[k]`.
        step: the time step.
        column: the draw that decides between equal values.
    """
    best = float(values[0])
    first = 0
    ties = 1
    for action in range(1, count):
        value = float(values[action])
        if value > best:
            best = value
            first = action
            ties = 1
        elif value == best:
            ties += 1
    if ties == 1:
        return first
    number = int(draw(key, step, column) * ties)
    for action in range(first, count):
        if values[action] == best:
            if number == 0:
                return action
            number -= 1
    return first


@jitable
def greedy_action(mind: Any, task: Task, k: int, step: int, cell: int) -> int:
    """Return A_k(t) of a robot that does not learn: the greedy action by Q*."""
    values = mind.q_star[k, cell]
    return greedy(values, len(ACTIONS), task.keys[k], step, TIE)


@jitable
def epsilon_greedy(values: Values, task: Task, k: int, step: int) -> int:
    """Return A_k(t) by the learning policy pi_epsilon (Algorithm 1, line 4).

    Args:
        values: the row Q*_k(x, .).
        task: the task.
        k: the robot.
        step: the time step t.
    """
    key = task.keys[k]
    if explores(task, k, step, EXPLORE):
        return int(draw(key, step, EXPLORED_ACTION) * task.actions)
    return greedy(values, len(ACTIONS), key, step, TIE)


@jitable
def explores(task: Task, k: int, step: int, column: int) -> bool:
    """Return whether a robot explores: with probability epsilon, and only while it learns.

    Args:
        task: the task.
        k: the robot.
        step: the time step t.
        column: the draw that decides.
    """
    return bool(
        task.learning
        and draw(task.keys[k], step, column) < scheduled(task.epsilon, step)
    )


@jitable
def check_action(action: int, count: int) -> None:
    """Raise `IndexError` unless a learner chose one of the first `count` actions.

    A compiled loop would write beside its arrays.
    """
    if not 0 <= action < count:
        raise IndexError(
            "it chose an action that it does not have: actions are 0 to 4, moves 0 to 3"
        )


def asks_surely(values: Any) -> Any:
    """Return whether a greedy robot asks here, whatever it draws.

    This defines "asks here": the value of COORDINATE is above that of every move. If it equals
    that of the best move, pi_g breaks the tie by a draw; the robot then asks at times, which does
    not count. A robot without COORDINATE (NaN) never asks.

    Args:
        values: a row of Q*; or Q* transposed, shape (5, cells).

    Returns:
        A bool; or bools of shape (cells,).
    """
    asks = values[COORDINATE] > values[0]
    for move in range(1, PRIMITIVES):
        asks = asks & (values[COORDINATE] > values[move])
    return asks


def asks_at_times(values: Any) -> Any:
    """Return whether a greedy robot may ask: COORDINATE is at least as good as any move.

    Arguments and return value as in `asks_surely`.
    """
    asks = values[COORDINATE] >= values[0]
    for move in range(1, PRIMITIVES):
        asks = asks & (values[COORDINATE] >= values[move])
    return asks


# Updates.


@jitable
def scheduled(values: Any, step: int) -> float:
    """Return the number of a time step in a schedule; after its end the last one holds.

    Args:
        values: a number for each time step: `task.epsilon` or `task.floors`.
        step: the time step t.
    """
    if step < len(values):
        return float(values[step])
    return float(values[-1])


@jitable
def step_size(task: Task, count: int, step: int) -> float:
    """Return alpha of the n-th update of an entry: never less than the floor of the time step.

    The setting `step_size` says both (the paper leaves it open).

    Args:
        task: the task.
        count: n, from 1.
        step: the time step t.
    """
    return max(float(task.step_sizes[count]), scheduled(task.floors, step))


@jitable
def toward(value: float, alpha: float, target: float) -> float:
    """Return a value moved toward a target by a share of the way: v + alpha (target - v).

    `ql_update` computes (1 - alpha) v + alpha target: the same, but for the last bit.

    Args:
        value: v.
        alpha: the share, from 0 to 1.
        target: the target.
    """
    return value + alpha * (target - value)


@jitable
def reward_of(task: Task, now: Transition) -> float:
    """Return R_k(t) as it counts in learning: r^I, r^C and the cost of asking, by their weights.

    Args:
        task: the task; `task.weights` are those of the learner's `weights`.
        now: the transition.
    """
    weights = task.weights
    individual = weights.individual * now.individual
    return individual + weights.common * now.common + weights.ask_cost * now.asking


@jitable
def ql_update(
    values: Any,
    updates: Any,
    b: int,
    task: Task,
    step: int,
    reward: float,
    after: float,
) -> None:
    """Update an entry of a row by QLUpdate (paper, Section 3.2; equation 3).

    Q(x, b) = (1 - alpha) Q(x, b) + alpha (r + gamma max_b' Q'(y, b'))

    Args:
        values: the row Q(x, .), changed.
        updates: how often each entry was updated, changed.
        b: the action.
        task: the task.
        step: the time step t.
        reward: r.
        after: max_b' Q'(y, b'), or the value of the goal.
    """
    count = updates[b] + 1
    updates[b] = count
    alpha = step_size(task, count, step)
    target = reward + task.discount * after
    values[b] = (1.0 - alpha) * float(values[b]) + alpha * target


@jitable
def copy_moves(source: Values, target: Any) -> None:
    """Copy the values of the moves.

    Args:
        source: a row of a table.
        target: a row [move], changed.
    """
    for b in range(PRIMITIVES):
        target[b] = source[b]


# Joint states.


@jitable
def everybody_but(k: int, robots: int) -> int:
    """Return all peers of robot k, as the sum of 2^j."""
    return ((1 << robots) - 1) & ~(1 << k)


@jitable
def joint_state(task: Task, k: int, cell: int, seen: int, cells: Any) -> int:
    """Return the number of a joint state: its digits are the own cell, then the seen peers'.

    Args:
        task: the task.
        k: the robot.
        cell: its cell.
        seen: the peers that it perceives, the sum of 2^j.
        cells: the cells of all robots.
    """
    key = cell
    for j in range(task.robots):
        if (seen >> j) & 1:
            key = key * task.cells + cells[j]
    return key
