# Copyright 2026 The sparse_coord_ros authors
# SPDX-License-Identifier: Apache-2.0
"""A learner with an exploration of its own, the Boltzmann policy: python boltzmann.py [STEPS].

An action is drawn with a probability proportional to exp(Q*(x, a) / temperature), by one draw.
The temperature falls as the scenario's epsilon does. It runs in plain Python and over ROS 2, and
compiled by numba, with the same bits.

On the command line: sparse_coord train env1 --learner boltzmann:Boltzmann
"""

import math
import sys

import sparse_coord_ros as sc

WARMTH = 150.0
"""The temperature at epsilon 1, in units of the return."""


class Boltzmann(sc.Coop):
    """Algorithm 1 that explores by the Boltzmann policy."""

    name = "boltzmann"
    summary = "Algorithm 1 that explores by the Boltzmann policy"

    @staticmethod
    def decide(mind, task, k, step, cell):
        """Return an action by the inverse of the cumulative distribution."""
        values = mind.q_star[k, cell]
        temperature = WARMTH * sc.rules.scheduled(task.epsilon, step)
        best = sc.rules.greatest(values, task.actions)
        total = 0.0
        for action in range(task.actions):
            total += math.exp((values[action] - best) / temperature)
        left = total * sc.rules.draw(task.keys[k], step, sc.rules.FREE)
        action = 0
        while left >= 0.0 and action < task.actions:
            left -= math.exp((values[action] - best) / temperature)
            action += 1
        return action - 1


sc.register_learner(Boltzmann)

if __name__ == "__main__":
    steps = int(sys.argv[1]) if len(sys.argv) > 1 else 50_000
    scenario = sc.load_scenario("env1", penalty=-20, steps=steps)
    for learner in ("coop", "boltzmann"):
        training = sc.train(scenario, learner, seed=1)
        earned = sc.evaluate(training).in_words("returns")
        print(f"{learner}: return {earned}, {training.engine}")
