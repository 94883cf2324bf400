# Copyright 2026 The sparse_coord_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Sparse cooperative Q-learning: python sparse_cooperative.py [SCENARIO [STEPS [TEAMS]]].

The scenario has two robots. The learner is that of Kok & Vlassis (ICML 2004; JMLR 7, 2006), the
rule as AI-Toolbox has it (SparseCooperativeQLearning.cpp). Q(s, a) is a sum of value rules. Here
they are given: where both robots are at most `REACH` moves from one doorway there is a rule for
each joint state and joint move, elsewhere one for each robot's own cell and move. Robot i's part
Q_i is its own rule, or half of the joint one. With a* the best joint move of the next state, each
rule of the step moves by

    alpha * sum over its robots i of (R_i + gamma Q_i(s', a*) - Q_i(s, a))

A robot is in one rule at a time, so no reward has to be shared among rules.

It is central: one table of joint moves, and one choice for both robots, which see each other at
all times for nothing. Each game of the vector environment has a team of its own.
"""

import sys

import numpy as np

import sparse_coord_ros as sc
from sparse_coord_ros.core.game.schedules import probabilities, step_sizes
from sparse_coord_ros.core.runs.measures import fails

REACH = 1
FIRST_VALUE = 20.0
MOVES = 4
LIKE_VOI = {
    "epsilon": "linear:0.3:0.02:0.8",
    "starts": "exploring:1:0:0.5",
    "step_size": "floored:0.6:0.1:0.01",
}


def places(scenario, reach):
    """Return numbers of the joint states in which robots coordinate, else -1: (cells, cells)."""
    cells = len(scenario.map.cells)
    together = np.zeros((cells, cells), dtype=bool)
    for doorway in scenario.map.doorways:
        near = np.arange(cells) == doorway
        for _ in range(reach):
            near = near | near[scenario.map.next_cell].any(axis=1)
        together |= near[:, None] & near
    numbers = together.cumsum().reshape(together.shape) - 1
    return np.where(together, numbers, -1)


class Teams:
    """What many teams have learned, each from a game of its own.

    Args:
        scenario: the problem, of two robots.
        teams: how many there are.
        reach: moves from a doorway within which robots coordinate.

    Attributes:
        own: values of a robot's moves, shape (teams, robots, cells, moves).
        joint: values of joint moves, shape (teams, joint states, moves * moves).
    """

    def __init__(self, scenario, teams, reach=REACH):
        self.numbers = places(scenario, reach)
        self.own = np.full((teams, 2, len(self.numbers), MOVES), FIRST_VALUE)
        states = self.numbers.max() + 1
        self.joint = np.full((teams, states, MOVES * MOVES), 2 * FIRST_VALUE)
        self.own_updates = np.zeros(self.own.shape, dtype=np.int64)
        self.joint_updates = np.zeros(self.joint.shape, dtype=np.int64)

    def states(self, cells, arrived):
        """Return the numbers of joint states; -1 where each robot is by itself: shape (games,)."""
        number = self.numbers[cells[:, 0], cells[:, 1]]
        return np.where(arrived.any(axis=1), -1, number)

    def best(self, team, cells, state):
        """Return the best moves, shape (games, robots)."""
        moves = self.own[team[:, None], [0, 1], cells].argmax(axis=-1)
        at = np.flatnonzero(state >= 0)
        chosen = self.joint[team[at], state[at]].argmax(axis=-1)
        moves[at] = np.stack(np.divmod(chosen, MOVES), axis=-1)
        return moves

    def parts(self, team, cells, state, moves):
        """Return Q_i, shape (games, robots)."""
        values = self.own[team[:, None], [0, 1], cells, moves]
        at = np.flatnonzero(state >= 0)
        pair = moves[at, 0] * MOVES + moves[at, 1]
        values[at] = self.joint[team[at], state[at], pair][:, None] / 2
        return values

    def learn(self, state, cells, moves, errors, acts, sizes, floor):
        """Move the rules of a step by the errors of their robots, shape (games, robots)."""
        at = np.flatnonzero((state >= 0) & acts.all(axis=1))
        rules = (at, state[at], moves[at, 0] * MOVES + moves[at, 1])
        self.joint_updates[rules] += 1
        alpha = np.maximum(sizes[self.joint_updates[rules]], floor)
        self.joint[rules] += alpha * errors[at].sum(axis=1)
        game, robot = np.nonzero((state < 0)[:, None] & acts)
        rules = (game, robot, cells[game, robot], moves[game, robot])
        self.own_updates[rules] += 1
        alpha = np.maximum(sizes[self.own_updates[rules]], floor)
        self.own[rules] += alpha * errors[game, robot]


def learn(scenario, teams, seed=0, reach=REACH):
    """Return teams that learned in the scenario's steps, each in its own game.

    A call that begins an episode is one of the steps.
    """
    random = np.random.default_rng(seed)
    env = sc.vector_env(scenario, teams, seed=seed, phase="learning")
    learned = Teams(scenario, teams, reach)
    every = np.arange(teams)
    epsilons = probabilities(scenario.epsilon, scenario.steps)
    sizes = step_sizes(scenario.step_size, scenario.steps)
    seen, infos = env.reset()
    cells = seen["observation"][:, :, 0]
    arrived = infos["arrived"]
    state = learned.states(cells, arrived)
    best = learned.best(every, cells, state)
    ended = np.zeros(teams, dtype=bool)
    for step in range(scenario.steps):
        draws = random.random((2, teams, 2))
        explored = (draws[1] * MOVES).astype(np.int64)
        moves = np.where(draws[0] < epsilons[step], explored, best)
        allowed = np.where(arrived | ended[:, None], 0, moves)
        before = learned.parts(every, cells, state, moves)
        seen, rewards, terminated, truncated, infos = env.step(allowed)
        acts = ~arrived & ~ended[:, None]
        next_cells = seen["observation"][:, :, 0]
        next_state = learned.states(next_cells, infos["arrived"])
        next_best = learned.best(every, next_cells, next_state)
        after = learned.parts(every, next_cells, next_state, next_best)
        after = env.discount * np.where(infos["arrived"], 0.0, after)
        errors = rewards + after - before
        learned.learn(
            state, cells, moves, errors, acts, sizes.by_count, sizes.by_step[step]
        )
        ended = terminated | truncated
        cells = next_cells
        arrived = infos["arrived"]
        state = next_state
        best = learned.best(every, cells, state)
    return learned


def play(scenario, learned, trials, seed=1):
    """Return the returns of greedy teams and who arrived, shape (teams, trials, robots) each."""
    teams = len(learned.own)
    team = np.repeat(np.arange(teams), trials)
    env = sc.vector_env(scenario, len(team), seed=seed)
    seen, infos = env.reset()
    returns = np.zeros((len(team), 2))
    arrived = infos["arrived"].copy()
    discount = np.ones((len(team), 1))
    while discount.any():
        cells = seen["observation"][:, :, 0]
        state = learned.states(cells, infos["arrived"])
        idle = infos["arrived"] | (discount == 0)
        moves = np.where(idle, 0, learned.best(team, cells, state))
        seen, rewards, terminated, truncated, infos = env.step(moves)
        returns += discount * rewards
        arrived |= infos["arrived"] & (discount > 0)
        discount *= env.discount
        discount[terminated | truncated] = 0.0
    shape = (teams, trials, 2)
    return returns.reshape(shape), arrived.reshape(shape)


def main(name="env1", steps=20000, teams=20):
    """Print what teams are worth that learned in so many steps."""
    settings = {**LIKE_VOI, "steps": int(steps)}
    scenario = sc.load_scenario(name, penalty=-100).with_settings(settings)
    returns, arrived = play(scenario, learn(scenario, int(teams)), 1000)
    means = returns.mean(axis=(1, 2))
    error = means.std(ddof=1) / len(means) ** 0.5
    failed = sum(fails(share) for share in arrived.all(axis=2).mean(axis=1))
    print(
        f"learned, central: {means.mean():.2f} ± {error:.2f}, {failed} of {teams} teams fail"
    )
    print(f"shortest paths: {sc.shortest_paths(scenario).in_words('returns')}")
    print(f"best asking team found: {sc.shipped_asking_team(scenario).value:.2f}")
    print(f"joint optimum: {sc.optimum(scenario).value:.2f}")


if __name__ == "__main__":
    main(*sys.argv[1:])
