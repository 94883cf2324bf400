# Copyright 2026 The sparse_coord_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Your own learner, which weights miscoordinations more: python own_learner.py [STEPS].

On the command line: sparse_coord run env1 --learner own_learner:Careful
"""

import sys

import sparse_coord_ros as sc


class Careful(sc.Coop):
    """Algorithm 1, but r^C counts once for each robot that it harms."""

    name = "careful"
    summary = "Algorithm 1 with r^C times the number of robots"

    def weights(self, scenario):
        """Return how much each part of the reward counts while it learns."""
        return sc.RewardWeights(individual=1, common=len(scenario.robots), ask_cost=1)


sc.register_learner(Careful)

if __name__ == "__main__":
    steps = int(sys.argv[1]) if len(sys.argv) > 1 else 50_000
    scenario = sc.load_scenario("env1", penalty=-20, steps=steps)
    for learner in ("coop", "careful"):
        team = sc.evaluate(sc.train(scenario, learner, seed=1))
        measured = [f"{name} {team.in_words(name)}" for name in ("returns", "asks")]
        print(f"{learner}: {', '.join(measured)}")
