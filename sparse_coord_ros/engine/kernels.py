# Copyright 2026 The sparse_coord_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Learning and trials as loops over arrays, for numba to compile.

What `learn.simulation` and `game.world` do object by object, here step by step on arrays. What a
learner does of its own is compiled in from its `learn.loops.Minds`. Plain Python runs these loops
too, with the same bits.
"""

import functools
from collections.abc import Callable
from typing import Any, NamedTuple

import numpy as np

from sparse_coord_ros.compiling import inlined, inner, jit
from sparse_coord_ros.game.actions import ACTIONS, COORDINATE
from sparse_coord_ros.game.miscoordination import NOWHERE, together
from sparse_coord_ros.game.streams import EXPLORE, EXPLORED_ACTION, MOTION, POLICY, START, TIE
from sparse_coord_ros.game.world import EPISODE_GAP
from sparse_coord_ros.learn import loops
from sparse_coord_ros.learn.loops import (
    DONE,
    END,
    EPISODE_START,
    NO_ROW,
    PLACED,
    STEP,
    Choices,
    CompiledScenario,
    Draws,
    Game,
    drawn,
    greedy_action,
)
from sparse_coord_ros.learn.rows import has_room, rehash

REWARD, TIME, ASKS, CONFLICTS = range(4)
"""Last axis of a trial's result."""


class Record(NamedTuple):
    """The learning history in the making: arrays as of `learn.history.History`, with room.

    Attributes:
        used: its one entry is the number of rows in use; the last one is that of the episode
            under way, or of the one that ended last.
        first_step, length, reward, miscoordinations, asks, arrived: [row], or [row, k].
    """

    used: np.ndarray
    first_step: np.ndarray
    length: np.ndarray
    reward: np.ndarray
    miscoordinations: np.ndarray
    asks: np.ndarray
    arrived: np.ndarray


@inner
def begin_block(game: Game, draws: Draws) -> None:
    """Begin the next block of time steps."""
    game.clock[END] += draws.block


@inlined
def place(problem: CompiledScenario, game: Game, draws: Draws) -> None:
    """Begin an episode: every robot at its start, or at an exploring start."""
    clock = game.clock
    step = clock[STEP]
    exploring = problem.exploring[min(step, len(problem.exploring) - 1)]
    for k in range(len(problem.starts)):
        game.cells[k] = problem.starts[k]
        game.arrived[k] = 1
    for k in problem.members:
        game.arrived[k] = 0
        if exploring > 0.0 and drawn(draws, START, k, step, 0) < exploring:
            pick = int(drawn(draws, START, k, step, 1) * problem.start_counts[k])
            game.cells[k] = problem.start_cells[k, pick]
    clock[EPISODE_START] = step
    clock[PLACED] = 1


@inlined
def choose(
    problem: CompiledScenario,
    minds: Any,
    game: Game,
    choice: Choices,
    draws: Draws,
    step: int,
    epsilon: float,
) -> None:
    """Let every robot that has not arrived choose (Algorithm 1, lines 4 to 10)."""
    loops.begin_step(problem, minds, game, choice)
    for k in problem.members:
        if game.arrived[k]:
            continue
        x = game.cells[k]
        values = minds.q_star[k, x]
        if epsilon > 0.0 and drawn(draws, POLICY, k, step, EXPLORE) < epsilon:
            action = int(drawn(draws, POLICY, k, step, EXPLORED_ACTION) * problem.actions)
        else:
            action = greedy_action(values, len(ACTIONS), draws, k, step, TIE)
        choice.cells[k] = x
        choice.actions[k] = action
        choice.moves[k] = action
        choice.rows[k] = NO_ROW
        if action == COORDINATE:
            choice.moves[k] = loops.coordinate(
                problem, minds, game, choice, draws, step, k, epsilon
            )


@inlined
def move(problem: CompiledScenario, game: Game, choice: Choices, draws: Draws, step: int) -> bool:
    """Move every robot that acts; return whether the step ends in a miscoordination."""
    cells = game.cells
    members = problem.members
    for k in members:
        if not game.arrived[k] and drawn(draws, MOTION, k, step, 0) < problem.move_success:
            cells[k] = problem.next_cell[cells[k], choice.moves[k]]
    for i in range(len(members)):
        place = problem.places[cells[members[i]]]
        if place != NOWHERE:
            for j in range(i):
                if together(place, problem.places[cells[members[j]]]):
                    return True
    return False


@inner
def has_rows(record: Record | None, block: int) -> bool:
    """Whether a record has room for all episodes that can begin in so many time steps."""
    if record is None:
        return True
    return bool(record.used[0] + block <= len(record.length))


def learn(
    problem: CompiledScenario,
    minds: Any,
    game: Game,
    choice: Choices,
    draws: Draws,
    record: Record | None,
) -> None:
    """Learn until the budget is used up, something needs more room, or it is to stop.

    What needs room are sparse tables and the record. A run in parts is the unbroken run.

    Args:
        problem: the scenario and the budget.
        minds: what the robots know, as of `loops.Minds`; changed.
        game: the game in progress, changed.
        choice: space for the robots' choices.
        draws: where the draws come from.
        record: the history, added to; or None. Numba compiles the loop for each by itself, and
            without a record nothing of it is left.
    """
    block = draws.block
    while (
        game.clock[DONE] < problem.budget
        and not draws.stop[0]
        and has_room(minds.rows, block)
        and has_rows(record, block)
    ):
        if game.clock[STEP] >= game.clock[END]:
            begin_block(game, draws)
        learn_block(problem, minds, game, choice, draws, record)


