# Copyright 2026 The sparse_coord_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The operator of docs/guarantees.md: a robot that asks by value beside a peer that never learns.

x is the own cell, z the peer's, b a move; y and w are the cells a step later. A decision is the
number of a move, or one more: to ask. Tables are Q^C, shape (x, z, b).
"""

import itertools
from typing import NamedTuple

import numpy as np

from sparse_coord_ros.core.game.actions import PRIMITIVES


class Game(NamedTuple):
    """A robot's problem while its peer keeps its policy.

    Attributes:
        moves: p(y | x, b), shape (x, b, y).
        peer: P(w | x, z), shape (x, z, w).
        reward: the mean reward of a step, shape (x, z, b).
        weights: M(x, z): how often the peer is in z while the robot is in x; rows sum to 1.
        goals: the own cells in which nothing is earned any more, shape (x,), bool.
        discount: gamma.
        cost: of a question.
    """

    moves: np.ndarray
    peer: np.ndarray
    reward: np.ndarray
    weights: np.ndarray
    goals: np.ndarray
    discount: float
    cost: float


def values(game, table, decisions):
    """Return V(x, z): what a robot that decides so earns from here on."""
    ask = table.shape[2]
    asking = table.max(axis=2) - game.cost
    made = np.where(decisions == ask, 0, decisions)
    moving = np.take_along_axis(table, made[:, None, None], axis=2)[:, :, 0]
    found = np.where((decisions == ask)[:, None], asking, moving)
    found[game.goals] = 0.0
    return found


def backup(game, table, decisions):
    """Return T_d Q: the operator for decisions that stay as they are."""
    after = values(game, table, decisions)
    by_cell = np.matmul(game.peer, after.T)
    return game.reward + game.discount * np.matmul(
        by_cell, game.moves.transpose(0, 2, 1)
    )


def means(game, table):
    """Return Q*, shape (x, moves + 1)."""
    moving = np.einsum("xz,xzb->xb", game.weights, table)
    asking = (game.weights * table.max(axis=2)).sum(axis=1) - game.cost
    return np.column_stack([moving, asking])


def chosen(game, table):
    """Return d(Q): the best decision of each cell by the means."""
    return means(game, table).argmax(axis=1)


def improved(game, table):
    """Return T Q."""
    return backup(game, table, chosen(game, table))


def algorithm1(game, table):
    """Return A Q: the backup of Algorithm 1, which does not know the peer's next cell."""
    after = np.where(game.goals, 0.0, means(game, table).max(axis=1))
    along = np.einsum("xby,y->xb", game.moves, after)
    return game.reward + game.discount * along[:, None, :]


def distance(one, other):
    """Return the greatest difference of two tables."""
    return abs(one - other).max()


def limit(operator, game, table, applications=2000):
    """Return the table at which an operator changes nothing any more, or None."""
    for _ in range(applications):
        new = operator(game, table)
        if distance(new, table) < 1e-9:
            return new
        table = new
    return None


def fixed_point(game, decisions):
    """Return Q_d."""
    return limit(
        lambda game, table: backup(game, table, decisions),
        game,
        np.zeros_like(game.reward),
    )


def informed(game):
    """Return the table of a robot that sees its peer always, for free."""
    always = np.full(len(game.goals), game.reward.shape[2])
    return fixed_point(game._replace(cost=0.0), always)


def all_decisions(game):
    """Yield all that a robot can decide."""
    cells, _, moves = game.reward.shape
    free = np.flatnonzero(~game.goals)
    for found in itertools.product(range(moves + 1), repeat=len(free)):
        decisions = np.zeros(cells, dtype=int)
        decisions[free] = found
        yield decisions


def acting(table, decisions):
    """Return the probability of each move, shape (x, z, b)."""
    ask = table.shape[2]
    asks = (decisions == ask)[:, None]
    made = np.where(asks, table.argmax(axis=2), decisions[:, None])
    return np.eye(ask)[made]


