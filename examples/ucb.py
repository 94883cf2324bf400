# Copyright 2026 The sparse_coord_ros authors
# SPDX-License-Identifier: Apache-2.0
"""A learner with an exploration of its own, upper confidence bounds: python ucb.py [STEPS].

In each cell a robot takes the action with the greatest Q*(x, a) + WIDTH sqrt(ln n(x) / n(x, a)),
where n counts updates (UCB1; Auer, Cesa-Bianchi and Fischer, 2002). Actions never tried come
first. It runs in plain Python and over ROS 2, and compiled by numba, with the same bits.

On the command line: sparse_coord train env1 --learner ucb:UCB
"""

import math
import sys

import sparse_coord_ros as sc

WIDTH = 200.0
"""In units of the return."""


class UCB(sc.Coop):
    """Algorithm 1 that explores by upper confidence bounds."""

    name = "ucb"
    summary = "Algorithm 1 that explores by upper confidence bounds"

    @staticmethod
    def decide(mind, task, k, step, cell):
        """Return the action with the greatest bound; of equal ones the first."""
        updates = mind.updates[k, cell]
        log_n = math.log(updates.sum() + 1)
        chosen = 0
        greatest = -math.inf
        for action in range(task.actions):
            if updates[action] == 0:
                return action
            bound = mind.q_star[k, cell, action]
            bound += WIDTH * math.sqrt(log_n / updates[action])
            if bound > greatest:
                chosen = action
                greatest = bound
        return chosen


sc.register_learner(UCB)

if __name__ == "__main__":
    steps = int(sys.argv[1]) if len(sys.argv) > 1 else 50_000
    scenario = sc.load_scenario("env1", penalty=-20, steps=steps)
    for learner in ("coop", "ucb"):
        training = sc.train(scenario, learner, seed=1)
        earned = sc.evaluate(training).in_words("returns")
        print(f"{learner}: return {earned}, {training.engine}")
