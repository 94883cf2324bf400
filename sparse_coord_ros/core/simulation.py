# Copyright 2026 The sparse_coord_ros authors
# SPDX-License-Identifier: Apache-2.0
"""A learning run without ROS: the same world and the same agents, one after the other."""

from collections.abc import Callable

import numpy as np

from sparse_coord_ros.core.agent import Agent, Decision, Tables
from sparse_coord_ros.core.learners import Learner, learner_of
from sparse_coord_ros.core.perception import percept_probabilities
from sparse_coord_ros.core.scenario import Scenario
from sparse_coord_ros.core.sparse import SparseTable
from sparse_coord_ros.core.streams import LEARNING, PERCEPT, Stream
from sparse_coord_ros.core.world import Action, StepOutcome, World


class Team:
    """Agents that act in one process: active perception is a look at the world's joint state.

    Args:
        scenario: the problem.
        seed: the run's seed.
        agents: the agents, one for each robot of the scenario.
        phase: LEARNING or EVALUATION.
    """

    def __init__(
        self, scenario: Scenario, seed: int, agents: list[Agent], *, phase: int = LEARNING
    ) -> None:
        self.agents = agents
        self._percepts = [Stream(seed, agent.number, PERCEPT, phase) for agent in agents]
        self._probabilities = percept_probabilities(scenario.perception, scenario.map).tolist()

    def act(self, world: World) -> tuple[list, list[Action | None]]:
        """Let every agent that has not arrived choose.

        Returns:
            What each agent decided and perceived, as `(cell, decision, action, perceived)`, and
            the joint action; None in both for agents that do not act.
        """
        choices: list = [None] * len(world.cells)
        actions: list[Action | None] = [None] * len(world.cells)
        for agent in self.agents:
            k = agent.number
            if world.arrived[k]:
                continue
            cell = world.cells[k]
            decision = agent.decide(world.step, cell)
            perceived = self._perceive(world, k, decision)
            action = agent.act(world.step, cell, decision, perceived)
            choices[k] = (cell, decision, action, perceived)
            actions[k] = action
        return choices, actions

    def learn(self, choices: list, world: World, outcome: StepOutcome) -> None:
        """Let every agent that acted learn from the step that the world just made."""
        for agent in self.agents:
            choice = choices[agent.number]
            if choice is not None:
                reward = outcome.rewards[agent.number]
                agent.learn(world.step - 1, *choice, reward, world.cells[agent.number])

    def _perceive(self, world: World, k: int, decision: Decision) -> tuple[int, ...] | None:
        """Return the cells of the asked peers; None unless the percept of each succeeds."""
        if not decision.peers:
            return None
        peer_cells = tuple(world.cells[peer] for peer in decision.peers)
        draw = self._percepts[k].at(world.step)[0]
        probabilities = self._probabilities[world.cells[k]]
        return peer_cells if all(draw < probabilities[cell] for cell in peer_cells) else None


def learn(
    scenario: Scenario,
    learner: str | Learner,
    seed: int,
    *,
    progress: Callable[[int, int], None] = lambda done, budget: None,
) -> list[Tables]:
    """Run one learner for the scenario's budget and return the tables of every robot.

    Arguments as of `learn_agents`.
    """
    return [agent.tables for agent in learn_agents(scenario, learner, seed, progress=progress)]


def learn_agents(
    scenario: Scenario,
    learner: str | Learner,
    seed: int,
    *,
    progress: Callable[[int, int], None] = lambda done, budget: None,
) -> list[Agent]:
    """Run one learner for the scenario's budget and return every robot's agent.

    Most learners learn all at once; one that learns `alone` has one robot at a time in the world,
    each for the whole budget, so that no robot ever meets another (paper, Section 4).

    Args:
        scenario: the problem and its protocol.
        learner: a learner, or its name.
        seed: the run's seed.
        progress: called with transitions done and to be done, about every hundredth.
    """
    rule = learner_of(learner)
    everyone = range(len(scenario.robots))
    teams = [[k] for k in everyone] if rule.alone else [list(everyone)]
    budget = scenario.steps * len(teams)
    learned: list[Agent] = []
    for members in teams:
        agents = [rule.agent(scenario, k, seed) for k in members]
        team = Team(scenario, seed, agents)
        world = World(scenario, seed, agents=members)
        while world.transitions < scenario.steps:
            choices, actions = team.act(world)
            outcome = world.advance(actions)
            team.learn(choices, world, outcome)
            if outcome.episode_over:
                world.begin_episode()
            if world.transitions % max(1, budget // 100) == 0:
                progress(len(learned) * scenario.steps + world.transitions, budget)
        learned += agents
    return learned


def tables_equal(one: list[Tables], other: list[Tables]) -> bool:
    """Whether two teams' tables agree bit for bit (NaN columns included)."""
    return len(one) == len(other) and all(
        _same_bits(a, b)
        for mine, theirs in zip(one, other, strict=True)
        for a, b in zip(mine, theirs, strict=True)
    )


def _same_bits(one: np.ndarray | SparseTable, other: np.ndarray | SparseTable) -> bool:
    if isinstance(one, SparseTable) or isinstance(other, SparseTable):
        return type(one) is type(other) and one.same_bits(other)
    return np.array_equal(one.view(np.int64), other.view(np.int64))
