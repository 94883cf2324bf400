# Copyright 2026 The sparse_coord_ros authors
# SPDX-License-Identifier: Apache-2.0
"""A planner for teams too large for exact planning: routes, an order, and one step looked ahead.

It sees all robots at all times, for free. In each step robots choose one after the other: those in
a doorway first, then by their order. Each takes the move with the largest value of a robot alone
on its route, less the team's expected loss by miscoordinations with the others. A route is a set
of doorways that the robot avoids. A local search finds order and routes, by trials with the same
draws, and whether doorways side by side are for one robot at a time. A team with full sight can
reach the result; it is not a bound.
"""

import functools
from collections.abc import Callable, Collection, Iterator, Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from sparse_coord_ros.base.compiling import has_numba, inner, jit
from sparse_coord_ros.core.game.actions import PRIMITIVES
from sparse_coord_ros.core.game.grid import moves_to
from sparse_coord_ros.core.game.interactions import (
    NOWHERE,
    check_only_together,
    interactions_of,
    meet,
)
from sparse_coord_ros.core.game.scenario import Scenario
from sparse_coord_ros.core.solve.optimum import value_alone

SEARCHED = 400
"""Trials by which the search judges a plan, all with the same draws."""

JUDGED = 10_000
"""Other trials, by which the best plan is judged."""

TRIALS_AT_ONCE = 1000
"""Trials played at once: their draws are held in memory."""

LEAST_GAIN = 0.01
"""A change is kept that is better by more."""


@dataclass(frozen=True)
class RoutePlan:
    """The planner's result for a team.

    Attributes:
        value: total discounted reward from the scenario's starts, averaged over the robots.
        standard_error: of the trials.
        order: numbers of the robots (from 0), first the one that chooses first.
        avoided: of each robot, the doorways that it keeps out of: cell numbers, ascending.
        one_at_a_time: whether doorways side by side are taken for one.
    """

    value: float
    standard_error: float
    order: tuple[int, ...]
    avoided: tuple[tuple[int, ...], ...]
    one_at_a_time: bool


class TeamPlan(NamedTuple):
    """The part of a plan that the search changes; attributes as of `RoutePlan`."""

    order: tuple[int, ...]
    avoided: tuple[frozenset[int], ...]
    one_at_a_time: bool = False

    def changes(self, doorways: Sequence[int]) -> Iterator["TeamPlan"]:
        """Yield the plans with one change: two places in the order, one doorway of one robot."""
        yield self._replace(one_at_a_time=not self.one_at_a_time)
        for j, own in enumerate(self.order):
            for i, other in enumerate(self.order[:j]):
                order = list(self.order)
                order[i] = own
                order[j] = other
                yield self._replace(order=tuple(order))
        for k, kept in enumerate(self.avoided):
            for doorway in doorways:
                avoided = list(self.avoided)
                avoided[k] = kept ^ {doorway}
                yield self._replace(avoided=tuple(avoided))


class Routed(NamedTuple):
    """A scenario and a plan as arrays.

    Attributes:
        lead: where a successful move leads; (cells, moves).
        places: the meeting place of each cell, or `NOWHERE`; (cells,).
        claims: places for one robot at a time, in the form of `places`.
        starts, goals: of each robot; (robots,).
        after: value of a robot alone on its route at the end of a step; (robots, cells).
        order: as of `RoutePlan`; (robots,).
        toll: sum of r^C over the robots.
        prize: value of an arrival, for ever.
        discount: gamma.
        success: probability that a move succeeds.
    """

    lead: np.ndarray
    places: np.ndarray
    claims: np.ndarray
    starts: np.ndarray
    goals: np.ndarray
    after: np.ndarray
    order: np.ndarray
    toll: float
    prize: float
    discount: float
    success: float


