# Copyright 2026 The sparse_coord_ros authors
# SPDX-License-Identifier: Apache-2.0
"""FCQ-learning (De Hauwere, Vrancx & Nowe, AAMAS 2011): ask where conflicts lie ahead.

As CQ-learning (`learn.cq`), but it tests what a move is worth, and so sees a conflict some steps
ahead. Q* begins as the lone robot's Q0* and goes on learning among the others:

    Q*(x, a) = (1 - alpha) Q*(x, a) + alpha (Q0*(x, a) + d),   d = r^C + gamma (V(y) - V0(y)),

V and V0 their maxima over moves: a sampled Q-value less that of a lone robot with the same
transition. Samples of d are tested by the statistic of Kolmogorov and Smirnov against a lone
robot, whose d is always 0: the larger of the shares that lie below and above it. What differs by
no more than a question costs does not count. Q^C bootstraps on V.
"""

import numpy as np

from sparse_coord_ros.compiling import inner
from sparse_coord_ros.game.actions import COORDINATE, PRIMITIVES
from sparse_coord_ros.game.world import Reward
from sparse_coord_ros.learn import loops
from sparse_coord_ros.learn.agent import Choice, learn_entry
from sparse_coord_ros.learn.algorithm import greatest, weighed
from sparse_coord_ros.learn.cq import (
    COUNT,
    WINDOW,
    CQAgent,
    CQMinds,
    clear,
    is_marked,
    set_mark,
)

KS_CRITICAL = 0.294
"""The statistic of 20 samples that chance exceeds once in twenty times."""

BELOW, ABOVE = 1, 2
"""Samples hold, beside their count, how many lie on either side."""


@inner
def strays(sample: np.ndarray, value: float, least: float) -> bool:
    """Add a sample; return whether it differs by the test of this window, or of one before.

    Args:
        sample: the window: [COUNT, BELOW, ABOVE]; it begins anew when it is full.
        value: d.
        least: the greatest difference that does not count.
    """
    if sample[COUNT] < 0.0:
        return True
    sample[COUNT] += 1.0
    if value < -least:
        sample[BELOW] += 1.0
    elif value > least:
        sample[ABOVE] += 1.0
    if sample[COUNT] < WINDOW:
        return False
    found = bool(max(sample[BELOW], sample[ABOVE]) > KS_CRITICAL * WINDOW)
    clear(sample, found)
    return found


class FCQAgent(CQAgent):
    """Agent k; arguments as of `Agent`."""

    def learn(self, step: int, choice: Choice, reward: Reward, next_cell: int) -> None:
        """Learn Q*; test what it learned from; learn Q^C. As of `Agent.learn`."""
        if not self.learning:
            return
        cell, decision, action, perceived = choice
        star, move = self._tables.q_star, action.move
        values, samples = star[cell], self._samples[cell]
        after, less = self._goal_value, 0.0
        if next_cell != self.goal:
            after = self.bootstrap(next_cell, step)
            less = after - greatest(self._lone[next_cell].tolist(), PRIMITIVES)
        common, marked = self.weights.common * reward.common, is_marked(values)
        begun = float(self._lone[cell, move]) + common
        self.update(star, self.star_updates, (cell, move), step, begun, less)
        set_mark(values, marked)
        other = common + self.discount * less
        if decision.action != COORDINATE:
            if not marked and strays(samples[move], other, self._ask_cost):
                set_mark(values, True)
            return
        self.star_updates[cell, COORDINATE] += 1
        if perceived is not None:
            if strays(samples[PRIMITIVES + perceived[0]], other, self._ask_cost):
                entry, total = (cell, *perceived, move), weighed(reward, self.weights)
                self.update(self._coord, self.coord_updates, entry, step, total, after)


class FCQMinds(CQMinds):
    """The compiled form of `FCQAgent`; attributes as of `CQMinds`."""

    @staticmethod
    def learn(state: loops.State, minds: CQMinds, now: loops.Transition) -> None:
        """Learn Q*; test what it learned from; learn Q^C. As `FCQAgent.learn`."""
        step, k, y, reward, floor = now
        problem, choice = state.problem, state.choice
        x, m, row = choice.cells[k], choice.moves[k], choice.rows[k]
        values, samples, least = minds.q_star[k, x], minds.samples[k, x], problem.ask_cost
        after, less = loops.worth_of(state, minds, step, k, y), 0.0
        if y != problem.goals[k]:
            less = after - greatest(minds.lone[k, y], PRIMITIVES)
        common, marked = problem.weights[1] * reward[1], is_marked(values)
        begun = minds.lone[k, x, m] + common
        learn_entry(problem, values, minds.star_updates[k, x], m, begun, less, floor)
        set_mark(values, marked)
        other = common + problem.discount * less
        if choice.actions[k] != COORDINATE:
            if not marked and strays(samples[m], other, least):
                set_mark(values, True)
            return
        minds.star_updates[k, x, COORDINATE] += 1
        z = row % minds.q_star.shape[1]
        if row != loops.NO_ROW:
            if strays(samples[PRIMITIVES + z], other, least):
                values, updates = minds.rows.values[k, row], minds.rows.updates[k, row]
                learn_entry(
                    problem, values, updates, m, weighed(reward, problem.weights), after, floor
                )
