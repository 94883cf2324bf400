# Copyright 2026 The sparse_coord_ros authors
# SPDX-License-Identifier: Apache-2.0
"""A robot's learning once more, fed with what its log says: one loop for each kind of tables.

The loops take nested lists in plain Python and arrays where numba compiled them: the same bits.
Choices and updates are the functions of `learn.algorithm` and `learn.factors`.
"""

import functools
from collections.abc import Callable
from typing import Any, NamedTuple

import numpy as np

from sparse_coord_ros.compiling import compile_once, has_numba
from sparse_coord_ros.engine.compiled import jitted
from sparse_coord_ros.game.streams import BLIND_ACTION, BLIND_EXPLORE
from sparse_coord_ros.kept import is_kept
from sparse_coord_ros.learn.algorithm import (
    COORDINATE,
    PRIMITIVES,
    epsilon_greedy,
    greatest,
    greedy,
    step_size,
    updated,
    weighed,
)
from sparse_coord_ros.learn.factors import (
    Own,
    Terms,
    learn_asking,
    learn_correction,
    learn_move,
    refresh,
    replay,
)

COMPILING_PAYS = 300_000
"""Actions from which on compiling a loop, a few seconds, takes less time than it saves."""

LOADING_PAYS = 50_000
"""The same for a loop that was compiled before and kept: half a second."""


class Rule(NamedTuple):
    """What holds at every step.

    Attributes:
        actions: 5 with COORDINATE, 4 without.
        learning: whether anything is learned.
        goal: the cell that ends the robot's episodes.
        discount: gamma.
        goal_value: value of being at the goal while learning.
        weights: how much each part of a reward counts.
    """

    actions: int
    learning: bool
    goal: int
    discount: float
    goal_value: float
    weights: tuple[float, float, float]


class Learned(NamedTuple):
    """What one robot has learned so far.

    Attributes:
        q_star: Q* [x][action].
        q_coord: the rows of Q^C that the log speaks of [row][move].
        star_updates, coord_updates: how often each entry was updated.
        shows: 1 where the robot would choose COORDINATE, else 0 [x].
    """

    q_star: Any
    q_coord: Any
    star_updates: Any
    coord_updates: Any
    shows: Any


class Said(NamedTuple):
    """What the log says of the robot's actions; index i is an action.

    Attributes:
        cell: where it was; next_cell: where it was one step later.
        action: A_k(t), 0 to 4; move: the primitive action that it became.
        row: the row of Q^C that it perceived, or -1.
        learned: whether it has learned from the action.
        reward: individual, common, cost of asking [i][3].
        draws: the draws of the policy at the time step [i][5].
        epsilon: probability of exploring.
        alpha: least step size.
    """

    cell: Any
    next_cell: Any
    action: Any
    move: Any
    row: Any
    learned: Any
    reward: Any
    draws: Any
    epsilon: Any
    alpha: Any


class FactorRules(NamedTuple):
    """What holds at every step of a robot that learns in factors.

    Attributes:
        actions, learning, weights: as of `Rule`.
        terms: the numbers of the rule.
        replays, percept_update: as of `learn.factors.FactorRule`.
    """

    actions: int
    learning: bool
    weights: tuple[float, float, float]
    terms: Terms
    replays: int
    percept_update: bool


class LearnedFactors(NamedTuple):
    """What one robot that learns in factors has learned so far.

    Attributes:
        own: its factors but rho, and its model.
        rho: the rows of rho that the log speaks of [row][move]; counts: their updates.
        peers: the other robots' numbers, ascending.
        correction: space for Q^C(x, z, .) - U(x, .) [move]; values: for Q^C(x, z, .).
    """

    own: Own
    rho: Any
    counts: Any
    peers: Any
    correction: Any
    values: Any


class SaidFactors(NamedTuple):
    """What the log says of the actions of a robot that learns in factors.

    Attributes:
        cell, next_cell, action, move, learned, reward, draws, epsilon, alpha: as of `Said`.
        known: the rows of rho of its peers, or -1 where it does not know where one is [i][peer].
        counted: those of them that count where it acts on a percept, others -1 [i][peer].
        unseen: the row of failed percepts, or -1 where it perceived its peers [i].
        partners: as of `game.world.Reward`.
        blind: the draws for a move after a failed percept [i][2].
        replay: the draw that picks what is replayed [i].
    """

    cell: Any
    next_cell: Any
    action: Any
    move: Any
    known: Any
    counted: Any
    unseen: Any
    learned: Any
    reward: Any
    partners: Any
    draws: Any
    blind: Any
    replay: Any
    epsilon: Any
    alpha: Any


def coordinates(values: Any, actions: int) -> int:
    """Return 1 where COORDINATE is the first greatest of a row's values, else 0."""
    if actions > COORDINATE and values[COORDINATE] > greatest(values, PRIMITIVES):
        return 1
    return 0


