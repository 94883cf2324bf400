# Copyright 2026 The sparse_coord_ros authors
# SPDX-License-Identifier: Apache-2.0
"""An upper bound for teams too large to solve: groups of robots, each at its joint optimum.

python studies/group_bound.py SCENARIO... [--penalty P] [--size N] [--write]

It prints the bound of each scenario; `--write` puts it into config/bounds.json, where the lists
of `benchmark` find the ends of the gaps of larger teams. A group of four takes seconds to
minutes.

Let the team be split into groups, and let V(S) be the joint optimum of group S in the same
scenario without the other robots, as the sum over its robots. The value of every policy of the
whole team is at most the sum of all V(S), for three reasons.

1. Two robots of one group that meet are two robots of the team that meet, and r^C falls on each
   robot of the team. So in each step the team pays at least what its groups would pay that meet.
2. Arrivals are paid to each robot as in its group, and asking is never a gain.
3. Where the other robots are does not change where a move leads. So what the team's policy makes
   of group S, the other robots being draws of chance, is a policy of S, with value at most V(S).

Values are computed from above: they begin at the bound by pairs, and each backup leaves an
upper bound. So it remains a bound though only states are backed up to which the best known
policy leads (real-time dynamic programming; Barto, Bradtke & Singh, Artificial Intelligence
1995), and whenever that ends. It holds where robots can only be together.
"""

import argparse
import json
from dataclasses import replace
from itertools import combinations
from pathlib import Path

import numpy as np
from script import run_script

import sparse_coord_ros as sc
from sparse_coord_ros.base.errors import SettingError
from sparse_coord_ros.core.game.interactions import interactions_of, only_together
from sparse_coord_ros.core.game.specs import Spec
from sparse_coord_ros.core.solve.optimum import payment, successors, value_alone
from sparse_coord_ros.core.solve.shipped import game_digest

try:
    from numba import njit
except ImportError:  # hundreds of times slower

    def njit(function):
        """Return the function as it is."""
        return function


BOUNDS = Path(__file__).parents[1] / "config" / "bounds.json"

TOLERANCE = 1e-5
"""Where all values fall by less in a sweep, it is the last one."""

LEAST_FALL = 1e-3
"""Where the start's value falls by less in a block of trials, it is the last one."""

LARGEST_GROUP = 4
"""Robots of a group: of four robots there are up to 50 million joint states on 85 cells."""

TRIALS = 2000
"""Trials of a block."""

LONGEST = 200
"""Steps of a trial."""

MOVES = 4
ENDS = 5
"""Cells where a step of a robot can end: its own, if the move fails, or that of a move."""


def group_bound(scenario, size: int) -> float:
    """Return an upper bound by groups of at most so many robots, averaged over the robots."""
    if not only_together(interactions_of(scenario)):
        allowed = "together, together:anywhere or together:any_doorway"
        raise SettingError(
            f"bound by groups: setting interactions is {scenario.interactions!r}, allowed: "
            f"{allowed}, as it plans by the cells in which steps end; see the joint optimum"
        )
    groups = split(pair_losses(scenario), size)
    print(f"{scenario.name}: groups {groups}", flush=True)
    total = sum(len(group) * group_optimum(scenario, group) for group in groups)
    return total / len(scenario.robots)


def pair_losses(scenario) -> np.ndarray:
    """Return the loss of each pair against two lone robots, shape (robots, robots)."""
    team = range(len(scenario.robots))
    alone = [group_optimum(scenario, [k]) for k in team]
    losses = np.zeros((len(team), len(team)))
    for i, j in combinations(team, 2):
        loss = alone[i] + alone[j] - 2 * group_optimum(scenario, [i, j])
        losses[i, j] = loss
        losses[j, i] = loss
    return losses


def split(losses: np.ndarray, size: int) -> list[list[int]]:
    """Return robots in groups of at most so many, in which they lose much by each other.

    A group begins with the robot that loses most by those that are left, and takes the robot that
    adds most, again and again.
    """
    left = list(range(len(losses)))
    groups = []
    while left:
        group: list[int] = []
        while left and len(group) < size:
            others = group or left
            chosen = max(left, key=lambda k: losses[k, others].sum())
            group.append(chosen)
            left.remove(chosen)
        groups.append(sorted(group))
    return groups


