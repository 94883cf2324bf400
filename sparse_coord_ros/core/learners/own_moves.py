# Copyright 2026 The sparse_coord_ros authors
# SPDX-License-Identifier: Apache-2.0
"""U of the learner `core.learners.factored`, and its model of where moves lead.

The model counts how often a move led out of its cell, and keeps the cell where it led last.
"""

from typing import Any

from sparse_coord_ros.base.compiling import of_learner
from sparse_coord_ros.core.game.actions import COORDINATE, PRIMITIVES
from sparse_coord_ros.core.learners.rules import (
    Task,
    Transition,
    greatest,
    step_size,
    toward,
)

LEAST_VALUE_SHARE = 0.36
"""The least value of a cell in a team of more than two, as a share of a lone robot's."""


@of_learner
def cell_value(mind: Any, task: Task, cell: int) -> float:
    """As `Factored.cell_value`."""
    raise NotImplementedError


@inlined
def refresh(mind: Any, task: Task, cell: int) -> None:
    """Set Q*(cell, .) from the factors."""
    u = mind.u[cell]
    r_bar = mind.r_bar[cell]
    q_star = mind.q_star[cell]
    for b in range(PRIMITIVES):
        q_star[b] = u[b] + r_bar[b]
    q_star[COORDINATE] = greatest(u, PRIMITIVES) - task.ask_cost + mind.w[cell]
    mind.value[cell] = cell_value(mind, task, cell)


@inlined
def count_move(mind: Any, task: Task, now: Transition, y: int) -> None:
    """Count the move of a step, which leads a robot alone to cell y, in the model."""
    x = now.cell
    b = now.move
    mind.updates[x][b] += 1
    if mind.updates[x][b] == 1 and task.map_samples == 0:
        mind.tried[mind.used[0]] = x * PRIMITIVES + b
        mind.used[0] += 1
    if y != x:
        mind.moved[x][b] += 1
        mind.successor[x][b] = y


@inlined
def learn_u(mind: Any, task: Task, now: Transition, y: int) -> None:
    """Learn U of the move of a step, which leads a robot alone to cell y.

    A robot that knows its map takes the values of all moves in the cell from its model instead.
    """
    x = now.cell
    b = now.move
    if task.map_samples > 0:
        plan_cell(mind, task, x)
        return
    after = task.goal_value if y == task.goal else mind.value[y]
    alpha = step_size(task, mind.updates[x][b], now.floor)
    target = now.individual + task.discount * after
    mind.u[x][b] = toward(mind.u[x][b], alpha, target)


@inlined
def plan_cell(mind: Any, task: Task, x: int) -> None:
    """Set U of all moves in a cell to their values in the model."""
    for b in range(PRIMITIVES):
        plan_move(mind, task, x, b)


@inlined
def plan_move(mind: Any, task: Task, x: int, b: int) -> None:
    """Set U of a move, and its value to a robot alone, by the model."""
    s = mind.successor[x][b]
    share = mind.moved[x][b] / (mind.updates[x][b] + task.map_samples)
    arrival = task.goal_reward + task.discount * task.goal_value
    there = arrival if s == task.goal else task.discount * mind.value[s]
    here = task.discount * mind.value[x]
    mind.u[x][b] = share * there + (1.0 - share) * here
    if task.robots > 2:
        there = arrival
        if s != task.goal:
            there = task.discount * greatest(mind.alone[s], PRIMITIVES)
        here = task.discount * greatest(mind.alone[x], PRIMITIVES)
        mind.alone[x][b] = share * there + (1.0 - share) * here
