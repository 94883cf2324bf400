# Copyright 2026 The sparse_coord_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The exact value of a team of at most two robots, from its joint Markov chain.

The same trials as `core.runs.evaluation.play` plays, without drawing any: greedy policies, ties
and percepts with their probabilities, the same end. So nothing here has a standard error. Where
the two differ is only in what a trial's draws cannot show: a draw has 53 bits, a probability here
is a float, and moments are sums of floats (a spread below about 1e-6 of the mean is rounding).
"""

import math
from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np

from sparse_coord_ros.base.errors import SettingError
from sparse_coord_ros.core.game.actions import COORDINATE, OUTCOMES, PRIMITIVES, STAY
from sparse_coord_ros.core.game.interactions import (
    interactions_of,
    miscoordinations,
    settled,
)
from sparse_coord_ros.core.game.perception import sight_of
from sparse_coord_ros.core.game.scenario import Scenario
from sparse_coord_ros.core.game.sight import probabilities_between
from sparse_coord_ros.core.learners.learner import Learner
from sparse_coord_ros.core.learners.registry import learner_of
from sparse_coord_ros.core.learners.tables import JointTable, Tables
from sparse_coord_ros.core.runs import evaluation
from sparse_coord_ros.core.runs.evaluation import Progress
from sparse_coord_ros.core.runs.measures import BY_ROBOT, EXACT, TRIAL, Measures
from sparse_coord_ros.core.solve.exact_loops import Chain, Moments, loop_for

MOST_ROBOTS = 2
"""The joint chain of more robots is too large; they are evaluated by trials."""

MOST_STATES = 2**20
MOST_OUTCOMES = 2**22
"""Joint states within reach, and outcomes of steps from them. They take up to a gigabyte, and some
seconds: beyond that trials are quicker."""

QUICK = 50_000_000
"""Outcomes of steps from all joint states, times the horizon: a batch follows as many a run."""


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
        acting = [
            Tables(scenario, rule, k, table.memory) for k, table in enumerate(tables)
        ]
    return evaluate_greedy(scenario, _robots(acting))


def evaluate_greedy(scenario: Scenario, robots: Sequence["Greedy"]) -> Measures:
    """Compute the value of one or two robots with known policies.

    Raises:
        SettingError: there are more joint states within their reach than it pays for.
    """
    reached = _within_reach(scenario, robots)
    moments = _moments(scenario, _chain(scenario, robots, reached), reached)
    visits = moments.visits.reshape([len(cells) for cells in reached])
    home = _joint_state(reached, [robot.goal for robot in scenario.robots])
    last = moments.likely[scenario.horizon % 2].reshape(visits.shape)
    means, squares = map(_by_name, (moments.mean, moments.square))
    arrived = np.array([min(1.0, visits[home] + last[home])])
    means["arrived"] = arrived
    squares["arrived"] = arrived
    variances = {
        name: np.array([max(0.0, square.mean() - means[name].mean() ** 2)])
        for name, square in squares.items()
    }
    stays = _stays(scenario, reached, visits)
    return Measures(
        source=EXACT,
        unit=TRIAL,
        trials=0,
        **means,
        asked=stays * [robot.asks for robot in robots],
        stays=stays,
        variances=variances,
    )


def _by_name(quantities: np.ndarray) -> dict[str, np.ndarray]:
    """Return quantities by the names of measures, with one row each."""
    rows = quantities[:-1].reshape(len(BY_ROBOT), 1, -1)
    return {
        **dict(zip(BY_ROBOT, rows, strict=True)),
        "miscoordinations": quantities[-1:],
    }


def _stays(
    scenario: Scenario, reached: Sequence[np.ndarray], visits: np.ndarray
) -> np.ndarray:
    """Return the expected steps that each robot acts in each cell, shape (robots, cells)."""
    stays = np.zeros((len(reached), len(scenario.map.cells)))
    for k, robot in enumerate(scenario.robots):
        others = tuple(j for j in range(len(reached)) if j != k)
        stays[k, reached[k]] = visits.sum(axis=others)
        stays[k, robot.goal] = 0.0
    return stays


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
        learner: as for `evaluate_exact`.
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


def is_quick(scenario: Scenario) -> bool:
    """Return whether the exact evaluation of every team is quicker than its trials."""
    team = len(scenario.robots)
    outcomes: int = (len(scenario.map.cells) * OUTCOMES) ** team
    return team <= MOST_ROBOTS and outcomes * scenario.horizon <= QUICK


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
    return [_choices(table) for table in tables]


def _choices(tables: Tables) -> Greedy:
    cells = tables.task.cells
    actions = tables.task.actions
    chosen = _greedy(tables.q_star[:, :actions])
    asks = chosen[:, COORDINATE] if actions > COORDINATE else np.zeros(cells)
    blind = np.zeros((cells, PRIMITIVES))
    for x in np.flatnonzero(asks).tolist():
        blind[x] = _greedy(np.array(tables.values_asking(x, 0, ())))
    # entry by entry: a robot asks in few cells
    return Greedy(asks, chosen[:, :PRIMITIVES], blind, JointTable(tables))


def _within_reach(scenario: Scenario, robots: Sequence[Greedy]) -> list[np.ndarray]:
    """Return the cells that each robot can come to, ascending; SettingError where too many."""
    moving = [(robot.moves > 0.0) | (robot.blind > 0.0) for robot in robots]
    reached = [np.empty(0, dtype=np.int64)] * len(robots)
    while True:
        before = reached
        reached = [_closure(scenario, k, moves) for k, moves in enumerate(moving)]
        states = math.prod(map(len, reached))
        if states > MOST_STATES:
            raise _does_not_pay(
                scenario, f"{states:,} joint states", f"{MOST_STATES:,}"
            )
        if all(map(np.array_equal, before, reached)):
            return reached
        for k, robot in enumerate(robots if len(robots) > 1 else ()):
            where = reached[k][robot.asks[reached[k]] > 0.0]
            seen = _greedy(_rows(robot.coord, where, reached[1 - k]))
            moving[k][where] |= (seen > 0.0).any(axis=1)


def _closure(scenario: Scenario, k: int, moves: np.ndarray) -> np.ndarray:
    """Return the cells that robot k can come to by moves, shape (cells, moves), bool."""
    robot = scenario.robots[k]
    lead = scenario.map.next_cell
    cells = {robot.start, robot.goal}
    left = [robot.start]
    while left:
        x = left.pop()
        if x != robot.goal:
            new = set(lead[x, moves[x]].tolist()) - cells
            cells |= new
            left += new
    return np.array(sorted(cells))


def _joint_state(reached: Sequence[np.ndarray], cells: Any) -> tuple[Any, ...]:
    """Return where the robots' cells stand among those that each can come to."""
    return tuple(map(np.searchsorted, reached, cells))


