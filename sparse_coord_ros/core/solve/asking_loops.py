# Copyright 2026 The sparse_coord_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The loops of the search for the best asking team: the value of a team, and climbing.

Plain Python over NumPy arrays, compiled by numba where it is installed. A joint state is a number:
first robot's cell * cells + second robot's cell.
"""

import functools
from collections.abc import Callable
from typing import NamedTuple

import numpy as np

from sparse_coord_ros.base.compiling import has_numba, jit, jitable
from sparse_coord_ros.core.game.actions import OUTCOMES, PRIMITIVES, STAY

ASK_AS_NOW = 2 * PRIMITIVES
OPTIONS = ASK_AS_NOW + 1
"""What a robot can do in a cell, by number: make a move without asking; then ask, with that move
where the percept fails; `ASK_AS_NOW`: ask, with the present move there."""

MOST_SWEEPS = 20_000
ACCURACY = 1e-9
"""A value is known to within this; an improvement is larger than `LEAST_GAIN`."""

LEAST_GAIN = 1e-7

OUTSIDE_SWEEPS = 1
"""Sweeps over the joint states where a team does not get: from above, they stay bounds. More take
longer than they spare."""


class WeightedGame(NamedTuple):
    """The game of two robots, with a weight for each robot's reward.

    Attributes:
        after: the joint state in which a step ends, by the outcome of each robot: the move that
            succeeds, or `STAY`; (joint states, outcomes, outcomes).
        paid: weighted reward of that step, an arrival paid for ever; same shape.
        start: joint state of the starts.
        home: joint state of the goals.
        goals: goal cell of each robot; (2,).
        percept: probability that a percept succeeds; (cells, cells), asker first.
        fails: whether a percept can fail in the asker's cell; (cells,).
        cost: weighted cost of each robot's asking; (2,).
        discount: gamma.
        success: probability that a move succeeds.
        above: an upper bound of a team's value from a joint state; (joint states,).
        everything: every joint state but `home`, the farthest from the goals first.
    """

    after: np.ndarray
    paid: np.ndarray
    start: int
    home: int
    goals: np.ndarray
    percept: np.ndarray
    fails: np.ndarray
    cost: np.ndarray
    discount: float
    success: float
    above: np.ndarray
    everything: np.ndarray


class AskingPolicies(NamedTuple):
    """A team of Algorithm 1's form.

    Attributes:
        moves: the move of each robot in each own cell, without asking, or where the percept
            fails; (2, cells).
        asks: whether it asks there, never at its goal; (2, cells).
        seen: the move of one that asks and perceives; (2, cells, cells), own cell first.
    """

    moves: np.ndarray
    asks: np.ndarray
    seen: np.ndarray


class Workspace(NamedTuple):
    """Working memory of the loops.

    Attributes:
        value: value of each joint state; (joint states,).
        kept: a copy of it.
        order: joint states that are computed, the last one first; (joint states,).
        reached: whether a joint state is among them.
        inside: whether the team gets into a joint state.
        visited: whether a robot acts in a cell; (2, cells).
        chances: probability of each outcome of each robot; (2, outcomes).
        nobody: of each robot, that its moves after a percept are given: False; (2,).
    """

    value: np.ndarray
    kept: np.ndarray
    order: np.ndarray
    reached: np.ndarray
    inside: np.ndarray
    visited: np.ndarray
    chances: np.ndarray
    nobody: np.ndarray


@jitable
def write_chances(
    game: WeightedGame,
    policy: AskingPolicies,
    chances: np.ndarray,
    k: int,
    x: int,
    z: int,
    seen: int,
) -> None:
    """Write the probability of each outcome of robot k in cell x, the peer in z.

    `seen` is its move after a percept.
    """
    for outcome in range(OUTCOMES):
        chances[k, outcome] = 0.0
    if x == game.goals[k]:
        chances[k, STAY] = 1.0
        return
    sees = 0.0
    if policy.asks[k, x]:
        sees = game.percept[x, z]
    chances[k, STAY] = 1.0 - game.success
    chances[k, seen] += game.success * sees
    chances[k, policy.moves[k, x]] += game.success * (1.0 - sees)


@jitable
def chooses(
    game: WeightedGame,
    policy: AskingPolicies,
    free: np.ndarray,
    k: int,
    x: int,
    z: int,
) -> bool:
    """Return whether robot k in cell x, the peer in z, chooses a move after a percept."""
    return bool(free[k] and policy.asks[k, x] and game.percept[x, z] > 0.0)


@jitable
def reach(
    game: WeightedGame,
    policy: AskingPolicies,
    free: np.ndarray,
    space: Workspace,
    reached: np.ndarray,
) -> int:
    """Write the joint states that the team can reach to `order`, from the start on.

    Args:
        game: the game.
        policy: the team.
        free: of each robot, whether its moves after a percept are still to be chosen: then it can
            do all of them.
        space: written to.
        reached: whether a joint state is among them; written.

    Returns:
        Their number, without the one in which both have arrived.
    """
    cells = len(game.fails)
    order = space.order
    chances = space.chances
    for state in range(len(reached)):
        reached[state] = False
    reached[game.start] = True
    reached[game.home] = True
    order[0] = game.start
    count = 1
    done = 0
    while done < count:
        state = order[done]
        done += 1
        x = state // cells
        y = state % cells
        write_chances(game, policy, chances, 0, x, y, policy.seen[0, x, y])
        write_chances(game, policy, chances, 1, y, x, policy.seen[1, y, x])
        all0 = chooses(game, policy, free, 0, x, y)
        all1 = chooses(game, policy, free, 1, y, x)
        for a in range(OUTCOMES):
            for b in range(OUTCOMES):
                possible = (all0 or chances[0, a] > 0.0) and (
                    all1 or chances[1, b] > 0.0
                )
                target = game.after[state, a, b]
                if possible and not reached[target]:
                    reached[target] = True
                    order[count] = target
                    count += 1
    return count


@jitable
def step_value(
    game: WeightedGame, value: np.ndarray, chances: np.ndarray, state: int, cost: float
) -> float:
    """Return the value of a joint step, which is repeated as long as both robots stay.

    Args:
        game: the game.
        value: value of each joint state.
        chances: probability of each outcome of each robot.
        state: the joint state.
        cost: what the robots pay for asking.
    """
    gain = -cost
    stay = 0.0
    for a in range(OUTCOMES):
        p = chances[0, a]
        if p == 0.0:
            continue
        for b in range(OUTCOMES):
            q = p * chances[1, b]
            if q == 0.0:
                continue
            target = game.after[state, a, b]
            gain += q * game.paid[state, a, b]
            if target == state:
                stay += q
            else:
                gain += q * game.discount * value[target]
    return gain / (1.0 - game.discount * stay)


@jitable
def best_at(
    game: WeightedGame,
    policy: AskingPolicies,
    free: np.ndarray,
    space: Workspace,
    state: int,
) -> float:
    """Return the value of a joint state; choose the moves after a percept of who is free.

    Of moves that are equally good the first is chosen.
    """
    cells = len(game.fails)
    x = state // cells
    y = state % cells
    cost = 0.0
    if policy.asks[0, x]:
        cost += game.cost[0]
    if policy.asks[1, y]:
        cost += game.cost[1]
    # A robot that chooses looks at all four moves, another one at its own.
    first0 = policy.seen[0, x, y]
    first1 = policy.seen[1, y, x]
    end0 = first0 + 1
    end1 = first1 + 1
    if chooses(game, policy, free, 0, x, y):
        first0 = 0
        end0 = PRIMITIVES
    if chooses(game, policy, free, 1, y, x):
        first1 = 0
        end1 = PRIMITIVES
    best = -np.inf
    for i in range(first0, end0):
        write_chances(game, policy, space.chances, 0, x, y, i)
        for j in range(first1, end1):
            write_chances(game, policy, space.chances, 1, y, x, j)
            worth = step_value(game, space.value, space.chances, state, cost)
            if worth > best + 1e-12:
                best = worth
                policy.seen[0, x, y] = i
                policy.seen[1, y, x] = j
    return best


@jitable
def sweep(
    game: WeightedGame,
    policy: AskingPolicies,
    free: np.ndarray,
    space: Workspace,
    count: int,
    target: float,
    sweeps: int,
) -> float:
    """Iterate over the values of the joint states in `order`, the last one first.

    Args:
        game: the game.
        policy: the team; the moves after percepts of who is free are written.
        free: of each robot, whether its moves after percepts are to be chosen.
        space: its values are changed.
        count: how many there are.
        target: give up as soon as the value is known to be less.
        sweeps: how often at most.

    Returns:
        The value from the starts.
    """
    value = space.value
    value[game.home] = 0.0
    ratio = game.discount / (1.0 - game.discount)
    for _ in range(sweeps):
        change = 0.0
        for i in range(count - 1, -1, -1):
            state = space.order[i]
            new = best_at(game, policy, free, space, state)
            change = max(change, abs(new - value[state]))
            value[state] = new
        if change * ratio < ACCURACY or value[game.start] + change * ratio < target:
            break
    return float(value[game.start])


@jitable
def solve(
    game: WeightedGame,
    policy: AskingPolicies,
    free: np.ndarray,
    space: Workspace,
    target: float,
) -> float:
    """Return the team's value from the starts, the moves after percepts chosen at best.

    Arguments are as in `sweep`; the workspace begins with the values that it has.
    """
    count = reach(game, policy, free, space, space.reached)
    return sweep(game, policy, free, space, count, target, MOST_SWEEPS)


@jitable
def visit(game: WeightedGame, policy: AskingPolicies, space: Workspace) -> int:
    """Write to `visited` and `inside` where the team gets, its moves after percepts given.

    Return the number of joint states, which are in `order`.
    """
    cells = len(game.fails)
    count = reach(game, policy, space.nobody, space, space.inside)
    for x in range(cells):
        space.visited[0, x] = False
        space.visited[1, x] = False
    for i in range(count):
        state = space.order[i]
        x = state // cells
        y = state % cells
        if x != game.goals[0]:
            space.visited[0, x] = True
        if y != game.goals[1]:
            space.visited[1, y] = True
    return count


@jitable
def surround(
    game: WeightedGame, policy: AskingPolicies, free: np.ndarray, space: Workspace
) -> None:
    """Write where the team gets, and what the joint states elsewhere are worth at most."""
    visit(game, policy, space)
    count = 0
    for state in game.everything:
        if not space.inside[state]:
            space.value[state] = game.above[state]
            space.order[count] = state
            count += 1
    sweep(game, policy, free, space, count, -np.inf, OUTSIDE_SWEEPS)


@jitable
def promises(
    game: WeightedGame,
    policy: AskingPolicies,
    free: np.ndarray,
    space: Workspace,
    k: int,
    x: int,
) -> bool:
    """Return whether a new choice of robot k in cell x is better for some peer's cell.

    If a step of it, before all goes on as it was, is better nowhere, the new team is not better.
    """
    cells = len(game.fails)
    enough = 0.5 * LEAST_GAIN * (1.0 - game.discount)
    for z in range(cells):
        state = x * cells + z if k == 0 else z * cells + x
        if state == game.home or not space.inside[state]:
            continue
        if best_at(game, policy, free, space, state) > space.value[state] + enough:
            return True
    return False


def climb(
    game: WeightedGame,
    policy: AskingPolicies,
    free: np.ndarray,
    space: Workspace,
    trials: np.ndarray,
) -> float:
    """Change one robot's choice in one cell as long as that makes the team better.

    Args:
        game: the game.
        policy: the team; becomes better. Its moves after percepts become the best ones.
        free: whether each robot's choices may change.
        space: what is written to: in the end `visited` is that of the team.
        trials: the order in which choices are tried: robot, cell and option in one number; empty:
            only moves after percepts are chosen.

    Returns:
        The team's value.
    """
    cells = len(game.fails)
    value = space.value
    best = -np.inf
    target = -np.inf
    failed = 0
    i = 0
    k = 0
    x = 0
    old_move = 0
    old_asks = False
    ends = False
    while True:
        reached = solve(game, policy, free, space, target)
        if reached > target:
            best = reached
            failed = 0
            surround(game, policy, free, space)
            if ends:
                return best
        else:
            policy.moves[k, x] = old_move
            policy.asks[k, x] = old_asks
            for state in range(len(value)):
                value[state] = space.kept[state]
        # The next change that promises to make the team better.
        promising = False
        while not promising and failed < len(trials):
            trial = trials[i]
            i = (i + 1) % len(trials)
            failed += 1
            k = trial // (cells * OPTIONS)
            x = trial // OPTIONS % cells
            option = trial % OPTIONS
            if not free[k] or not space.visited[k, x]:
                continue
            old_move = policy.moves[k, x]
            old_asks = policy.asks[k, x]
            asks = option >= PRIMITIVES
            move = old_move if option == ASK_AS_NOW else option % PRIMITIVES
            if asks and (option == ASK_AS_NOW) == game.fails[x]:
                continue
            if asks == old_asks and move == old_move:
                continue
            policy.moves[k, x] = move
            policy.asks[k, x] = asks
            promising = promises(game, policy, free, space, k, x)
            if not promising:
                policy.moves[k, x] = old_move
                policy.asks[k, x] = old_asks
        target = best + LEAST_GAIN
        for state in range(len(value)):
            space.kept[state] = value[state]
        if not promising:  # for the moves after percepts, which trials have changed
            ends = True
            target = -np.inf


@functools.cache
def compiled() -> Callable[..., float]:
    """Return `climb`, compiled by numba where it is installed (when it is first called)."""
    return jit([climb])[0] if has_numba() else climb