def occupancy(game, likely, start):
    """Return how often, discounted, a robot is in x while its peer is in z.

    Args:
        game: the problem.
        likely: the probability of each move, shape (x, z, b).
        start: of each (x, z) at the start.
    """
    total = np.zeros_like(start)
    now = np.where(game.goals[:, None], 0.0, start)
    while now.sum() > 1e-13:
        total += now
        own = np.einsum("xz,xzb,xby->xzy", now, likely, game.moves)
        now = game.discount * np.einsum("xzy,xzw->yw", own, game.peer)
        now[game.goals] = 0.0
    return total


# --------------------------------------------------------------------- scenarios of two robots


def motion(scenario, k):
    """Return p(y | x, b) of robot k, which stays where it has arrived."""
    cells = np.arange(len(scenario.map.cells))
    found = np.zeros((len(cells), PRIMITIVES, len(cells)))
    for b in range(PRIMITIVES):
        found[cells, b, scenario.map.next_cell[:, b]] += scenario.move_success
        found[cells, b, cells] += 1.0 - scenario.move_success
    goal = scenario.robots[k].goal
    found[goal] = cells == goal
    return found


def steps_of_peer(scenario, team, k):
    """Return P(w | x, z) of the peer of robot k."""
    return np.einsum("zxb,zbw->xzw", team[1 - k], motion(scenario, 1 - k))


def meetings(scenario, team, arrivals, epsilon=0.05, exploring=0.5):
    """Return how often each robot is in x beside a peer in z, in an episode of learning.

    Args:
        scenario: the problem.
        team: the probability of each move of each robot, shape (x, z, b).
        arrivals: whether only steps count in which the robot comes to x.
        epsilon: the probability of a random move.
        exploring: the part of the episodes that begins anywhere.
    """
    cells = len(scenario.map.cells)
    begin = []
    for robot in scenario.robots:
        anywhere = np.full(cells, exploring / (cells - 1))
        anywhere[robot.goal] = 0.0
        anywhere[robot.start] += 1.0 - exploring
        begin.append(anywhere)
    explores = [(1.0 - epsilon) * likely + epsilon / PRIMITIVES for likely in team]
    steps = [steps_of_peer(scenario, explores, k) for k in range(2)]
    now = np.outer(*begin)
    met = np.zeros_like(now)
    for _ in range(scenario.max_steps):
        met += now
        now = np.einsum("xz,zxy,xzw->yw", now, steps[1], steps[0], optimize=True)
    found = [met, met.T]
    if arrivals:
        for k in range(2):
            stays = np.einsum("zxx->xz", steps[1 - k])
            found[k] = found[k] - np.einsum("xz,xzw->xw", found[k] * stays, steps[k])
    return [np.maximum(often, 0.0) for often in found]


def games_of(scenario, team, credit=2.0, arrivals=False):
    """Return the problem of each robot beside the other one of a team.

    Args:
        scenario: two robots that can only be together in a doorway.
        team: the probability of each move of each robot, shape (x, z, b).
        credit: how much a miscoordination counts: 2, for both robots.
        arrivals: whether M counts only steps in which the robot comes to x, as that of `voi`.
    """
    door = np.zeros(len(scenario.map.cells), dtype=bool)
    door[list(scenario.map.doorways)] = True
    met = meetings(scenario, team, arrivals)
    games = []
    for k, robot in enumerate(scenario.robots):
        moves = motion(scenario, k)
        peer = steps_of_peer(scenario, team, k)
        both = np.einsum("xby,xzy->xzb", moves[:, :, door], peer[:, :, door])
        arrives = scenario.arrival_value * moves[:, :, robot.goal]
        reward = arrives[:, None, :] + credit * scenario.penalties[k] * both
        goals = np.arange(len(door)) == robot.goal
        reward[goals] = 0.0
        total = met[k].sum(axis=1, keepdims=True)
        weights = met[k] / np.where(total > 0.0, total, 1.0)
        discount, cost = scenario.discount, scenario.ask_cost
        games.append(Game(moves, peer, reward, weights, goals, discount, cost))
    return games