def _chain(
    scenario: Scenario, robots: Sequence[Greedy], reached: Sequence[np.ndarray]
) -> Chain:
    """Return the Markov chain of robots that can come to the cells `reached`.

    Raises:
        SettingError: steps have too many outcomes.
    """
    team = len(robots)
    shape = [len(cells) for cells in reached]
    size = math.prod(shape)
    of_robots = [
        _outcomes(scenario, k, robot, reached) for k, robot in enumerate(robots)
    ]
    chances, asking = zip(*of_robots, strict=True)
    if team == 1:
        joint = chances[0][:, 0]
    else:
        joint = chances[0][..., None] * chances[1].swapaxes(0, 1)[:, :, None]
    home = _joint_state(reached, [robot.goal for robot in scenario.robots])
    joint[home] = 0.0  # a trial is over
    count = np.count_nonzero(joint)
    if count > MOST_OUTCOMES:
        what = f"{count:,} outcomes of steps"
        raise _does_not_pay(scenario, what, f"{MOST_OUTCOMES:,}")
    where = np.nonzero(joint)
    states = where[:team]
    outcomes = where[team:]
    before = np.stack([reached[k][states[k]] for k in range(team)])
    asks = np.stack(
        [
            asking[k][states[k], states[1 - k] if team > 1 else 0, outcomes[k]]
            for k in range(team)
        ]
    )
    stay = np.arange(len(scenario.map.cells))
    lead = np.column_stack([scenario.map.next_cell, stay])
    after = settled(interactions_of(scenario), before, lead[before, outcomes])
    change, square = _changes(scenario, before, after, asks)
    number = np.ravel_multi_index(states, shape)
    probability = joint[where]

    def mean_by_state(values: np.ndarray) -> np.ndarray:
        """Return the mean over the outcomes of each joint state, shape (states, quantities)."""
        rows = [np.bincount(number, probability * row, size) for row in values]
        return np.column_stack(rows)

    discounts = np.ones(len(change))
    discounts[:team] = scenario.discount
    return Chain(
        first=np.searchsorted(number, np.arange(size + 1)),
        probability=probability,
        after=np.asarray(np.ravel_multi_index(_joint_state(reached, after), shape)),
        change=np.ascontiguousarray(change.T),
        mean=mean_by_state(change),
        square=mean_by_state(square),
        discounts=discounts,
    )


