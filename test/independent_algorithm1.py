# Copyright 2026 The sparse_coord_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Algorithm 1 of Melo & Veloso (2009) for two robots, and both baselines, written a second time.

It was written from the paper and shares no code with the package: its own reader of maps, its own
learning loop with NumPy's random numbers, its own exact evaluation. The numbers of the protocol
are the defaults of docs/commands.md. `test/learners/test_independent.py` compares the two.
"""

from pathlib import Path
from typing import NamedTuple

import numpy as np
from numba import njit

MOVES = 4  # north, south, east, west
COORDINATE = 4
OFFSETS = ((-1, 0), (1, 0), (0, 1), (0, -1))

DISCOUNT = 0.95
MOVE_SUCCESS = 0.8
GOAL_REWARD = 10.0
GOAL_VALUE = GOAL_REWARD / (1 - DISCOUNT)
ASK_COST = 1.0
MAX_STEPS = 100
HORIZON = 100
PAUSE = 2  # time steps from the last state of an episode to the first of the next one
FIRST_Q_STAR = 20.0
FIRST_Q_COORD = 200.0

PROBLEMS = {
    "env1": ("env1", ("1", "2"), ((4, 4), (4, 0))),
    "env2-2r": ("env2", ("1", "2"), ((6, 5), (6, 1))),
    "pentagon": ("pentagon", ("1", "2"), ("2", "1")),
}
"""Map, starts and goals: digits of the map, or (row, column)."""


class Problem(NamedTuple):
    """Two robots on a map: where moves lead [cell][move], doorways [cell], starts, goals."""

    next_cell: np.ndarray
    doorway: np.ndarray
    starts: np.ndarray
    goals: np.ndarray


def read_problem(name: str, maps: Path) -> Problem:
    """Return a problem, of the package's file of the map."""
    file, starts, goals = PROBLEMS[name]
    rows = (maps / f"{file}.txt").read_text().split("---\n")[1].splitlines()
    cells = {}
    for i, row in enumerate(rows):
        for j, sign in enumerate(row):
            if sign != "#":
                cells[i, j] = len(cells)
    next_cell = np.zeros((len(cells), MOVES), dtype=np.int64)
    for (i, j), cell in cells.items():
        for move, (down, right) in enumerate(OFFSETS):
            next_cell[cell, move] = cells.get((i + down, j + right), cell)

    def number(place):
        if isinstance(place, tuple):
            return cells[place]
        return next(cell for (i, j), cell in cells.items() if rows[i][j] == place)

    return Problem(
        next_cell,
        np.array([rows[i][j] == "D" for i, j in cells]),
        np.array([number(start) for start in starts]),
        np.array([number(goal) for goal in goals]),
    )


def learn_team(
    problem: Problem, learner: str, penalty: float, steps: int, seed: int
) -> tuple[np.ndarray, np.ndarray]:
    """Return Q* [k][x][action] and Q^C [k][x][z][move] of a run.

    Args:
        problem: from `read_problem`.
        learner: "coop": Algorithm 1; "noncoop": both robots learn at once, without COORDINATE;
            "indiv": so does each robot without the other one in the world.
        penalty: r^C of a miscoordination.
        steps: transitions.
        seed: of the random numbers.
    """
    np_random_seed(seed)
    team = np.array([True, True])
    if learner == "coop":
        return learn(problem, penalty, steps, COORDINATE + 1, team)
    if learner == "noncoop":
        return learn(problem, penalty, steps, MOVES, team)
    first, q_coord = learn(problem, penalty, steps, MOVES, np.array([True, False]))
    second, _ = learn(problem, penalty, steps, MOVES, np.array([False, True]))
    return np.stack([first[0], second[1]]), q_coord


@njit(cache=True)
def np_random_seed(seed):
    """Seed the random numbers of compiled functions."""
    np.random.seed(seed)


@njit(cache=True)
def falling(first, last, share, step, steps):
    """Return a number that falls linearly over a share of the run, then stays."""
    return first + (last - first) * min(1.0, step / (share * steps))


@njit(cache=True)
def greedy(values):
    """Return the best action; all best ones have the same probability."""
    best = np.flatnonzero(values == values.max())
    return best[np.random.randint(len(best))]


@njit(cache=True)
def update(values, counts, b, floor, target):
    """Move an entry toward a target: by n^-1/2 at its n-th update, but not less than the floor."""
    counts[b] += 1
    alpha = max(counts[b] ** -0.5, floor)
    values[b] += alpha * (target - values[b])