@inner
def learn_block(
    problem: CompiledScenario,
    minds: Any,
    game: Game,
    choice: Choices,
    draws: Draws,
    record: Record | None,
) -> None:
    """Learn until the block of time steps, or the budget, is used up (Algorithm 1)."""
    clock, arrived = game.clock, game.arrived
    end = clock[END]
    last = len(problem.epsilon) - 1
    while clock[DONE] < problem.budget and clock[STEP] < end:
        if not clock[PLACED]:
            place(problem, game, draws)
            if record is not None:
                record.first_step[record.used[0]] = clock[STEP]
                record.used[0] += 1
        step = clock[STEP]
        scheduled = min(step, last)
        choose(problem, minds, game, choice, draws, step, problem.epsilon[scheduled])
        conflict = move(problem, game, choice, draws, step)
        loops.end_step(problem, minds, game)
        floor = problem.alpha_by_step[scheduled]
        if record is not None:
            row = record.used[0] - 1
            record.length[row] += 1
            record.miscoordinations[row] += conflict
        over = True
        for k in problem.members:
            if arrived[k]:
                continue
            y = game.cells[k]
            action = choice.actions[k]
            home = y == problem.goals[k]
            individual = problem.goal_reward if home else 0.0
            common = problem.penalties[k] if conflict else 0.0
            cost = -problem.ask_cost if action == COORDINATE else 0.0
            if record is not None:
                record.reward[row, k] += individual + common + cost
                record.asks[row, k] += action == COORDINATE
                record.arrived[row, k] = home
            if home:
                arrived[k] = 1
            else:
                over = False
            loops.learn(problem, minds, choice, draws, step, k, y, individual, common, cost, floor)
        clock[STEP] = step + 1
        clock[DONE] += 1
        if over or clock[STEP] - clock[EPISODE_START] >= problem.max_steps:
            clock[STEP] += EPISODE_GAP
            clock[PLACED] = 0


def play(
    problem: CompiledScenario,
    minds: Any,
    game: Game,
    choice: Choices,
    draws: Draws,
    results: np.ndarray,
    asked: np.ndarray,
    stays: np.ndarray,
) -> None:
    """Play greedy trials until all are played, or as `learn` does; arguments as `play_block`."""
    block = draws.block
    while game.clock[DONE] < problem.budget and not draws.stop[0] and has_room(minds.rows, block):
        begin_block(game, draws)
        play_block(problem, minds, game, choice, draws, results, asked, stays)


@inner
def play_block(
    problem: CompiledScenario,
    minds: Any,
    game: Game,
    choice: Choices,
    draws: Draws,
    results: np.ndarray,
    asked: np.ndarray,
    stays: np.ndarray,
) -> None:
    """Play greedy trials until the block of time steps, or the trials, are used up.

    Args:
        problem: the scenario; `budget` trials of at most `max_steps` steps.
        minds: what the robots have learned.
        game: the game in progress.
        choice: space for the robots' choices.
        draws: where the draws come from.
        results: filled, [trial, k, REWARD to CONFLICTS]; TIME is the horizon, and one more, for
            a robot that does not arrive.
        asked: counted up where COORDINATE is chosen, [k, x].
        stays: counted up where a robot acts, [k, x].
    """
    clock, cells, arrived = game.clock, game.cells, game.arrived
    end = clock[END]
    never = problem.max_steps + 1
    while clock[DONE] < problem.budget and clock[STEP] < end:
        if not clock[PLACED]:
            place(problem, game, draws)
        step = clock[STEP]
        elapsed = step - clock[EPISODE_START]
        result = results[clock[DONE]]
        choose(problem, minds, game, choice, draws, step, 0.0)
        conflict = move(problem, game, choice, draws, step)
        over = True
        discount = problem.discounts[elapsed]
        for k in problem.members:
            common = problem.penalties[k] if conflict else 0.0
            cost = 0.0
            if not arrived[k]:
                stays[k, choice.cells[k]] += 1
                if choice.actions[k] == COORDINATE:
                    cost = -problem.ask_cost
                    result[k, ASKS] += 1
                    asked[k, choice.cells[k]] += 1
            result[k, REWARD] += discount * (common + cost)
            result[k, CONFLICTS] += conflict
            if arrived[k]:
                continue
            if cells[k] == problem.goals[k]:
                arrived[k] = 1
                result[k, TIME] = elapsed + 1
                result[k, REWARD] += discount * problem.goal_reward / (1.0 - problem.discount)
            else:
                over = False
                result[k, TIME] = never
        clock[STEP] = step + 1
        if over or clock[STEP] - clock[EPISODE_START] >= problem.max_steps:
            clock[STEP] += EPISODE_GAP
            clock[PLACED] = 0
            clock[DONE] += 1


class Loops(NamedTuple):
    """The loops, ready to be called."""

    learn: Callable[..., None]
    play: Callable[..., None]
    rehash: Callable[..., None]


PLAIN = Loops(learn, play, rehash)
"""The loops as plain Python: slow, for tests."""


@functools.cache
def compiled(minds: type[Any]) -> Loops:
    """Return the loops for a class of `learn.loops.Minds`; they compile when first called."""
    return Loops(*jit(PLAIN, minds))
