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
from sparse_coord_ros.game.miscoordination import meet
from sparse_coord_ros.game.streams import EXPLORE, EXPLORED_ACTION, MOTION, POLICY, START, TIE
from sparse_coord_ros.game.world import EPISODE_GAP
from sparse_coord_ros.learn import loops
from sparse_coord_ros.learn.history import History
from sparse_coord_ros.learn.loops import DONE, END, EPISODE_START, NO_ROW, PLACED, STEP
from sparse_coord_ros.learn.rows import has_room, rehash

REWARD, TIME, ASKS, CONFLICTS = range(4)
"""Last axis of a trial's result."""


class Record(NamedTuple):
    """The learning history in the making.

    Attributes:
        used: its one entry is the number of rows in use; the last one is that of the episode
            under way, or of the one that ended last.
        rows: one an episode, with room for more.
    """

    used: np.ndarray
    rows: History


@inner
def begin_block(game: loops.GameState, draws: loops.Draws) -> None:
    """Begin the next block of time steps."""
    game.clock[END] += draws.block


@inlined
def place(state: loops.State) -> None:
    """Begin an episode: every robot at its start, or at an exploring start."""
    problem, game, draws = state.problem, state.game, state.draws
    clock = game.clock
    step = clock[STEP]
    exploring = problem.exploring[min(step, len(problem.exploring) - 1)]
    for k in range(len(problem.starts)):
        game.cells[k] = problem.starts[k]
        game.arrived[k] = 1
    for k in problem.members:
        game.arrived[k] = 0
        if exploring > 0.0 and loops.drawn(draws, START, k, step, 0) < exploring:
            pick = int(loops.drawn(draws, START, k, step, 1) * problem.start_counts[k])
            game.cells[k] = problem.start_cells[k, pick]
    clock[EPISODE_START] = step
    clock[PLACED] = 1


@inlined
def choose(state: loops.State, minds: Any, step: int, epsilon: float) -> None:
    """Let every robot that has not arrived choose (Algorithm 1, lines 4 to 10)."""
    problem, game, choice, draws = state
    loops.begin_step(state, minds)
    for k in problem.members:
        if game.arrived[k]:
            continue
        x = game.cells[k]
        values = minds.q_star[k, x]
        if epsilon > 0.0 and loops.drawn(draws, POLICY, k, step, EXPLORE) < epsilon:
            action = int(loops.drawn(draws, POLICY, k, step, EXPLORED_ACTION) * problem.actions)
        else:
            action = loops.greedy_action(values, len(ACTIONS), draws, k, step, TIE)
        choice.cells[k] = x
        choice.actions[k] = action
        choice.moves[k] = action
        choice.rows[k] = NO_ROW
        if action == COORDINATE:
            choice.moves[k] = loops.coordinate(state, minds, step, k, epsilon)


@inlined
def move(state: loops.State, step: int) -> bool:
    """Move every robot that acts; return whether the step ends in a miscoordination."""
    problem, game, choice, draws = state
    cells = game.cells
    for k in problem.members:
        if not game.arrived[k] and loops.drawn(draws, MOTION, k, step, 0) < problem.move_success:
            cells[k] = problem.next_cell[cells[k], choice.moves[k]]
    return meet(problem.places, cells, problem.members)


@inner
def has_rows(record: Record | None, block: int) -> bool:
    """Whether a record has room for all episodes that can begin in so many time steps."""
    if record is None:
        return True
    return bool(record.used[0] + block <= len(record.rows.length))


def learn(state: loops.State, minds: Any, record: Record | None) -> None:
    """Learn until the budget is used up, something needs more room, or it is to stop.

    What needs room are sparse tables and the record. A run in parts is the unbroken run.

    Args:
        state: the run under way.
        minds: what the robots know, as of `loops.Minds`; changed.
        record: the history, added to; or None. Numba compiles the loop for each by itself, and
            without a record nothing of it is left.
    """
    problem, game, _, draws = state
    block = draws.block
    while (
        game.clock[DONE] < problem.budget
        and not draws.stop[0]
        and has_room(minds.rows, block)
        and has_rows(record, block)
    ):
        if game.clock[STEP] >= game.clock[END]:
            begin_block(game, draws)
        learn_block(state, minds, record)


@inner
def learn_block(state: loops.State, minds: Any, record: Record | None) -> None:
    """Learn until the block of time steps, or the budget, is used up (Algorithm 1)."""
    problem, game, choice, _ = state
    clock, arrived = game.clock, game.arrived
    end = clock[END]
    last = len(problem.epsilon) - 1
    while clock[DONE] < problem.budget and clock[STEP] < end:
        if not clock[PLACED]:
            place(state)
            if record is not None:
                record.rows.first_step[record.used[0]] = clock[STEP]
                record.used[0] += 1
        step = clock[STEP]
        scheduled = min(step, last)
        choose(state, minds, step, problem.epsilon[scheduled])
        conflict = move(state, step)
        loops.end_step(state, minds)
        floor = problem.alpha_by_step[scheduled]
        if record is not None:
            row = record.used[0] - 1
            record.rows.length[row] += 1
            record.rows.miscoordinations[row] += conflict
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
                record.rows.reward[row, k] += individual + common + cost
                record.rows.asks[row, k] += action == COORDINATE
                record.rows.arrived[row, k] = home
            if home:
                arrived[k] = 1
            else:
                over = False
            now = loops.Transition(step, k, y, (individual, common, cost), floor)
            loops.learn(state, minds, now)
        clock[STEP] = step + 1
        clock[DONE] += 1
        if over or clock[STEP] - clock[EPISODE_START] >= problem.max_steps:
            clock[STEP] += EPISODE_GAP
            clock[PLACED] = 0


def play(
    state: loops.State, minds: Any, results: np.ndarray, asked: np.ndarray, stays: np.ndarray
) -> None:
    """Play greedy trials until all are played, or as `learn` does; arguments as `play_block`."""
    problem, game, _, draws = state
    block = draws.block
    while game.clock[DONE] < problem.budget and not draws.stop[0] and has_room(minds.rows, block):
        begin_block(game, draws)
        play_block(state, minds, results, asked, stays)


@inner
def play_block(
    state: loops.State, minds: Any, results: np.ndarray, asked: np.ndarray, stays: np.ndarray
) -> None:
    """Play greedy trials until the block of time steps, or the trials, are used up.

    Args:
        state: the game in progress, with `budget` trials of at most `max_steps` steps.
        minds: what the robots have learned.
        results: filled, [trial, k, REWARD to CONFLICTS]; TIME is the horizon, and one more, for
            a robot that does not arrive.
        asked: counted up where COORDINATE is chosen, [k, x].
        stays: counted up where a robot acts, [k, x].
    """
    problem, game, choice, _ = state
    clock, cells, arrived = game.clock, game.cells, game.arrived
    end = clock[END]
    never = problem.max_steps + 1
    while clock[DONE] < problem.budget and clock[STEP] < end:
        if not clock[PLACED]:
            place(state)
        step = clock[STEP]
        elapsed = step - clock[EPISODE_START]
        result = results[clock[DONE]]
        choose(state, minds, step, 0.0)
        conflict = move(state, step)
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
            if problem.paired:
                clock[STEP] = clock[EPISODE_START] + problem.max_steps
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
