# Copyright 2026 The sparse_coord_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The value of fixed shortest-path policies, to which "Indiv." of the paper tends.

Each robot walks a shortest path to its goal and never minds the others (paper, Section 4). If
robots can only be together, they are independent Markov chains: each is carried forward on its
own, and at every time step the chance of a miscoordination follows from who is how likely where.
With swap or block they are not independent: a pair is evaluated as one joint chain, exactly,
and a larger team by trials.
"""

import itertools
import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from sparse_coord_ros.base.errors import SettingError
from sparse_coord_ros.base.percents import percent
from sparse_coord_ros.core.game.actions import PRIMITIVES
from sparse_coord_ros.core.game.interactions import (
    NOWHERE,
    interactions_of,
    miscoordinates,
    miscoordinations,
    only_together,
    settled,
)
from sparse_coord_ros.core.game.scenario import Robot, Scenario, ScenarioLike, loaded
from sparse_coord_ros.core.runs.measures import HEADINGS, MEASURES
from sparse_coord_ros.core.solve.exact import MOST_ROBOTS, Greedy, evaluate_greedy
from sparse_coord_ros.core.solve.optimum import independent_bound

NEGLIGIBLE_PROBABILITY = 1e-16
"""Probability (discounted, where the horizon is over) of what is left out at the end."""

TRIALS = 10_000
"""Trials of a team that swaps or blocks and is too large for the joint chain; all draws are
those of one seed."""


@dataclass(frozen=True)
class Reference:
    """Expected measures of a team on fixed shortest paths from the scenario's starts.

    Attributes:
        returns: total discounted reward, averaged over the robots: the goal paid from arrival on
            for ever, and a penalty for each miscoordination until all have arrived. Unlike trials,
            it knows no horizon; but with swap or block it does.
        time_to_goal: steps until arrival, averaged over the robots; without horizon too. With
            swap or block: the horizon for a robot that does not arrive.
        miscoordinations: steps of a trial that end in a miscoordination, within the horizon.
        all_arrived: probability that all robots arrive within the horizon.
        trials: how many trials it is the mean of; 0: it is exact.
        returns_error: standard error of the return; 0 where it is exact.
        time_to_goal_error: likewise.
        miscoordinations_error: likewise.
    """

    returns: float
    time_to_goal: float
    miscoordinations: float
    all_arrived: float = 1.0
    trials: int = 0
    returns_error: float = 0.0
    time_to_goal_error: float = 0.0
    miscoordinations_error: float = 0.0

    @property
    def exact(self) -> bool:
        """True if it is exact: no trials were played."""
        return self.trials == 0

    def measure_in_words(self, name: str) -> str:
        """Return a measure by its name, with its standard error if it is of trials."""
        value = f"{getattr(self, name):.2f}"
        if self.exact:
            return value
        return f"{value} ({getattr(self, f'{name}_error'):.2f})"

    def cells(self) -> dict[str, str]:
        """Return the cells of a table's row, as `Measures.cells`."""
        cells = {HEADINGS[name]: "0.00" for name in MEASURES}
        for name in ("returns", "time_to_goal", "miscoordinations"):
            cells[HEADINGS[name]] = self.measure_in_words(name)
        cells[HEADINGS["arrived"]] = percent(self.all_arrived)
        return cells | {"source": "exact" if self.exact else f"{self.trials} trials"}

    def in_words(self) -> str:
        """Return return and miscoordinations, with their errors, and the failures."""
        returns = self.measure_in_words("returns")
        missed = self.measure_in_words("miscoordinations")
        text = f"{returns}, {missed} miscoordinations"
        arrive = percent(self.all_arrived)
        if arrive != percent(1.0):
            text += f", all arrive in {arrive}"
        return text


def shortest_path_reference(scenario: ScenarioLike) -> Reference:
    """Return the value of fixed shortest paths, with no coordination (paper, Section 4).

    It is what Indiv. tends to. Of equally short ways each move is equally likely at every cell, as
    greedy agents choose between equal values. `returns` (total discounted) and `time_to_goal`
    (steps) are means over the robots, `miscoordinations` is that of a trial. It is exact
    (`exact`), but for more than two robots that swap or block it is the mean of 10,000 trials,
    with standard errors.

    Args:
        scenario: the problem.
    """
    scenario = loaded(scenario)
    moves = [_shortest(scenario, robot) for robot in scenario.robots]
    if only_together(interactions_of(scenario)):
        return _independent(scenario, moves)
    if len(scenario.robots) > MOST_ROBOTS:
        return _played(scenario, moves)
    try:
        return _joint(scenario, moves)
    except SettingError:  # too many joint states
        return _played(scenario, moves)


