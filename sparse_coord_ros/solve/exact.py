# Copyright 2026 The sparse_coord_ros authors
# SPDX-License-Identifier: Apache-2.0
"""What a team of at most two robots is worth, computed exactly: its joint Markov chain.

The same trials as `learn.evaluation.play` plays, without drawing any: greedy policies, ties and
percepts with their probabilities, the same end. So nothing here has a standard error. Where the
two differ is only in what a trial's draws cannot show: a draw has 53 bits, a probability here is a
float, and moments are sums of floats (a spread below about 1e-6 of the mean is rounding). One
robot is a pair whose other robot has arrived before it begins.
"""

from collections.abc import Sequence
from dataclasses import asdict, dataclass
from typing import Any, NamedTuple

import numpy as np

from sparse_coord_ros.errors import SettingError
from sparse_coord_ros.game.actions import COORDINATE, OUTCOMES, PRIMITIVES, STAY
from sparse_coord_ros.game.links import check_up
from sparse_coord_ros.game.miscoordination import meeting_places, together
from sparse_coord_ros.game.perception import percept_probabilities
from sparse_coord_ros.game.plugins import is_shipped
from sparse_coord_ros.game.scenario import Scenario
from sparse_coord_ros.game.streams import EVALUATION
from sparse_coord_ros.learn.agent import Tables
from sparse_coord_ros.learn.evaluation import (
    Evaluation,
    Measure,
    acting_on,
    check_tables,
    evaluate,
)
from sparse_coord_ros.learn.learners import Learner, learner_of
from sparse_coord_ros.solve.exact_loops import (
    ARRIVED,
    CONFLICTS,
    QUANTITIES,
    REWARD,
    Pair,
    Sums,
    compiled,
)

MOST_ROBOTS = 2
"""The joint chain of more robots is too large; they are evaluated by trials."""

CHOOSING = ("decide", "act", "coordinate", "values_asking")
"""How an agent chooses, beside its `values`: an agent of the user's own that changes one of these
acts by a rule that its tables do not say."""


@dataclass(frozen=True)
class ExactEvaluation:
    """What a team is worth, exactly; the measures are those of `Evaluation`.

    Attributes:
        reward: total discounted reward a robot: goal paid from arrival on for ever, penalties,
            costs of asking. Its spread is over single robots and trials, as in trials.
        time_to_goal: steps until arrival; the horizon for a robot that does not arrive.
        miscoordinations: steps of a trial that end in a miscoordination.
        asks: how often a robot chose COORDINATE in a trial.
        all_arrived: probability that all robots arrive within the horizon.
        robots: expected reward of each robot.
        asked: expected number of asks of a trial in each cell, shape (robots, cells).
        stays: expected number of steps that each robot acts in each cell, same shape.
    """

    reward: Measure
    time_to_goal: Measure
    miscoordinations: Measure
    asks: Measure
    all_arrived: float
    robots: tuple[float, ...]
    asked: np.ndarray
    stays: np.ndarray

    @property
    def how(self) -> str:
        """How it was found, in words."""
        return "exact"

    def to_dict(self) -> dict[str, Any]:
        """Return plain data, without what there is for each cell."""
        said = asdict(self)
        return {k: v for k, v in said.items() if k not in ("asked", "stays")}


def evaluate_exact(
    scenario: Scenario, tables: Sequence[Tables], *, learner: str | Learner | None = None
) -> ExactEvaluation:
    """Compute what a team of one or two robots is worth.

    Args:
        scenario: the problem.
        tables: the tables of every robot.
        learner: whose greedy policy acts on them; None: Algorithm 1's, or that of a baseline
            where the column of COORDINATE is NaN.

    Raises:
        TablesError: the tables do not fit the scenario.
        SettingError: more than two robots, or a learner whose agents act by a rule of their own.
    """
    check_exact(scenario)
    check_tables(scenario, tables, learner)
    pair, team = _pair(scenario, tables, learner), len(scenario.robots)
    sums = _carried(pair, spreads=True)
    squares = sums.squares[:-1].reshape(3, 2)
    reward, time_to_goal, asks = map(_measure, sums.robots[:, :team], squares[:, :team])
    return ExactEvaluation(
        reward=reward,
        time_to_goal=time_to_goal,
        miscoordinations=_measure(sums.team[: CONFLICTS + 1], sums.squares[-1:]),
        asks=asks,
        all_arrived=min(1.0, float(sums.team[ARRIVED])),
        robots=tuple(sums.robots[REWARD, :team].tolist()),
        asked=sums.asked[:team],
        stays=sums.stays[:team],
    )