def group_optimum(scenario, group: list[int]) -> float:
    """Return a bound, near to it, of the joint optimum of some of the robots without the others.

    It is the average over the group, from the scenario's starts.
    """
    alone = without_others(scenario, group)
    starts = tuple(robot.start for robot in alone.robots)
    if len(group) <= 2:
        return float(solved(alone)[starts])
    game = Game(alone)
    entering = alone.discount * by_pairs(alone).ravel() + game.paid
    random = np.random.default_rng(0)
    while True:
        before = entering[game.start]
        draws = random.random((TRIALS, LONGEST, len(group)))
        play(*game.arrays, game.start, game.end, entering, draws)
        if before - entering[game.start] < LEAST_FALL:
            break
    return float(entering[game.start] - game.paid[game.start]) / alone.discount


def solved(scenario) -> np.ndarray:
    """Return the optimum of one robot or two from all joint states, shape (cells,) * robots."""
    goals = [robot.goal for robot in scenario.robots]
    far = np.array([scenario.map.distances_to(goal) for goal in goals])
    lone = value_alone(scenario, far)
    lone[np.arange(len(goals)), goals] = scenario.arrival_value
    if len(lone) == 1:
        return lone[0]
    value = (lone[0][:, None] + lone[1][None, :]) / 2
    game = Game(scenario)
    entering = scenario.discount * value.ravel() + game.paid
    while sweep(*game.arrays, game.end, entering) > TOLERANCE:
        pass
    return ((entering - game.paid) / scenario.discount).reshape(value.shape)


def by_pairs(scenario) -> np.ndarray:
    """Return a bound of all joint states: the least that disjoint pairs give."""
    count = len(scenario.robots)
    cells = len(scenario.map.cells)
    bound = np.full((cells,) * count, np.inf)
    values = {}
    for size in (1, 2):
        for group in combinations(range(count), size):
            values[group] = solved(without_others(scenario, group))
    for pairing in pairings(tuple(range(count))):
        total = np.zeros((cells,) * count)
        for group in pairing:
            shape = [cells if k in group else 1 for k in range(count)]
            total += values[group].reshape(shape) * (len(group) / count)
        np.minimum(bound, total, out=bound)
    return bound


def pairings(robots: tuple[int, ...]):
    """Yield each way to split robots into pairs, and one alone if their number is odd."""
    if len(robots) <= 2:
        yield [robots]
        return
    first, *others = robots
    for other in others:
        rest = tuple(k for k in others if k != other)
        for pairing in pairings(rest):
            yield [(first, other), *pairing]
    if len(robots) % 2:
        for pairing in pairings(tuple(others)):
            yield [(first,), *pairing]


def without_others(scenario, group):
    """Return the scenario with some of its robots alone; each pays the r^C that it paid."""
    shares = scenario.common_reward
    if shares.kind == "each":
        shares = Spec("each", tuple(shares.numbers[k] for k in group))
    robots = tuple(scenario.robots[k] for k in group)
    return replace(scenario, robots=robots, common_reward=shares)


class Game:
    """The joint game of a group as arrays.

    Attributes:
        arrays: the cells where a step of a robot may end, first its own [robot][cell][end];
            strides of each robot's cell in the number of a joint state; the average reward of a
            step that ends in a joint state; gamma; the probability that a move succeeds.
        paid: that reward.
        start: the joint state in which trials begin.
        end: the one in which all have arrived.
    """

    def __init__(self, scenario) -> None:
        cells = len(scenario.map.cells)
        count = len(scenario.robots)
        ends = np.zeros((count, cells, ENDS), dtype=np.int64)
        ends[:, :, 0] = np.arange(cells)
        for k in range(count):
            ends[k, :, 1:] = successors(scenario, k).T
        strides = cells ** np.arange(count - 1, -1, -1)
        self.paid = payment(scenario).ravel()
        numbers = float(scenario.discount), float(scenario.move_success)
        self.arrays = ends, strides, self.paid, *numbers
        self.start = int(strides @ [robot.start for robot in scenario.robots])
        self.end = int(strides @ [robot.goal for robot in scenario.robots])