def _joint(scenario: Scenario, moves: Sequence[np.ndarray]) -> Reference:
    """Return the value of one or two robots, by their joint chain."""
    cells = len(scenario.map.cells)
    never = np.zeros(cells)
    blind = np.zeros((cells, PRIMITIVES))
    robots = [
        Greedy(never, _equal_shares(own, 1.0), blind, coord=None) for own in moves
    ]
    found = evaluate_greedy(scenario, robots)
    return Reference(
        returns=found.mean("returns"),
        time_to_goal=found.mean("time_to_goal"),
        miscoordinations=found.mean("miscoordinations"),
        all_arrived=found.mean("arrived"),
    )


def _played(scenario: Scenario, moves: Sequence[np.ndarray]) -> Reference:
    """Return the value of a team by trials, all played at once."""
    rng = np.random.default_rng(0)
    robots = scenario.robots
    team = len(robots)
    inter = interactions_of(scenario)
    lead = scenario.map.next_cell
    goals = np.array([robot.goal for robot in robots])[:, None]
    cells = np.tile([[robot.start] for robot in robots], (1, TRIALS))
    chances = [_equal_shares(own, 1.0).cumsum(axis=1) for own in moves]
    toll = float(np.mean(scenario.penalties))
    returns = np.zeros(TRIALS)
    times = np.zeros(TRIALS)
    conflicts = np.zeros(TRIALS)
    for t in range(scenario.horizon):
        under_way = cells != goals
        running = under_way.any(axis=0)
        if not running.any():
            break
        wanted = cells.copy()
        for k in range(team):
            draws = rng.random((2, TRIALS))
            passed = draws[0] >= chances[k][cells[k]].T
            move = np.minimum(passed.sum(axis=0), PRIMITIVES - 1)
            moves_on = under_way[k] & (draws[1] < scenario.move_success)
            wanted[k] = np.where(moves_on, lead[cells[k], move], cells[k])
        ends = settled(inter, cells, wanted)
        conflict = running & miscoordinations(inter, cells, ends)
        arrivals = (under_way & (ends == goals)).sum(axis=0)
        returns += scenario.discount**t * (
            conflict * toll + arrivals * scenario.arrival_value / team
        )
        times += under_way.mean(axis=0)
        conflicts += conflict
        cells = ends
    measures = [returns, times, conflicts]
    errors = [float(own.std(ddof=1)) / math.sqrt(TRIALS) for own in measures]
    return Reference(
        returns=float(returns.mean()),
        time_to_goal=float(times.mean()),
        miscoordinations=float(conflicts.mean()),
        all_arrived=float((cells == goals).all(axis=0).mean()),
        trials=TRIALS,
        returns_error=errors[0],
        time_to_goal_error=errors[1],
        miscoordinations_error=errors[2],
    )


def _independent(scenario: Scenario, moves: Sequence[np.ndarray]) -> Reference:
    """Return the value of robots whose only interaction is to be together."""
    conflict, all_arrived = _miscoordination_probability(scenario, moves)
    discounted = conflict @ scenario.discount ** np.arange(len(conflict))
    distances = [
        scenario.map.distances_to(robot.goal)[robot.start] for robot in scenario.robots
    ]
    return Reference(
        returns=independent_bound(scenario)
        + float(np.mean(scenario.penalties) * discounted),
        time_to_goal=float(np.mean(distances)) / scenario.move_success,
        miscoordinations=float(conflict[: scenario.horizon].sum()),
        all_arrived=all_arrived,
    )


def _miscoordination_probability(
    scenario: Scenario, moves: Sequence[np.ndarray]
) -> tuple[np.ndarray, float]:
    """Return probabilities of robots that can only be together.

    Returns:
        That step 1, 2, ... is made and ends in a miscoordination, shape (steps,); and that all
        arrive within the horizon.
    """
    robots = scenario.robots
    inter = interactions_of(scenario)
    places = inter.places
    meeting = [
        np.flatnonzero(places == one) for one in np.unique(places[places != NOWHERE])
    ]
    goals = np.array([robot.goal for robot in robots])
    numbers = np.arange(len(robots))
    places_in_time = _places_in_time(scenario, moves)
    place = next(places_in_time)
    in_doorway: list[list[np.ndarray]] = []
    all_arrived: list[float] = []
    moving = np.ones(place.shape, dtype=bool)
    moving[numbers, goals] = False
    while True:
        steps = len(in_doorway)
        rest = float(place[moving].sum())
        if steps >= scenario.horizon:
            rest *= scenario.discount**steps / (1.0 - scenario.discount)
        if rest <= NEGLIGIBLE_PROBABILITY:
            break
        all_arrived.append(place[numbers, goals].prod())
        place = next(places_in_time)
        in_doorway.append([place[:, cells].sum(axis=1) for cells in meeting])
    occupied = np.array(in_doorway).reshape(len(in_doorway), len(meeting), len(robots))
    # Robots that have all arrived, in one doorway, end the trial: those steps are not made.
    crowded_at_home = float(miscoordinates(inter, goals, goals))
    apart = _one_each(occupied.T)
    likely = np.maximum(1.0 - apart - crowded_at_home * np.array(all_arrived), 0.0)
    in_time = all_arrived[scenario.horizon : scenario.horizon + 1]
    return likely, float(in_time[0]) if in_time else 1.0