def evaluate_best(
    scenario: Scenario,
    tables: Sequence[Tables],
    *,
    trials: int,
    seed: int = 0,
    learner: str | Learner | None = None,
) -> ExactEvaluation | Evaluation:
    """Compute what a team is worth where that can be, else play trials.

    Args:
        scenario: the problem.
        tables: the tables of every robot.
        trials: how many, if trials are played.
        seed: of the trials.
        learner: as of `evaluate_exact`.

    Raises:
        TablesError: the tables do not fit the scenario.
    """
    try:
        return evaluate_exact(scenario, tables, learner=learner)
    except SettingError:  # more robots, a link that fails by time, agents with a rule of their own
        return evaluate(scenario, tables, trials=trials, seed=seed, learner=learner)


def check_exact(scenario: Scenario) -> None:
    """Raise `SettingError` where the team is too large for exact evaluation."""
    team = len(scenario.robots)
    if team > MOST_ROBOTS:
        raise SettingError(
            f"exact evaluation: scenario {scenario.name} has {team} robots, allowed: 1 or "
            f"{MOST_ROBOTS}; larger teams are evaluated by trials, leave out 'exact'"
        )


class ExactMeans(NamedTuple):
    """What a trial of a team of two robots brings on average, exactly.

    Attributes:
        reward, time_to_goal, asks: of each robot, shape (2,).
        miscoordinations: of the team.
        arrived: probability that both arrive within the horizon.
    """

    reward: np.ndarray
    time_to_goal: np.ndarray
    asks: np.ndarray
    miscoordinations: float
    arrived: float


def exact_means(
    scenario: Scenario, tables: Sequence[Tables], learner: Learner
) -> ExactMeans | None:
    """Return the means of `evaluate_exact`, a hundred times faster; None where there are none.

    There are none for another number of robots than two, and for learners whose agents act by a
    rule of their own.

    Args:
        scenario: the problem.
        tables: the tables of every robot, which fit it.
        learner: whose greedy policy acts on them.
    """
    if len(scenario.robots) != MOST_ROBOTS:
        return None
    try:
        pair = _pair(scenario, tables, learner)
    except SettingError:
        return None
    sums = _carried(pair, spreads=False)
    return ExactMeans(*sums.robots, *map(float, sums.team))


def _pair(scenario: Scenario, tables: Sequence[Tables], learner: str | Learner | None) -> Pair:
    asking, moves = (np.array(found) for found in _policies(scenario, tables, learner))
    cells, alone = len(scenario.map.cells), len(scenario.robots) == 1
    starts = [robot.start for robot in scenario.robots]
    goals = [robot.goal for robot in scenario.robots]
    places = meeting_places(scenario)
    meets, penalties = together(places[:, None], places[None, :]), scenario.penalties
    if alone:
        starts, goals, penalties = [*starts, *goals], [*goals, *goals], (*penalties, 0.0)
        asking, moves = np.repeat(asking, 2, axis=0), np.repeat(moves, 2, axis=0)
        meets = np.zeros_like(meets)
    either = moves.sum(axis=1)
    asked = np.empty((2, cells, cells, OUTCOMES))
    asked[..., :STAY] = moves[:, 1] / np.where(either > 0.0, either, 1.0)
    asked[..., STAY] = asking[:, :, None]
    return Pair(
        lead=np.column_stack([scenario.map.next_cell, np.arange(cells)]),
        starts=np.array(starts),
        goals=np.array(goals),
        moves=either,
        asks=asking,
        asked=asked,
        meets=meets,
        penalties=np.array(penalties),
        worth=scenario.goal_reward / (1.0 - scenario.discount),
        cost=float(scenario.ask_cost),
        discount=float(scenario.discount),
        success=float(scenario.move_success),
        horizon=scenario.horizon,
    )


