# Copyright 2026 The sparse_coord_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Independent Q-learning in many games at once, with NumPy: python vector_learner.py [CALLS].

Each robot has a table of what it observes, with COORDINATE among the actions, and learns from the
mean error of all games.
"""

import sys

import numpy as np

import sparse_coord_ros as sc

GAMES = 256
FIRST_VALUE = 20.0  # from 0 most teams do not learn to ask


def act(env, q, seen, epsilon, random):
    """Return the rows of robots' observations, their actions' values, and their actions."""
    rows = np.ravel_multi_index(tuple(seen["observation"].T), env.column_sizes).T
    values = q[np.arange(len(q)), rows]
    values[seen["action_mask"] == 0] = -np.inf
    explored = (random.random(values.shape) * seen["action_mask"]).argmax(axis=-1)
    explores = random.random(rows.shape) < epsilon
    return rows, values, np.where(explores, explored, values.argmax(axis=-1))


def learn(scenario, calls, seed=0):
    """Return values, shape (robots, observations, actions)."""
    random = np.random.default_rng(seed)
    env = sc.vector_env(scenario, GAMES, seed=seed, phase="learning")
    q = np.full((len(env.robots), np.prod(env.column_sizes), env.actions), FIRST_VALUE)
    seen, infos = env.reset()
    ended = np.zeros(GAMES, dtype=bool)
    for rest in np.linspace(1.0, 0.0, calls):
        rows, _, actions = act(env, q, seen, max(0.02, 0.3 * rest), random)
        acts = ~infos["arrived"] & ~ended[:, None]
        entries = np.ravel_multi_index((np.arange(len(q)), rows, actions), q.shape)[
            acts
        ]
        seen, rewards, terminated, truncated, infos = env.step(actions)
        ended = terminated | truncated
        _, values, _ = act(env, q, seen, 0.0, random)
        discount = np.where(infos["half_step"], 1.0, env.discount)[:, None]
        after = discount * values.max(axis=-1) * ~infos["arrived"]
        errors = (rewards + after)[acts] - q.ravel()[entries]
        counts = np.bincount(entries, minlength=q.size)
        means = np.bincount(entries, errors, minlength=q.size) / np.maximum(counts, 1)
        q += max(0.02, 0.3 * rest) * means.reshape(q.shape)
    return q


def play(scenario, q, games=4000):
    """Return the discounted returns of greedy robots, shape (games, robots)."""
    random = np.random.default_rng(0)
    env = sc.vector_env(scenario, games, seed=1)
    seen, _ = env.reset()
    returns = np.zeros((games, len(env.robots)))
    discount = np.ones((games, 1))
    while discount.any():
        _, _, actions = act(env, q, seen, 0.0, random)
        seen, rewards, terminated, truncated, infos = env.step(actions)
        returns += discount * rewards
        discount *= np.where(infos["half_step"], 1.0, env.discount)[:, None]
        discount[terminated | truncated] = 0.0
    return returns


def main(calls=3000):
    """Print the value of a team that has learned in so many calls of `step`."""
    scenario = sc.load_scenario("env1")
    returns = play(scenario, learn(scenario, calls)).mean(axis=1)
    error = returns.std(ddof=1) / len(returns) ** 0.5
    print(f"learned: {returns.mean():.2f} ± {error:.2f}")
    print(f"shortest paths: {sc.shortest_paths(scenario).in_words('returns')}")
    print(f"best asking team found: {sc.shipped_asking_team(scenario).value:.2f}")
    print(f"joint optimum: {sc.optimum(scenario).value:.2f}")


if __name__ == "__main__":
    main(*map(int, sys.argv[1:]))
