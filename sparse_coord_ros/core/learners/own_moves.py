# Copyright 2026 The sparse_coord_ros authors
# SPDX-License-Identifier: Apache-2.0
"""U of the learner `core.learners.factored`, and its model of where moves lead.

The model counts how often a move led out of its cell, and keeps the cell where it led last.
"""

from typing import Any

from sparse_coord_ros.base.compiling import jitable
from sparse_coord_ros.core.game.actions import ACTIONS, COORDINATE, PRIMITIVES
from sparse_coord_ros.core.game.draws import REPLAY, draw
from sparse_coord_ros.core.learners.rules import (
    Task,
    Transition,
    greatest,
    step_size,
    toward,
)

LEAST_VALUE_SHARE = 0.36
"""The least value of a cell in a team of more than two, as a share of a lone robot's."""

GOLDEN = 0.6180339887498949
"""Golden section: its multiples, modulo 1, spread one draw evenly over the moves to replay."""


@jitable
def refresh(mind: Any, task: Task, k: int, cell: int) -> None:
    """Set Q*(cell, .) from the factors."""
    u = mind.u[k, cell]
    for b in range(PRIMITIVES):
        mind.q_star[k, cell, b] = u[b] + mind.r_bar[k, cell, b]
    ask_cost = task.weights[2] * task.ask_cost
    asking = greatest(u, PRIMITIVES) - ask_cost + mind.w[k, cell]
    mind.q_star[k, cell, COORDINATE] = asking
    mind.value[k, cell] = cell_value(mind, task, k, cell)


@jitable
def cell_value(mind: Any, task: Task, k: int, cell: int) -> float:
    """Return max_b Q*(cell, b); in a larger team at least a share of a lone robot's.

    There r^C counts so often that the values of a room could fall to 0, and stay there.
    """
    best = greatest(mind.q_star[k, cell], len(ACTIONS))
    if task.robots > 2:
        alone = greatest(mind.alone[k, cell], PRIMITIVES)
        return max(best, LEAST_VALUE_SHARE * alone)
    return best


@jitable
def arrival_value(task: Task) -> float:
    """Return the value of an arrival: its reward, and that of being at the goal."""
    return float(task.weights[0] * task.goal_reward + task.discount * task.goal_value)


@jitable
def count_move(mind: Any, task: Task, k: int, now: Transition, y: int) -> None:
    """Count the move of a step, which leads a robot alone to cell y, in the model."""
    x = now.cell
    b = now.move
    mind.updates[k, x, b] += 1
    if mind.updates[k, x, b] == 1 and task.map_samples == 0:
        mind.tried[k, mind.used[k, 0]] = x * PRIMITIVES + b
        mind.used[k, 0] += 1
    if y != x:
        mind.moved[k, x, b] += 1
        mind.successor[k, x, b] = y


@jitable
def learn_u(mind: Any, task: Task, k: int, now: Transition, after: float) -> None:
    """Learn U of the move of a step, by the value of the cell where it leads a robot alone.

    A robot that knows its map takes the values of all moves in the cell from its model instead.
    """
    x = now.cell
    b = now.move
    if task.map_samples > 0:
        plan_cell(mind, task, k, x)
        return
    alpha = step_size(task, int(mind.updates[k, x, b]), now.step)
    target = task.weights[0] * now.individual + task.discount * after
    mind.u[k, x, b] = toward(mind.u[k, x, b], alpha, target)


@jitable
def replay(mind: Any, task: Task, k: int, step: int) -> None:
    """Set U of moves to their values in the robot's own model (Dyna).

    They are drawn among the moves that were tried. A robot that knows its map replays all
    moves of the cell.
    """
    chance = draw(task.keys[k], step, REPLAY)
    for number in range(task.replays):
        share = (chance + number * GOLDEN) % 1.0
        pair = int(mind.tried[k, int(share * mind.used[k, 0])])
        x = pair // PRIMITIVES
        if task.map_samples > 0:
            plan_cell(mind, task, k, x)
        else:
            plan_move(mind, task, k, x, pair % PRIMITIVES)
        refresh(mind, task, k, x)


@jitable
def plan_cell(mind: Any, task: Task, k: int, x: int) -> None:
    """Set U of all moves in a cell to their values in the model."""
    for b in range(PRIMITIVES):
        plan_move(mind, task, k, x, b)


@jitable
def plan_move(mind: Any, task: Task, k: int, x: int, b: int) -> None:
    """Set U of a move, and its value to a robot alone, by the model."""
    s = int(mind.successor[k, x, b])
    share = mind.moved[k, x, b] / (mind.updates[k, x, b] + task.map_samples)
    arrival = arrival_value(task)
    leads_home = s == task.goals[k]
    there = arrival if leads_home else task.discount * mind.value[k, s]
    here = task.discount * mind.value[k, x]
    mind.u[k, x, b] = share * there + (1.0 - share) * here
    if task.robots > 2:
        there = arrival
        if not leads_home:
            there = task.discount * greatest(mind.alone[k, s], PRIMITIVES)
        here = task.discount * greatest(mind.alone[k, x], PRIMITIVES)
        mind.alone[k, x, b] = share * there + (1.0 - share) * here
