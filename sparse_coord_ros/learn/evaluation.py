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

from sparse_coord_ros.errors import TablesError
from sparse_coord_ros.game.actions import ACTIONS, COORDINATE, PRIMITIVES
from sparse_coord_ros.game.links import Percepts
from sparse_coord_ros.game.scenario import Scenario
from sparse_coord_ros.game.settings import Setting
from sparse_coord_ros.game.streams import EVALUATION, LEARNING
from sparse_coord_ros.game.world import Action, StepOutcome, World
from sparse_coord_ros.learn.agent import Agent, Choice, Tables
from sparse_coord_ros.learn.learners import Learner, learner_of

MEASURES = ("reward", "time_to_goal", "miscoordinations", "asks")
"""The measures of an `Evaluation`."""

Progress: TypeAlias = Callable[[int, int], None]
"""Is told what is done, of all that there is to do."""


def silent(done: int, total: int) -> None:
    """Tell nobody."""


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
        self._percepts = Percepts(scenario, seed, phase)

    def act(self, world: World) -> tuple[list[Choice | None], list[Action | None]]:
        """Let every agent that has not arrived choose.

        Returns:
            What each agent decided and perceived, and the joint action; None in both for agents
            that do not act.
        """
        choices: list[Choice | None] = [None] * len(world.cells)
        actions: list[Action | None] = [None] * len(world.cells)
        for agent in self.agents:
            k = agent.number
            if world.arrived[k]:
                continue
            cell = world.cells[k]
            decision = agent.decide(world.step, cell)
            peers = decision.peers
            perceived = self._perceived(world, k, peers) if peers else None
            action = agent.act(world.step, cell, decision, perceived)
            choices[k] = Choice(cell, decision, action, perceived)
            actions[k] = action
        return choices, actions

    def learn(self, choices: Sequence[Choice | None], world: World, outcome: StepOutcome) -> None:
        """Let every agent that acted learn from the step that the world just made."""
        for agent in self.agents:
            choice = choices[agent.number]
            if choice is not None:
                reward = outcome.rewards[agent.number]
                agent.learn(world.step - 1, choice, reward, world.cells[agent.number])

    def _perceived(self, world: World, k: int, peers: tuple[int, ...]) -> tuple[int, ...] | None:
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
class Trials:
    """Greedy trials from the scenario's starts.

    Attributes:
        reward: total discounted reward, shape (trials, robots).
        time_to_goal: steps until arrival; the horizon for a robot that does not arrive; same
            shape.
        asks: how often COORDINATE was chosen; same shape.
        arrived: whether the robot arrived; same shape.
        miscoordinations: steps that end in a miscoordination, shape (trials,).
        asked: how often COORDINATE was chosen in each cell in all trials, shape (robots, cells).
        stays: how often the robot acted in each cell in all trials, same shape: the steps until
            it has arrived.
    """

    reward: np.ndarray
    time_to_goal: np.ndarray
    asks: np.ndarray
    arrived: np.ndarray
    miscoordinations: np.ndarray
    asked: np.ndarray
    stays: np.ndarray

    def __repr__(self) -> str:
        """Return what they are, on one line."""
        return "<Trials: {} of {} robots>".format(*self.reward.shape)


@dataclass(frozen=True)
class Evaluation:
    """What a team is worth.

    Attributes:
        trials: Monte-Carlo trials.
        reward: total discounted reward a robot: goal paid from arrival on for ever, penalties,
            costs of asking.
        time_to_goal: steps until arrival; the horizon for a robot that does not arrive.
        miscoordinations: steps of a trial that end in a miscoordination.
        asks: how often a robot chose COORDINATE in a trial.
        not_arrived: trials in which some robot did not arrive within the horizon.
    """

    trials: int
    reward: Measure
    time_to_goal: Measure
    miscoordinations: Measure
    asks: Measure
    not_arrived: int

    def __repr__(self) -> str:
        """Return what was measured, on one line; in parentheses the standard error."""
        return f"<Evaluation: {self.how}; {measured_in_words(self)}>"

    @property
    def all_arrived(self) -> float:
        """Share of the trials in which all robots arrived."""
        return 1.0 - self.not_arrived / self.trials

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
    error = found.reward.standard_error
    shown = "" if error == 0.0 or math.isnan(error) else f" ({error:.2f})"
    return (
        f"reward {found.reward.mean:.2f}{shown}, time to goal {found.time_to_goal.mean:.2f}, "
        f"miscoordinations {found.miscoordinations.mean:.2f}, asks {found.asks.mean:.2f}, "
        f"all arrive in {found.all_arrived:.2%}"
    )


