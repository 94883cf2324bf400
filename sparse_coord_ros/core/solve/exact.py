# Copyright 2026 The sparse_coord_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The exact value of a team of at most two robots, from its joint Markov chain.

The same trials as `core.runs.evaluation.play` plays, without drawing any: greedy policies, ties
and percepts with their probabilities, the same end. So nothing here has a standard error. Where
the two differ is only in what a trial's draws cannot show: a draw has 53 bits, a probability here
is a float, and moments are sums of floats (a spread below about 1e-6 of the mean is rounding). One
robot is a pair whose other robot has arrived before it begins.
"""

from collections.abc import Sequence
from dataclasses import replace
from typing import Any, NamedTuple

import numpy as np

from sparse_coord_ros.base.errors import SettingError
from sparse_coord_ros.core.game.actions import COORDINATE, OUTCOMES, PRIMITIVES, STAY
from sparse_coord_ros.core.game.interactions import NOWHERE, interactions_of
from sparse_coord_ros.core.game.perception import sight_of
from sparse_coord_ros.core.game.scenario import Scenario
from sparse_coord_ros.core.game.sight import probabilities_between
from sparse_coord_ros.core.learners.learner import Learner
from sparse_coord_ros.core.learners.registry import learner_of
from sparse_coord_ros.core.learners.tables import Tables
from sparse_coord_ros.core.runs import evaluation
from sparse_coord_ros.core.runs.evaluation import Progress
from sparse_coord_ros.core.runs.measures import EXACT, TRIAL, Measures
from sparse_coord_ros.core.solve.exact_loops import (
    ARRIVED,
    CONFLICTS,
    QUANTITIES,
    Distribution,
    Pair,
    Sums,
    compiled,
)

MOST_ROBOTS = 2
"""The joint chain of more robots is too large; they are evaluated by trials."""

MOST_STATES = 2**20
MOST_OUTCOMES = 50_000_000
"""Joint states within reach, which take up to a gigabyte, and outcomes of steps that are followed,
which take up to five seconds: beyond that trials are quicker."""


def evaluate_exact(
    scenario: Scenario,
    tables: Sequence[Tables],
    *,
    learner: str | Learner | None = None,
) -> Measures:
    """Compute the value of a team of one or two robots.

    Args:
        scenario: the problem.
        tables: the tables of every robot.
        learner: whose greedy policy acts on them; None: Algorithm 1's, or that of a baseline
            where the column of COORDINATE is NaN.

    Raises:
        TablesError: the tables do not fit the scenario.
        SettingError: more than two robots, or more joint states within their reach than it pays
            for.
    """
    check_exact(scenario)
    evaluation.check_tables(scenario, tables, learner)
    acting = tables
    if learner is not None:
        rule = learner_of(learner)
        acting = [Tables(scenario, rule, k, one.memory) for k, one in enumerate(tables)]
    return evaluate_greedy(scenario, _robots(acting))


def evaluate_greedy(scenario: Scenario, robots: Sequence["Greedy"]) -> Measures:
    """Compute the value of one or two robots with known policies.

    Raises:
        SettingError: there are more joint states within their reach than it pays for.
    """
    own = _within_reach(scenario, robots)
    sums = _carried(_pair(scenario, robots, own), spreads=True, most=MOST_OUTCOMES)
    if sums is None:
        raise _does_not_pay(
            scenario, f"over {MOST_OUTCOMES:,} outcomes of steps", "as many"
        )
    found = _measures(scenario, own, sums)
    team = len(scenario.robots)
    returns, time_to_goal, asks = sums.squares[:-1].reshape(3, 2)[:, :team]
    squares = {
        "returns": returns,
        "time_to_goal": time_to_goal,
        "miscoordinations": sums.squares[-1:],
        "asks": asks,
        "arrived": found.arrived,
    }
    variances = {
        name: np.array([max(0.0, square.mean() - found.mean(name) ** 2)])
        for name, square in squares.items()
    }
    return replace(found, variances=variances)


def _measures(scenario: Scenario, own: np.ndarray, sums: Sums) -> Measures:
    """Return the means of a trial, in which robots do not leave the cells `own`."""
    team = len(scenario.robots)
    asked, stays = np.zeros((2, team, len(scenario.map.cells)))
    asked[:, own] = sums.asked[:team]
    stays[:, own] = sums.stays[:team]
    returns, time_to_goal, asks = sums.robots[:, None, :team]
    return Measures(
        source=EXACT,
        unit=TRIAL,
        trials=0,
        returns=returns,
        time_to_goal=time_to_goal,
        miscoordinations=sums.team[[CONFLICTS]],
        asks=asks,
        arrived=np.minimum(1.0, sums.team[[ARRIVED]]),
        asked=asked,
        stays=stays,
    )


def evaluate_best(
    scenario: Scenario,
    tables: Sequence[Tables],
    *,
    trials: int,
    seed: int = 0,
    learner: str | Learner | None = None,
    progress: Progress = evaluation.silent,
) -> Measures:
    """Compute the exact value of a team if possible, else play trials.

    Args:
        scenario: the problem.
        tables: the tables of every robot.
        trials: how many, if trials are played.
        seed: of the trials.
        learner: as of `evaluate_exact`.
        progress: of the trials.

    Raises:
        TablesError: the tables do not fit the scenario.
    """
    try:
        return evaluate_exact(scenario, tables, learner=learner)
    except SettingError:  # too many robots, or too large
        return evaluation.play(
            scenario,
            tables,
            trials=trials,
            seed=seed,
            learner=learner,
            progress=progress,
        )


def check_exact(scenario: Scenario) -> None:
    """Raise `SettingError` if the team is too large."""
    team = len(scenario.robots)
    if team > MOST_ROBOTS:
        raise SettingError(
            f"exact evaluation: scenario {scenario.name} has {team} robots, allowed: 1 or "
            f"{MOST_ROBOTS}; larger teams are evaluated by trials, leave out 'exact'"
        )


def exact_means(scenario: Scenario, tables: Sequence[Tables]) -> Measures | None:
    """Return the means of `evaluate_exact`, without spreads, a hundred times faster; or None.

    There are none for another number of robots than two, and on maps so large that a team without
    a policy would take longer than trials.

    Args:
        scenario: the problem.
        tables: the tables of every robot, which fit it.
    """
    cells = len(scenario.map.cells)
    large = cells**2 * OUTCOMES**2 * scenario.horizon > MOST_OUTCOMES
    if len(scenario.robots) != MOST_ROBOTS or large:
        return None
    every = np.arange(cells)
    sums = _carried(_pair(scenario, _robots(tables), every), spreads=False)
    assert sums is not None
    return _measures(scenario, every, sums)


def _does_not_pay(scenario: Scenario, what: str, most: str) -> SettingError:
    return SettingError(
        f"exact evaluation: this team in scenario {scenario.name} has {what}, allowed: up to "
        f"{most}; leave out 'exact' for trials, or evaluate a team that has learned more"
    )


class Greedy(NamedTuple):
    """Probabilities of a greedy robot's actions in each cell, before any percept.

    Attributes:
        asks: that it asks, (cells,): 1 where it `asks_surely`, less where a draw breaks a tie
            with a move.
        moves: each move without asking; (cells, moves).
        blind: each move after a percept that failed, 0 where it never asks; (cells, moves).
        coord: its Q^C, by which it acts after others; not looked at if it never asks.
    """

    asks: np.ndarray
    moves: np.ndarray
    blind: np.ndarray
    coord: Any


def _robots(tables: Sequence[Tables]) -> list[Greedy]:
    """Return the robots as greedy ones that act on tables, which fit."""
    return [_choices(one) for one in tables]


def _choices(tables: Tables) -> Greedy:
    cells = tables.task.cells
    actions = tables.task.actions
    chosen = _greedy(tables.q_star[:, :actions])
    asks = chosen[:, COORDINATE] if actions > COORDINATE else np.zeros(cells)
    blind = np.zeros((cells, PRIMITIVES))
    for x in np.flatnonzero(asks).tolist():
        blind[x] = _greedy(np.array(tables.values_asking(x, 0, ())))
    return Greedy(asks, chosen[:, :PRIMITIVES], blind, tables.q_coord)


def _within_reach(scenario: Scenario, robots: Sequence[Greedy]) -> np.ndarray:
    """Return the cells that robots can come to, ascending; SettingError where too many."""
    moving = [(one.moves > 0.0) | (one.blind > 0.0) for one in robots]
    reached = [np.empty(0, dtype=np.int64)] * len(robots)
    while True:
        before = reached
        reached = [_closure(scenario, k, moves) for k, moves in enumerate(moving)]
        own = np.union1d(reached[0], reached[-1])
        if len(own) ** 2 > MOST_STATES:
            raise _does_not_pay(
                scenario, f"{len(own) ** 2:,} joint states", f"{MOST_STATES:,}"
            )
        if all(map(np.array_equal, before, reached)):
            return own
        for k, one in enumerate(robots if len(robots) > 1 else ()):
            where = reached[k][one.asks[reached[k]] > 0.0]
            seen = _greedy(_rows(one.coord, where, reached[1 - k]))
            moving[k][where] |= (seen > 0.0).any(axis=1)


def _closure(scenario: Scenario, k: int, moves: np.ndarray) -> np.ndarray:
    """Return the cells that robot k can come to by moves, shape (cells, moves), bool."""
    robot = scenario.robots[k]
    lead = scenario.map.next_cell
    found = {robot.start, robot.goal}
    left = [robot.start]
    while left:
        x = left.pop()
        if x != robot.goal:
            new = set(lead[x, moves[x]].tolist()) - found
            found |= new
            left += new
    return np.array(sorted(found))


def _pair(scenario: Scenario, robots: Sequence[Greedy], own: np.ndarray) -> Pair:
    """Return the two robots on the cells `own`, ascending, which they do not leave."""
    cells = len(own)
    alone = len(robots) == 1
    percepts = probabilities_between(sight_of(scenario.perception, scenario.map), own)
    if alone:  # it has no peer to ask: its percepts fail
        percepts = np.zeros_like(percepts)
    asking = np.array([one.asks[own] for one in robots])
    moves = np.array([_moves(one, own, percepts) for one in robots])
    starts = np.searchsorted(own, [robot.start for robot in scenario.robots])
    goals = np.searchsorted(own, [robot.goal for robot in scenario.robots])
    inter = interactions_of(scenario)
    interactions = inter._replace(
        places=inter.places[own], passages=inter.passages[own], narrow=inter.narrow[own]
    )
    penalties = scenario.penalties
    if alone:
        starts = np.append(starts, goals)
        goals = np.tile(goals, 2)
        penalties = (*penalties, 0.0)
        asking = np.repeat(asking, 2, axis=0)
        moves = np.repeat(moves, 2, axis=0)
        interactions = interactions._replace(
            places=np.full(cells, NOWHERE), swaps=False, blocks=False
        )
    # No robot makes a move that leads out of the cells.
    lead = np.minimum(np.searchsorted(own, scenario.map.next_cell[own]), cells - 1)
    either = moves.sum(axis=1)
    asked = np.empty((2, cells, cells, OUTCOMES))
    asked[..., :STAY] = moves[:, 1] / np.where(either > 0.0, either, 1.0)
    asked[..., STAY] = asking[:, :, None]
    return Pair(
        lead=np.column_stack([lead, np.arange(cells)]),
        starts=starts,
        goals=goals,
        moves=either,
        asks=asking,
        asked=asked,
        interactions=interactions,
        penalties=np.array(penalties),
        arrival_value=scenario.arrival_value,
        cost=float(scenario.ask_cost),
        discount=float(scenario.discount),
        success=float(scenario.move_success),
        horizon=scenario.horizon,
    )


def _carried(pair: Pair, *, spreads: bool, most: float = np.inf) -> Sums | None:
    """Return the sums of a trial, with squares only if `spreads`.

    None: steps have more than `most` outcomes in all.
    """
    cells = len(pair.lead)
    now, later = (
        Distribution(
            likely=np.zeros(cells**2),
            states=np.zeros(cells**2, dtype=np.int64),
            size=np.zeros(1, dtype=np.int64),
        )
        for _ in range(2)
    )
    sums = Sums(
        robots=np.zeros((3, 2)),
        team=np.zeros(2),
        squares=np.zeros(QUANTITIES),
        asked=np.zeros((2, cells)),
        stays=np.zeros((2, cells)),
        brought=np.zeros((2, QUANTITIES)),
        so_far=np.zeros((2, cells**2 if spreads else 0, QUANTITIES)),
        step=np.zeros((2, 2), dtype=np.int64),
    )
    return sums if compiled()(pair, now, later, sums, most) else None


def _moves(robot: Greedy, own: np.ndarray, percepts: np.ndarray) -> np.ndarray:
    """Return the probability of each move of a robot, (2, own cell, peer's cell, moves).

    Without asking, and together with asking; the sum over both and the moves is 1.
    """
    both = np.zeros((2, len(own), len(own), PRIMITIVES))
    both[0] = robot.moves[own, None, :]
    where = np.flatnonzero(robot.asks[own])
    if len(where):
        there = own[where]
        seen = percepts[where, :, None]
        after = seen * _greedy(_rows(robot.coord, there, own))
        after += (1.0 - seen) * robot.blind[there, None, :]
        both[1, where] = robot.asks[there, None, None] * after
    return both


def _rows(q_coord: Any, own: np.ndarray, peers: np.ndarray) -> np.ndarray:
    """Return the rows of Q^C of some cells, shape (own cells, peer's cells, moves)."""
    if isinstance(q_coord, np.ndarray):
        found: np.ndarray = q_coord[np.ix_(own, peers)]
        return found
    rows = [[q_coord[x, z] for z in peers.tolist()] for x in own.tolist()]
    return np.array(rows).reshape(len(own), len(peers), PRIMITIVES)


def _greedy(values: np.ndarray) -> np.ndarray:
    """Return the probabilities of pi_g over the last axis: uniform among the exact maxima."""
    best = values == values.max(axis=-1, keepdims=True)
    chosen: np.ndarray = best / best.sum(axis=-1, keepdims=True)
    return chosen
