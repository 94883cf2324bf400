# Copyright 2026 The sparse_coord_ros authors
# SPDX-License-Identifier: Apache-2.0
"""How fast environments step, beside the engine, on one core.

An agent-step is one robot's part of one whole time step: of two half steps only one counts. Robots
choose among the actions that their masks allow, all with equal probability. The time of `step` is
counted, with observations, masks and infos; the time of choosing is not.
"""

import time
from collections.abc import Callable, Mapping
from functools import partial

import numpy as np

from sparse_coord_ros.cli.options import format_table
from sparse_coord_ros.core.game.scenario import Scenario, load_scenario
from sparse_coord_ros.core.vector_env import ASKING, VectorGame
from tools.bench.batch import learn_batch, seconds_of
from tools.bench.rates import in_turn, spread

MEASURED = ("env1", "crowd-8r")
"""Scenarios."""

CALLS = 1000
"""Of `step` in a measurement."""

RUNS = 50
"""Learning runs of a measurement of the engine."""


def measured(name: str, games: int, steps: int, repeats: int) -> str:
    """Return the table of a scenario.

    Args:
        name: the scenario's.
        games: of the vector environments.
        steps: transitions of a learning run of the engine.
        repeats: how often each figure is measured, all figures in turn.
    """
    scenario = load_scenario(name).with_settings({"steps": steps})
    ways: dict[str, Callable[[], float]] = {
        "PettingZoo, 1 game": partial(pettingzoo_rate, scenario)
    }
    for asking in ASKING:
        env = VectorGame(scenario, games, seed=1, asking=asking)
        vector_rate(env, 10)  # compiles
        ways[f"{asking}, {games} games"] = partial(vector_rate, env, CALLS)
    learn_batch(scenario.with_settings({"steps": 1}), "coop", 1)
    ways["engine, learning (Coop.)"] = partial(engine_rate, scenario)
    title = f"{name}, {len(scenario.robots)} robots, 1 core"
    return table(title, in_turn(ways, repeats))


def vector_rate(env: VectorGame, calls: int) -> float:
    """Return 10^6 agent-steps a second of a vector environment."""
    random = np.random.default_rng(1)
    seen, infos = env.reset(seed=1)
    seconds = 0.0
    whole_steps = 0
    over = np.zeros(env.num_envs, dtype=bool)
    for _ in range(calls):
        masks = seen["action_mask"]
        actions = (random.random(masks.shape) * masks).argmax(axis=-1)
        begins = over
        started = time.perf_counter()
        seen, _, terminated, truncated, infos = env.step(actions)
        seconds += time.perf_counter() - started
        whole_steps += int(np.sum(~infos["half_step"] & ~begins))
        over = terminated | truncated
    return whole_steps * len(env.robots) / seconds / 1e6


def pettingzoo_rate(scenario: Scenario) -> float:
    """Return 10^6 agent-steps a second of the PettingZoo environment."""
    from sparse_coord_ros.core.pettingzoo_env import parallel_env

    env = parallel_env(scenario)
    random = np.random.default_rng(1)
    seen, _ = env.reset(seed=1)
    seconds = 0.0
    whole_steps = 0
    for _ in range(CALLS):
        masks = np.array([seen[name]["action_mask"] for name in env.agents])
        chosen = (random.random(masks.shape) * masks).argmax(axis=-1).tolist()
        actions = dict(zip(env.agents, chosen, strict=True))
        started = time.perf_counter()
        seen, _, _, _, infos = env.step(actions)
        seconds += time.perf_counter() - started
        whole_steps += not any(info["half_step"] for info in infos.values())
        if not env.agents:
            seen, _ = env.reset()
    return whole_steps * len(env.possible_agents) / seconds / 1e6


def engine_rate(scenario: Scenario) -> float:
    """Return 10^6 agent-steps a second of the engine, which also learns."""
    agent_steps = scenario.steps * len(scenario.robots) * RUNS
    return agent_steps / 1e6 / seconds_of(partial(learn_batch, scenario, "coop", RUNS))


def table(title: str, rates: Mapping[str, list[float]]) -> str:
    """Return the table of measurements.

    Args:
        title: the work.
        rates: 10^6 agent-steps a second, an entry a repeat, by way.
    """
    rows = [[way, *spread(found, 3)] for way, found in rates.items()]
    return format_table([title, "M agent-steps/s", "range"], rows)