def summary(trials: Trials) -> Evaluation:
    """Return mean, spread and standard error of each measure."""
    return Evaluation(
        trials=len(trials.reward),
        reward=_measure(trials.reward),
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
        trials: how many trials, >= 2.
        seed: seed of the trials' draws, independent of the draws of learning.
        learner: whose greedy policy acts on them; None: Algorithm 1's, or that of a baseline
            where the column of COORDINATE is NaN.
        progress: called with the trials played and all of them, before each one.

    Raises:
        TablesError: the tables do not fit the scenario.
    """
    team = greedy_team(scenario, tables, seed, learner)
    world = World(scenario, seed, phase=EVALUATION, max_steps=scenario.horizon)
    shape = (trials, len(tables))
    reward, asks, arrived = np.zeros(shape), np.zeros(shape), np.zeros(shape, dtype=bool)
    times = np.full(shape, float(scenario.horizon))
    conflicts = np.zeros(trials)
    asked = np.zeros((len(tables), len(scenario.map.cells)), dtype=np.int64)
    stays = np.zeros_like(asked)
    for trial in range(trials):
        progress(trial, trials)
        world.begin_episode()
        discount, elapsed = 1.0, 0
        while not world.episode_over:
            cells = list(world.cells)
            _, actions = team.act(world)
            outcome = world.advance(actions)
            elapsed += 1
            for k, parts in enumerate(outcome.rewards):
                reward[trial, k] += discount * (parts.common + parts.ask_cost)
                action = actions[k]
                if action is None:
                    continue
                stays[k, cells[k]] += 1
                if action.asked:
                    asks[trial, k] += 1
                    asked[k, cells[k]] += 1
            for k in outcome.arrived:
                times[trial, k] = elapsed
                reward[trial, k] += discount * scenario.goal_reward / (1.0 - scenario.discount)
            conflicts[trial] += outcome.miscoordination
            discount *= scenario.discount
        arrived[trial] = world.arrived
    return Trials(reward, times, asks, arrived, conflicts, asked, stays)


def check_tables(
    scenario: Scenario, tables: Sequence[Tables], learner: str | Learner | None = None
) -> None:
    """Raise `TablesError` unless each robot has one pair of tables that fits.

    Args:
        scenario: the problem.
        tables: the tables of every robot.
        learner: who is to use them: the column of COORDINATE is NaN for one that does not ask;
            None: whoever learned them.
    """
    cells = len(scenario.map.cells)
    coord_shape = (cells,) * scenario.perceived + (PRIMITIVES,)
    due = {"q_star": (cells, len(ACTIONS)), "q_coord": coord_shape}
    if len(tables) != len(scenario.robots):
        more = f"which has {len(scenario.robots)}; use the tables of a run of this scenario"
        raise TablesError(f"tables of {len(tables)} robots for scenario {scenario.name}, {more}")
    rule = None if learner is None else learner_of(learner)
    for k, table in enumerate(tables, start=1):
        for name, needed in due.items():
            shape = getattr(table, name).shape
            if shape != needed:
                raise TablesError(
                    f"{name}_{k} has shape {shape}, scenario {scenario.name} needs {needed}; use "
                    "the tables of a run on the same map and with the same setting peers"
                )
        arrays = {**table.arrays(), "q_star": table.q_star[:, :PRIMITIVES]}
        if not all(np.isfinite(array).all() for array in arrays.values()):
            what = f"tables of robot {k} hold values that are no finite numbers"
            raise TablesError(f"{what}; use tables that run or train wrote")
        if rule is not None and acting_on(table) != kind_of(rule):
            raise TablesError(
                f"tables of robot {k} have the form of learner {acting_on(table)}, learner "
                f"{rule.label} needs that of {kind_of(rule)}; use the tables of a run with that "
                "learner, or choose the other one"
            )


def greedy_team(
    scenario: Scenario, tables: Sequence[Tables], seed: int, learner: str | Learner | None = None
) -> Team:
    """Return a team that acts greedily on learned tables; arguments and errors as of `play`."""
    check_tables(scenario, tables, learner)
    agents = greedy_agents(scenario, tables, seed, learner)
    return Team(scenario, seed, agents, phase=EVALUATION)


def greedy_agents(
    scenario: Scenario, tables: Sequence[Tables], seed: int, learner: str | Learner | None
) -> list[Agent]:
    """Return the agents of `greedy_team`; the tables fit."""
    how: Any = {"learning": False, "phase": EVALUATION}
    return [
        learner_of(learner or acting_on(table)).agent(scenario, k, seed, tables=table, **how)
        for k, table in enumerate(tables)
    ]


def acting_on(table: Tables) -> str:
    """Return the learner whose greedy policy the tables are for."""
    if table.factors is not None:
        return "factored"
    return "noncoop" if np.isnan(table.q_star[:, COORDINATE]).any() else "coop"


def kind_of(learner: Learner) -> str:
    """Return the learner of this package whose tables are made as those of a learner."""
    if learner.factors is not None:
        return "factored"
    return "coop" if learner.asks else "noncoop"


def _measure(values: np.ndarray) -> Measure:
    means = values.mean(axis=1)
    error = means.std(ddof=1) / math.sqrt(len(means)) if len(means) > 1 else math.nan
    return Measure(float(values.mean()), float(values.std()), float(error))
