# Copyright 2026 The sparse_coord_ros authors
# SPDX-License-Identifier: Apache-2.0
"""A learner with an update rule of its own, compiled: python expected_sarsa.py [STEPS].

Expected SARSA (Sutton & Barto, 2018, Section 6.6) expects of the next cell not the best action,
but what the exploring policy does. The rule stands once, in `expected`; the `Agent` applies it
in plain Python and over ROS 2, the `Minds` in the compiled loops, with the same bits.

On the command line: sparse_coord train env1 --learner expected_sarsa:ExpectedSarsa
"""

import sys

import sparse_coord_ros as sc
from sparse_coord_ros.compiling import inner
from sparse_coord_ros.learners.agent import TableMinds
from sparse_coord_ros.learners.policy import greatest
from sparse_coord_ros.learn.loops import epsilon_at


@inner
def expected(values, count, epsilon):
    """Return the mean of the first `count` values under the policy that explores by epsilon."""
    total = 0.0
    for action in range(count):
        total += values[action]
    return (1.0 - epsilon) * greatest(values, count) + epsilon * total / count


class Agent(sc.Agent):
    """One robot."""

    def bootstrap(self, cell, step):
        """Return what the robot expects from its next cell on."""
        return expected(self.values(cell), self.actions, self.epsilon(step))


class Minds(TableMinds):
    """All robots, for the compiled loops."""

    @staticmethod
    def bootstrap(state, minds, step, k, cell):
        """Return what robot k expects from its next cell on."""
        return expected(minds.q_star[k, cell], state.problem.actions, epsilon_at(state, step))


class ExpectedSarsa(sc.Learner):
    """Algorithm 1 with the update of expected SARSA."""

    name = "expected_sarsa"
    title = "Expected SARSA"
    summary = "Algorithm 1 that bootstraps on the policy it follows"
    agent_class = Agent
    minds = Minds


sc.register_learner(ExpectedSarsa)

if __name__ == "__main__":
    steps = int(sys.argv[1]) if len(sys.argv) > 1 else 50_000
    scenario = sc.load_scenario("env1", penalty=-20, steps=steps)
    for learner in ("coop", "expected_sarsa"):
        training = sc.train(scenario, learner, seed=1)
        print(f"{learner}: reward {sc.evaluate(training).reward.mean:.1f}, {training.engine}")
