# Copyright 2026 The sparse_coord_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Choose the benchmark's unseen buildings: config/unseen.json.

python studies/unseen.py [--kinds KIND...] [--config FOLDER]

Of each kind and team, seeds are looked at from 0 on, and the first with a real conflict are
taken: what a planner with full sight is worth is above shortest paths by more than `CONFLICT`.
`--kinds` chooses anew for some of `unseen1-door-4r` and so on, `--config` writes into a copy of
the file in another folder. `studies/shipped.py unseen` then searches for the asking teams.

Of two robots the planner is the joint optimum. More robots are too many for it: they plan routes
and an order, and look one step ahead. In each step robots choose one after the other: those in a
doorway first, then by their order. Each takes the move with the largest value of a robot alone on
its route, less the team's expected loss by miscoordinations with the others. A route is a set of
doorways that the robot avoids. A local search finds order and routes, by trials with the same
draws, and whether doorways side by side are for one robot at a time. A team with full sight can
reach the result; it is not a bound.
"""

import argparse
import functools
import json
from collections.abc import Callable, Collection, Iterator, Sequence
from itertools import count, product
from pathlib import Path
from typing import NamedTuple

import numpy as np
from script import run_script

import sparse_coord_ros as sc
from sparse_coord_ros.base.compiling import has_numba, jit, jitable
from sparse_coord_ros.core.game.actions import PRIMITIVES
from sparse_coord_ros.core.game.grid import moves_to
from sparse_coord_ros.core.game.interactions import (
    NOWHERE,
    Interactions,
    interactions_of,
    miscoordinates,
)
from sparse_coord_ros.core.game.unseen import KINDS, SPLITS, TEAMS, VERSIONS, split_of
from sparse_coord_ros.core.solve.shipped import game_digest

CONFIG = Path(__file__).parents[1] / "config"

COUNTS = {2: 4, 4: 2, 8: 1}
TEST_COUNTS = {2: 6, 4: 4, 8: 2}
"""Buildings of each kind, by robots: for tuning and validation each, and for the test."""

CONFLICT = 1.0

RESTARTS = 4
"""How often the search begins anew; first with shortest paths for all."""

SEARCHED = 400
"""Trials by which the search judges a plan, all with the same draws."""

JUDGED = 10_000
"""Other trials, by which the best plan is judged."""

LEAST_GAIN = 0.01
"""A change is kept that is better by more."""


class TeamPlan(NamedTuple):
    """What the search changes.

    Attributes:
        order: numbers of the robots (from 0), first the one that chooses first.
        avoided: of each robot, the doorways that it keeps out of.
        one_at_a_time: whether doorways side by side are taken for one.
    """

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
        interactions: those of the scenario.
        claims: places for one robot at a time, in the form of their `places`.
        starts, goals: of each robot; (robots,).
        after: value of a robot alone on its route at the end of a step; (robots, cells).
        order: as of `TeamPlan`; (robots,).
        toll: sum of r^C over the robots.
        prize: value of an arrival, for ever.
        discount: gamma.
        success: probability that a move succeeds.
    """

    lead: np.ndarray
    interactions: Interactions
    claims: np.ndarray
    starts: np.ndarray
    goals: np.ndarray
    after: np.ndarray
    order: np.ndarray
    toll: float
    prize: float
    discount: float
    success: float


def planned(scenario, options) -> float:
    """Search for order and routes; return the mean return of other trials, a robot's."""
    team = len(scenario.robots)
    doorways = sorted(scenario.map.doorways)
    found: list[tuple[float, TeamPlan]] = []
    for restart in range(RESTARTS):
        rng = np.random.default_rng([0, restart])
        draws = rng.random((options.searched, scenario.horizon, team))
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
    rng = np.random.default_rng([0, RESTARTS])
    fresh = rng.random((options.judged, scenario.horizon, team))
    return float(returns_of(scenario, ways, fresh).mean())


