# Copyright 2026 The sparse_coord_ros authors
# SPDX-License-Identifier: Apache-2.0
"""What a team of at most two robots is worth, computed exactly: its joint Markov chain.

The same trials as `learn.evaluation.play` plays, without drawing any: greedy policies, ties and
percepts with their probabilities, the same end. So nothing here has a standard error. Where the
two differ is only in what a trial's draws cannot show: a draw has 53 bits, a probability here is a
float, and moments are sums of floats (a spread below about 1e-6 of the mean is rounding).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import asdict, dataclass
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from sparse_coord_ros.errors import SettingError
from sparse_coord_ros.game.actions import COORDINATE, PRIMITIVES, STAY
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
from sparse_coord_ros.learn.sparse import SparseTable
from sparse_coord_ros.solve import exact_loops

if TYPE_CHECKING:
    from scipy.sparse import csr_array

MOST_ROBOTS = 2
"""The joint chain of more robots is too large; they are evaluated by trials."""

CHOOSING = ("decide", "act", "coordinate", "values_asking")
"""How an agent chooses, beside its `values`: an agent of the user's own that changes one of these
acts by a rule that its tables do not say."""

OUTCOMES = PRIMITIVES + 1
"""What a step can come to: each move, and `STAY`."""


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
        joint_states: joint states that the team can get into.
    """

    reward: Measure
    time_to_goal: Measure
    miscoordinations: Measure
    asks: Measure
    all_arrived: float
    robots: tuple[float, ...]
    asked: np.ndarray
    stays: np.ndarray
    joint_states: int

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
    asking, outcomes = _policies(scenario, tables, learner)
    chain = _chain(scenario, asking, outcomes)
    return _measured(scenario, chain)


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
    team = len(scenario.robots)
    if team != MOST_ROBOTS:
        return None
    try:
        asking, moves = _policies(scenario, tables, learner)
    except SettingError:
        return None
    cells = len(scenario.map.cells)
    pair = exact_loops.Pair(
        lead=np.column_stack([scenario.map.next_cell, np.arange(cells)]),
        start=scenario.robots[0].start * cells + scenario.robots[1].start,
        goals=np.array([robot.goal for robot in scenario.robots]),
        moves=np.array([both.sum(axis=0) for both in moves]),
        asks=np.array(asking),
        meets=_meetings(scenario),
        penalties=np.array(scenario.penalties),
        worth=scenario.goal_reward / (1.0 - scenario.discount),
        cost=float(scenario.ask_cost),
        discount=float(scenario.discount),
        success=float(scenario.move_success),
        horizon=scenario.horizon,
    )
    likely, places = np.zeros((2, cells**2)), np.zeros((2, cells**2), dtype=np.int64)
    sums, whole = np.zeros((3, 2)), np.zeros(2)
    exact_loops.compiled()(pair, *likely, *places, sums, whole)
    return ExactMeans(*sums, *map(float, whole))


def _meetings(scenario: Scenario) -> np.ndarray:
    """Return whether a step that ends in two cells is a miscoordination, shape (cells, cells)."""
    places = meeting_places(scenario)
    meets: np.ndarray = together(places[:, None], places[None, :])
    return meets


class _Chain(NamedTuple):
    """The team's joint Markov chain over the joint states that it gets into.

    Attributes:
        states: the cell of every robot in each joint state, shape (robots, states); the team
            starts in the first. The one in which all have arrived is none of them.
        go: probability of each transition between them, shape (states, states).
        paid: go times what the transition brings, for each of several quantities.
        first: expected value of what a step from each state brings, shape (quantities, states).
        second: expected value of its square.
        asking: probability that each robot asks in each joint state, shape (robots, states).
    """

    states: np.ndarray
    go: csr_array
    paid: list[csr_array]
    first: np.ndarray
    second: np.ndarray
    asking: np.ndarray


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
        q_coord = agent.tables.q_coord
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
            coord = q_coord.dense() if isinstance(q_coord, SparseTable) else np.asarray(q_coord)
            after_asking = seen * _greedy(coord[where]) + (1.0 - seen) * blind
            both[1, where] = asks[where, None, None] * after_asking
        asking.append(asks)
        moves.append(both)
    return asking, moves