@njit(cache=True)
def learn(problem, penalty, steps, actions, members):
    """Return Q* and Q^C of a run; only `members` are in the world."""
    next_cell, doorway, starts, goals = problem
    cells = len(next_cell)
    q_star = np.full((2, cells, 5), FIRST_Q_STAR)
    q_star[:, :, actions:] = -np.inf
    q_coord = np.full((2, cells, cells, MOVES), FIRST_Q_COORD)
    counts = np.zeros((2, cells, 5))
    coord_counts = np.zeros((2, cells, cells, MOVES))
    x = starts.copy()
    y = starts.copy()
    action = np.zeros(2, np.int64)
    move = np.zeros(2, np.int64)
    at_goal = np.ones(2, np.bool_)
    t = 1 - PAUSE
    begun = t
    for _ in range(steps):
        if at_goal.all() or t - begun >= MAX_STEPS:
            t += PAUSE
            begun = t
            for k in range(2):
                x[k] = starts[k]
                at_goal[k] = not members[k]
                if np.random.rand() < falling(1.0, 0.2, 0.5, t, steps):
                    x[k] = goals[k]
                    while x[k] == goals[k]:
                        x[k] = np.random.randint(cells)
        epsilon = falling(0.15, 0.02, 0.8, t, steps)
        floor = falling(0.1, 0.01, 1.0, t, steps)
        for k in range(2):
            y[k] = x[k]
            if at_goal[k]:
                continue
            if np.random.rand() < epsilon:  # line 4
                action[k] = np.random.randint(actions)
            else:
                action[k] = greedy(q_star[k, x[k]])
            move[k] = action[k]
            if action[k] == COORDINATE:  # lines 5 to 7: the other robot always answers
                move[k] = greedy(q_coord[k, x[k], x[1 - k]])
            if np.random.rand() < MOVE_SUCCESS:
                y[k] = next_cell[x[k], move[k]]
        common = 0.0
        if members.all() and y[0] == y[1] and doorway[y[0]]:
            common = penalty
        for k in range(2):
            if at_goal[k]:
                continue
            reward = common
            value = q_star[k, y[k]].max()
            if action[k] == COORDINATE:
                reward -= ASK_COST
            if y[k] == goals[k]:
                reward += GOAL_REWARD
                value = GOAL_VALUE
                at_goal[k] = True
            target = reward + DISCOUNT * value
            if action[k] == COORDINATE:  # lines 12 to 14
                z = x[1 - k]
                update(
                    q_coord[k, x[k], z],
                    coord_counts[k, x[k], z],
                    move[k],
                    floor,
                    target,
                )
            update(
                q_star[k, x[k]], counts[k, x[k]], action[k], floor, target
            )  # line 18
        x[:] = y
        t += 1
    return q_star, q_coord


@njit(cache=True)
def choices(problem, q_star, q_coord, k, x, z):
    """Return the distribution of the next cell of a greedy robot, and its probability of asking.

    Returns:
        The cells to which the moves lead and the present one; their probabilities; that of asking.
    """
    targets = np.append(problem.next_cell[x], x)
    chances = np.zeros(5)
    asking = 0.0
    if x == problem.goals[k]:
        chances[4] = 1.0
        return targets, chances, asking
    best = np.flatnonzero(q_star[k, x] == q_star[k, x].max())
    for action in best:
        if action != COORDINATE:
            chances[action] += MOVE_SUCCESS / len(best)
            continue
        asking = 1 / len(best)
        moves = np.flatnonzero(q_coord[k, x, z] == q_coord[k, x, z].max())
        for move in moves:
            chances[move] += MOVE_SUCCESS / len(best) / len(moves)
    chances[4] = 1 - MOVE_SUCCESS
    return targets, chances, asking


@njit(cache=True)
def evaluate(problem, penalty, q_star, q_coord):
    """Return the exact measures of a greedy team, from the Markov chain of both cells.

    Returns:
        The mean total discounted reward of a robot, the mean number of its questions in an
        episode, miscoordinations in an episode, and the probability that both arrive in time.
    """
    cells = len(problem.next_cell)
    goals = problem.goals
    chance = np.zeros((cells, cells))
    chance[problem.starts[0], problem.starts[1]] = 1.0
    discount = 1.0
    returns = 0.0
    asks = 0.0
    miscoordinations = 0.0
    for _ in range(HORIZON):
        after = np.zeros((cells, cells))
        first_cells, second_cells = np.nonzero(chance)
        for number in range(len(first_cells)):
            x0 = first_cells[number]
            x1 = second_cells[number]
            here = chance[x0, x1]
            y0, p0, asking0 = choices(problem, q_star, q_coord, 0, x0, x1)
            y1, p1, asking1 = choices(problem, q_star, q_coord, 1, x1, x0)
            asks += here * (asking0 + asking1) / 2
            returns -= here * discount * ASK_COST * (asking0 + asking1) / 2
            for i in range(5):
                for j in range(5):
                    joint = here * p0[i] * p1[j]
                    after[y0[i], y1[j]] += joint
                    if y0[i] == y1[j] and problem.doorway[y0[i]]:
                        miscoordinations += joint
                        returns += discount * joint * penalty
                    if x0 != goals[0] and y0[i] == goals[0]:
                        returns += discount * joint * GOAL_VALUE / 2
                    if x1 != goals[1] and y1[j] == goals[1]:
                        returns += discount * joint * GOAL_VALUE / 2
        chance = after
        discount *= DISCOUNT
    return returns, asks, miscoordinations, chance[goals[0], goals[1]]