def returns_of(scenario, ways: TeamPlan, draws: np.ndarray) -> np.ndarray:
    """Play trials of a plan; return the team's mean return in each.

    Args:
        scenario: the problem.
        ways: the plan.
        draws: random numbers in [0, 1); (trials, steps, robots).
    """
    grid = scenario.map
    inter = interactions_of(scenario)
    routed = Routed(
        lead=np.ascontiguousarray(grid.next_cell, dtype=np.int64),
        interactions=inter,
        claims=passages(scenario) if ways.one_at_a_time else inter.places,
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


def alone(scenario, avoided: Sequence[Collection[int]]) -> np.ndarray:
    """Return the values of robots alone after a step to each cell: (robots, cells).

    Args:
        scenario: the problem.
        avoided: of each robot, the cells that it keeps out of.
    """
    lead = scenario.map.next_cell
    far = []
    for robot, closed in zip(scenario.robots, avoided, strict=True):
        # A move into a closed cell leads nowhere.
        kept = np.where(
            np.isin(lead, list(closed)), np.arange(len(lead))[:, None], lead
        )
        far.append(moves_to(kept, robot.goal))
    moves = np.array(far)
    gamma = scenario.discount
    p = scenario.move_success
    # The moves take a negative binomial time.
    value = scenario.arrival_value * gamma ** np.maximum(moves, 0)
    value = value * (p / (1.0 - gamma * (1.0 - p))) ** moves
    return np.where(moves < 0, 0.0, value)


def passages(scenario) -> np.ndarray:
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


@jitable
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


@jitable
def in_turn(routed: Routed, cells: np.ndarray, sequence: np.ndarray) -> None:
    """Write in which order the robots choose: those in a doorway first."""
    count = 0
    for inside in (True, False):
        for k in routed.order:
            if (routed.interactions.places[cells[k]] != NOWHERE) == inside:
                sequence[count] = k
                count += 1


@jitable
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
            if miscoordinates(routed.interactions, cells, cells):
                total += factor * routed.toll
            factor *= routed.discount
        returns[trial] = total / team


@functools.cache
def compiled() -> Callable[..., None]:
    """Return the loop compiled by numba, or as plain Python where it is not installed."""
    return jit([play])[0] if has_numba() else play


def chosen(version: str, kind: str, robots: int, options):
    """Yield the buildings of a kind with their reference values, in the order of their seeds."""
    counts = dict.fromkeys(SPLITS[:2], COUNTS[robots])
    if version == VERSIONS[1]:
        counts = {SPLITS[2]: TEST_COUNTS[robots]}
    for seed in count():
        if not any(counts.values()):
            return
        name = f"{version}-{kind}-{robots}r-{seed}"
        if not counts.get(split_of(name)):
            continue
        scenario = sc.load_scenario(name)
        paths = sc.shortest_paths(scenario).mean("returns")
        optimum = sc.optimum(scenario)
        facts: dict[str, object] = {"shortest_paths": paths}
        if optimum.exact:
            facts["optimum"] = optimum.value
        best = optimum.value if robots == 2 else planned(scenario, options)
        if best > paths + CONFLICT:
            counts[split_of(name)] -= 1
            yield name, {"game": game_digest(scenario), **facts}


def main() -> None:
    """Choose, print, and write."""
    parser = argparse.ArgumentParser(
        description=__doc__.split("\n")[0],
        formatter_class=argparse.ArgumentDefaultsHelpFormatter,
    )
    parser.add_argument("--kinds", nargs="+", default=[])
    parser.add_argument("--searched", type=int, default=SEARCHED, help="trials")
    parser.add_argument("--judged", type=int, default=JUDGED, help="trials")
    parser.add_argument("--config", type=Path, default=CONFIG)
    options = parser.parse_args()
    file = options.config / "unseen.json"
    said = json.loads(file.read_text("utf-8"))
    buildings = said["buildings"] if options.kinds else {}
    for version, robots, kind in product(VERSIONS, TEAMS, KINDS):
        if options.kinds and f"{version}-{kind}-{robots}r" not in options.kinds:
            continue
        for name, facts in chosen(version, kind, robots, options):
            print(name, facts, flush=True)
            buildings[name] = facts
    lines = [
        f"  {json.dumps(name)}: {json.dumps(one)}" for name, one in buildings.items()
    ]
    head = f'{{"format": {said["format"]},\n "about": {json.dumps(said["about"])},\n'
    text = ",\n".join(lines)
    file.write_text(f'{head} "buildings": {{\n{text}\n }}}}\n', "utf-8")


if __name__ == "__main__":
    run_script(main)
