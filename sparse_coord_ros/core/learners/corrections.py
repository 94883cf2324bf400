# Copyright 2026 The sparse_coord_ros authors
# SPDX-License-Identifier: Apache-2.0
"""rho, the corrections of the learner `core.learners.factored`: rows of a table.

A row [b] belongs to an own cell, a peer and the peer's cell. It says how the values of the moves
change if the peer is perceived there. Each own cell has one more row, for failed percepts.
"""

from collections.abc import Mapping
from typing import Any

from sparse_coord_ros.base.compiling import jitable
from sparse_coord_ros.core.game.actions import PRIMITIVES
from sparse_coord_ros.core.learners.rules import (
    NOT_PERCEIVED,
    Task,
    Transition,
    Values,
    greatest,
    step_size,
    toward,
)
from sparse_coord_ros.core.learners.table import find

NO_CORRECTION = 0
"""The row that all rows begin with: it corrects nothing."""

# Keys of rows.


@jitable
def rho_key(cell: int, peer: int, peer_cell: int, cells: int, robots: int) -> int:
    """Return the key of a row of rho."""
    return (cell * robots + peer) * cells + peer_cell


@jitable
def failed_key(cell: int, cells: int, robots: int) -> int:
    """Return the key of the row of failed percepts of a cell; of cell number `cells` the end."""
    return cells * robots * cells + cell


# Values.


def corrections_of(
    mind: Any,
    task: Task,
    k: int,
    cell: int,
    perceived: Mapping[int, int] | None,
    move: int,
) -> dict[tuple[int, int], float]:
    """Return rho of a move, by (peer, its cell); by twice `NOT_PERCEIVED` if the percept failed.

    Args:
        mind: the team's mind.
        task: its task.
        k: the robot.
        cell: its cell.
        perceived: the cells of the peers, by peer; None: the percept failed.
        move: the primitive action.
    """
    keys = {(NOT_PERCEIVED, NOT_PERCEIVED): failed_key(cell, task.cells, task.robots)}
    if perceived is not None:
        keys = {
            (peer, place): rho_key(cell, peer, place, task.cells, task.robots)
            for peer, place in perceived.items()
        }
    return {
        place: float(mind.rho.values[k, find(mind.rho, k, key), move])
        for place, key in keys.items()
    }


@jitable
def counts(task: Task, k: int, peer: int, cell: int, peer_cell: int) -> bool:
    """Return whether a robot counts the correction of a peer that it perceives.

    Of more than two robots in one cell, only those with higher numbers give way; a pair
    learns who waits by itself.
    """
    return not (task.robots > 2 and cell == peer_cell and k < peer)


@jitable
def correct(mind: Any, task: Task, k: int, cell: int, seen: int, cells: Any) -> None:
    """Set `mind.correction` to Q^C(x, z, .) - U(x, .), and `mind.found` to its rows of rho."""
    for b in range(PRIMITIVES):
        mind.correction[k, b] = 0.0
    if seen == 0:
        add_row(mind, k, failed_key(cell, task.cells, task.robots))
        return
    for peer in range(task.robots):
        mind.found[k, peer] = NO_CORRECTION
        peer_cell = int(cells[peer])
        if peer != k and counts(task, k, peer, cell, peer_cell):
            key = rho_key(cell, peer, peer_cell, task.cells, task.robots)
            mind.found[k, peer] = add_row(mind, k, key)


@jitable
def add_row(mind: Any, k: int, key: int) -> int:
    """Add a row of rho to `mind.correction`; return it."""
    row = find(mind.rho, k, key)
    for b in range(PRIMITIVES):
        mind.correction[k, b] += mind.rho.values[k, row, b]
    return row


@jitable
def gain(u: Values, correction: Values) -> float:
    """Return the change of the best move's value by a percept."""
    best = u[0] + correction[0]
    for b in range(1, PRIMITIVES):
        best = max(best, u[b] + correction[b])
    return best - greatest(u, PRIMITIVES)


# Learning.


@jitable
def learn_rho(
    mind: Any, task: Task, k: int, now: Transition, row: int, b: int, common: float
) -> None:
    """Learn one entry of rho from the r^C that its peer caused."""
    count = int(mind.rho.updates[k, row, b]) + 1
    mind.rho.updates[k, row, b] = count
    alpha = step_of_rho(task, count, now.step)
    mind.rho.values[k, row, b] = toward(mind.rho.values[k, row, b], alpha, common)


@jitable
def step_of_rho(task: Task, count: int, step: int) -> float:
    """Return the step size of an entry's update: less than U's, which counts from 1."""
    return step_size(task, min(count + 1, len(task.step_sizes) - 1), step)
