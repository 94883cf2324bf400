# Copyright 2026 The sparse_coord_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Monte-Carlo evaluation of learned tables: the paper's three measures (Section 4).

All policies are evaluated greedily "in the original problem", all robots moving at once.
"""

import math
from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass
from functools import partial
from typing import Any, TypeAlias

import numpy as np

from sparse_coord_ros.base.errors import TablesError
from sparse_coord_ros.base.percents import percent
from sparse_coord_ros.core.game.draws import EVALUATION
from sparse_coord_ros.core.game.percepts import Percepts
from sparse_coord_ros.core.game.scenario import Scenario
from sparse_coord_ros.core.game.settings import Setting
from sparse_coord_ros.core.game.world import Action, World
from sparse_coord_ros.core.learners.agent import Agent
from sparse_coord_ros.core.learners.learner import Learner
from sparse_coord_ros.core.learners.memory import check_memory
from sparse_coord_ros.core.learners.registry import learner_of
from sparse_coord_ros.core.learners.tables import Tables
from sparse_coord_ros.core.runs.team import Team
from sparse_coord_ros.core.runs.trials import Trials

MEASURES = ("returns", "time_to_goal", "miscoordinations", "asks")
"""The measures of an `Evaluation`."""

ARRIVE = 0.999
"""Share of its episodes in which all robots of a team must arrive; in a failed team fewer do."""

Progress: TypeAlias = Callable[[int, int], None]
"""Is told what is done, of all that there is to do."""


def silent(done: int, total: int) -> None:
    """Report no progress."""


def fails(all_arrived: float) -> bool:
    """Return whether a team fails: some robot is missing in more than one of 1,000 episodes.

    Args:
        all_arrived: share of its episodes in which all robots arrive.
    """
    return all_arrived < ARRIVE


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


@dataclass(frozen=True)
class Measure:
    """Mean, spread over single robots and trials (the paper's ±), and standard error of the mean.

    The standard error is that of independent samples: in an `Evaluation` the trials, the robots
    of one trial being dependent; in a `ConditionResult` the learning runs, the trials of one
    run being dependent.
    """

    mean: float
    spread: float
    standard_error: float


@dataclass(frozen=True)
class Evaluation:
    """The measures of a team in trials.

    Attributes:
        trials: Monte-Carlo trials.
        returns: total discounted reward a robot: goal paid from arrival on for ever, penalties,
            costs of asking.
        time_to_goal: steps until arrival; the horizon for a robot that does not arrive.
        miscoordinations: steps of a trial that end in a miscoordination.
        asks: how often a robot chose COORDINATE in a trial.
        not_arrived: trials in which some robot did not arrive within the horizon.
    """

    trials: int
    returns: Measure
    time_to_goal: Measure
    miscoordinations: Measure
    asks: Measure
    not_arrived: int

    def __repr__(self) -> str:
        """Return the measures on one line; standard errors in parentheses."""
        return f"<Evaluation: {self.how}; {measured_in_words(self)}>"

    @property
    def all_arrived(self) -> float:
        """Share of the trials in which all robots arrived."""
        return (self.trials - self.not_arrived) / self.trials

    @property
    def how(self) -> str:
        """How it was found, in words."""
        return f"{self.trials} trials"

    def to_dict(self) -> dict[str, Any]:
        """Return plain data."""
        return asdict(self)


def with_spread(measure: Measure, digits: int = 2) -> str:
    """Return `mean ± spread`, and the standard error where the mean is one of trials."""
    said = f"{measure.mean:.{digits}f} ± {measure.spread:.{digits}f}"
    error = measure.standard_error
    return f"{said} (s.e. {error:.{digits}f})" if error > 0.0 else said


def measured_in_words(found: Any) -> str:
    """Return the means of an `Evaluation` or `ExactEvaluation`, on one line."""
    error = found.returns.standard_error
    shown = "" if error == 0.0 or math.isnan(error) else f" ({error:.2f})"
    return (
        f"return {found.returns.mean:.2f}{shown}, time to goal {found.time_to_goal.mean:.2f}, "
        f"miscoordinations {found.miscoordinations.mean:.2f}, asks {found.asks.mean:.2f}, "
        f"all arrive in {percent(found.all_arrived)}"
    )


def summary(trials: Trials) -> Evaluation:
    """Return mean, spread and standard error of each measure."""
    return Evaluation(
        trials=len(trials.returns),
        returns=_measure(trials.returns),
        time_to_goal=_measure(trials.time_to_goal),
        miscoordinations=_measure(trials.miscoordinations[:, None]),
        asks=_measure(trials.asks),
        not_arrived=int((~trials.arrived.all(axis=1)).sum()),
    )


def play(
    scenario: Scenario,
    tables: Sequence[Tables],
    *,
    trials: int,
    seed: int,
    learner: str | Learner | None = None,
    progress: Progress = silent,
) -> Trials:
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
    minds = team.initial([table.memory for table in tables])
    return team.play(minds, seed, trials, progress=progress)


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
    """Return a team that acts greedily on learned tables; arguments and errors as of `play`."""
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


def _measure(values: np.ndarray) -> Measure:
    means = values.mean(axis=1)
    error = means.std(ddof=1) / math.sqrt(len(means)) if len(means) > 1 else math.nan
    return Measure(float(values.mean()), float(values.std()), float(error))