def _changes(
    scenario: Scenario, before: np.ndarray, after: np.ndarray, asks: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Return mean and mean square of the changes of the quantities in steps.

    The quantities: `BY_ROBOT`, each of all robots, and miscoordinations.

    Args:
        scenario: the problem.
        before: the cell of each robot before each step, shape (robots, steps).
        after: the cell in which it ended, same shape.
        asks: the probability that it asked, same shape.

    Returns:
        Two arrays of shape (quantities, steps).
    """
    goals = np.array([[robot.goal] for robot in scenario.robots])
    acts = before != goals
    arrives = acts & (after == goals)
    meets = miscoordinations(interactions_of(scenario), before, after)[None]
    paid = meets * np.array(scenario.penalties)[:, None]
    paid += arrives * scenario.arrival_value
    with_cost = paid - scenario.ask_cost
    mean = asks * with_cost + (1.0 - asks) * paid
    square = asks * with_cost**2 + (1.0 - asks) * paid**2
    others = (acts, asks, meets)  # of a change by 0 or 1 the square is the same
    return np.concatenate([mean, *others]), np.concatenate([square, *others])


def _moments(
    scenario: Scenario, chain: Chain, reached: Sequence[np.ndarray]
) -> Moments:
    """Return the moments of a trial."""
    states = len(chain.first) - 1
    quantities = len(chain.discounts)
    moments = Moments(
        mean=np.zeros(quantities),
        square=np.zeros(quantities),
        visits=np.zeros(states),
        likely=np.zeros((2, states)),
        so_far=np.zeros((2, states, quantities)),
        factors=np.ones(quantities),
    )
    start = _joint_state(reached, [robot.start for robot in scenario.robots])
    shape = [len(cells) for cells in reached]
    moments.likely[0, np.ravel_multi_index(start, shape)] = 1.0
    loop_for(chain, scenario.horizon)(chain, moments, scenario.horizon)
    return moments


def _outcomes(
    scenario: Scenario, k: int, robot: Greedy, reached: Sequence[np.ndarray]
) -> tuple[np.ndarray, np.ndarray]:
    """Return the probability of each outcome of robot k's step, and of having asked then.

    An outcome is the move that succeeds, or `STAY`. Shapes (own cells, peer's cells, outcomes); a
    robot without a peer has one cell of the peer.
    """
    cells = reached[k]
    peers = reached[1 - k] if len(reached) > 1 else cells[:1]
    after_asking = np.zeros((len(cells), len(peers), PRIMITIVES))
    where = np.flatnonzero(robot.asks[cells])
    if len(where):
        there = cells[where]
        moves = robot.blind[there, None]
        if len(reached) > 1:
            sees = _percepts(scenario, there, peers)[..., None]
            seen = _greedy(_rows(robot.coord, there, peers))
            moves = sees * seen + (1.0 - sees) * moves
        after_asking[where] = robot.asks[there, None, None] * moves
    either = robot.moves[cells, None] + after_asking
    chances = np.empty((*either.shape[:2], OUTCOMES))
    chances[..., :STAY] = scenario.move_success * either
    chances[..., STAY] = 1.0 - scenario.move_success
    asks = np.empty(chances.shape)
    asks[..., :STAY] = after_asking / np.where(either > 0.0, either, 1.0)
    asks[..., STAY] = robot.asks[cells, None]
    home = cells == scenario.robots[k].goal
    chances[home] = np.arange(OUTCOMES) == STAY
    asks[home] = 0.0
    return chances, asks


def _percepts(
    scenario: Scenario, own_cells: np.ndarray, peers: np.ndarray
) -> np.ndarray:
    """Return the probabilities that percepts succeed, shape (own cells, peer's cells)."""
    cells = np.union1d(own_cells, peers)
    between = probabilities_between(sight_of(scenario.perception, scenario.map), cells)
    probabilities: np.ndarray = between[
        np.ix_(np.searchsorted(cells, own_cells), np.searchsorted(cells, peers))
    ]
    return probabilities


def _rows(q_coord: JointTable, cells: np.ndarray, peers: np.ndarray) -> np.ndarray:
    """Return the rows of Q^C of some cells, shape (own cells, peer's cells, moves)."""
    rows = [[q_coord[x, z] for z in peers.tolist()] for x in cells.tolist()]
    return np.array(rows).reshape(len(cells), len(peers), PRIMITIVES)


def _greedy(values: np.ndarray) -> np.ndarray:
    """Return the probabilities of pi_g over the last axis: uniform among the exact maxima."""
    best = values == values.max(axis=-1, keepdims=True)
    chosen: np.ndarray = best / best.sum(axis=-1, keepdims=True)
    return chosen
