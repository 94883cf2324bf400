# Copyright 2026 The sparse_coord_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The loops of the search for the best asking team: the value of a team, and climbing.

Plain Python over NumPy arrays, compiled by numba where it is installed. A joint state is the pair
(first robot's cell, second robot's cell).
"""

import functools
from collections.abc import Callable
from typing import NamedTuple

import numpy as np

from sparse_coord_ros.base.compiling import has_numba, inner, jit
from sparse_coord_ros.core.game.actions import OUTCOMES, PRIMITIVES, STAY
from sparse_coord_ros.core.game.interactions import (
    Interactions,
    miscoordinates,
    settle,
)

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
        lead: where a successful move leads, and `STAY`; (cells, moves + 1).
        starts: start cell of each robot; (2,).
        goals: goal cell of each robot; (2,).
        percept: probability that a percept succeeds; (cells, cells), asker first.
        fails: whether a percept can fail in the asker's cell; (cells,).
        interactions: of the two robots.
        toll: weighted r^C of a miscoordination.
        prize: weighted value of each robot's arrival, for ever; (2,).
        cost: weighted cost of each robot's asking; (2,).
        discount: gamma.
        success: probability that a move succeeds.
        above: an upper bound of a team's value from a joint state; (cells, cells).
        everything: every joint state but that in which both have arrived, in a good order.
        step: room for the cells before and after a step; (2, 2).
    """

    lead: np.ndarray
    starts: np.ndarray
    goals: np.ndarray
    percept: np.ndarray
    fails: np.ndarray
    interactions: Interactions
    toll: float
    prize: np.ndarray
    cost: np.ndarray
    discount: float
    success: float
    above: np.ndarray
    everything: np.ndarray
    step: np.ndarray


class AskingPolicies(NamedTuple):
    """A team of Algorithm 1's form.

    Attributes:
        moves: the move of each robot in each own cell, without asking, or where the percept
            fails; (2, cells).
        asks: whether it asks there; (2, cells).
        seen: the move of one that asks and perceives; (2, cells, cells), own cell first.
    """

    moves: np.ndarray
    asks: np.ndarray
    seen: np.ndarray


class Workspace(NamedTuple):
    """Working memory of the loops.

    Attributes:
        value: value of each joint state; (cells, cells).
        kept: a copy of it.
        order: joint states in the order in which they are computed, numbered; (cells * cells,).
        stack: joint states whose successors are looked at.
        tried: how many combinations of outcomes of a joint state were looked at; -1: unknown.
        inside: whether the team gets into a joint state; (cells * cells,).
        visited: whether a robot acts in a cell; (2, cells).
        nobody: of each robot, that its moves after a percept are given: False; (2,).
    """

    value: np.ndarray
    kept: np.ndarray
    order: np.ndarray
    stack: np.ndarray
    tried: np.ndarray
    inside: np.ndarray
    visited: np.ndarray
    nobody: np.ndarray


@inner
def can_do(
    game: WeightedGame,
    policy: AskingPolicies,
    free: np.ndarray,
    k: int,
    x: int,
    z: int,
    outcome: int,
) -> bool:
    """Return whether robot k in cell x, the peer in z, may end a step by this outcome."""
    if outcome == STAY:
        return True
    if x == game.goals[k]:
        return False
    if not policy.asks[k, x]:
        return bool(policy.moves[k, x] == outcome)
    if game.percept[x, z] < 1.0 and policy.moves[k, x] == outcome:
        return True
    return bool(
        game.percept[x, z] > 0.0 and (free[k] or policy.seen[k, x, z] == outcome)
    )


@inner
def reach(
    game: WeightedGame, policy: AskingPolicies, free: np.ndarray, space: Workspace
) -> int:
    """Write the joint states that the team can reach to `order`, successors first.

    Args:
        game: the game.
        policy: the team.
        free: of each robot, whether its moves after a percept are still to be chosen: then it can
            do all of them.
        space: what is written to.

    Returns:
        Their number, without the one in which both have arrived.
    """
    cells = game.lead.shape[0]
    last = game.goals[0] * cells + game.goals[1]
    space.tried[:] = -1
    space.stack[0] = game.starts[0] * cells + game.starts[1]
    space.tried[space.stack[0]] = 0
    depth = 1
    count = 0
    while depth > 0:
        state = space.stack[depth - 1]
        x = state // cells
        y = state % cells
        index = space.tried[state]
        found = -1
        while index < OUTCOMES * OUTCOMES and found < 0:
            one = index // OUTCOMES
            other = index % OUTCOMES
            index += 1
            if can_do(game, policy, free, 0, x, y, one) and can_do(
                game, policy, free, 1, y, x, other
            ):
                before, after = game.step
                before[0] = x
                before[1] = y
                after[0] = game.lead[x, one]
                after[1] = game.lead[y, other]
                settle(game.interactions, before, after)
                target = after[0] * cells + after[1]
                if space.tried[target] < 0 and target != last:
                    found = target
        space.tried[state] = index
        if found >= 0:
            space.tried[found] = 0
            space.stack[depth] = found
            depth += 1
        else:
            depth -= 1
            space.order[count] = state
            count += 1
    return count


