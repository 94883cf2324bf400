# Copyright 2026 The sparse_coord_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Many games at once as arrays, for learners that act from outside.

Game i is the game of `core.game.world.World` with the seed of game i: the same draws, the same
rules. The functions run on arrays in compiled loops and in plain Python. In all of them i is a
game and k a robot.
"""

import functools
from collections.abc import Callable
from typing import Any, NamedTuple

import numpy as np

from sparse_coord_ros.base.compiling import has_numba, jit, jitable
from sparse_coord_ros.core.game.actions import ACTIONS, COORDINATE, PRIMITIVES
from sparse_coord_ros.core.game.draws import EVALUATION, keys_of
from sparse_coord_ros.core.game.interactions import miscoordinates, settle
from sparse_coord_ros.core.game.rules import (
    EPISODE_GAP,
    Problem,
    episode_ends,
    led,
    paid_for_ever,
    perceive,
    problem_of,
    rewards_of,
    start_of,
)
from sparse_coord_ros.core.game.scenario import Scenario
from sparse_coord_ros.core.game.schedules import probabilities
from sparse_coord_ros.core.game.world import FIRST_STEP

CELL, SECOND_HALF, ANSWERED, PEERS = range(4)
"""Columns of an observation: the own cell; whether it is the second half of a time step; whether
an answer came; from here on a column for each other robot: its cell plus 1, or 0."""

PARTS = 3
"""Parts of a reward: individual, common, cost of asking."""

WAIT = 0
"""The only action in the mask of a robot that has nothing to choose; it means nothing."""


class Games(NamedTuple):
    """Many games in progress.

    Attributes:
        problem: the scenario.
        team: number of robots.
        exploring: probability of an exploring start [time step].
        most_steps: steps after which an episode ends.
        in_halves: whether robots ask in the first half of a time step; else with their moves.
        keys: the keys of the robots' draws [i][role][k].
        step: the time step [i].
        first_step: that of the episode's beginning [i].
        half: whether it is the second half of a time step [i].
        ended: whether the episode has ended [i].
        cells: the cell of each robot [i][k].
        before: the cell in which it began its last time step [i][k].
        arrived: whether it has reached its goal [i][k].
        chosen: what it chose in this time step, a move or COORDINATE [i][k].
        seen: the peers that it perceives, the sum of 2^j [i][k].
    """

    problem: Problem
    team: int
    exploring: Any
    most_steps: int
    in_halves: bool
    keys: Any
    step: Any
    first_step: Any
    half: Any
    ended: Any
    cells: Any
    before: Any
    arrived: Any
    chosen: Any
    seen: Any


class Observations(NamedTuple):
    """What the robots observe.

    Attributes:
        observation: int64 [i][k][column].
        action_mask: whether an action is allowed, int8 [i][k][action].
    """

    observation: np.ndarray
    action_mask: np.ndarray


class Infos(NamedTuple):
    """Results of a call of `step_all`, beside the rewards.

    Attributes:
        half_step: whether the next call completes this time step, bool [i].
        miscoordination: whether the step ended in a miscoordination, bool [i].
        arrived: whether a robot has reached its goal, bool [i][k].
        reward_parts: r^I_k, r^C and minus the cost of asking, float64 [i][k][part].
    """

    half_step: np.ndarray
    miscoordination: np.ndarray
    arrived: np.ndarray
    reward_parts: np.ndarray


class Outcome(NamedTuple):
    """Rewards and ends.

    Attributes:
        reward: what a step pays, a goal's for ever, float64 [i][k].
        terminated: whether all robots have arrived with this step, bool [i].
        truncated: whether the steps are used up with this step, bool [i].
    """

    reward: np.ndarray
    terminated: np.ndarray
    truncated: np.ndarray


def room_for_games(
    scenario: Scenario, games: int, *, phase: int, in_halves: bool
) -> Games:
    """Return memory for games; `seed_one` and `begin` fill it.

    Args:
        scenario: the problem.
        games: number of games.
        phase: LEARNING or EVALUATION.
        in_halves: as in `Games`.
    """
    team = len(scenario.robots)
    exploring = np.zeros(1)
    if phase != EVALUATION:
        exploring = probabilities(scenario.starts, scenario.steps)
    return Games(
        problem=problem_of(scenario),
        team=team,
        exploring=exploring,
        most_steps=longest_episode(scenario, phase),
        in_halves=in_halves,
        keys=np.zeros((games, 2, team), dtype=np.uint64),
        step=np.zeros(games, dtype=np.int64),
        first_step=np.zeros(games, dtype=np.int64),
        half=np.zeros(games, dtype=np.bool_),
        ended=np.zeros(games, dtype=np.bool_),
        cells=np.zeros((games, team), dtype=np.int64),
        before=np.zeros((games, team), dtype=np.int64),
        arrived=np.zeros((games, team), dtype=np.bool_),
        chosen=np.zeros((games, team), dtype=np.int64),
        seen=np.zeros((games, team), dtype=np.int64),
    )


def longest_episode(scenario: Scenario, phase: int) -> int:
    """Return after how many steps an episode ends."""
    return scenario.horizon if phase == EVALUATION else scenario.max_steps


def seed_one(games: Games, i: int, seed: int, phase: int) -> None:
    """Let a game be at the beginning of the run with a seed; its first episode is yet to begin."""
    games.step[i] = FIRST_STEP - EPISODE_GAP
    games.keys[i] = keys_of(seed, phase, games.team)


def actions_of(games: Games) -> int:
    """Return the number of actions: in halves 5, else each move without and with asking."""
    return len(ACTIONS) if games.in_halves else 2 * PRIMITIVES


def new_observations(games: Games) -> Observations:
    """Return memory for the observations."""
    n, team = games.cells.shape
    columns = PEERS + team - 1
    return Observations(
        np.empty((n, team, columns), dtype=np.int64),
        np.empty((n, team, actions_of(games)), dtype=np.int8),
    )


def new_infos(games: Games) -> Infos:
    """Return memory for the infos of a step."""
    n, team = games.cells.shape
    return Infos(
        np.empty(n, dtype=np.bool_),
        np.empty(n, dtype=np.bool_),
        np.empty((n, team), dtype=np.bool_),
        np.empty((n, team, PARTS)),
    )


def new_outcome(games: Games) -> Outcome:
    """Return memory for rewards and ends."""
    n, team = games.cells.shape
    return Outcome(
        np.empty((n, team)), np.empty(n, dtype=np.bool_), np.empty(n, dtype=np.bool_)
    )


@jitable
def is_allowed(action: int, waits: bool, half: bool, chosen: int) -> bool:
    """Return whether a robot may choose an action now.

    Args:
        action: the action.
        waits: whether the robot has nothing to choose: it has arrived, or the episode has ended.
        half: whether it is the second half of a time step.
        chosen: what the robot chose in the first half.
    """
    if waits:
        return action == WAIT
    if not half:
        return True
    if chosen == COORDINATE:
        return action != COORDINATE
    return action == chosen


def first_refused(actions: Any, games: Games, allowed: Any) -> int:
    """Return the index i * robots + k of the first action that is not allowed; -1: all are.

    Args:
        actions: the action of each robot [i][k].
        games: the games.
        allowed: the masks of the last observations [i][k][action].
    """
    team = games.team
    for i in range(len(games.step)):
        if games.ended[i]:
            continue
        for k in range(team):
            if games.arrived[i, k]:
                continue
            action = actions[i, k]
            known = 0 <= action < allowed.shape[2]
            if not known or not allowed[i, k, action]:
                return i * team + k
    return -1


@jitable
def begin(games: Games, i: int) -> None:
    """Begin the next episode of a game."""
    keys = games.keys[i]
    step = int(games.step[i]) + EPISODE_GAP
    exploring = games.exploring[min(step, len(games.exploring) - 1)]
    for k in range(games.team):
        games.cells[i, k] = start_of(games.problem, keys, k, step, exploring)
        games.arrived[i, k] = False
        games.seen[i, k] = 0
    games.step[i] = step
    games.first_step[i] = step
    games.half[i] = False
    games.ended[i] = False


@jitable
def ask_first(games: Games, i: int, actions: Any) -> bool:
    """Make the first half of a time step; return whether any robot asks."""
    keys = games.keys[i]
    step = int(games.step[i])
    asks = False
    for k in range(games.team):
        games.chosen[i, k] = actions[i, k]
        if actions[i, k] == COORDINATE and not games.arrived[i, k]:
            asks = True
            games.seen[i, k] = perceive(games.problem, keys, k, step, games.cells[i])
    return asks


@jitable
def choose_both(games: Games, i: int, actions: Any) -> None:
    """Note which robots ask with their moves; they perceive after the moves."""
    for k in range(games.team):
        asks = actions[i, k] >= PRIMITIVES
        games.chosen[i, k] = COORDINATE if asks else actions[i, k]


@jitable
def move(games: Games, i: int, actions: Any, outcome: Outcome, infos: Infos) -> None:
    """Complete a time step: moves, rewards, ends."""
    problem = games.problem
    keys = games.keys[i]
    step = int(games.step[i])
    inter = problem.interactions
    cells = games.cells[i]
    before = games.before[i]
    for k in range(games.team):
        before[k] = cells[k]
        if not games.arrived[i, k]:
            cells[k] = led(problem, keys, k, step, cells[k], actions[i, k] % PRIMITIVES)
    settle(inter, before, cells)
    conflict = miscoordinates(inter, before, cells)
    over = True
    for k in range(games.team):
        acts = not games.arrived[i, k]
        home = acts and cells[k] == problem.goals[k]
        asked = acts and games.chosen[i, k] == COORDINATE
        individual, common, ask_cost = rewards_of(problem, k, conflict, home, asked)
        outcome.reward[i, k] = paid_for_ever(problem, home, common, ask_cost)
        infos.reward_parts[i, k, 0] = individual
        infos.reward_parts[i, k, 1] = common
        infos.reward_parts[i, k, 2] = ask_cost
        if home:
            games.arrived[i, k] = True
        over = over and games.arrived[i, k]
        games.seen[i, k] = 0
        if asked and not home and not games.in_halves:
            games.seen[i, k] = perceive(problem, keys, k, step + 1, cells)
    games.step[i] = step + 1
    games.half[i] = False
    elapsed = step + 1 - games.first_step[i]
    games.ended[i] = episode_ends(over, elapsed, games.most_steps)
    outcome.terminated[i] = over
    outcome.truncated[i] = games.ended[i] and not over
    infos.miscoordination[i] = conflict


@jitable
def clear_outcome(games: Games, i: int, outcome: Outcome) -> None:
    """Note that nothing is paid, and that nothing ends."""
    for k in range(games.team):
        outcome.reward[i, k] = 0.0
    outcome.terminated[i] = False
    outcome.truncated[i] = False


@jitable
def clear_infos(games: Games, i: int, infos: Infos) -> None:
    """Note that no step was made."""
    infos.miscoordination[i] = False
    for k in range(games.team):
        for part in range(PARTS):
            infos.reward_parts[i, k, part] = 0.0


@jitable
def advance(games: Games, i: int, actions: Any, outcome: Outcome, infos: Infos) -> None:
    """Make a time step of a game, or half of one."""
    if not games.in_halves:
        choose_both(games, i, actions)
    elif not games.half[i]:
        games.half[i] = ask_first(games, i, actions)
        if games.half[i]:
            clear_outcome(games, i, outcome)
            clear_infos(games, i, infos)
            return
    move(games, i, actions, outcome, infos)


@jitable
def observe(games: Games, i: int, shown: Observations, infos: Infos) -> None:
    """Fill in the observations and the infos of a game."""
    half = games.half[i]
    infos.half_step[i] = half
    for k in range(games.team):
        infos.arrived[i, k] = games.arrived[i, k]
        seen = games.seen[i, k]
        row = shown.observation[i, k]
        row[CELL] = games.cells[i, k]
        row[SECOND_HALF] = half
        row[ANSWERED] = seen != 0
        column = PEERS
        for j in range(games.team):
            if j != k:
                row[column] = games.cells[i, j] + 1 if seen >> j & 1 else 0
                column += 1
        waits = games.arrived[i, k] or games.ended[i]
        mask = shown.action_mask[i, k]
        for action in range(len(mask)):
            mask[action] = is_allowed(action, waits, half, games.chosen[i, k])


def begin_all(
    games: Games, which: Any, shown: Observations, outcome: Outcome, infos: Infos
) -> None:
    """Begin the next episode of some games.

    Args:
        games: the games, changed.
        which: whether a game is to begin [i].
        shown: filled.
        outcome: filled: nothing was paid.
        infos: filled.
    """
    for i in range(len(games.step)):
        if which[i]:
            begin(games, i)
        clear_outcome(games, i, outcome)
        clear_infos(games, i, infos)
        observe(games, i, shown, infos)


def step_all(
    games: Games, actions: Any, shown: Observations, outcome: Outcome, infos: Infos
) -> None:
    """Make a time step of every game, or half of one; a game that has ended begins anew.

    Args:
        games: the games, changed.
        actions: the action of each robot [i][k]; ignored where a robot waits.
        shown: filled.
        outcome: filled.
        infos: filled.
    """
    for i in range(len(games.step)):
        if games.ended[i]:
            begin(games, i)
            clear_outcome(games, i, outcome)
            clear_infos(games, i, infos)
        else:
            advance(games, i, actions, outcome, infos)
        observe(games, i, shown, infos)


class GameLoops(NamedTuple):
    """The loops, ready to be called."""

    first_refused: Callable[..., int]
    begin_all: Callable[..., None]
    step_all: Callable[..., None]


PLAIN = GameLoops(first_refused, begin_all, step_all)
"""The loops as plain Python."""


@functools.cache
def loops() -> GameLoops:
    """Return the loops, compiled where numba is installed; they compile when first called."""
    return GameLoops(*jit(PLAIN)) if has_numba() else PLAIN
