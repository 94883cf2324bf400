# Copyright 2026 The sparse_coord_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Q* and Q^C in factors: U(x, b), what a robot does alone, and what its peers change in it.

    Q*(x, b)          = U(x, b) + r_bar(x, b)                      for the four moves b
    Q*(x, COORDINATE) = max_b U(x, b) - cost of asking + W(x)
    Q^C(x, z, b)      = U(x, b) + sum over the peers j of rho_j(x, z_j, b)

By its definition Q^C(x, z, b) = E[r^I + gamma max Q*(y, .)] + E[r^C]: the first term, U, does not
depend on where the peers are; the second, rho, is 0 in nearly all joint states. Here is what
is learned, as data, and the rule as functions of one robot's rows; the agent of `learn.factored`
calls them with lists, the compiled loops with arrays. docs/coordination.md has the reasons.
"""

from collections.abc import Iterable
from typing import Any, NamedTuple

import numpy as np

from sparse_coord_ros.compiling import inlined, inner
from sparse_coord_ros.game.actions import ACTIONS, COORDINATE, PRIMITIVES
from sparse_coord_ros.game.scenario import is_sparse
from sparse_coord_ros.learn.algorithm import Values, greatest, step_size
from sparse_coord_ros.learn.archive import check_range

UNSEEN = -1
"""In place of a peer and its cell: the percept failed."""


class FactorRule(NamedTuple):
    """The parts of the rule; turning one off is for ablations.

    Attributes:
        replays: moves whose U is set to what the own model says of them, after each step.
        percept_update: whether a percept also corrects r_bar, for every move.
        right_of_way: whether, of several robots in one cell, only those with higher numbers give
            way: a robot leaves out the correction of a peer in its own cell that has a higher
            number. Of more than two robots only; a pair learns who waits by itself.
        look_back: whether a robot that asks in two steps in a row learns what each move would
            have brought in the first.
    """

    replays: int = 1
    percept_update: bool = True
    right_of_way: bool = True
    look_back: bool = True


class Factors(NamedTuple):
    """What one robot has learned.

    Attributes:
        individual: U, shape (cells, 4), float64.
        common: r_bar, the r^C to be expected without knowing where the peers are, (cells, 4).
        asking: W, what a percept is worth, shape (cells,).
        states: where rho is not 0, ascending, shape (rows, 3), int32: the own cell, the peer's
            number from 0 and its cell; twice `UNSEEN` for the row of failed percepts.
        corrections: rho of these, shape (rows, 4), float64.
    """

    individual: np.ndarray
    common: np.ndarray
    asking: np.ndarray
    states: np.ndarray
    corrections: np.ndarray


@inner
def counted(number: int, peer: int, x: int, z: int, right_of_way: bool) -> bool:
    """Return whether a robot in x counts the correction of a peer that it perceives in z.

    Args:
        number: the robot.
        peer: the peer.
        x: the own cell.
        z: the peer's cell.
        right_of_way: whether the lower number goes first where both are in one cell.
    """
    return not (right_of_way and x == z and number < peer)


@inner
def key_of(x: int, peer: int, z: int, cells: int, robots: int) -> int:
    """Return the number of a correction's row: the own cell, the peer, the peer's cell."""
    return (x * robots + peer) * cells + z


@inner
def unseen_key(x: int, cells: int, robots: int) -> int:
    """Return the number of the row of failed percepts of a cell."""
    return cells * robots * cells + x


def keys_below(cells: int, robots: int) -> int:
    """Return the number that all row numbers are below."""
    return unseen_key(cells, cells, robots)


def rows_at_most(cells: int, robots: int) -> int:
    """Return how many rows of corrections a robot can have."""
    return cells * (cells * (robots - 1) + 1)


def states_of(keys: Iterable[int], cells: int, robots: int) -> np.ndarray:
    """Return what row numbers mean, as `Factors.states`: shape (rows, 3), int32."""
    numbers = np.fromiter(keys, dtype=np.int64)
    seen = numbers < cells * robots * cells
    own, rest = np.divmod(numbers, robots * cells)
    peer, z = np.divmod(rest, cells)
    columns = [np.where(seen, own, numbers - cells * robots * cells)]
    columns += [np.where(seen, peer, UNSEEN), np.where(seen, z, UNSEEN)]
    return np.stack(columns, axis=1).astype(np.int32)


def check_states(states: np.ndarray, cells: int, robots: int) -> None:
    """Raise `ValueError` unless these can be `Factors.states`."""
    for column, low, high in zip(
        states.T, (0, UNSEEN, UNSEEN), (cells, robots, cells), strict=True
    ):
        check_range(column, low, high, "states")


def keys_of(states: np.ndarray, cells: int, robots: int) -> np.ndarray:
    """Return the row numbers of `Factors.states`: shape (rows,), int64."""
    x, peer, z = states.astype(np.int64).T
    keys: np.ndarray = np.where(
        peer == UNSEEN, cells * robots * cells + x, (x * robots + peer) * cells + z
    )
    return keys


class AdditiveTable:
    """Q^C over joint states too many for an array, read from factors.

    `table[cell, *peer_cells]` is the row of a joint state, `table[cell, *peer_cells, action]` an
    entry of it; the peers are in ascending order. It cannot be written to. Who has the right of
    way in a cell counts, as of `counted`.

    Args:
        factors: the robot's factors.
        number: the robot, from 0.
        robots: how many there are.
    """

    def __init__(self, factors: Factors, number: int, robots: int) -> None:
        cells = len(factors.individual)
        self.shape = (cells,) * robots + (PRIMITIVES,)
        self._individual, self._number = factors.individual, number
        self._peers = [peer for peer in range(robots) if peer != number]
        states = map(tuple, factors.states.tolist())
        self._rows = dict(zip(states, factors.corrections, strict=True))

    def __getitem__(self, index: tuple[int, ...]) -> Any:
        """Return the row of a joint state, or one entry of it."""
        x, *others = index
        correction = np.zeros(PRIMITIVES)
        for peer, z in zip(self._peers, others, strict=False):
            row = self._rows.get((x, peer, z))
            if row is not None and counted(self._number, peer, x, z, len(self._peers) > 1):
                correction = correction + row
        values = self._individual[x] + correction
        return values[others[-1]] if len(index) == len(self.shape) else values


def coordination_table(factors: Factors, number: int, robots: int) -> "np.ndarray | AdditiveTable":
    """Return Q^C as the robot acts on it: an array for two robots, else read from the factors.

    On large maps it is read from them as well, as of `is_sparse`. An array has the shape (cells,
    cells, 4), float64: the own cell, the peer's, the move.

    Args:
        factors: the robot's factors.
        number: the robot, from 0.
        robots: how many there are.
    """
    if is_sparse(len(factors.individual), robots):
        return AdditiveTable(factors, number, robots)
    cells = len(factors.individual)
    correction = np.zeros((cells, cells, PRIMITIVES))
    seen = factors.states[:, 1] != UNSEEN
    x, _, z = factors.states[seen].T
    correction[x, z] += factors.corrections[seen]
    table: np.ndarray = factors.individual[:, None, :] + correction
    return table


# The rule. Rows are lists in plain Python and arrays in the compiled loops.


class Own(NamedTuple):
    """One robot's factors and model while it learns; x is a cell, b a move.

    Attributes:
        u: U [x][b].
        r_bar: [x][b].
        w: W [x].
        star: Q* [x][action], kept up to date.
        value: max_b Q*(x, b) over all five actions [x], kept up to date.
        updates: how often a move was tried [x][b], and COORDINATE [x][4].
        door: the last r^C felt on coming to a cell, or staying there, weighed; 0: never any [x].
        commons: updates of each entry of r_bar [x][b].
        moved: how often a move led out of its cell [x][b].
        successor: where it led the last time that it did [x][b].
        last: of the last step with COORDINATE: the step after it, the move and all robots' cells,
            the peers' `UNSEEN` where the percept failed.
        tried: the moves that were tried, x * moves + b, in the order of their first time, with
            room for all.
        used: [number of moves that were tried].
    """

    u: Any
    r_bar: Any
    w: Any
    star: Any
    value: Any
    updates: Any
    door: Any
    commons: Any
    moved: Any
    successor: Any
    last: Any
    tried: Any
    used: Any


class Terms(NamedTuple):
    """The numbers of the rule.

    Attributes:
        cost: of asking, weighed.
        discount: gamma.
        goal: the cell that ends the robot's episodes.
        goal_value: value of being there.
        arrival: r^I there, weighed, and gamma times `goal_value`.
        credit: how often r^C counts, at least 1.
    """

    cost: float
    discount: float
    goal: int
    goal_value: float
    arrival: float
    credit: float


@inner
def toward(value: float, alpha: float, target: float) -> float:
    """Return a value moved toward a target by a share of the way."""
    return value + alpha * (target - value)


@inlined
def refresh(own: Own, x: int, terms: Terms) -> None:
    """Set Q*(x, .) and its maximum from the factors."""
    u, r_bar, star = own.u[x], own.r_bar[x], own.star[x]
    for b in range(PRIMITIVES):
        star[b] = u[b] + r_bar[b]
    star[COORDINATE] = greatest(u, PRIMITIVES) - terms.cost + own.w[x]
    own.value[x] = greatest(star, len(ACTIONS))


@inlined
def learn_move(
    own: Own,
    x: int,
    m: int,
    y: int,
    individual: float,
    common: float,
    asked: bool,
    terms: Terms,
    by_count: Values,
    floor: float,
) -> None:
    """Learn U and the model from the move m from x to y and, if nobody was asked, r_bar.

    Args:
        own: the robot's factors, changed.
        x: X_k(t).
        m: the primitive action.
        y: X_k(t+1).
        individual: r^I, weighed.
        common: r^C as far as it is the robot's, weighed.
        asked: whether the robot chose COORDINATE.
        terms: the numbers of the rule.
        by_count: n^-w by n.
        floor: least step size.
    """
    count = own.updates[x][m] + 1
    own.updates[x][m] = count
    if count == 1:
        own.tried[own.used[0]] = x * PRIMITIVES + m
        own.used[0] += 1
    if y != x:
        own.moved[x][m] += 1
        own.successor[x][m] = y
    if common != 0.0:
        own.door[y] = common
    after = terms.goal_value if y == terms.goal else own.value[y]
    alpha = step_size(by_count[count], floor)
    own.u[x][m] = toward(own.u[x][m], alpha, individual + terms.discount * after)
    if not asked:
        count = own.commons[x][m] + 1
        own.commons[x][m] = count
        alpha = step_size(1.0 / (count + 1), floor / terms.credit)
        own.r_bar[x][m] = toward(own.r_bar[x][m], alpha, common)


@inner
def step_of_rho(count: int, by_count: Values, floor: float) -> float:
    """Return the step size of an entry's update: less than U's, which counts from 1."""
    return step_size(by_count[min(count + 1, len(by_count) - 1)], floor)


@inner
def learn_correction(
    rho: Any, counts: Any, m: int, common: float, by_count: Values, floor: float
) -> None:
    """Learn one entry of a row of rho from the r^C that is its peer's doing."""
    count = counts[m] + 1
    counts[m] = count
    rho[m] = toward(rho[m], step_of_rho(count, by_count, floor), common)


