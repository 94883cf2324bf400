# Copyright 2026 The sparse_coord_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The parts that all learners share: a robot's task, a transition, and QLUpdate.

The functions marked `of_learner` make up a learner. Each is a static method of its class
(`core.learners.learner.Learner` specifies them). They run on lists in plain Python
and on arrays in compiled loops, so they return numbers or nothing, and make no arrays.
"""

from collections.abc import Sequence
from typing import Any, NamedTuple, TypeAlias

import numpy as np

from sparse_coord_ros.base.compiling import flag_of_learner, inlined, inner, of_learner
from sparse_coord_ros.core.game.actions import PRIMITIVES
from sparse_coord_ros.core.game.scenario import Scenario
from sparse_coord_ros.core.game.sight import Sight
from sparse_coord_ros.core.learners.mind import Rows, place

Values: TypeAlias = Sequence[float] | np.ndarray
"""A row of a table: the values of the actions, in their order."""


NOT_PERCEIVED = -1
"""In place of a peer's cell, or of a peer: the percept failed."""


class Task(NamedTuple):
    """A robot's knowledge of its task.

    Attributes:
        number: the robot k, from 0.
        robots: number of robots.
        cells: free cells of the map.
        goal: the cell that ends its episodes.
        actions: number of its actions: all five, or only the moves.
        discount: gamma.
        goal_value: value of being at the goal while learning.
        goal_reward: r^I on arrival, weighed.
        ask_cost: the cost of asking, weighed.
        credit: how often r^C counts.
        step_sizes: the step size of the n-th update of an entry, without the floor [n].
        sight: probabilities that percepts succeed; `BLIND` for learners that do not use them.
        swaps: whether robots that exchange cells interact.
        blocks: whether robots can stop each other.
        map_samples: for how many samples of each move the map counts; 0: the map is not known.
        replays: how many moves a learner with a model replays in each step.
        leaves: whether it leaves stand-offs.
    """

    number: int
    robots: int
    cells: int
    goal: int
    actions: int
    discount: float
    goal_value: float
    goal_reward: float
    ask_cost: float
    credit: float
    step_sizes: Any
    sight: Sight
    swaps: bool
    blocks: bool
    map_samples: int
    replays: int
    leaves: bool


class Transition(NamedTuple):
    """A transition, from which a robot learns: a time step t and its result.

    Attributes:
        step: the time step t.
        cell: X_k(t).
        action: A_k(t), as of `core.game.actions`.
        move: the primitive action that it became.
        seen: the peers that were perceived, the sum of 2^j; 0: none.
        cells: the cells of all robots at t; of peers only those that were perceived are known.
        next_cell: X_k(t+1).
        next_seen, next_cells: as `seen` and `cells`, at t+1, of learners that always see all.
        individual: r^I_k, weighed.
        common: r^C, weighed.
        felt: r^C as it is.
        asking: minus the cost of asking, weighed; or 0.
        partners: the peers with which it interacted, the sum of 2^j; -1: not known.
        epsilon: probability of exploring.
        floor: least step size.
        draw: a random number in [0, 1), for learners that need one.
    """

    step: int
    cell: int
    action: int
    move: int
    seen: int
    cells: Any
    next_cell: int
    next_seen: int
    next_cells: Any
    individual: float
    common: float
    felt: float
    asking: float
    partners: int
    epsilon: float
    floor: float
    draw: float


MAP_SAMPLES = 20
"""For how many samples of each move the map counts in a robot's model of where moves lead."""


def map_samples(scenario: Scenario) -> int:
    """Return `Task.map_samples`."""
    return MAP_SAMPLES if scenario.prior == "map" else 0


REPLAYS = 8
"""Replays of each step where the map is known, or large."""

LARGE_MAP = 1000
"""Cells from which on one replay of each step is too little to bring values over a long way."""


def replays_of(scenario: Scenario) -> int:
    """Return `Task.replays`."""
    if scenario.prior == "map" or len(scenario.map.cells) >= LARGE_MAP:
        return REPLAYS
    return 1


# The functions of a learner.


@of_learner
def begin_episode(mind: Any, task: Task) -> None:
    """Begin an episode."""


