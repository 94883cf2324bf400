# Copyright 2026 The sparse_coord_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The policies pi_epsilon and pi_g of Algorithm 1, for plain Python and compiled loops."""

from typing import Any

from sparse_coord_ros.base.compiling import inlined, inner
from sparse_coord_ros.core.game.actions import ACTIONS, COORDINATE, PRIMITIVES
from sparse_coord_ros.core.game.draws import (
    BLIND_ACTION,
    BLIND_EXPLORE,
    EXPLORE,
    EXPLORED_ACTION,
    LEAVE,
    MOVE_TIE,
    TIE,
    draw,
)
from sparse_coord_ros.core.learners.rules import (
    Task,
    Values,
    asking_values,
    explores,
    greatest,
    way_out,
)

LEAVING = 0.5
"""The probability with which a robot leaves a stand-off."""


@inlined
def greedy_action(values: Values, count: int, key: int, step: int, column: int) -> int:
    """Return the greedy action pi_g of the first `count`: uniform among exact maxima.

    Args:
        values: one row of a table.
        count: how many actions compete.
        key: the key of the robot's draws.
        step: the time step.
        column: the column of the draw that decides between ties.
    """
    best = greatest(values, count)
    ties = 0
    last = 0
    for action in range(count):
        if values[action] == best:
            ties += 1
            last = action
    # nearly always: without a branch for each value the processor waits less
    if ties == 1:
        return last
    return tied(values, best, count, int(draw(key, step, column) * ties))


@inner
def tied(values: Values, best: float, count: int, number: int) -> int:
    """Return the action with this number, from 0, among those with the best value."""
    for action in range(count):
        if values[action] == best:
            if number == 0:
                return action
            number -= 1
    return 0


@inlined
def choose(values: Values, count: int, epsilon: float, key: int, step: int) -> int:
    """Return A_k(t) by the learning policy pi_epsilon (Algorithm 1, line 4)."""
    if epsilon > 0.0 and draw(key, step, EXPLORE) < epsilon:
        return int(draw(key, step, EXPLORED_ACTION) * count)
    # NaN is never chosen
    return greedy_action(values, len(ACTIONS), key, step, TIE)


@inlined
def choose_move(
    mind: Any,
    task: Task,
    cell: int,
    seen: int,
    cells: Any,
    epsilon: float,
    key: int,
    step: int,
    values: Any,
) -> int:
    """Return the move that COORDINATE becomes (Algorithm 1, lines 6 to 10).

    Args:
        mind: the robot's mind.
        task: its task.
        cell: X_k(t).
        seen: the peers that it perceives, the sum of 2^j; 0: the percept failed.
        cells: the cells of all robots.
        epsilon: probability of exploring.
        key: the key of the robot's draws.
        step: the time step t.
        values: space for a row [move].
    """
    if epsilon > 0.0 and explores(mind, task, seen):
        if draw(key, step, BLIND_EXPLORE) < epsilon:
            return int(draw(key, step, BLIND_ACTION) * PRIMITIVES)
    asking_values(mind, task, cell, seen, cells, values)
    move = greedy_action(values, PRIMITIVES, key, step, MOVE_TIE)
    if task.leaves:
        out = way_out(mind, task, step, cell, seen, cells, values, move)
        if out != move and draw(key, step, LEAVE) < LEAVING:
            return out
    return move


@inner
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


@inner
def asks_at_times(values: Any) -> Any:
    """Return whether a greedy robot may ask: COORDINATE is at least as good as any move.

    Arguments and return value as of `asks_surely`.
    """
    asks = values[COORDINATE] >= values[0]
    for move in range(1, PRIMITIVES):
        asks = asks & (values[COORDINATE] >= values[move])
    return asks


def tabulate(mind: Any, task: Task, peer: int, cells: Any, table: Any) -> None:
    """Fill in Q^C of pairs: the values by which COORDINATE chooses a move.

    Args:
        mind: the robot's mind.
        task: its task.
        peer: the perceived peer.
        cells: space for the cells of all robots.
        table: filled, [own cell][cell of the peer][move].
    """
    for x in range(task.cells):
        cells[task.number] = x
        for z in range(task.cells):
            cells[peer] = z
            asking_values(mind, task, x, 1 << peer, cells, table[x][z])