@inner
def gain(u: Values, correction: Values) -> float:
    """Return what a percept changes in the value of the best move."""
    best = u[0] + correction[0]
    for b in range(1, PRIMITIVES):
        best = max(best, u[b] + correction[b])
    return best - greatest(u, PRIMITIVES)


@inner
def best_of(values: Values) -> int:
    """Return the best of the four moves, of equal ones the first."""
    best = 0
    for b in range(1, PRIMITIVES):
        if values[b] > values[best]:
            best = b
    return best


class Sight(NamedTuple):
    """What a robot knows, having asked, of where its peers are.

    Attributes:
        perceived: whether the percept succeeded.
        cells: all robots' cells; of peers only if it did.
        ruled_out: where a peer cannot be if it failed [cell].
    """

    perceived: Any
    cells: Any
    ruled_out: Any


@inner
def met(sight: Sight, peers: int, place: int) -> bool:
    """Return whether one of the peers (the sum of 2^j) was perceived in a cell."""
    for j in range(len(sight.cells)):
        if (peers >> j) & 1 and sight.cells[j] == place:
            return bool(sight.perceived)
    return False


@inner
def empty(sight: Sight, place: int) -> bool:
    """Return whether a failed percept says that nobody is in a cell: of one peer alone."""
    return bool(len(sight.cells) == 2 and sight.ruled_out[place])


