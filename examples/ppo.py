# Copyright 2026 The sparse_coord_ros authors
# SPDX-License-Identifier: Apache-2.0
"""A deep learner beside ours: python ppo.py [SCENARIO [STEPS [SEED]]].

Proximal policy optimisation of Stable-Baselines3: one network for all robots, each of which sees
what a robot may see here. It needs, in an environment of its own:
pip install stable-baselines3 numba sparse_coord_ros
"""

import sys
import time

import numpy as np
import torch
from gymnasium import spaces
from stable_baselines3 import PPO
from stable_baselines3.common.callbacks import BaseCallback
from stable_baselines3.common.vec_env import VecEnv

import sparse_coord_ros as sc

GAMES = 64
SCALE = 0.01  # of rewards, which are up to 200
LOOKS = 10  # evaluations on the way


class Robots(VecEnv):
    """Each robot of each game is an environment: its own cell, the answer, and its number."""

    def __init__(self, scenario, games, **how):
        self.env = sc.vector_env(scenario, games, asking="in_observation", **how)
        self.team = len(self.env.robots)
        self.sizes = np.array(self.env.column_sizes)
        self.first = np.concatenate([[0], self.sizes.cumsum()[:-1]])
        self.width = self.sizes.sum() + self.team
        shown = spaces.Box(0.0, 1.0, (self.width,), np.float32)
        self.render_mode = None
        super().__init__(games * self.team, shown, spaces.Discrete(self.env.actions))
        self.actions = None

    def shown(self, seen):
        """Return observations one-hot, a row for each robot of each game."""
        columns = seen["observation"].reshape(-1, len(self.sizes)) + self.first
        found = np.zeros((len(columns), self.width), dtype=np.float32)
        np.put_along_axis(found, columns, 1.0, axis=1)
        numbers = np.arange(len(columns)) % self.team + self.sizes.sum()
        found[np.arange(len(columns)), numbers] = 1.0
        return found

    def reset(self):
        """Begin an episode of each game."""
        return self.shown(self.env.reset()[0])

    def step_async(self, actions):
        """Keep the actions."""
        self.actions = actions.reshape(-1, self.team)

    def step_wait(self):
        """Make a step; games that end begin anew."""
        seen, rewards, terminated, truncated, _ = self.env.step(self.actions)
        ended = terminated | truncated
        dones = np.repeat(ended, self.team)
        told = [{} for _ in range(self.num_envs)]
        shown = self.shown(seen)
        if ended.any():
            for place in np.flatnonzero(dones):
                told[place] = {
                    "terminal_observation": shown[place].copy(),
                    "TimeLimit.truncated": bool(truncated[place // self.team]),
                }
            begun, _ = self.env.reset(options={"reset_mask": ended})
            shown[dones] = self.shown(begun)[dones]
        return shown, SCALE * rewards.ravel(), dones, told

    def close(self):
        """Do nothing: there are no open resources."""

    def get_attr(self, name, indices=None):
        """Return an attribute for each environment."""
        return [getattr(self, name)] * self.num_envs

    def set_attr(self, name, value, indices=None):
        """Not used."""

    def env_method(self, name, *values, indices=None, **more):
        """Not used."""

    def env_is_wrapped(self, wrapper, indices=None):
        """Return False for each environment."""
        return [False] * self.num_envs


def play(scenario, model, games=2000):
    """Return the team's mean return in each game, and whether all robots arrived."""
    robots = Robots(scenario, games, seed=1)
    seen = robots.reset()
    returns = np.zeros(games)
    discount = np.ones(games)
    arrived = np.zeros(games, dtype=bool)
    while discount.any():
        actions, _ = model.predict(seen, deterministic=True)
        robots.step_async(actions)
        seen, rewards, ended, told = robots.step_wait()
        returns += discount * rewards.reshape(games, -1).mean(axis=1) / SCALE
        discount *= scenario.discount
        over = ended.reshape(games, -1)[:, 0]
        for game in np.flatnonzero(over & (discount > 0)):
            arrived[game] = not told[game * robots.team]["TimeLimit.truncated"]
        discount[over] = 0.0
    return returns, arrived


class Curve(BaseCallback):
    """Prints the team's value from time to time."""

    def __init__(self, scenario, every):
        super().__init__()
        self.scenario = scenario
        self.every = every
        self.due = every
        self.spent = 0.0
        self.began = time.perf_counter()

    def _on_step(self):
        transitions = self.num_timesteps // len(self.scenario.robots)
        if transitions >= self.due:
            self.due += self.every
            seconds = time.perf_counter() - self.began - self.spent
            returns, arrived = play(self.scenario, self.model)
            self.spent = time.perf_counter() - self.began - seconds
            error = returns.std(ddof=1) / len(returns) ** 0.5
            print(
                f"{transitions:>9,} steps {seconds:6.1f} s: {returns.mean():7.2f} ± {error:.2f}, "
                f"all arrive in {100 * arrived.mean():.1f} %",
                flush=True,
            )
        return True


def main(name="env1", steps=1_000_000, seed=0):
    """Learn, and print the curve beside the scenario's reference values."""
    torch.set_num_threads(1)
    scenario = sc.load_scenario(name, penalty=-100)
    robots = Robots(scenario, GAMES, seed=seed, phase="learning")
    model = PPO(
        "MlpPolicy",
        robots,
        seed=seed,
        gamma=scenario.discount,
        n_steps=64,
        batch_size=2048,
        n_epochs=10,
        learning_rate=1e-3,
        ent_coef=0.01,
        policy_kwargs={"net_arch": [64, 64]},
        device="cpu",
    )
    print(f"{name}; shortest paths: {sc.shortest_paths(scenario).in_words('returns')}")
    curve = Curve(scenario, steps // LOOKS)
    model.learn(steps * robots.team, callback=curve)


if __name__ == "__main__":
    main(*sys.argv[1:2], *map(int, sys.argv[2:]))
