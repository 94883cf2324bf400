# Copyright 2026 The sparse_coord_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The factored learner with one part of its rule turned off, and learners of the joint state."""

from typing import Any

from sparse_coord_ros.game.actions import COORDINATE, PRIMITIVES
from sparse_coord_ros.game.streams import PRIMITIVE_TIE
from sparse_coord_ros.game.world import Reward
from sparse_coord_ros.learn.agent import Agent, Choice, Decision
from sparse_coord_ros.learn.algorithm import greatest
from sparse_coord_ros.learn.factors import FactorRule
from sparse_coord_ros.learn.learners import Factored, Learner


class NotToldByRequests(Factored):
    """Learns nothing from being asked."""

    factors = FactorRule(share=False)


class NoPerceptUpdate(Factored):
    """Learns r_bar from its own moves alone."""

    factors = FactorRule(percept_update=False)


class NoReplay(Factored):
    """Does not learn from its own model."""

    factors = FactorRule(replays=0)


class FiveReplays(Factored):
    """Learns five times a step from its own model."""

    factors = FactorRule(replays=5)


class NoLookingBack(Factored):
    """Learns of no move what it would have brought."""

    factors = FactorRule(look_back=False)


class NoRightOfWay(Factored):
    """Several robots in one cell wait for one another."""

    factors = FactorRule(right_of_way=False)


class JointAgent(Agent):
    """Q-learning over the joint state, which it sees in every step.

    Its table is `q_coord`; it learns of a step when it sees where the next one begins.
    """

    def __init__(self, *arguments: Any, **more: Any) -> None:
        super().__init__(*arguments, **more)
        self._last: tuple[int, tuple[int, ...], float] | None = None  # step, entry, reward

    def decide(self, step: int, cell: int) -> Decision:
        """Look at everybody, always."""
        return Decision(COORDINATE, self._peers)

    def coordinate(self, step: int, cell: int, perceived: tuple[int, ...] | None) -> int:
        """Learn from the step before, and choose by pi_epsilon over the joint state."""
        assert perceived is not None  # percepts that fail are another problem
        row = self._tables.q_coord[cell, *perceived].tolist()
        if self._last is not None and self._last[0] == step - 1:
            self._update(greatest(row, PRIMITIVES))
        return self.explored(step, row, PRIMITIVES, PRIMITIVE_TIE)

    def learn(self, step: int, choice: Choice, reward: Reward, next_cell: int) -> None:
        """Keep what the step brought; arguments as of `Agent.learn`."""
        cell, _, action, perceived = choice
        if not self.learning or perceived is None:
            return
        self._last = (step, (cell, *perceived, action.move), reward.total)
        if next_cell == self.goal:
            self._update(self._goal_value)

    def _update(self, bootstrap: float) -> None:
        assert self._last is not None
        step, entry, reward = self._last
        self.update(self._coord, self.coord_updates, entry, step, reward, bootstrap)
        self._last = None


class JointState(Learner):
    """Independent learners, each with a table over the full joint state. Plain Python."""

    agent_class = JointAgent