class Outlook(NamedTuple):
    """What the second of two questions in a row would have been worth in other cells.

    Attributes:
        here: in the cell of the first, beyond what U says of staying there.
        there: where each move leads from it, beyond what U says of being there [b].
        blame: how far each robot is in the way there: its rho of the best move, if negative
            [b][robot].
    """

    here: Any
    there: Any
    blame: Any


@inner
def surplus(own: Own, x: int, correction: Values, discount: float) -> float:
    """Return what a percept is worth in x one step later, beyond the average of percepts there."""
    worth: float = discount * (gain(own.u[x], correction) - own.w[x])
    return worth


@inner
def share_of(peers: int, blame: Values) -> float:
    """Return how much of what is in the way these peers (the sum of 2^j) are.

    Of nobody's blame all peers have an equal share.
    """
    count, some, whole = 0, 0.0, 0.0
    for j in range(len(blame)):
        whole += blame[j]
        if (peers >> j) & 1:
            count += 1
            some += blame[j]
    return some / whole if whole < 0.0 else count / (len(blame) - 1)


@inlined
def look_back(
    own: Own,
    x: int,
    rho: Any,
    counts: Any,
    peers: int,
    sight: Sight,
    outlook: Outlook,
    by_count: Values,
    floor: float,
) -> None:
    """Learn what the moves in x would have brought, now that it is known where peers went.

    Each move that was tried in x would have led to its successor, or left the robot in x; where
    a peer is now, and r^C was felt there once, it would have been felt. Of the move that was
    made r^C is learned already. Being there has the value that the second question would have
    had, and waiting as well, if peers are in the way.

    Args:
        own: the robot's factors and model.
        x: the cell in which the robot first asked.
        rho: the row of what it perceived there, changed.
        counts: its updates, changed.
        peers: whose row it is, the sum of 2^j; all of a failed percept.
        sight: what came of the second question.
        outlook: what that would have been worth elsewhere.
        by_count: n^-w by n.
        floor: least step size.
    """
    owed = outlook.here if rho[best_of(own.u[x])] < 0.0 else 0.0
    for b in range(PRIMITIVES):
        if own.updates[x][b] == 0:
            continue
        share, s = own.moved[x][b] / own.updates[x][b], own.successor[x][b]
        brought = (1.0 - share) * owed
        brought += share * outlook.there[b] * share_of(peers, outlook.blame[b])
        if b == own.last[1]:
            rho[b] += step_of_rho(counts[b], by_count, floor) * brought
        elif sight.perceived or (empty(sight, x) and (share == 0.0 or empty(sight, s))):
            if met(sight, peers, x):
                brought += (1.0 - share) * own.door[x]
            if met(sight, peers, s):
                brought += share * own.door[s]
            if brought != 0.0 or rho[b] != 0.0:
                learn_correction(rho, counts, b, brought, by_count, floor)


