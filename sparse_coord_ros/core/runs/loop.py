# Copyright 2026 The sparse_coord_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Learning and trials as loops, for plain Python (on lists) and for numba (on arrays).

The game is that of `core.game.rules`, the choices are those of `core.learners.policy`; what a
robot learns is its learner's.
"""

import functools
from collections.abc import Callable
from typing import Any, NamedTuple

from sparse_coord_ros.base.compiling import compiled_as, inlined, inner, jit
from sparse_coord_ros.core.game.actions import COORDINATE
from sparse_coord_ros.core.game.draws import REPLAY, ROBOT, draw
from sparse_coord_ros.core.game.interactions import (
    interacting,
    miscoordinate,
    settle,
)
from sparse_coord_ros.core.game.rules import (
    EPISODE_GAP,
    UNKNOWN_PARTNERS,
    Problem,
    asking_reward,
    common_reward,
    episode_ends,
    goal_paid,
    individual_reward,
    led,
    perceive,
    start_of,
)
from sparse_coord_ros.core.learners.mind import mind_of
from sparse_coord_ros.core.learners.policy import choose, choose_move, tabulate
from sparse_coord_ros.core.learners.rules import (
    Task,
    Transition,
    begin_episode,
    learn,
    sees_all,
    wants_draw,
    wants_partners,
)

STEP, EPISODE_START, DONE, PLACED, END = range(5)
"""Entries of `GameState.clock`: time step, first step of the episode, transitions (or trials)
done, whether the episode has begun, the step at which the loop is to look up."""

RETURN, TIME, ASKS, CONFLICTS = range(4)
"""Last axis of a trial's result."""


class Rule(NamedTuple):
    """The rules by which a team learns.

    Attributes:
        problem: the game.
        members: the robots that act.
        actions: number of a robot's actions.
        max_steps: steps after which an episode ends.
        exploring: probability of an exploring start [time step].
        epsilon: probability of an explored action [time step].
        floors: least step size [time step].
        weights: how much the individual and the common part of a reward and the cost of asking
            count while learning [3].
        goal_value: value of being at the goal while learning.
        step_sizes: the step size of the n-th update of an entry, without the floor [n].
        map_samples, replays, leaves: as of `Task`.
        tasks: in plain Python the tasks of the robots.
    """

    problem: Problem
    members: Any
    actions: int
    max_steps: int
    exploring: Any
    epsilon: Any
    floors: Any
    weights: Any
    goal_value: float
    step_sizes: Any
    map_samples: int
    replays: int
    leaves: bool
    tasks: Any


def made_task(rule: Rule, k: int) -> Task:
    """As `task_of`, of arrays."""
    problem = rule.problem
    return Task(
        k,
        len(problem.goals),
        len(problem.next_cell),
        problem.goals[k],
        rule.actions,
        problem.discount,
        rule.goal_value,
        rule.weights[0] * problem.goal_reward,
        rule.weights[2] * problem.ask_cost,
        rule.weights[1],
        rule.step_sizes,
        problem.sight,
        problem.interactions.swaps,
        problem.interactions.blocks,
        rule.map_samples,
        rule.replays,
        rule.leaves,
    )


@compiled_as(made_task)
def task_of(rule: Rule, k: int) -> Task:
    """Return the task of robot k."""
    task: Task = rule.tasks[k]
    return task


class GameState(NamedTuple):
    """A game in progress: the clock, each robot's cell, and whether it has arrived."""

    clock: Any
    cells: Any
    arrived: Any


class Choices(NamedTuple):
    """Each robot's choice at this time step.

    Attributes:
        cells: the cell that it was in; of robots that do not act, too.
        actions: A_k(t), as of `core.game.actions`.
        moves: the primitive action that it became.
        wanted: the cell to which it led, before robots stop each other.
        seen: the peers that it perceived by COORDINATE, the sum of 2^j; 0: it did not ask, or
            the percept failed.
        values: space for a row [move].
    """

    cells: Any
    actions: Any
    moves: Any
    wanted: Any
    seen: Any
    values: Any


class State(NamedTuple):
    """A run in progress, without the robots' minds.

    Attributes:
        rule: the game, and how the team learns.
        game: the joint state, changed.
        choice: the robots' choices, changed.
        keys: the keys of the robots' draws [role][k], from `keys_of`.
        stop: its one entry is set where the result is not wanted any more.
    """

    rule: Rule
    game: GameState
    choice: Choices
    keys: Any
    stop: Any


