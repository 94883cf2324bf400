# Copyright 2026 The sparse_coord_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Looking back: how the learner `core.learners.factored` learns from two questions in a row.

The second answer says where the peers went. So the robot knows what each move at the first
question would have brought, not only the move that it made.
"""

from typing import Any

from sparse_coord_ros.base.compiling import jitable
from sparse_coord_ros.core.game.actions import PRIMITIVES
from sparse_coord_ros.core.game.interactions import stops
from sparse_coord_ros.core.game.sight import is_ruled_out
from sparse_coord_ros.core.learners.corrections import (
    correct,
    failed_key,
    gain,
    learn_rho,
    rho_key,
    step_of_rho,
)
from sparse_coord_ros.core.learners.own_moves import arrival_value
from sparse_coord_ros.core.learners.rules import NOT_PERCEIVED, Task, Transition, Values
from sparse_coord_ros.core.learners.table import find, met

STOP = 0.5
"""The weight of a stop, as a share of the value of an arrival. It costs one step, but robots that
stop each other may stand for ever: by that step alone most teams in a lane do."""


@jitable
def loss_of_stop(task: Task) -> float:
    """Return the loss from a stop: a share of the value of an arrival."""
    return STOP * arrival_value(task)


@jitable
def note_question(mind: Any, task: Task, k: int, now: Transition) -> None:
    """Note the question of this step, for the next one."""
    mind.last[k, 0] = now.step + 1
    mind.last[k, 1] = now.move
    for robot in range(task.robots):
        known = robot == k or now.seen != 0
        mind.last[k, 2 + robot] = int(now.cells[robot]) if known else NOT_PERCEIVED


@jitable
def learn_from_two_questions(mind: Any, task: Task, k: int, now: Transition) -> None:
    """Learn the result of each move at the first question, for each row of its percept.

    Args:
        mind: the team's mind; `last` has the first question.
        task: its task.
        k: the robot.
        now: the step with the second question.
    """
    first = int(mind.last[k, 2 + k])
    for b in range(PRIMITIVES):
        look_ahead(mind, task, k, now, first, b)
    correct(mind, task, k, first, now.seen, now.cells)
    here = share_of_surplus(mind, task, k, first, surplus(mind, task, k, first))
    failed = False
    for peer in range(task.robots):
        if peer == k:
            continue
        peer_cell = int(mind.last[k, 2 + peer])
        if peer_cell == NOT_PERCEIVED:
            failed = True
        else:
            key = rho_key(first, peer, peer_cell, task.cells, task.robots)
            learn_first(mind, task, k, now, first, key, peer, peer + 1, here)
    if failed:
        key = failed_key(first, task.cells, task.robots)
        learn_first(mind, task, k, now, first, key, 0, task.robots, here)


# The value of the second question.


@jitable
def look_ahead(
    mind: Any, task: Task, k: int, now: Transition, first: int, b: int
) -> None:
    """Set the value of a second question where a move leads, and the peers in the way there.

    Args:
        mind: the team's mind; `there` and `obstruction` are set.
        task: its task.
        k: the robot.
        now: the step with the second question.
        first: the cell of the first question.
        b: the move.
    """
    mind.there[k, b] = 0.0
    mind.obstructed[k, b] = 0.0
    for peer in range(task.robots):
        mind.obstruction[k, b, peer] = 0.0
    s = int(mind.successor[k, first, b])
    if mind.moved[k, first, b] == 0 or s == task.goals[k]:
        return
    correct(mind, task, k, s, now.seen, now.cells)
    mind.there[k, b] = surplus(mind, task, k, s)
    if now.seen != 0:
        best = best_move(mind.u[k, s])
        for peer in range(task.robots):
            value = float(mind.rho.values[k, mind.found[k, peer], best])
            mind.obstruction[k, b, peer] = min(0.0, value)
            mind.obstructed[k, b] += mind.obstruction[k, b, peer]


@jitable
def surplus(mind: Any, task: Task, k: int, cell: int) -> float:
    """Return the value of the percept of `mind.correction` in a cell one step later.

    It is counted beyond the average of percepts there.
    """
    change = gain(mind.u[k, cell], mind.correction[k])
    return float(task.discount * (change - mind.w[k, cell]))


@jitable
def best_move(values: Values) -> int:
    """Return the best of the four moves, of equal ones the first."""
    best = 0
    for b in range(1, PRIMITIVES):
        if values[b] > values[best]:
            best = b
    return best


@jitable
def share_of_surplus(mind: Any, task: Task, k: int, first: int, here: float) -> float:
    """Return the gain of waiting at the first question, for each peer in the way.

    The peers share a surplus: if each were credited with all of it, r_bar would say that
    waiting pays without asking, too. A loss counts in full.
    """
    if here > 0.0 and task.robots > 2:
        return here / max(1, in_the_way(mind, task, k, first))
    return here


@jitable
def in_the_way(mind: Any, task: Task, k: int, first: int) -> int:
    """Return the number of peers in the way at the first of two questions."""
    count = 0
    best = best_move(mind.u[k, first])
    for peer in range(task.robots):
        peer_cell = int(mind.last[k, 2 + peer])
        if peer != k and peer_cell != NOT_PERCEIVED:
            key = rho_key(first, peer, peer_cell, task.cells, task.robots)
            row = find(mind.rho, k, key)
            if mind.rho.values[k, row, best] < 0.0:
                count += 1
    return count


@jitable
def share_of(mind: Any, task: Task, k: int, low: int, high: int, b: int) -> float:
    """Return these peers' share of the obstruction; if no peer is in the way, shares are equal.

    Args:
        mind: the team's mind.
        task: its task.
        k: the robot.
        low: the peers are one, with this number; or all.
        high: the number after theirs.
        b: the move.
    """
    if high - low > 1:
        return 1.0
    if mind.obstructed[k, b] < 0.0:
        return float(mind.obstruction[k, b, low] / mind.obstructed[k, b])
    return 1.0 / (task.robots - 1)


# The moves at the first question.


@jitable
def learn_first(
    mind: Any,
    task: Task,
    k: int,
    now: Transition,
    first: int,
    key: int,
    low: int,
    high: int,
    here: float,
) -> None:
    """Learn the results of the moves at the first question, for one row of rho.

    Each move that was tried would have led to its successor, or left the robot in its cell. The
    new cell counts with the value of a second question there, and so does waiting, if peers are
    in the way. To this comes the r^C that the move would have cost. For the actual move r^C is
    learned already.

    Args:
        mind: the team's mind.
        task: its task.
        k: the robot.
        now: the step with the second question.
        first: the cell of the first question.
        key: of the row of the percept there.
        low: the peer of the row; 0 for a failed percept, which has all peers.
        high: the number after that of the last peer.
        here: the value of the second question in the first cell.
    """
    row = met(mind.rho, task, k, key)
    rho = mind.rho.values[k, row]
    waiting = here if rho[best_move(mind.u[k, first])] < 0.0 else 0.0
    for b in range(PRIMITIVES):
        tried = int(mind.updates[k, first, b]) + task.map_samples
        if tried == 0:
            continue
        share = mind.moved[k, first, b] / tried
        s = int(mind.successor[k, first, b])
        stopped = would_stop(mind, task, k, now, low, high, first, s)
        brought = (1.0 - share) * waiting
        if stopped:
            brought += share * here
        else:
            brought += share * mind.there[k, b] * share_of(mind, task, k, low, high, b)
        if b == mind.last[k, 1]:
            count = int(mind.rho.updates[k, row, b])
            rho[b] += step_of_rho(task, count, now.step) * brought
        elif common_is_known(task, now, first, s, share):
            brought += (1.0 - share) * common_of_staying(
                mind, task, k, now, low, high, first
            )
            going = common_of_going(mind, task, k, now, low, high, first, s, stopped)
            brought += share * going
            if brought != 0.0 or rho[b] != 0.0:
                learn_rho(mind, task, k, now, row, b, brought)


@jitable
def would_stop(
    mind: Any,
    task: Task,
    k: int,
    now: Transition,
    low: int,
    high: int,
    first: int,
    s: int,
) -> bool:
    """Return whether a peer would have stopped the robot on its way from first to s."""
    if not task.blocks or now.seen == 0 or not mind.narrow[k, s]:
        return False
    for j in range(low, high):
        if j != k:
            before = mind.last[k, 2 + j]
            if stops(s, first, before, now.cells[j], j < k):
                return True
    return False


@jitable
def common_is_known(
    task: Task, now: Transition, first: int, s: int, share: float
) -> bool:
    """Return whether the second percept says what r^C a move from first to s would have cost.

    A failed percept says so if it proves that the cells are empty. The successor does not count
    for a move that never led away (`share` is 0).
    """
    if now.seen != 0:
        return True
    return is_empty(task, now, first) and (share == 0.0 or is_empty(task, now, s))


@jitable
def is_empty(task: Task, now: Transition, cell: int) -> bool:
    """Return whether a failed percept proves that a cell is empty; only with one peer."""
    return task.robots == 2 and is_ruled_out(task.sight, now.cell, cell)


@jitable
def common_of_staying(
    mind: Any, task: Task, k: int, now: Transition, low: int, high: int, first: int
) -> float:
    """Return the r^C that was once felt in the first cell, if one of the peers is there now."""
    if is_met(k, now, low, high, first):
        return float(mind.door[k, first])
    return 0.0


@jitable
def common_of_going(
    mind: Any,
    task: Task,
    k: int,
    now: Transition,
    low: int,
    high: int,
    first: int,
    s: int,
    stopped: bool,
) -> float:
    """Return the r^C that a move from first to s would have cost, or the loss from a stop."""
    if stopped:
        return -loss_of_stop(task)
    if is_met(k, now, low, high, s):
        return float(mind.door[k, s])
    if task.swaps and would_exchange(mind, task, k, now, low, high, first, s):
        return float(mind.passage[k, s])
    return 0.0


@jitable
def is_met(k: int, now: Transition, low: int, high: int, cell: int) -> bool:
    """Return whether one of the peers was perceived in a cell."""
    if now.seen == 0:
        return False
    for j in range(low, high):
        if j != k and now.cells[j] == cell:
            return True
    return False


@jitable
def would_exchange(
    mind: Any,
    task: Task,
    k: int,
    now: Transition,
    low: int,
    high: int,
    first: int,
    s: int,
) -> bool:
    """Return whether the robot would have exchanged cells with a peer, going from first to s."""
    if now.seen == 0:
        return False
    for j in range(low, high):
        if j != k and mind.last[k, 2 + j] == s and now.cells[j] == first:
            return True
    return False