@inner
def outcome(
    lead: np.ndarray,
    success: float,
    x: int,
    sees: float,
    seen: int,
    unseen: int,
    number: int,
) -> tuple[int, float]:
    """Return the cell and the probability of one of a step's three outcomes.

    The outcomes: the robot perceives its peer and its move `seen` succeeds; it does not, and its
    move `unseen` succeeds; it stays in x.
    """
    if number == 0:
        return lead[x, seen], success * sees
    if number == 1:
        return lead[x, unseen], success * (1.0 - sees)
    return x, 1.0 - success


@inner
def expected(
    game: WeightedGame,
    value: np.ndarray,
    x: int,
    y: int,
    sees: tuple[float, float],
    seen: tuple[int, int],
    unseen: tuple[int, int],
) -> tuple[float, float]:
    """Return the value of a joint step, without the part of staying in (x, y).

    Args:
        game: the game.
        value: value of each joint state; (cells, cells).
        x: the first robot's cell.
        y: the second's.
        sees: how likely each robot perceives the other.
        seen: the move of each robot if it does.
        unseen: its move if it does not.

    Returns:
        Expected reward, and value of what comes after unless both stay; probability of staying.
    """
    inter = game.interactions
    gain = 0.0
    stay = 0.0
    for i in range(3):
        to, p = outcome(game.lead, game.success, x, sees[0], seen[0], unseen[0], i)
        if p == 0.0:
            continue
        for j in range(3):
            b, q = outcome(game.lead, game.success, y, sees[1], seen[1], unseen[1], j)
            before, after = game.step
            before[0] = x
            before[1] = y
            after[0] = to
            after[1] = b
            settle(inter, before, after)
            a = after[0]
            b = after[1]
            got = game.toll if miscoordinates(inter, before, after) else 0.0
            if a == game.goals[0] and x != a:
                got += game.prize[0]
            if b == game.goals[1] and y != b:
                got += game.prize[1]
            if a == x and b == y:
                stay += p * q
            else:
                got += game.discount * value[a, b]
            gain += p * q * got
    return gain, stay


@inner
def asks_at(game: WeightedGame, policy: AskingPolicies, k: int, x: int) -> bool:
    """Return whether robot k asks in cell x."""
    return bool(policy.asks[k, x] and x != game.goals[k])


@inner
def tried(chooses: bool, seen: int) -> range:
    """Return the moves after a percept to look at: all of one that chooses, else its own."""
    return range(PRIMITIVES) if chooses else range(seen, seen + 1)


@inner
def best_at(
    game: WeightedGame,
    policy: AskingPolicies,
    free: np.ndarray,
    value: np.ndarray,
    x: int,
    y: int,
) -> float:
    """Return the value of a joint state; choose the moves after a percept of who is free.

    Of moves that are equally good the first is chosen.
    """
    asks0 = asks_at(game, policy, 0, x)
    asks1 = asks_at(game, policy, 1, y)
    sees0 = game.percept[x, y] if asks0 else 0.0
    sees1 = game.percept[y, x] if asks1 else 0.0
    sees = (sees0, sees1)
    cost0 = game.cost[0] if asks0 else 0.0
    cost1 = game.cost[1] if asks1 else 0.0
    move0 = STAY if x == game.goals[0] else policy.moves[0, x]
    move1 = STAY if y == game.goals[1] else policy.moves[1, y]
    chooses0 = sees0 > 0.0 and free[0]
    chooses1 = sees1 > 0.0 and free[1]
    seen0 = policy.seen[0, x, y]
    seen1 = policy.seen[1, y, x]
    best = -np.inf
    best0 = seen0
    best1 = seen1
    for i in tried(chooses0, seen0):
        for j in tried(chooses1, seen1):
            gain, stay = expected(game, value, x, y, sees, (i, j), (move0, move1))
            found = (gain - (cost0 + cost1)) / (1.0 - game.discount * stay)
            if found > best + 1e-12:
                best = found
                best0 = i
                best1 = j
    if chooses0:
        policy.seen[0, x, y] = best0
    if chooses1:
        policy.seen[1, y, x] = best1
    return best


