# Copyright 2026 The sparse_coord_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The Markov game in progress: dynamics, r^I_k, r^C, episodes and time steps.

The world simulator node, the simulation without ROS and the evaluation all step this one object.
"""

from collections.abc import Sequence
from typing import NamedTuple

from sparse_coord_ros.base.compiling import viewed
from sparse_coord_ros.core.game.draws import LEARNING, keys_of
from sparse_coord_ros.core.game.interactions import (
    miscoordinates,
    partners,
    settle,
)
from sparse_coord_ros.core.game.rules import (
    EPISODE_GAP,
    UNKNOWN_PARTNERS,
    episode_ends,
    led,
    problem_of,
    rewards_of,
    start_of,
)
from sparse_coord_ros.core.game.scenario import Scenario
from sparse_coord_ros.core.game.schedules import probabilities

FIRST_STEP = 1
"""The first time step; 0 is left for requests of people, who do not know the step."""


class Reward(NamedTuple):
    """R_k(t) and its parts: total = individual + common + ask_cost.

    Attributes:
        individual: r^I_k.
        common: r^C.
        ask_cost: minus the cost of asking, or 0.
        total: their sum.
        partners: the peers j (from 0) with which the robot interacted, as a sum of 2^j; or
            `UNKNOWN_PARTNERS`.
    """

    individual: float
    common: float
    ask_cost: float
    total: float
    partners: int = UNKNOWN_PARTNERS


class RewardWeights(NamedTuple):
    """How much each part of R_k(t) counts for a learner."""

    individual: float
    common: float
    ask_cost: float


class Action(NamedTuple):
    """The action of an agent at a time step.

    Attributes:
        move: the primitive action (the hatted A_k(t) of Algorithm 1 after COORDINATE).
        asked: whether the agent chose COORDINATE.
        peer: the agent whose local state it asked for; -1 if it asked no agent or several.
        perceived: whether the percept (of every asked agent) succeeded.
    """

    move: int
    asked: bool
    peer: int
    perceived: bool


class StepOutcome(NamedTuple):
    """Results of one step of the world.

    Attributes:
        rewards: R_k(t) of every agent.
        miscoordination: whether the step ended in a miscoordination.
        arrived: the agents that reached their goals with this step.
        episode_over: all agents have arrived, or the episode's steps are used up.
    """

    rewards: tuple[Reward, ...]
    miscoordination: bool
    arrived: tuple[int, ...]
    episode_over: bool


class Position(NamedTuple):
    """Position of a game between two transitions; another world can continue from it.

    Attributes:
        transitions: steps made so far.
        step: the current time step t.
        under_way: whether the episode has had a transition; if not, it begins at `step`, and the
            following attributes mean nothing.
        episode_start: the time step at which it began.
        cells: the local state X_k(t) of every agent.
        arrived: whether each agent has reached its goal.
    """

    transitions: int
    step: int
    under_way: bool
    episode_start: int
    cells: tuple[int, ...]
    arrived: tuple[bool, ...]


def before_episode(transitions: int, step: int, team: int) -> Position:
    """Return the position of a game whose next episode begins at a time step."""
    return Position(transitions, step, False, step, (0,) * team, (False,) * team)


class World:
    """The joint state of a team on its map, stepped by joint actions.

    Args:
        scenario: the problem.
        seed: the run's seed.
        phase: LEARNING or EVALUATION: which random draws the world uses. Episodes of LEARNING
            begin as the learning protocol says, those of EVALUATION at the scenario's starts.
        max_steps: steps after which an episode ends; the scenario's where None.

    Attributes:
        step: the current time step t.
        cells: the local state X_k(t) of every agent.
        arrived: whether each agent has reached its goal in this episode.
        episode: number of the current episode, from 0.
        transitions: steps made so far.
        miscoordinations: how many of them ended in a miscoordination.
    """

    def __init__(
        self,
        scenario: Scenario,
        seed: int,
        *,
        phase: int = LEARNING,
        max_steps: int | None = None,
    ) -> None:
        self.scenario = scenario
        self.max_steps = scenario.max_steps if max_steps is None else max_steps
        self.step = FIRST_STEP
        self.episode = 0
        self.transitions = 0
        self.miscoordinations = 0
        self._problem = viewed(problem_of(scenario, percepts=False))
        self._keys = viewed(keys_of(seed, phase, len(scenario.robots)))
        self._exploring = None
        if phase == LEARNING:
            self._exploring = probabilities(scenario.starts, scenario.steps)
        self._begin_here()

    def begin_episode(self) -> None:
        """Put every agent at a start; the new episode's first step lies `EPISODE_GAP` later."""
        self.episode += 1
        self.step += EPISODE_GAP
        self._begin_here()

    def _begin_here(self) -> None:
        self._episode_start = self.step
        self.cells = [robot.start for robot in self.scenario.robots]
        self.arrived = [False] * len(self.cells)
        if self._exploring is None:
            return
        share = float(self._exploring[min(self.step, len(self._exploring) - 1)])
        for k in range(len(self.cells)):
            self.cells[k] = start_of(self._problem, self._keys, k, self.step, share)

    @property
    def episode_over(self) -> bool:
        """True if all agents have arrived, or the episode's steps are used up."""
        steps = self.step - self._episode_start
        return episode_ends(all(self.arrived), steps, self.max_steps)

    def position(self) -> Position:
        """Return the position of the game."""
        if self.step == self._episode_start:
            return before_episode(self.transitions, self.step, len(self.cells))
        cells = tuple(self.cells)
        arrived = tuple(self.arrived)
        return Position(
            self.transitions, self.step, True, self._episode_start, cells, arrived
        )

    def go_on_from(self, position: Position) -> None:
        """Continue from another world's position of the same run; `episode` restarts at 0."""
        self.transitions = position.transitions
        self.step = position.step
        self._episode_start = position.episode_start
        if position.under_way:
            self.cells = list(position.cells)
            self.arrived = list(position.arrived)
        else:
            self._begin_here()

    def advance(self, actions: Sequence[Action | None]) -> StepOutcome:
        """Make one time step.

        Args:
            actions: one entry an agent; None where it does not act (arrived, or missing).

        Returns:
            The outcome; `step` and `cells` are then those of the next time step.
        """
        before = self.cells
        wanted = list(before)
        acting = []
        for k, action in enumerate(actions):
            if action is not None and not self.arrived[k]:
                wanted[k] = self.led(k, action.move)
                acting.append(k)
        self.cells = self.settled(wanted)
        arrivals = [k for k in acting if self.cells[k] == self._problem.goals[k]]
        inter = self._problem.interactions
        conflict = miscoordinates(inter, before, self.cells)
        rewards = []
        for k, action in enumerate(actions):
            others = partners(inter, before, wanted, self.cells, k)
            asked = action is not None and action.asked
            parts = rewards_of(self._problem, k, conflict, k in arrivals, asked)
            individual, common, cost = parts
            total = individual + common + cost
            rewards.append(Reward(individual, common, cost, total, others))
        for k in arrivals:
            self.arrived[k] = True
        self.step += 1
        self.transitions += 1
        self.miscoordinations += conflict
        return StepOutcome(tuple(rewards), conflict, tuple(arrivals), self.episode_over)

    def led(self, k: int, move: int) -> int:
        """Return the cell in which a move of agent k ends in this time step."""
        return led(self._problem, self._keys, k, self.step, self.cells[k], move)

    def settled(self, wanted: Sequence[int]) -> list[int]:
        """Return the cells in which agents end, from the cells that they want to enter."""
        cells = list(wanted)
        settle(self._problem.interactions, self.cells, cells)
        return cells
