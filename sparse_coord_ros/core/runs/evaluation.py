# Copyright 2026 The sparse_coord_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Monte-Carlo evaluation of learned tables: the paper's three measures (Section 4).

All policies are evaluated greedily "in the original problem", all robots moving at once.
"""

from collections.abc import Callable, Sequence
from functools import partial
from typing import TypeAlias

from sparse_coord_ros.base.errors import TablesError
from sparse_coord_ros.core.game.draws import EVALUATION
from sparse_coord_ros.core.game.percepts import Percepts
from sparse_coord_ros.core.game.scenario import Scenario
from sparse_coord_ros.core.game.settings import Setting
from sparse_coord_ros.core.game.world import Action, World
from sparse_coord_ros.core.learners.agent import Agent
from sparse_coord_ros.core.learners.learner import Learner
from sparse_coord_ros.core.learners.memory import check_memory
from sparse_coord_ros.core.learners.mind import team_mind
from sparse_coord_ros.core.learners.registry import learner_of
from sparse_coord_ros.core.learners.tables import Tables
from sparse_coord_ros.core.runs.measures import Measures
from sparse_coord_ros.core.runs.team import Team

Progress: TypeAlias = Callable[[int, int], None]
"""Is told what is done, of all that there is to do."""


def silent(done: int, total: int) -> None:
    """Report no progress."""


class GreedyTeam:
    """Agents that act in one process: active perception is a look at the world's joint state.

    Args:
        scenario: the problem.
        seed: the run's seed.
        agents: the agents, one for each robot of the scenario.
    """

    def __init__(self, scenario: Scenario, seed: int, agents: list[Agent]) -> None:
        self.agents = agents
        self._percepts = Percepts(scenario, seed, EVALUATION)

    def begin_episode(self, world: World) -> None:
        """Let an episode begin, in the world and for every agent."""
        world.begin_episode()
        for agent in self.agents:
            agent.begin_episode()

    def act(self, world: World) -> list[Action | None]:
        """Let every agent that has not arrived choose; None for agents that do not act."""
        actions: list[Action | None] = [None] * len(world.cells)
        for agent in self.agents:
            k = agent.number
            if world.arrived[k]:
                continue
            cell = world.cells[k]
            decision = agent.decide(world.step, cell)
            peers = decision.peers
            perceived = self._perceived(world, k, peers) if peers else None
            actions[k] = agent.act(world.step, cell, decision, perceived)
        return actions

    def _perceived(
        self, world: World, k: int, peers: tuple[int, ...]
    ) -> tuple[int, ...] | None:
        """Ask peers, one after the other; return their cells, None where one is not perceived."""
        cells = tuple(world.cells[peer] for peer in peers)
        sees = partial(self._percepts.sees, world.step, k, world.cells[k])
        return cells if all(map(sees, cells)) else None


TRIALS = Setting("trials", int, 1000, "Monte-Carlo trials", low=1, high=10_000_000)


def play(
    scenario: Scenario,
    tables: Sequence[Tables],
    *,
    trials: int,
    seed: int,
    learner: str | Learner | None = None,
    progress: Progress = silent,
) -> Measures:
    """Play greedy trials from the scenario's starts.

    Args:
        scenario: the problem.
        tables: the tables of every robot.
        trials: number of trials, >= 2.
        seed: seed of the trials' draws, independent of the draws of learning.
        learner: whose greedy policy acts on them; None: Algorithm 1's, or that of a baseline
            where the column of COORDINATE is NaN.
        progress: called with the trials played and all of them, before each one.

    Raises:
        TablesError: the tables do not fit the scenario.
    """
    check_tables(scenario, tables, learner)
    rule = learner_of(learner or tables[0].rule)
    team = Team(scenario, rule, compiled=False)
    memories = [table.memory for table in tables]
    mind = team_mind(rule, scenario, range(len(tables)), memories)
    return team.play(mind, seed, trials, progress=progress)


def check_tables(
    scenario: Scenario, tables: Sequence[Tables], learner: str | Learner | None = None
) -> None:
    """Raise `TablesError` unless each robot has tables that fit.

    Args:
        scenario: the problem.
        tables: the tables of every robot.
        learner: the learner that acts on them; None: the learner of the tables.
    """
    if len(tables) != len(scenario.robots):
        more = f"which has {len(scenario.robots)}; use the tables of a run of this scenario"
        raise TablesError(
            f"tables of {len(tables)} robots for scenario {scenario.name}, {more}"
        )
    for k, table in enumerate(tables):
        check_memory(scenario, learner_of(learner or table.rule), k, table.memory)


def greedy_team(
    scenario: Scenario,
    tables: Sequence[Tables],
    seed: int,
    learner: str | Learner | None = None,
) -> GreedyTeam:
    """Return a team that acts greedily on learned tables; arguments and errors as in `play`."""
    check_tables(scenario, tables, learner)
    agents = greedy_agents(scenario, tables, seed, learner)
    return GreedyTeam(scenario, seed, agents)


def greedy_agents(
    scenario: Scenario,
    tables: Sequence[Tables],
    seed: int,
    learner: str | Learner | None = None,
) -> list[Agent]:
    """Return the agents of `greedy_team`; the tables fit."""
    return [
        Agent(
            learner_of(learner or table.rule),
            scenario,
            k,
            seed,
            memory=table.memory,
            learning=False,
            phase=EVALUATION,
        )
        for k, table in enumerate(tables)
    ]
