# Copyright 2026 The sparse_coord_ros authors
# SPDX-License-Identifier: Apache-2.0
"""rho, the corrections of the learner `core.learners.factored`: rows of a sparse table.

A row [b] belongs to an own cell, a peer and the peer's cell. It says how the values of the moves
change if the peer is perceived there. Each own cell has one more row, for failed percepts.
"""

from collections.abc import Mapping
from typing import Any

from sparse_coord_ros.base.compiling import inner
from sparse_coord_ros.core.game.actions import PRIMITIVES
from sparse_coord_ros.core.learners.mind import NO_ROW, find
from sparse_coord_ros.core.learners.rules import (
    NOT_PERCEIVED,
    Task,
    Transition,
    Values,
    greatest,
    step_size,
    toward,
)

# Keys of rows.


@inner
def rho_key(cell: int, peer: int, peer_cell: int, cells: int, robots: int) -> int:
    """Return the key of a row of rho."""
    return (cell * robots + peer) * cells + peer_cell


@inner
def failed_key(cell: int, cells: int, robots: int) -> int:
    """Return the key of the row of failed percepts of a cell; of cell number `cells` the end."""
    return cells * robots * cells + cell


# Values.


def corrections_of(
    mind: Any, task: Task, cell: int, perceived: Mapping[int, int] | None, move: int
) -> dict[tuple[int, int], float]:
    """Return rho of a move, by (peer, its cell); by twice `NOT_PERCEIVED` if the percept failed.

    Args:
        mind: the robot's mind, as lists.
        task: its task.
        cell: the own cell.
        perceived: the cells of the peers, by peer; None: the percept failed.
        move: the primitive action.
    """
    keys = {(NOT_PERCEIVED, NOT_PERCEIVED): failed_key(cell, task.cells, task.robots)}
    if perceived is not None:
        keys = {
            (peer, place): rho_key(cell, peer, place, task.cells, task.robots)
            for peer, place in perceived.items()
        }
    rows = {place: find(mind.rho, key) for place, key in keys.items()}
    return {
        place: 0.0 if row == NO_ROW else mind.rho.values[row][move]
        for place, row in rows.items()
    }


@inner
def counts(task: Task, peer: int, cell: int, peer_cell: int) -> bool:
    """Return whether the robot counts the correction of a peer that it perceives.

    Of more than two robots in one cell, only those with higher numbers give way; a pair
    learns who waits by itself.
    """
    return not (task.robots > 2 and cell == peer_cell and task.number < peer)


@inlined
def correct(mind: Any, task: Task, cell: int, seen: int, cells: Any) -> None:
    """Set `mind.correction` to Q^C(x, z, .) - U(x, .), and `mind.found` to its rows of rho."""
    for b in range(PRIMITIVES):
        mind.correction[b] = 0.0
    if seen == 0:
        add_row(mind, failed_key(cell, task.cells, task.robots))
        return
    for peer in range(task.robots):
        mind.found[peer] = NO_ROW
        if peer != task.number and counts(task, peer, cell, cells[peer]):
            key = rho_key(cell, peer, cells[peer], task.cells, task.robots)
            mind.found[peer] = add_row(mind, key)


@inlined
def add_row(mind: Any, key: int) -> int:
    """Add a row of rho to `mind.correction`, if there is one; return it, or `NO_ROW`."""
    row = find(mind.rho, key)
    if row != NO_ROW:
        for b in range(PRIMITIVES):
            mind.correction[b] += mind.rho.values[row][b]
    return row


@inner
def gain(u: Values, correction: Values) -> float:
    """Return the change of the best move's value by a percept."""
    best = u[0] + correction[0]
    for b in range(1, PRIMITIVES):
        best = max(best, u[b] + correction[b])
    return best - greatest(u, PRIMITIVES)


# Learning.


@inlined
def learn_rho(
    mind: Any, task: Task, now: Transition, row: int, b: int, common: float
) -> None:
    """Learn one entry of rho from the r^C that its peer caused."""
    updates = mind.rho.updates[row]
    values = mind.rho.values[row]
    count = updates[b] + 1
    updates[b] = count
    values[b] = toward(values[b], step_of_rho(task, count, now.floor), common)


@inlined
def step_of_rho(task: Task, count: int, floor: float) -> float:
    """Return the step size of an entry's update: less than U's, which counts from 1."""
    return step_size(task, min(count + 1, len(task.step_sizes) - 1), floor)