@inner
def solve(
    game: WeightedGame,
    policy: AskingPolicies,
    free: np.ndarray,
    space: Workspace,
    target: float,
) -> float:
    """Return the team's value from the starts, the moves after percepts chosen at best.

    Args:
        game: the game.
        policy: the team; the moves after percepts of who is free are written.
        free: of each robot, whether its moves after percepts are to be chosen.
        space: what is written to; begins with the values that it has.
        target: give up as soon as the value is known to be less.
    """
    count = reach(game, policy, free, space)
    return sweep(game, policy, free, space.value, space.order[:count], target)


@inner
def sweep(
    game: WeightedGame,
    policy: AskingPolicies,
    free: np.ndarray,
    value: np.ndarray,
    order: np.ndarray,
    target: float,
    sweeps: int = MOST_SWEEPS,
) -> float:
    """Iterate over the joint states of `order`; other arguments and value as of `solve`."""
    cells = game.lead.shape[0]
    x0, y0 = game.starts
    value[game.goals[0], game.goals[1]] = 0.0
    ratio = game.discount / (1.0 - game.discount)
    for _ in range(sweeps):
        change = 0.0
        for state in order:
            x = state // cells
            y = state % cells
            new = best_at(game, policy, free, value, x, y)
            change = max(change, abs(new - value[x, y]))
            value[x, y] = new
        if change * ratio < ACCURACY or value[x0, y0] + change * ratio < target:
            break
    return float(value[x0, y0])


@inner
def visit(game: WeightedGame, policy: AskingPolicies, space: Workspace) -> None:
    """Write to `visited` and `inside` where the team gets, its moves after percepts given."""
    cells = game.lead.shape[0]
    space.visited[:] = False
    space.inside[:] = False
    for state in space.order[: reach(game, policy, space.nobody, space)]:
        x = state // cells
        y = state % cells
        space.inside[state] = True
        if x != game.goals[0]:
            space.visited[0, x] = True
        if y != game.goals[1]:
            space.visited[1, y] = True


@inner
def surround(
    game: WeightedGame, policy: AskingPolicies, free: np.ndarray, space: Workspace
) -> None:
    """Write where the team gets, and what the joint states elsewhere are worth at most."""
    visit(game, policy, space)
    cells = game.lead.shape[0]
    count = 0
    for state in game.everything:
        if not space.inside[state]:
            x = state // cells
            y = state % cells
            space.value[x, y] = game.above[x, y]
            space.order[count] = state
            count += 1
    sweep(game, policy, free, space.value, space.order[:count], -np.inf, OUTSIDE_SWEEPS)


@inner
def promising(
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
    cells = game.lead.shape[0]
    enough = 0.5 * LEAST_GAIN * (1.0 - game.discount)
    for z in range(cells):
        a, b = (x, z) if k == 0 else (z, x)
        if not space.inside[a * cells + b]:
            continue
        if best_at(game, policy, free, space.value, a, b) > space.value[a, b] + enough:
            return True
    return False


@inner
def copy(source: np.ndarray, target: np.ndarray) -> None:
    """Copy the values of joint states; NumPy's own way would have numba count references."""
    for x in range(len(source)):
        for y in range(len(source)):
            target[x, y] = source[x, y]


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
        policy: the team; becomes better.
        free: whether each robot's choices may change.
        space: what is written to.
        trials: the order in which choices are tried: robot, cell and option in one number.

    Returns:
        The team's value.
    """
    cells = game.lead.shape[0]
    best = solve(game, policy, free, space, -np.inf)
    surround(game, policy, free, space)
    failed = 0
    i = 0
    while failed < len(trials):
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
        if promising(game, policy, free, space, k, x):
            copy(space.value, space.kept)
            found = solve(game, policy, free, space, best + LEAST_GAIN)
            if found > best + LEAST_GAIN:
                best = found
                failed = 0
                surround(game, policy, free, space)
                continue
            copy(space.kept, space.value)
        policy.moves[k, x] = old_move
        policy.asks[k, x] = old_asks
    best = solve(game, policy, free, space, -np.inf)
    visit(game, policy, space)
    return best


class SearchLoops(NamedTuple):
    """The loops that the search calls."""

    solve: Callable[..., float]
    visit: Callable[..., None]
    climb: Callable[..., float]
    sweep: Callable[..., float]


PLAIN = SearchLoops(solve, visit, climb, sweep)
"""The loops as plain Python: slow, for tests and where numba is missing."""


@functools.cache
def compiled() -> SearchLoops:
    """Return the loops compiled by numba, or as plain Python where it is not installed."""
    return SearchLoops(*jit(PLAIN)) if has_numba() else PLAIN