def _places_in_time(
    scenario: Scenario, moves: Sequence[np.ndarray]
) -> Iterator[np.ndarray]:
    """Yield the probability of robot k in cell x [k, x], at the start and after each step.

    It does not end. Robots are not in each other's way.
    """
    shares = [_shares(scenario, own) for own in moves]
    cells = len(scenario.map.cells)
    stay = np.arange(cells)[:, None]
    leads = np.concatenate([scenario.map.next_cell, stay], axis=1).ravel()
    place = np.zeros((len(moves), cells))
    starts = [robot.start for robot in scenario.robots]
    place[np.arange(len(moves)), starts] = 1.0
    while True:
        yield place
        moved = zip(place, shares, strict=True)
        place = np.stack(
            [np.bincount(leads, (p[:, None] * s).ravel(), cells) for p, s in moved]
        )


def expected_meetings(scenario: Scenario) -> np.ndarray:
    """Return how many pairs of robots on shortest paths end a step in a cell, by cell [x].

    Steps are discounted, and end at the horizon. Equally short ways are equally likely. Robots are
    not in each other's way, and none counts at its own goal.
    """
    moves = [_shortest(scenario, robot) for robot in scenario.robots]
    goals = [robot.goal for robot in scenario.robots]
    found = np.zeros(len(scenario.map.cells))
    places_in_time = itertools.islice(
        _places_in_time(scenario, moves), scenario.horizon
    )
    for t, place in enumerate(places_in_time):
        under_way = place.copy()
        under_way[np.arange(len(goals)), goals] = 0.0
        pairs = (under_way.sum(axis=0) ** 2 - (under_way**2).sum(axis=0)) / 2
        found += scenario.discount**t * pairs
    return found


def _one_each(occupied: np.ndarray) -> np.ndarray:
    """Return the probability that no place holds two robots, which are independent.

    Args:
        occupied: probability that a robot is in a place, shape (robots, places, steps).

    Returns:
        Shape (steps,).
    """
    # For each set of robots (bits): the probability that just they are in the places looked at
    # so far, each in one of its own, as to those robots alone.
    placed = {0: np.ones(occupied.shape[2])}
    for place in range(occupied.shape[1]):
        visitors = [k for k in range(len(occupied)) if occupied[k, place].any()]
        for members, probability in list(placed.items()):
            for k in visitors:
                if not members >> k & 1:
                    more = members | 1 << k
                    placed[more] = (
                        placed.get(more, 0.0) + probability * occupied[k, place]
                    )
    outside = 1.0 - occupied.sum(axis=1)
    total = np.zeros(occupied.shape[2])
    for members, probability in placed.items():
        others = [k for k in range(len(occupied)) if not members >> k & 1]
        total += probability * outside[others].prod(axis=0)
    return total


def _shares(scenario: Scenario, moves: np.ndarray) -> np.ndarray:
    """Shape (cells, 5): probability of each move from a cell, and to stay; the goal absorbs."""
    shares = np.zeros((len(moves), PRIMITIVES + 1))
    shares[:, :PRIMITIVES] = _equal_shares(moves, scenario.move_success)
    shares[:, PRIMITIVES] = np.where(
        moves.any(axis=1), 1.0 - scenario.move_success, 1.0
    )
    return shares


def _equal_shares(moves: np.ndarray, whole: float) -> np.ndarray:
    """Return a number shared equally by the moves of each cell that are chosen; same shape."""
    count = np.maximum(1, moves.sum(axis=1, keepdims=True))
    return np.where(moves, whole / count, 0.0)


def _shortest(scenario: Scenario, robot: Robot) -> np.ndarray:
    """Shape (cells, 4): the moves that a robot chooses from; at its goal none."""
    grid = scenario.map
    distance = grid.distances_to(robot.goal)
    chosen = np.zeros((len(distance), PRIMITIVES), dtype=bool)
    for x in np.flatnonzero(distance > 0):
        moves = [
            a for a, y in enumerate(grid.next_cell[x]) if distance[y] == distance[x] - 1
        ]
        chosen[x, moves] = True
    return chosen