def _carried(pair: Pair, *, spreads: bool) -> Sums:
    """Return what a trial brings; its squares only where `spreads` asks for them."""
    cells = len(pair.lead)
    likely, places = np.zeros((2, cells**2)), np.zeros((2, cells**2), dtype=np.int64)
    sums = Sums(
        robots=np.zeros((3, 2)),
        team=np.zeros(2),
        squares=np.zeros(QUANTITIES),
        asked=np.zeros((2, cells)),
        stays=np.zeros((2, cells)),
        brought=np.zeros((2, QUANTITIES)),
        moments=np.zeros((2, cells**2 if spreads else 0, 2, QUANTITIES)),
    )
    compiled()(pair, *likely, *places, sums)
    return sums


def _policies(
    scenario: Scenario, tables: Sequence[Tables], learner: str | Learner | None
) -> tuple[list[np.ndarray], list[np.ndarray]]:
    """Return, for each robot, how likely it asks and what it does.

    Returns:
        The probability of asking in each own cell, shape (cells,); and that of each move, shape
        (2, cells, peer's cells, moves): without asking, and together with asking. The second's
        sum over asking and moves is 1.
    """
    check_up(scenario.link, "exact evaluation")
    percepts = percept_probabilities(scenario.perception, scenario.map)
    cells = len(scenario.map.cells)
    asking, moves = [], []
    for k, table in enumerate(tables):
        rule = learner_of(learner or acting_on(table))
        agent = rule.agent(scenario, k, 0, tables=table, learning=False, phase=EVALUATION)
        if not all(is_shipped(getattr(type(agent), name)) for name in CHOOSING):
            raise SettingError(
                f"exact evaluation: learner {rule.label} acts by a rule of its own, allowed: "
                "learners whose agents act as Algorithm 1 does; leave out 'exact' for trials"
            )
        values = [agent.values(x)[: agent.actions] for x in range(cells)]
        chosen = _greedy(np.array(values))
        asks = chosen[:, COORDINATE] if agent.actions > COORDINATE else np.zeros(cells)
        both = np.zeros((2, cells, cells, PRIMITIVES))
        both[0] = chosen[:, None, :PRIMITIVES]
        where = np.flatnonzero(asks)  # most robots ask in few cells
        if len(where):
            unseen = [agent.values_asking(x, None)[:PRIMITIVES] for x in where.tolist()]
            blind = _greedy(np.array(unseen))[:, None, :]
            # One robot alone has nobody to ask: its percept fails.
            seen = percepts[where, :, None] if len(tables) > 1 else np.zeros((1, cells, 1))
            coord = np.asarray(agent.tables.q_coord)[where]
            after_asking = seen * _greedy(coord) + (1.0 - seen) * blind
            both[1, where] = asks[where, None, None] * after_asking
        asking.append(asks)
        moves.append(both)
    return asking, moves


def _greedy(values: np.ndarray) -> np.ndarray:
    """Return the probabilities of pi_g over the last axis: uniform among the exact maxima."""
    best = values == values.max(axis=-1, keepdims=True)
    chosen: np.ndarray = best / best.sum(axis=-1, keepdims=True)
    return chosen


def _measure(means: np.ndarray, squares: np.ndarray) -> Measure:
    """Return mean and spread over robots and trials; there is no error of sampling."""
    mean = means.mean()
    return Measure(float(mean), float(np.sqrt(max(0.0, squares.mean() - mean**2))), 0.0)
