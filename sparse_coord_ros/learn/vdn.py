# Copyright 2026 The sparse_coord_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Value decomposition (Sunehag et al., AAMAS 2018), as tables: one value of the team, shared out.

Two robots see each other always, as those of `learn.joint`, but learn one thing: what the team is
worth is the sum of their own Q^C, and learns from the team's reward,

    d = sum_k (R_k + gamma max_b Q^C_k(y, z', b) - Q^C_k(x, z, a_k)),

over the robots that act. Each of them changes its Q^C_k(x, z, a_k) by alpha d, divided by their
number, so that the sum makes a step of alpha.
"""

from sparse_coord_ros.game.actions import COORDINATE
from sparse_coord_ros.learn import loops
from sparse_coord_ros.learn.algorithm import step_size, weighed
from sparse_coord_ros.learn.joint import JointMinds


class VDNMinds(JointMinds):
    """What two robots know; attributes as of `JointMinds`."""

    @staticmethod
    def learn(state: loops.State, minds: JointMinds, now: loops.Transition) -> None:
        """Add robot k's part to d; the last robot that acts lets all of them learn."""
        step, k, y, reward, floor = now
        problem, choice, error = state.problem, state.choice, minds.error
        size = minds.q_star.shape[1]
        x, z, acts = choice.cells[k], choice.cells[1 - k], minds.acts
        after = loops.worth_of(state, minds, step, k, y)
        total = weighed(reward, problem.weights) - problem.ask_cost + problem.discount * after
        error[0] += total - minds.rows.values[k, x * size + z, choice.moves[k]]
        minds.star_updates[k, x, COORDINATE] += 1
        if k == 0 and acts[1]:
            return
        for j in range(2):
            if acts[j]:
                row, move = choice.cells[j] * size + choice.cells[1 - j], choice.moves[j]
                count = minds.rows.updates[j, row, move] + 1
                minds.rows.updates[j, row, move] = count
                alpha = step_size(problem.alpha_by_count[count], floor)
                minds.rows.values[j, row, move] += alpha * error[0] / (1 + acts[1 - j])
