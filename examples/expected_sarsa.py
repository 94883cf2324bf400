# Copyright 2026 The sparse_coord_ros authors
# SPDX-License-Identifier: Apache-2.0
"""A learner with an update rule of its own: python expected_sarsa.py [STEPS].

Expected SARSA (Sutton & Barto, 2018, Section 6.6) bootstraps not on the best action of the next
cell, but on the mean of the exploring policy. The rule is one function. It runs in plain Python
and over ROS 2, and compiled by numba, with the same bits.

On the command line: sparse_coord train env1 --learner expected_sarsa:ExpectedSarsa
"""

import sys

import sparse_coord_ros as sc


class ExpectedSarsa(sc.Coop):
    """Algorithm 1 with the update of expected SARSA."""

    name = "expected_sarsa"
    summary = "Algorithm 1 that bootstraps on the policy it follows"

    @staticmethod
    def bootstrap(mind, task, k, cell, now):
        """Return the mean of Q*(cell, .) under the policy that explores by epsilon."""
        values = mind.q_star[k, cell]
        total = 0.0
        for action in range(task.actions):
            total += values[action]
        mean = total / task.actions
        epsilon = sc.rules.scheduled(task.epsilon, now.step)
        return (1.0 - epsilon) * sc.rules.greatest(
            values, task.actions
        ) + epsilon * mean


sc.register_learner(ExpectedSarsa)

if __name__ == "__main__":
    steps = int(sys.argv[1]) if len(sys.argv) > 1 else 50_000
    scenario = sc.load_scenario("env1", penalty=-20, steps=steps)
    for learner in ("coop", "expected_sarsa"):
        training = sc.train(scenario, learner, seed=1)
        earned = sc.evaluate(training).in_words("returns")
        print(f"{learner}: return {earned}, {training.engine}")