class Record(NamedTuple):
    """The learning history in the making: a row an episode.

    Fields are those of `core.runs.history.History`, and:

    Attributes:
        used: the number of rows in use [0]; the last one is that of the episode under way, or of
            the one that ended last.
    """

    used: Any
    first_step: Any
    length: Any
    returns: Any
    miscoordinations: Any
    asks: Any
    arrived: Any


@inner
def _row_in_arrays(record: Record, step: int) -> None:
    record.first_step[record.used[0]] = step
    record.used[0] += 1


@compiled_as(_row_in_arrays)
def begin_row(record: Record, step: int) -> None:
    """Begin the row of an episode."""
    team = record.used[1]
    record.first_step.append(step)
    record.length.append(0)
    record.returns.append([0.0] * team)
    record.miscoordinations.append(0)
    record.asks.append([0] * team)
    record.arrived.append([False] * team)
    record.used[0] += 1


@inlined
def begin(state: State, minds: Any, step: int) -> None:
    """Begin an episode: every robot at its start, or at an exploring start."""
    rule, game, choice, keys, _ = state
    clock = game.clock
    exploring = rule.exploring[min(step, len(rule.exploring) - 1)]
    for k in range(len(game.cells)):
        game.cells[k] = rule.problem.starts[k]
        choice.cells[k] = rule.problem.starts[k]
        game.arrived[k] = 1
    for k in rule.members:
        game.arrived[k] = 0
        game.cells[k] = start_of(rule.problem, keys, k, step, exploring)
        begin_episode(mind_of(minds, k), task_of(rule, k))
    clock[EPISODE_START] = step
    clock[PLACED] = 1


@inlined
def choose_all(state: State, minds: Any, step: int, epsilon: float) -> None:
    """Let every robot that has not arrived choose (Algorithm 1, lines 4 to 10)."""
    rule, game, choice, keys, _ = state
    cells = game.cells
    for k in rule.members:
        cell = int(cells[k])
        choice.cells[k] = cell
        if game.arrived[k]:
            continue
        mind = mind_of(minds, k)
        key = keys[ROBOT][k]
        action = choose(mind.q_star[cell], rule.actions, epsilon, key, step)
        move = action
        seen = 0
        if action == COORDINATE:
            seen = perceive(rule.problem, keys, k, step, cells)
            task = task_of(rule, k)
            move = choose_move(
                mind, task, cell, seen, cells, epsilon, key, step, choice.values
            )
        choice.actions[k] = action
        choice.moves[k] = move
        choice.seen[k] = seen


@inlined
def move_all(state: State, step: int) -> bool:
    """Move every robot that acts; return whether the step is a miscoordination."""
    rule, game, choice, keys, _ = state
    problem = rule.problem
    inter = problem.interactions
    cells = game.cells
    for k in rule.members:
        if not game.arrived[k]:
            cells[k] = led(problem, keys, k, step, cells[k], choice.moves[k])
        choice.wanted[k] = cells[k]
    settle(inter, choice.cells, cells, rule.members)
    return miscoordinate(inter, choice.cells, cells, rule.members)


@inner
def everybody_but(k: int, team: int) -> int:
    """Return all robots but one, as the sum of 2^j."""
    return ((1 << team) - 1) & ~(1 << k)


@inlined
def learn_from(
    state: State,
    minds: Any,
    k: int,
    step: int,
    felt: float,
    epsilon: float,
    floor: float,
) -> None:
    """Let robot k learn from the step that was made; it felt an r^C."""
    rule, game, choice, keys, _ = state
    problem = rule.problem
    weights = rule.weights
    cells = game.cells
    next_cell = int(cells[k])
    action = int(choice.actions[k])
    seen = choice.seen[k]
    mind = mind_of(minds, k)
    next_seen = 0
    if sees_all(mind):
        seen = next_seen = everybody_but(k, len(cells))
    partners = UNKNOWN_PARTNERS
    if wants_partners(mind):
        partners = interacting(
            problem.interactions, choice.cells, choice.wanted, cells, rule.members, k
        )
    replay = 0.0
    if wants_draw(mind):
        replay = draw(keys[ROBOT][k], step, REPLAY)
    now = Transition(
        step,
        int(choice.cells[k]),
        action,
        int(choice.moves[k]),
        seen,
        choice.cells,
        next_cell,
        next_seen,
        cells,
        weights[0] * individual_reward(problem, next_cell == problem.goals[k]),
        weights[1] * felt,
        felt,
        weights[2] * asking_reward(problem, action == COORDINATE),
        partners,
        epsilon,
        floor,
        replay,
    )
    learn(mind, task_of(rule, k), now)


