# Copyright 2026 The sparse_coord_ros authors
# SPDX-License-Identifier: Apache-2.0
"""A learning run without ROS: the same world and the same agents, one after the other."""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from sparse_coord_ros.game.scenario import Scenario
from sparse_coord_ros.game.world import Action, Position, Reward, StepOutcome, World
from sparse_coord_ros.learn.agent import Agent, Memory, Tables
from sparse_coord_ros.learn.evaluation import Team, Trials, play
from sparse_coord_ros.learn.history import History, HistoryRecorder, concatenated
from sparse_coord_ros.learn.learners import Learner, learner_of


class LearningState(NamedTuple):
    """A learning run between two transitions: either engine can go on from it, bit for bit.

    Attributes:
        positions: the game of each group of robots that learn together.
        memories: what each robot has learned.
        histories: the episodes of each group.
    """

    positions: tuple[Position, ...]
    memories: tuple[Memory, ...]
    histories: tuple[History, ...]


class Glimpse(NamedTuple):
    """One transition of K robots, for who watches them.

    Attributes:
        step: the time step t (of robots that learn alone: of the first one).
        cells: X_k(t); None where nobody told it.
        actions: what each robot did; None where it did not act.
        after: X_k(t+1), likewise; None: nobody told any.
        miscoordination: whether robots ended up in the same doorway.
        rewards: R_k(t); empty: not told.
        ends: how percepts ended, numbers of `wire.PerceptEnd`; empty: not told.
    """

    step: int
    cells: tuple[int | None, ...]
    actions: tuple[Action | None, ...]
    after: tuple[int | None, ...] | None
    miscoordination: bool
    rewards: Sequence[Reward | None] = ()
    ends: Sequence[int | None] = ()


def groups_of(scenario: Scenario, learner: Learner) -> list[list[int]]:
    """Return the robots (from 0) that learn together.

    They are all, or for a learner that learns `alone` each robot by itself: one robot at a time
    in the world, each for the whole budget, so that none ever meets another (paper, Section 4).
    """
    everyone = list(range(len(scenario.robots)))
    return [[k] for k in everyone] if learner.alone else [everyone]


class Learning:
    """A learning run in progress, in plain Python.

    Args:
        scenario: the problem and its protocol.
        learner: a learner, or its name.
        seed: the run's seed.
        state: where to go on; None: at the beginning.
        gathering: whether to gather the history; without it learning is a little faster.

    Attributes:
        scenario, learner, seed: as of the arguments.
        done: transitions made, by each group of robots.
        agents: every robot's agent.
    """

    def __init__(
        self,
        scenario: Scenario,
        learner: str | Learner,
        seed: int,
        state: LearningState | None = None,
        *,
        gathering: bool = True,
    ) -> None:
        self.scenario, self.learner, self.seed = scenario, learner_of(learner), seed
        self.done = 0
        self.agents: list[Agent] = []
        self._gathering = gathering
        self._groups: list[tuple[World, Team, HistoryRecorder]] = []
        robots = len(scenario.robots)
        for number, members in enumerate(groups_of(scenario, self.learner)):
            agents = [self.learner.agent(scenario, k, seed) for k in members]
            world = World(scenario, seed, agents=members)
            history, under_way = None, False
            if state is not None:
                position, history = state.positions[number], state.histories[number]
                self.done, under_way = position.transitions, position.under_way
                world.go_on_from(position)
                for agent in agents:
                    agent.go_on_from(state.memories[agent.number])
            recorder = HistoryRecorder(
                robots, members=members, history=history, under_way=under_way
            )
            self._groups.append((world, Team(scenario, seed, agents), recorder))
            self.agents += agents

    def advance(self, until: int) -> None:
        """Let every group of robots learn until it has made so many transitions."""
        for world, team, recorder in self._groups:
            while world.transitions < until:
                self._advance(world, team, recorder)
        self.done = max(self.done, until)

    def _advance(
        self, world: World, team: Team, recorder: HistoryRecorder
    ) -> tuple[list[Action | None], StepOutcome, tuple[int, ...]]:
        """Make one transition; return the actions, what they brought, and where they led."""
        choices, actions = team.act(world)
        outcome = world.advance(actions)
        team.learn(choices, world, outcome)
        if self._gathering:
            recorder.add(world.episode, world.step - 1, actions, outcome)
        after = tuple(world.cells)
        if outcome.episode_over:
            world.begin_episode()
        return actions, outcome, after

    def glimpse(self) -> Glimpse:
        """Let every group of robots make one transition, and return it."""
        step, met = self._groups[0][0].step, False
        rows: list[tuple[int, Action | None, int]] = []  # in the order of the robots
        for world, team, recorder in self._groups:
            before = tuple(world.cells)
            did, outcome, then = self._advance(world, team, recorder)
            met |= outcome.miscoordination
            rows += [(before[k], did[k], then[k]) for k in world.agents]
        self.done += 1
        cells, actions, after = zip(*rows, strict=True)
        return Glimpse(step, cells, actions, after, met)

    def play(self, trials: int) -> Trials:
        """Play greedy trials with what was learned so far."""
        seed, learner = self.seed, self.learner
        return play(self.scenario, self.tables, trials=trials, seed=seed, learner=learner)

    @property
    def step(self) -> int:
        """The time step of the next transition (of robots that learn alone: of the first one)."""
        return self._groups[0][0].step

    @property
    def asked(self) -> np.ndarray:
        """How often each robot has learned from COORDINATE in each cell, shape (robots, cells)."""
        return np.array([agent.asked_in for agent in self.agents])

    @property
    def tables(self) -> list[Tables]:
        """What every robot has learned so far; it goes on learning in them."""
        return [agent.tables for agent in self.agents]

    @property
    def visited(self) -> np.ndarray:
        """Joint states of Q^C that each robot has updated, shape (robots,), int64."""
        return np.array([agent.coord_visited for agent in self.agents])

    @property
    def history(self) -> History:
        """The episodes so far."""
        return concatenated([recorder.history() for _, _, recorder in self._groups])

    def state(self) -> LearningState:
        """Return where the run is."""
        return LearningState(
            tuple(world.position() for world, _, _ in self._groups),
            tuple(agent.memory() for agent in self.agents),
            tuple(recorder.history() for _, _, recorder in self._groups),
        )


def learn(scenario: Scenario, learner: str | Learner, seed: int) -> list[Tables]:
    """Run one learner for the scenario's budget and return the tables of every robot.

    Args:
        scenario: the problem and its protocol.
        learner: a learner, or its name.
        seed: the run's seed.
    """
    learning = Learning(scenario, learner, seed, gathering=False)
    learning.advance(scenario.steps)
    return learning.tables


def tables_equal(one: list[Tables], other: list[Tables]) -> bool:
    """Whether two teams' tables agree bit for bit (NaN columns included)."""
    return [_bits(tables) for tables in one] == [_bits(tables) for tables in other]


def _bits(tables: Tables) -> dict[str, tuple[tuple[int, ...], bytes]]:
    return {name: (array.shape, array.tobytes()) for name, array in tables.arrays().items()}