def route_plan(scenario: Scenario, *, restarts: int = 4, seed: int = 0) -> RoutePlan:
    """Search for order and routes; the first restart begins with shortest paths for all.

    Args:
        scenario: the problem.
        restarts: how often to begin anew, in a random order.
        seed: of every random draw.

    Raises:
        SettingError: robots swap or block, which the planner does not foresee.
    """
    check_only_together(
        scenario, "route planner", "the joint optimum knows all interactions"
    )
    team = len(scenario.robots)
    doorways = sorted(scenario.map.doorways)
    found: list[tuple[float, TeamPlan]] = []
    for restart in range(restarts):
        rng = np.random.default_rng([seed, restart])
        draws = rng.random((SEARCHED, scenario.horizon, team))
        order = rng.permutation(team).tolist() if restart else range(team)
        ways = TeamPlan(tuple(order), (frozenset(),) * team)
        best = float(returns_of(scenario, ways, draws).mean())
        better = True
        while better:
            better = False
            changed = list(ways.changes(doorways))
            for number in rng.permutation(len(changed)).tolist():
                value = float(returns_of(scenario, changed[number], draws).mean())
                if value > best + LEAST_GAIN:
                    best = value
                    ways = changed[number]
                    better = True
                    break
        found.append((best, ways))
    _, ways = max(found, key=lambda one: one[0])
    rng = np.random.default_rng([seed, restarts])
    fresh = (
        rng.random((TRIALS_AT_ONCE, scenario.horizon, team))
        for _ in range(JUDGED // TRIALS_AT_ONCE)
    )
    means = np.concatenate([returns_of(scenario, ways, draws) for draws in fresh])
    return RoutePlan(
        value=float(means.mean()),
        standard_error=float(means.std(ddof=1) / len(means) ** 0.5),
        order=ways.order,
        avoided=tuple(tuple(sorted(one)) for one in ways.avoided),
        one_at_a_time=ways.one_at_a_time,
    )


def returns_of(scenario: Scenario, ways: TeamPlan, draws: np.ndarray) -> np.ndarray:
    """Play trials of a plan; return the team's mean return in each.

    Args:
        scenario: the problem.
        ways: the plan.
        draws: random numbers in [0, 1); (trials, steps, robots).
    """
    grid = scenario.map
    places = interactions_of(scenario).places
    routed = Routed(
        lead=np.ascontiguousarray(grid.next_cell, dtype=np.int64),
        places=places,
        claims=passages(scenario) if ways.one_at_a_time else places,
        starts=np.array([robot.start for robot in scenario.robots]),
        goals=np.array([robot.goal for robot in scenario.robots]),
        after=alone(scenario, ways.avoided),
        order=np.array(ways.order),
        toll=float(sum(scenario.penalties)),
        prize=scenario.arrival_value,
        discount=float(scenario.discount),
        success=float(scenario.move_success),
    )
    returns = np.zeros(len(draws))
    compiled()(routed, draws, np.zeros((3, len(ways.order)), dtype=np.int64), returns)
    return returns


def alone(scenario: Scenario, avoided: Sequence[Collection[int]]) -> np.ndarray:
    """Return the values of robots alone after a step to each cell: (robots, cells).

    Args:
        scenario: the problem.
        avoided: of each robot, the cells that it keeps out of.
    """
    goals = [robot.goal for robot in scenario.robots]
    far = [
        moves_to(scenario.map.next_cell, *one)
        for one in zip(goals, avoided, strict=True)
    ]
    return value_alone(scenario, np.array(far), moved=True)


def passages(scenario: Scenario) -> np.ndarray:
    """Return the passage of each cell, its least doorway, or `NOWHERE`; shape (cells,), int64."""
    found: np.ndarray = interactions_of(scenario).places
    lead = scenario.map.next_cell
    doorways = sorted(scenario.map.doorways)
    for _ in doorways:  # no passage is longer
        for x in doorways:
            beside = [int(y) for y in lead[x] if y in scenario.map.doorways]
            found[x] = min(int(found[y]) for y in [x, *beside])
    return found


# The loop, compiled where numba is installed.


@inner
def meeting(x: int, y: int, p: float, here: int, there: int, q: float) -> float:
    """Return the probability that two robots end a step at one place.

    Args:
        x: the place of the one.
        y: the place that it goes to; each may be `NOWHERE`.
        p: probability that it gets there.
        here: as `x`, of the other.
        there: as `y`.
        q: as `p`.
    """
    found = 0.0
    if x != NOWHERE:
        found += (1.0 - p) * ((1.0 - q) * (x == here) + q * (x == there))
    if y != NOWHERE:
        found += p * ((1.0 - q) * (y == here) + q * (y == there))
    return found


@inner
def in_turn(routed: Routed, cells: np.ndarray, sequence: np.ndarray) -> None:
    """Write in which order the robots choose: those in a doorway first."""
    count = 0
    for inside in (True, False):
        for k in routed.order:
            if (routed.places[cells[k]] != NOWHERE) == inside:
                sequence[count] = k
                count += 1


@inner
def choose(routed: Routed, space: np.ndarray, place: int) -> None:
    """Write where a robot goes.

    Args:
        routed: the scenario and the plan.
        space: as of `play`.
        place: which robot, by its place in the sequence.
    """
    cells, chosen, sequence = space
    claims = routed.claims
    k = sequence[place]
    x = cells[k]
    chosen[k] = x
    best = -np.inf
    if x == routed.goals[k]:
        return
    for b in range(PRIMITIVES):
        y = routed.lead[x, b]
        p = routed.success if y != x else 1.0
        value = p * routed.after[k, y] + (1.0 - p) * routed.after[k, x]
        for other in range(len(cells)):
            # Who has not chosen yet is taken to leave, which fails at times.
            j = sequence[other]
            if j != k:
                there = claims[chosen[j]] if other < place else NOWHERE
                here = claims[cells[j]]
                meet = meeting(claims[x], claims[y], p, here, there, routed.success)
                value += meet * routed.toll
        if value > best:
            best = value
            chosen[k] = y


def play(
    routed: Routed, draws: np.ndarray, space: np.ndarray, returns: np.ndarray
) -> None:
    """Play trials.

    Args:
        routed: the scenario and the plan.
        draws: in [0, 1), one for each trial, step and robot.
        space: room for cells, chosen cells and the step's sequence; (3, robots), int64.
        returns: return of each trial, averaged over the robots; set.
    """
    cells, chosen, sequence = space
    team = len(cells)
    for trial in range(len(draws)):
        total = 0.0
        factor = 1.0
        for k in range(team):
            cells[k] = routed.starts[k]
        for step in range(draws.shape[1]):
            in_turn(routed, cells, sequence)
            for place in range(team):
                choose(routed, space, place)
            under_way = False
            for k in range(team):
                if cells[k] == routed.goals[k]:
                    continue
                under_way = True
                if draws[trial, step, k] < routed.success:
                    cells[k] = chosen[k]
                    if cells[k] == routed.goals[k]:
                        total += factor * routed.prize
            if not under_way:
                break
            if meet(routed.places, cells, routed.order):
                total += factor * routed.toll
            factor *= routed.discount
        returns[trial] = total / team


@functools.cache
def compiled() -> Callable[..., None]:
    """Return the loop compiled by numba, or as plain Python where it is not installed."""
    return jit([play])[0] if has_numba() else play