def _greedy(values: np.ndarray) -> np.ndarray:
    """Return the probabilities of pi_g over the last axis: uniform among the exact maxima."""
    best = values == values.max(axis=-1, keepdims=True)
    chosen: np.ndarray = best / best.sum(axis=-1, keepdims=True)
    return chosen


def _chain(scenario: Scenario, asking: list[np.ndarray], moves: list[np.ndarray]) -> _Chain:
    """Return the chain over the joint states that the team gets into."""
    from scipy import sparse

    cells, team = len(scenario.map.cells), len(scenario.robots)
    source, target, probability, asked = _transitions(scenario, moves)
    size = cells**team
    start = int(np.ravel_multi_index([r.start for r in scenario.robots], (cells,) * team))
    goal = int(np.ravel_multi_index([r.goal for r in scenario.robots], (cells,) * team))
    graph = sparse.csr_array((probability, (source, target)), shape=(size, size))
    found = sparse.csgraph.breadth_first_order(graph, start, return_predecessors=False)
    known = np.zeros(size, dtype=bool)
    known[found] = True
    kept = known[source]
    source, target, probability = source[kept], target[kept], probability[kept]
    asked = asked[:, kept]
    paid = _payments(scenario, source, target, asked, goal)

    states = found[found != goal]
    number = np.full(size, -1)
    number[states] = np.arange(len(states))
    rows, columns = number[source], number[target]
    inside = columns >= 0
    first, second = (
        np.array([np.bincount(rows, probability * r, minlength=len(states)) for r in brought])
        for brought in (paid, paid**2)
    )

    def matrix(weights: np.ndarray) -> csr_array:
        entries = (weights[inside], (rows[inside], columns[inside]))
        return sparse.csr_array(entries, shape=(len(states), len(states)))

    places = np.array(np.unravel_index(states, (cells,) * team))
    goals = np.array([[robot.goal] for robot in scenario.robots])
    likely = np.array([asking[k][places[k]] for k in range(team)]) * (places != goals)
    return _Chain(
        states=places,
        go=matrix(probability),
        paid=[matrix(probability * r) for r in paid],
        first=first,
        second=second,
        asking=likely,
    )


def _transitions(
    scenario: Scenario, moves: list[np.ndarray]
) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """Return every transition between joint states: source, target, probability, who asked.

    A joint state is numbered like an element of an array of shape (cells,) * robots. The last
    has shape (robots, transitions). None leaves the joint state in which all have arrived.
    """
    cells, team = len(scenario.map.cells), len(scenario.robots)
    lead = np.column_stack([scenario.map.next_cell, np.arange(cells)])
    single = []  # of each robot: probability of (asked, outcome), shape (2, OUTCOMES, own, peer)
    for k, robot in enumerate(scenario.robots):
        done = np.zeros((2, OUTCOMES, cells, cells))
        done[:, :PRIMITIVES] = scenario.move_success * np.moveaxis(moves[k], -1, 1)
        done[:, STAY] = (1.0 - scenario.move_success) * moves[k].sum(axis=-1)
        done[:, :, robot.goal] = 0.0
        done[0, STAY, robot.goal] = 1.0  # has arrived: stays, and does not ask
        single.append(done)
    if team == 1:
        single = [single[0][..., :1]]
    else:
        single[1] = np.swapaxes(single[1], 2, 3)  # first the first robot's cell
    parts = []
    goals = tuple(robot.goal for robot in scenario.robots)
    over = goals if team > 1 else (*goals, 0)
    for choice in np.ndindex(*(2, OUTCOMES) * team):
        likely = np.ones(single[0].shape[2:])
        for k in range(team):
            likely = likely * single[k][choice[2 * k], choice[2 * k + 1]]
        likely[over] = 0.0
        places = np.nonzero(likely)
        if not len(places[0]):
            continue
        ends = [lead[places[k], choice[2 * k + 1]] for k in range(team)]
        here = np.ravel_multi_index(places[:team], (cells,) * team)
        there = np.ravel_multi_index(ends, (cells,) * team)
        who = np.array([[choice[2 * k]] for k in range(team)]).repeat(len(places[0]), axis=1)
        parts.append((here, there, likely[places], who))
    source, target, probability, asked = zip(*parts, strict=True)
    return (
        np.concatenate(source),
        np.concatenate(target),
        np.concatenate(probability),
        np.concatenate(asked, axis=1),
    )