@njit
def backup(ends, strides, paid, discount, success, entering, state):
    """Return the value of a joint state by its best joint move, and the robots' moves.

    `entering` is the value of each joint state for a step that ends there: the reward, and what
    follows.
    """
    count = len(strides)
    # The joint states where the step may end, the last robot's cell changing first.
    after = np.zeros(1, dtype=np.int64)
    for k in range(count):
        cell = state // strides[k] % ends.shape[1]
        longer = np.empty(len(after) * ENDS, dtype=np.int64)
        for i in range(len(longer)):
            longer[i] = after[i // ENDS] + ends[k, cell, i % ENDS] * strides[k]
        after = longer
    # The last robot first, the values of its ends become the mean values of its moves.
    values = entering[after]
    inside = 1
    for _ in range(count):
        outside = len(values) // (ENDS * inside)
        old = values.reshape((outside, ENDS, inside))
        new = np.empty((outside, MOVES, inside))
        for move in range(MOVES):
            new[:, move] = success * old[:, move + 1] + (1.0 - success) * old[:, 0]
        values = new.reshape(-1)
        inside *= MOVES
    best = values.argmax()
    moves = np.zeros(count, dtype=np.int64)
    for k in range(count):
        moves[k] = best // MOVES ** (count - 1 - k) % MOVES
    return paid[state] + discount * values[best], moves


@njit
def sweep(ends, strides, paid, discount, success, end, entering):
    """Back up each joint state once, in place; return the largest change."""
    most = 0.0
    for state in range(len(entering)):
        if state != end:
            value, _ = backup(ends, strides, paid, discount, success, entering, state)
            most = max(most, entering[state] - value)
            entering[state] = value
    return most


@njit
def play(ends, strides, paid, discount, success, start, end, entering, draws):
    """Play trials by the best known policy; back up the joint states on the way, and back again.

    `draws` are in [0, 1): [trial][step][robot].
    """
    passed = np.zeros(draws.shape[1], dtype=np.int64)
    for trial in range(len(draws)):
        state = start
        steps = 0
        while state != end and steps < len(passed):
            passed[steps] = state
            value, moves = backup(
                ends, strides, paid, discount, success, entering, state
            )
            entering[state] = value
            later = 0
            for k in range(len(strides)):
                cell = state // strides[k] % ends.shape[1]
                moved = draws[trial, steps, k] < success
                later += ends[k, cell, moves[k] + 1 if moved else 0] * strides[k]
            state = later
            steps += 1
        for step in range(steps - 1, -1, -1):
            value, _ = backup(
                ends, strides, paid, discount, success, entering, passed[step]
            )
            entering[passed[step]] = value


def write(scenario, value: float) -> None:
    """Put a bound into config/bounds.json, one line each."""
    said = json.loads(BOUNDS.read_text("utf-8"))
    title = f"{scenario.name}, penalty {scenario.penalty:g}"
    said["bounds"][title] = {"game": game_digest(scenario), "value": value}
    lines = [
        f"  {json.dumps(k)}: {json.dumps(one)}" for k, one in said["bounds"].items()
    ]
    about = json.dumps(said["about"])
    text = ",\n".join(lines)
    BOUNDS.write_text(f'{{"about": {about},\n "bounds": {{\n{text}\n }}}}\n', "utf-8")


def main() -> None:
    """Compute and print the bounds."""
    parser = argparse.ArgumentParser(
        description=__doc__.split("\n")[0],
        formatter_class=argparse.ArgumentDefaultsHelpFormatter,
    )
    parser.add_argument("scenarios", nargs="+", metavar="SCENARIO")
    parser.add_argument("--penalty", type=float, default=-100)
    parser.add_argument("--size", type=int, default=LARGEST_GROUP, help="of a group")
    parser.add_argument("--write", action="store_true", help="into config/bounds.json")
    options = parser.parse_args()
    for name in options.scenarios:
        scenario = sc.load_scenario(name, penalty=options.penalty)
        value = group_bound(scenario, options.size)
        print(f"{name}: {value:.3f}", flush=True)
        if options.write:
            write(scenario, value)


if __name__ == "__main__":
    run_script(main)