def learn_until(state: State, minds: Any, record: Record | None, budget: int) -> None:
    """Learn until so many transitions are made, or until the time step at which to look up.

    Args:
        state: the run under way.
        minds: the robots' minds, changed.
        record: the history, added to; or None: numba compiles the loop for each by itself.
        budget: transitions to make from the run's beginning on.
    """
    rule, game, choice, _, _ = state
    problem = rule.problem
    members = rule.members
    clock = game.clock
    arrived = game.arrived
    cells = game.cells
    last = len(rule.epsilon) - 1
    step = clock[STEP]
    done = clock[DONE]
    end = clock[END]
    while done < budget and step < end and not state.stop[0]:
        if not clock[PLACED]:
            begin(state, minds, step)
            if record is not None:
                begin_row(record, step)
        scheduled = min(step, last)
        epsilon = rule.epsilon[scheduled]
        floor = rule.floors[scheduled]
        choose_all(state, minds, step, epsilon)
        conflict = move_all(state, step)
        if record is not None:
            row = record.used[0] - 1
            record.length[row] += 1
            record.miscoordinations[row] += conflict
        over = True
        for k in members:
            if arrived[k]:
                continue
            home = cells[k] == problem.goals[k]
            common = common_reward(problem, k, conflict)
            learn_from(state, minds, k, step, common, epsilon, floor)
            if record is not None:
                asked = choice.actions[k] == COORDINATE
                individual = individual_reward(problem, home)
                record.returns[row][k] += (
                    individual + common + asking_reward(problem, asked)
                )
                record.asks[row][k] += asked
                record.arrived[row][k] = home
            if home:
                arrived[k] = 1
            else:
                over = False
        step += 1
        done += 1
        if episode_ends(over, step - clock[EPISODE_START], rule.max_steps):
            step += EPISODE_GAP
            clock[PLACED] = 0
    clock[STEP] = step
    clock[DONE] = done


def play_until(
    state: State,
    minds: Any,
    results: Any,
    asked: Any,
    stays: Any,
    trials: int,
) -> None:
    """Play greedy trials until so many are played.

    Args:
        state: the game in progress, with trials of at most `max_steps` steps.
        minds: the robots' minds.
        results: filled, [trial][k][RETURN to CONFLICTS]; TIME is the horizon, and one more, for
            a robot that does not arrive.
        asked: counted up where COORDINATE is chosen, [k][x].
        stays: counted up where a robot acts, [k][x].
        trials: number of trials.
    """
    rule, game, choice, _, _ = state
    problem = rule.problem
    members = rule.members
    clock = game.clock
    cells = game.cells
    arrived = game.arrived
    discount = 1.0
    while clock[DONE] < trials and not state.stop[0]:
        if not clock[PLACED]:
            begin(state, minds, clock[STEP])
            discount = 1.0
        step = clock[STEP]
        trial = clock[DONE]
        elapsed = step + 1 - clock[EPISODE_START]
        choose_all(state, minds, step, 0.0)
        conflict = move_all(state, step)
        over = True
        for k in members:
            common = common_reward(problem, k, conflict)
            result = results[trial][k]
            result[CONFLICTS] += conflict
            if arrived[k]:
                result[RETURN] += discount * common
                continue
            cell = choice.cells[k]
            asks = choice.actions[k] == COORDINATE
            stays[k][cell] += 1
            if asks:
                result[ASKS] += 1
                asked[k][cell] += 1
            result[RETURN] += discount * (common + asking_reward(problem, asks))
            if cells[k] == problem.goals[k]:
                arrived[k] = 1
                result[TIME] = elapsed
                result[RETURN] += goal_paid(problem, discount)
            else:
                over = False
                result[TIME] = rule.max_steps + 1
        discount *= problem.discount
        clock[STEP] = step + 1
        if episode_ends(over, elapsed, rule.max_steps):
            clock[STEP] += EPISODE_GAP
            clock[PLACED] = 0
            clock[DONE] += 1


class Loops(NamedTuple):
    """The loops, ready to be called."""

    learn: Callable[..., None]
    play: Callable[..., None]
    tabulate: Callable[..., None]


PLAIN = Loops(learn_until, play_until, tabulate)
"""The loops as plain Python, on lists."""


@functools.cache
def compiled(learner: type[Any]) -> Loops:
    """Return the loops for a learner; they compile when first called."""
    return Loops(*jit(PLAIN, learner))