@inlined
def learn_asking(
    own: Own, x: int, correction: Values, percept_update: bool, by_count: Values, floor: float
) -> None:
    """Learn from a percept what percepts are worth in x and, if so ruled, r_bar.

    Args:
        own: the robot's factors, changed.
        x: X_k(t).
        correction: Q^C(x, z, .) - U(x, .) of what was perceived.
        percept_update: whether r_bar learns from it.
        by_count: n^-w by n.
        floor: least step size.
    """
    count = own.updates[x][COORDINATE] + 1
    own.updates[x][COORDINATE] = count
    alpha = step_size(by_count[count], floor)
    own.w[x] = toward(own.w[x], alpha, gain(own.u[x], correction))
    if percept_update:
        for b in range(PRIMITIVES):
            own.r_bar[x][b] = toward(own.r_bar[x][b], floor, correction[b])


@inlined
def replay(own: Own, replays: int, draw: float, terms: Terms) -> None:
    """Set U of moves that were tried to what the own model says of them (Dyna).

    Args:
        own: the robot's factors, changed.
        replays: how many moves, one after the other.
        draw: draw in [0, 1) that picks the first; what is left of it picks the next.
        terms: the numbers of the rule.
    """
    for _ in range(replays):
        scaled = draw * own.used[0]
        place = int(scaled)
        draw = scaled - place
        pair = own.tried[place]
        x, m = pair // PRIMITIVES, pair % PRIMITIVES
        share = own.moved[x][m] / own.updates[x][m]
        s = own.successor[x][m]
        there = terms.arrival if s == terms.goal else terms.discount * own.value[s]
        here = terms.discount * own.value[x]
        own.u[x][m] = share * there + (1.0 - share) * here
        refresh(own, x, terms)