@of_learner
def asking_values(
    mind: Any, task: Task, cell: int, seen: int, cells: Any, values: Any
) -> None:
    """Set the values by which COORDINATE chooses a move (Algorithm 1, lines 6 to 10)."""


@of_learner
def explores(mind: Any, task: Task, seen: int) -> bool:
    """Return whether the move after COORDINATE is explored as any other."""
    raise NotImplementedError


@of_learner
def way_out(
    mind: Any,
    task: Task,
    step: int,
    cell: int,
    seen: int,
    cells: Any,
    values: Any,
    move: int,
) -> int:
    """Return the move by which the robot may leave a stand-off; `move`: it is in none."""
    raise NotImplementedError


@of_learner
def bootstrap(mind: Any, task: Task, cell: int, now: Transition) -> float:
    """Return the expected return from a cell that is not the goal: max_b Q*(cell, b)."""
    raise NotImplementedError


@of_learner
def learn(mind: Any, task: Task, now: Transition) -> None:
    """Learn from a transition (Algorithm 1, lines 12 to 14 and 18)."""


sees_all = flag_of_learner("sees_all")
"""True if the robots of a mind's learner see all others in every step."""

wants_draw = flag_of_learner("draws")
"""True if it wants a random number in each step."""

wants_partners = flag_of_learner("partners")
"""True if it wants to know with whom a robot interacted."""


# Their parts.


@inner
def greatest(values: Values, count: int) -> float:
    """Return the maximum of the first `count` values: max_b Q'(y, b) of QLUpdate."""
    best: float = values[0]
    for action in range(1, count):
        if values[action] > best:
            best = values[action]
    return best


@inlined
def step_size(task: Task, count: int, floor: float) -> float:
    """Return alpha of the n-th update of an entry: never less than the floor."""
    alpha: float = task.step_sizes[count]
    if alpha > floor:
        return alpha
    return floor


@inner
def toward(value: float, alpha: float, target: float) -> float:
    """Return a value moved toward a target by a share of the way."""
    return value + alpha * (target - value)


@inlined
def expected(mind: Any, task: Task, now: Transition) -> float:
    """Return the expected return from X_k(t+1): the value of the goal, or `bootstrap`."""
    if now.next_cell == task.goal:
        return task.goal_value
    return bootstrap(mind, task, now.next_cell, now)


@inlined
def reward_of(now: Transition) -> float:
    """Return R_k(t) as it counts in learning."""
    return now.individual + now.common + now.asking


@inlined
def ql_update(
    values: Any,
    updates: Any,
    b: int,
    task: Task,
    floor: float,
    reward: float,
    after: float,
) -> None:
    """Update an entry of a row by QLUpdate (paper, Section 3.2; equation 3).

    Q(x, b) = (1 - alpha) Q(x, b) + alpha (r + gamma max_b' Q'(y, b'))

    Args:
        values: the row Q(x, .), changed.
        updates: how often each entry was updated, changed.
        b: the action.
        task: the robot's task.
        floor: least step size.
        reward: r.
        after: max_b' Q'(y, b'), or the value of the goal.
    """
    count = updates[b] + 1
    updates[b] = count
    alpha = step_size(task, count, floor)
    values[b] = (1.0 - alpha) * values[b] + alpha * (reward + task.discount * after)


@inlined
def joint_state(task: Task, cell: int, seen: int, cells: Any) -> int:
    """Return the number of a joint state: its digits are the own cell, then the seen peers'."""
    if task.robots == 2:
        return cell * task.cells + cells[1 - task.number]
    key = cell
    for j in range(task.robots):
        if (seen >> j) & 1:
            key = key * task.cells + cells[j]
    return key


@inlined
def copy_moves(source: Values, target: Any) -> None:
    """Copy the values of the moves."""
    for b in range(PRIMITIVES):
        target[b] = source[b]


@inlined
def row_of_state(rows: Rows, task: Task, cell: int, seen: int, cells: Any) -> int:
    """Return the row of a joint state, a new one if it was not met."""
    return place(rows, joint_state(task, cell, seen, cells))
