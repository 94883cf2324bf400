# Copyright 2026 The sparse_coord_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The draws of many time steps at once: the same numbers as `game.streams.Stream` gives."""

import numpy as np

from sparse_coord_ros.game.links import LOST, link_of
from sparse_coord_ros.game.streams import DRAWS, LEARNING, PERCEPT, bit_generator
from sparse_coord_ros.learn.run_config import RunConfig

BLOCK = 8192
"""Time steps whose draws are made at once."""


def draws_at(seed: int, agent: int, role: int, steps: np.ndarray) -> np.ndarray:
    """Return the draws of some time steps.

    Args:
        seed: the run's seed.
        agent: the agent's number.
        role: one of the roles of `game.streams`.
        steps: the time steps, at least 0, ascending, shape (n,).

    Returns:
        Shape (n, draws that the role owns), float64 in [0, 1).
    """
    width = DRAWS[role]
    found = np.empty((len(steps), width))
    bits = bit_generator(seed, agent, role, LEARNING)
    generator, reached = np.random.Generator(bits), 0
    begin = 0
    while begin < len(steps):
        first = int(steps[begin])
        end = int(np.searchsorted(steps, first + BLOCK))
        bits.advance((first - reached) * width)
        block = generator.random((int(steps[end - 1]) + 1 - first, width))
        reached = int(steps[end - 1]) + 1
        found[begin:end] = block[steps[begin:end] - first]
        begin = end
    return found


def percept_draws(run: RunConfig, agent: int, steps: np.ndarray) -> np.ndarray:
    """Return the draws of a robot's percepts at some time steps, as `game.links` has them.

    Args:
        run: the run.
        agent: the robot's number.
        steps: as of `draws_at`.
    """
    found: np.ndarray = draws_at(run.seed, agent, PERCEPT, steps)[:, 0]
    found[link_of(run.scenario.link, run.seed, agent).down(steps)] = LOST
    return found