def follow(
    rule: Rule, learned: Learned, said: Said, by_count: Any, begin: int, end: int
) -> tuple[int, int, int]:
    """Choose and learn again from action `begin` on, before `end`.

    Returns:
        The first action that is another one than the log says, or `end`; what it chooses there,
        and the primitive action that comes of it.
    """
    q_star, q_coord = learned.q_star, learned.q_coord
    star_updates, coord_updates = learned.star_updates, learned.coord_updates
    last = len(by_count) - 1
    for i in range(begin, end):
        x = said.cell[i]
        values = q_star[x]
        draws = said.draws[i]
        action = epsilon_greedy(
            values, rule.actions, said.epsilon[i], draws[0], draws[1], draws[2]
        )
        row = said.row[i]
        move = action
        if action == COORDINATE:
            if row < 0:
                move = greedy(values, PRIMITIVES, draws[3])
            else:
                move = greedy(q_coord[row], PRIMITIVES, draws[3])
        if action != said.action[i] or move != said.move[i]:
            return i, action, move
        if not said.learned[i] or not rule.learning:
            continue
        parts = said.reward[i]
        reward = weighed(parts[0], parts[1], parts[2], rule.weights)
        y = said.next_cell[i]
        if y == rule.goal:
            bootstrap = rule.goal_value
        else:
            bootstrap = greatest(q_star[y], rule.actions)
        if row >= 0:
            count = coord_updates[row][move] + 1
            coord_updates[row][move] = count
            alpha = step_size(by_count[min(count, last)], said.alpha[i])
            value = q_coord[row][move]
            q_coord[row][move] = updated(value, alpha, reward, rule.discount, bootstrap)
        count = star_updates[x][action] + 1
        star_updates[x][action] = count
        alpha = step_size(by_count[min(count, last)], said.alpha[i])
        values[action] = updated(values[action], alpha, reward, rule.discount, bootstrap)
        learned.shows[x] = coordinates(values, rule.actions)
    return end, 0, 0


def correct(learned: LearnedFactors, counted: Any, unseen: int) -> None:
    """Set `learned.correction` to Q^C(x, z, .) - U(x, .) of what an action perceived."""
    correction, rho = learned.correction, learned.rho
    for b in range(PRIMITIVES):
        correction[b] = 0.0
    if unseen >= 0:
        for b in range(PRIMITIVES):
            correction[b] += rho[unseen][b]
        return
    for j in range(len(learned.peers)):
        if counted[j] >= 0:
            for b in range(PRIMITIVES):
                correction[b] += rho[counted[j]][b]


def follow_factors(
    rule: FactorRules,
    learned: LearnedFactors,
    said: SaidFactors,
    by_count: Any,
    begin: int,
    end: int,
) -> tuple[int, int, int]:
    """Do what `follow` does, for a robot that learns as `learn.factored.FactoredAgent` does."""
    own, rho, counts, values = learned.own, learned.rho, learned.counts, learned.values
    for i in range(begin, end):
        x = said.cell[i]
        draws, counted, unseen = said.draws[i], said.counted[i], said.unseen[i]
        action = epsilon_greedy(
            own.star[x], rule.actions, said.epsilon[i], draws[0], draws[1], draws[2]
        )
        move = action
        if action == COORDINATE:
            correct(learned, counted, unseen)
            for b in range(PRIMITIVES):
                values[b] = own.u[x][b] + learned.correction[b]
            if unseen >= 0 and said.blind[i][BLIND_EXPLORE] < said.epsilon[i]:
                move = int(said.blind[i][BLIND_ACTION] * PRIMITIVES)
            else:
                move = greedy(values, PRIMITIVES, draws[3])
        if action != said.action[i] or move != said.move[i]:
            return i, action, move
        if not said.learned[i] or not rule.learning:
            continue
        partners, floor = said.partners[i], said.alpha[i]
        individual = rule.weights[0] * said.reward[i][0]
        common = rule.weights[1] * (said.reward[i][1] if partners != 0 else 0.0)
        asked = action == COORDINATE
        y = said.next_cell[i]
        learn_move(own, x, move, y, individual, common, asked, rule.terms, by_count, floor)
        for j in range(len(learned.peers)):
            row = said.known[i][j]
            if row >= 0:
                share = common if (partners >> learned.peers[j]) & 1 else 0.0
                learn_correction(rho[row], counts[row], move, share, by_count, floor)
        if asked:
            if unseen >= 0:
                learn_correction(rho[unseen], counts[unseen], move, common, by_count, floor)
            correct(learned, counted, unseen)
            learn_asking(own, x, learned.correction, rule.percept_update, by_count, floor)
        refresh(own, x, rule.terms)
        replay(own, rule.replays, said.replay[i], rule.terms)
    return end, 0, 0


LOOPS: dict[str, Callable[..., Any]] = {"follow_tables": follow, "follow_factors": follow_factors}
"""The loops by what they are called where compiled ones are kept."""


def loop(
    name: str, count: int, *, compiled: bool | None = None
) -> tuple[Callable[..., Any], bool]:
    """Return a loop for so many actions, and whether it is compiled and takes arrays.

    Args:
        name: of `LOOPS`.
        count: how many actions there are to follow.
        compiled: whether to compile it; None: where numba is installed and it pays, or was
            compiled before and kept.
    """
    if compiled is None:
        pays = count >= COMPILING_PAYS or (count >= LOADING_PAYS and is_kept(name))
        compiled = pays and has_numba()
    if compiled:
        return functools.partial(_compiled_call, name), True
    return LOOPS[name], False


def _compiled_call(
    name: str, rule: Any, learned: Any, said: Any, by_count: Any, begin: int, end: int
) -> Any:
    call = _compiled(name)
    compile_once(name, lambda: call(rule, learned, said, by_count, 0, 0))  # for these types
    return call(rule, learned, said, by_count, begin, end)


@functools.cache
def _compiled(name: str) -> Callable[..., Any]:
    return jitted([LOOPS[name]], (epsilon_greedy, coordinates, correct))[0]


def as_lists(values: Any) -> Any:
    """Return a tuple of arrays, or of such tuples, as one of nested lists, for plain Python."""
    if isinstance(values, np.ndarray):
        return values.tolist()
    if hasattr(values, "_fields"):
        return type(values)(*map(as_lists, values))
    return values
