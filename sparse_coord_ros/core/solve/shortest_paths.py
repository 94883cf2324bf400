# Copyright 2026 The sparse_coord_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The value of fixed shortest-path policies, to which `indiv` tends.

Each robot walks a shortest path to its goal and never minds the others (paper, Section 4). If
robots can only be together, they are independent Markov chains: each is carried forward on its
own, and at every time step the chance of a miscoordination follows from who is how likely where.
With swap or block they are not independent: a pair is evaluated as one joint chain, exactly,
and a larger team by trials; so is one of many robots among many doorways.
"""

import functools
import itertools
import math
from collections.abc import Iterator, Sequence

import numpy as np

from sparse_coord_ros.base.errors import SettingError
from sparse_coord_ros.core.game.actions import PRIMITIVES
from sparse_coord_ros.core.game.interactions import (
    NOWHERE,
    Interactions,
    interactions_of,
    miscoordinates,
    miscoordinations,
    only_together,
    settled,
)
from sparse_coord_ros.core.game.scenario import Robot, Scenario, ScenarioLike, loaded
from sparse_coord_ros.core.runs.measures import EXACT, TRIAL, TRIALS, Measures
from sparse_coord_ros.core.solve.exact import MOST_ROBOTS, Greedy, evaluate_greedy
from sparse_coord_ros.core.solve.optimum import value_alone

NEGLIGIBLE_PROBABILITY = 1e-16
"""Probability (discounted, where the horizon is over) of what is left out at the end."""

PLAYED = 10_000
"""Trials of a team that is too large for exact measures; all draws are those of one seed."""

MOST_SETS = 2**16
"""The most sets of robots, each in a doorway of its own, for exact measures of a team that can
only be together."""


def shortest_paths(scenario: ScenarioLike) -> Measures:
    """Return the measures of fixed shortest paths, with no coordination (paper, Section 4).

    It is what `indiv` tends to. Of equally short ways each move is equally likely at every cell,
    as greedy agents choose between equal values. They are exact, but for more than two robots
    that swap or block, and for many robots among many doorways, they are those of 10,000 trials.
    Robots that can only be together are independent: their returns and times to the goal know no
    horizon, unlike those of trials, and spreads are not known. Miscoordinations and arrivals are
    those within the horizon. They are kept: those of the same scenario are not computed again.

    Args:
        scenario: the problem.
    """
    return _measures_of(loaded(scenario))


@functools.lru_cache(maxsize=16)
def _measures_of(scenario: Scenario) -> Measures:
    moves = [_shortest(scenario, robot) for robot in scenario.robots]
    inter = interactions_of(scenario)
    if only_together(inter) and _sets_in_doorways(scenario, inter) <= MOST_SETS:
        return _independent(scenario, moves)
    if len(scenario.robots) > MOST_ROBOTS:
        return _played(scenario, moves)
    try:
        return _joint(scenario, moves)
    except SettingError:  # too many joint states
        return _played(scenario, moves)


def _sets_in_doorways(scenario: Scenario, inter: Interactions) -> int:
    """Return how many sets of robots can be in doorways, each in one of its own."""
    team = len(scenario.robots)
    doorways = len(np.unique(inter.places[inter.places != NOWHERE]))
    return sum(math.comb(team, inside) for inside in range(doorways + 1))


def _joint(scenario: Scenario, moves: Sequence[np.ndarray]) -> Measures:
    """Return the measures of one or two robots, by their joint chain."""
    cells = len(scenario.map.cells)
    never = np.zeros(cells)
    blind = np.zeros((cells, PRIMITIVES))
    robots = [
        Greedy(never, _equal_shares(robot_moves, 1.0), blind, coord=None)
        for robot_moves in moves
    ]
    return evaluate_greedy(scenario, robots)


def _played(scenario: Scenario, moves: Sequence[np.ndarray]) -> Measures:
    """Return the measures of a team by trials, all played at once."""
    rng = np.random.default_rng(0)
    robots = scenario.robots
    team = len(robots)
    inter = interactions_of(scenario)
    lead = scenario.map.next_cell
    goals = np.array([robot.goal for robot in robots])[:, None]
    cells = np.tile([[robot.start] for robot in robots], (1, PLAYED))
    chances = [_equal_shares(robot_moves, 1.0).cumsum(axis=1) for robot_moves in moves]
    tolls = np.array(scenario.penalties)[:, None]
    returns = np.zeros((team, PLAYED))
    times = np.zeros((team, PLAYED))
    conflicts = np.zeros(PLAYED)
    stays = np.zeros((team, len(lead)))
    for t in range(scenario.horizon):
        under_way = cells != goals
        running = under_way.any(axis=0)
        if not running.any():
            break
        wanted = cells.copy()
        for k in range(team):
            draws = rng.random((2, PLAYED))
            passed = draws[0] >= chances[k][cells[k]].T
            move = np.minimum(passed.sum(axis=0), PRIMITIVES - 1)
            moves_on = under_way[k] & (draws[1] < scenario.move_success)
            wanted[k] = np.where(moves_on, lead[cells[k], move], cells[k])
            stays[k] += np.bincount(cells[k][under_way[k]], minlength=len(lead))
        ends = settled(inter, cells, wanted)
        conflict = running & miscoordinations(inter, cells, ends)
        arrives = under_way & (ends == goals)
        paid = conflict * tolls + arrives * scenario.arrival_value
        returns += scenario.discount**t * paid
        times += under_way
        conflicts += conflict
        cells = ends
    return Measures(
        source=TRIALS,
        unit=TRIAL,
        trials=PLAYED,
        returns=returns.T,
        time_to_goal=times.T,
        miscoordinations=conflicts,
        asks=np.zeros((PLAYED, team)),
        arrived=(cells == goals).all(axis=0),
        asked=np.zeros(stays.shape),
        stays=stays / PLAYED,
    )


def _independent(scenario: Scenario, moves: Sequence[np.ndarray]) -> Measures:
    """Return the measures of robots whose only interaction is to be together."""
    conflict, arrived, stays = _met(scenario, moves)
    discounted = conflict @ scenario.discount ** np.arange(len(conflict))
    far = np.array(
        [
            scenario.map.distances_to(robot.goal)[robot.start]
            for robot in scenario.robots
        ]
    )
    returns = value_alone(scenario, far) + np.array(scenario.penalties) * discounted
    return Measures(
        source=EXACT,
        unit=TRIAL,
        trials=0,
        returns=returns[None],
        time_to_goal=far[None] / scenario.move_success,
        miscoordinations=conflict[None, : scenario.horizon].sum(axis=1),
        asks=np.zeros((1, len(far))),
        arrived=np.array([arrived]),
        asked=np.zeros(stays.shape),
        stays=stays,
    )


def _met(
    scenario: Scenario, moves: Sequence[np.ndarray]
) -> tuple[np.ndarray, float, np.ndarray]:
    """Return how robots meet that can only be together.

    Returns:
        The probability that step 1, 2, ... is made and ends in a miscoordination, shape (steps,);
        the probability that all arrive within the horizon; and the expected steps of each robot in
        each cell, within the horizon, shape (robots, cells).
    """
    robots = scenario.robots
    inter = interactions_of(scenario)
    places = inter.places
    meeting = [
        np.flatnonzero(places == number)
        for number in np.unique(places[places != NOWHERE])
    ]
    goals = np.array([robot.goal for robot in robots])
    numbers = np.arange(len(robots))
    places_in_time = _places_in_time(scenario, moves)
    occupancy = next(places_in_time)
    in_doorway: list[list[np.ndarray]] = []
    all_arrived: list[float] = []
    moving = np.ones(occupancy.shape, dtype=bool)
    moving[numbers, goals] = False
    stays = np.zeros(occupancy.shape)
    while True:
        steps = len(in_doorway)
        rest = float(occupancy[moving].sum())
        if steps < scenario.horizon:
            stays[moving] += occupancy[moving]
        else:
            rest *= scenario.discount**steps / (1.0 - scenario.discount)
        if rest <= NEGLIGIBLE_PROBABILITY:
            break
        all_arrived.append(occupancy[numbers, goals].prod())
        occupancy = next(places_in_time)
        in_doorway.append([occupancy[:, cells].sum(axis=1) for cells in meeting])
    occupied = np.array(in_doorway).reshape(len(in_doorway), len(meeting), len(robots))
    # Robots that have all arrived, in one doorway, end the trial: those steps are not made.
    crowded_at_home = float(miscoordinates(inter, goals, goals))
    apart = _one_each(occupied.T)
    likely = np.maximum(1.0 - apart - crowded_at_home * np.array(all_arrived), 0.0)
    in_time = all_arrived[scenario.horizon : scenario.horizon + 1]
    return likely, float(in_time[0]) if in_time else 1.0, stays


def _places_in_time(
    scenario: Scenario, moves: Sequence[np.ndarray]
) -> Iterator[np.ndarray]:
    """Yield the probability of robot k in cell x [k, x], at the start and after each step.

    It does not end. Robots are not in each other's way.
    """
    shares = [_shares(scenario, robot_moves) for robot_moves in moves]
    cells = len(scenario.map.cells)
    stay = np.arange(cells)[:, None]
    leads = np.concatenate([scenario.map.next_cell, stay], axis=1).ravel()
    occupancy = np.zeros((len(moves), cells))
    starts = [robot.start for robot in scenario.robots]
    occupancy[np.arange(len(moves)), starts] = 1.0
    while True:
        yield occupancy
        moved = zip(occupancy, shares, strict=True)
        occupancy = np.stack(
            [np.bincount(leads, (p[:, None] * s).ravel(), cells) for p, s in moved]
        )


def expected_meetings(scenario: Scenario) -> np.ndarray:
    """Return how many pairs of robots on shortest paths end a step in a cell, by cell [x].

    Steps are discounted, and end at the horizon. Equally short ways are equally likely. Robots are
    not in each other's way, and none counts at its own goal.
    """
    moves = [_shortest(scenario, robot) for robot in scenario.robots]
    goals = [robot.goal for robot in scenario.robots]
    meetings = np.zeros(len(scenario.map.cells))
    places_in_time = itertools.islice(
        _places_in_time(scenario, moves), scenario.horizon
    )
    for t, occupancy in enumerate(places_in_time):
        under_way = occupancy.copy()
        under_way[np.arange(len(goals)), goals] = 0.0
        pairs = (under_way.sum(axis=0) ** 2 - (under_way**2).sum(axis=0)) / 2
        meetings += scenario.discount**t * pairs
    return meetings


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