def _payments(
    scenario: Scenario, source: np.ndarray, target: np.ndarray, asked: np.ndarray, goal: int
) -> np.ndarray:
    """Return what each transition brings, shape (quantities, transitions).

    The quantities, in this order: reward, step before arrival and ask of every robot, then
    miscoordination, and arrival of all.
    """
    cells, team = len(scenario.map.cells), len(scenario.robots)
    before = np.array(np.unravel_index(source, (cells,) * team))
    after = np.array(np.unravel_index(target, (cells,) * team))
    conflict = np.zeros(len(source), dtype=bool)
    if team > 1:
        conflict = _meetings(scenario)[after[0], after[1]]
    goals = np.array([[robot.goal] for robot in scenario.robots])
    acting = before != goals
    arriving = acting & (after == goals)
    worth = scenario.goal_reward / (1.0 - scenario.discount)
    penalties = np.array(scenario.penalties)[:, None]
    reward = arriving * worth + conflict * penalties - asked * scenario.ask_cost
    everyone = (target == goal)[None]
    return np.concatenate([reward, acting, asked, conflict[None], everyone]).astype(float)


def _measured(scenario: Scenario, chain: _Chain) -> ExactEvaluation:
    """Carry the first two moments of every quantity back over the horizon, from its end."""
    team = len(scenario.robots)
    discount = np.array([scenario.discount] * team + [1.0] * (len(chain.paid) - team))[:, None]
    mean, square = np.zeros_like(chain.first), np.zeros_like(chain.second)
    likely = np.zeros(chain.go.shape[0])
    likely[0] = 1.0
    back = chain.go.T.tocsr()
    spent = np.zeros_like(likely)  # expected steps in each joint state
    for _ in range(scenario.horizon):
        spent += likely
        likely = back @ likely
        crossed = np.array([r @ v for r, v in zip(chain.paid, mean, strict=True)])
        later = chain.second + 2.0 * discount * crossed + discount**2 * (chain.go @ square.T).T
        sooner = chain.first + discount * (chain.go @ mean.T).T
        settled = np.array_equal(sooner, mean) and np.array_equal(later, square)
        mean, square = sooner, later
        if settled and not likely.any():
            break
    means, squares = mean[:, 0], square[:, 0]
    cells = len(scenario.map.cells)
    goals = np.array([[robot.goal] for robot in scenario.robots])
    acting = spent * (chain.states != goals)

    def in_cells(weights: np.ndarray) -> np.ndarray:
        return np.array(
            [np.bincount(chain.states[k], weights[k], minlength=cells) for k in range(team)]
        )

    return ExactEvaluation(
        reward=_measure(means[:team], squares[:team]),
        time_to_goal=_measure(means[team : 2 * team], squares[team : 2 * team]),
        miscoordinations=_measure(
            means[3 * team : 3 * team + 1], squares[3 * team : 3 * team + 1]
        ),
        asks=_measure(means[2 * team : 3 * team], squares[2 * team : 3 * team]),
        all_arrived=min(1.0, float(means[-1])),
        robots=tuple(float(mean) for mean in means[:team]),
        asked=in_cells(acting * chain.asking),
        stays=in_cells(acting),
        joint_states=chain.states.shape[1],
    )


def _measure(means: np.ndarray, squares: np.ndarray) -> Measure:
    """Return mean and spread over robots and trials; there is no error of sampling."""
    mean = means.mean()
    return Measure(float(mean), float(np.sqrt(max(0.0, squares.mean() - mean**2))), 0.0)
