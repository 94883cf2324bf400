# Copyright 2026 The sparse_coord_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The random draws of a run: from NumPy's streams, or for compiled loops single draws of them.

Compiled loops skip draws that are not used: a jump of the generator makes a draw without the
draws before it (`core.game.pcg64`). The bits are those of `core.game.streams`.
"""

import functools
from typing import Any, NamedTuple

import numpy as np

from sparse_coord_ros.base.compiling import compiled_as, inlined, inner
from sparse_coord_ros.core.game.pcg64 import (
    MOST,
    jump_table,
    jumped,
    source_of,
    uniform,
)
from sparse_coord_ros.core.game.perception import sight_of
from sparse_coord_ros.core.game.scenario import Scenario
from sparse_coord_ros.core.game.sight import is_drawn
from sparse_coord_ros.core.game.streams import DRAWS, LEARNING, PERCEPT, Stream

WIDTHS = tuple(DRAWS.values())
"""Draws that a time step owns [role]."""

JUMPS = jump_table()
"""As of `CompiledDraws`."""


def are_percepts_drawn(scenario: Scenario) -> bool:
    """Return whether percepts need draws."""
    return is_drawn(sight_of(scenario.perception, scenario.map))


class PlainDraws:
    """The draws of a run for plain Python.

    Args:
        scenario: the problem.
        seed: the run's seed.
        phase: LEARNING or EVALUATION.
    """

    def __init__(self, scenario: Scenario, seed: int, phase: int = LEARNING) -> None:
        team = range(len(scenario.robots))
        self._scenario = scenario
        self.streams = [[Stream(seed, k, role, phase) for k in team] for role in DRAWS]

    @functools.cached_property
    def percepts_drawn(self) -> bool:
        """Whether percepts need draws; the model of percepts may be unknown until then."""
        return are_percepts_drawn(self._scenario)


class CompiledDraws(NamedTuple):
    """The draws of a run for compiled loops.

    Attributes:
        percepts_drawn: whether percepts need draws.
        sources: a generator at a time step's beginning, as of `pcg64.source_of`,
            [role, k, word]; 0 for roles that are not used.
        since: that time step [role, k].
        jumps: as of `pcg64.jump_table`.
    """

    percepts_drawn: bool
    sources: np.ndarray
    since: np.ndarray
    jumps: np.ndarray


def compiled_draws(
    scenario: Scenario,
    seed: int,
    phase: int,
    looked_at: dict[int, bool],
    members: np.ndarray,
    first: int,
) -> CompiledDraws:
    """Return the draws of a run for compiled loops.

    Args:
        scenario: the problem.
        seed: the run's seed.
        phase: LEARNING or EVALUATION.
        looked_at: whether the draws of a role are used; other roles need no generator.
        members: the robots that act.
        first: the time step that they begin with.
    """
    team = len(scenario.robots)
    sources = _sources(team, seed, phase, looked_at, members, first)
    since = np.full((len(DRAWS), team), first)
    return CompiledDraws(are_percepts_drawn(scenario), sources, since, JUMPS)


def _sources(
    team: int,
    seed: int,
    phase: int,
    looked_at: dict[int, bool],
    members: np.ndarray,
    first: int,
) -> np.ndarray:
    """Return the generators of a run, as of `CompiledDraws`; arguments as of `compiled_draws`."""
    sources = np.zeros((len(DRAWS), team, 4), dtype=np.uint64)
    for role, width in DRAWS.items():
        for k in members.tolist() if looked_at.get(role) else ():
            sources[role, k] = source_of(seed, k, role, phase, first * width)
    return sources


def room_for_draws(scenario: Scenario, games: int) -> CompiledDraws:
    """Return room for the draws of many games.

    `sources` and `since` have a first axis more: row i is that of game i.

    Args:
        scenario: the problem.
        games: number of games.
    """
    team = len(scenario.robots)
    sources = np.zeros((games, len(DRAWS), team, 4), dtype=np.uint64)
    since = np.zeros((games, len(DRAWS), team), dtype=np.int64)
    return CompiledDraws(are_percepts_drawn(scenario), sources, since, JUMPS)


def seed_game(
    draws: CompiledDraws,
    game: int,
    scenario: Scenario,
    seed: int,
    phase: int,
    looked_at: dict[int, bool],
    first: int,
) -> None:
    """Fill in the draws of one of many games.

    Args:
        draws: the draws of all games, changed.
        game: the game's number.
        scenario: as of `compiled_draws`, as the next four.
        seed: the game's seed.
        phase: LEARNING or EVALUATION.
        looked_at: whether the draws of a role are used.
        first: the time step with which the game begins.
    """
    team = len(scenario.robots)
    members = np.arange(team)
    draws.sources[game] = _sources(team, seed, phase, looked_at, members, first)
    draws.since[game] = first


@inlined
def _rows_of_game(draws: CompiledDraws, game: int) -> CompiledDraws:
    return CompiledDraws(
        draws.percepts_drawn, draws.sources[game], draws.since[game], draws.jumps
    )


@compiled_as(_rows_of_game)
def draws_of_game(draws: Any, game: int) -> Any:
    """Return the draws of one of many games: in plain Python they are a list of `PlainDraws`."""
    return draws[game]


@inlined
def _jumped_to(
    draws: CompiledDraws, role: int, k: int, step: int, column: int
) -> float:
    """As `drawn`; of each role and robot the time step is not before the last one's."""
    source = draws.sources[role, k]
    width = WIDTHS[role]
    steps = step - draws.since[role, k]
    if (steps + 1) * width > MOST:
        _go_on(draws, role, k, step)
        steps = 0
    high, low = jumped(source, draws.jumps[steps * width + column + 1])
    return uniform(high, low)


@inner
def _go_on(draws: CompiledDraws, role: int, k: int, step: int) -> None:
    """Advance a generator to a time step's beginning."""
    source = draws.sources[role, k]
    width = WIDTHS[role]
    while draws.since[role, k] < step:
        steps = min(step - draws.since[role, k], MOST // width)
        high, low = jumped(source, draws.jumps[steps * width])
        source[0] = high
        source[1] = low
        draws.since[role, k] += steps


@compiled_as(_jumped_to)
def drawn(draws: Any, role: int, k: int, step: int, column: int) -> float:
    """Return a draw of robot k in a role at a time step."""
    draw: float = draws.streams[role][k].at(step)[column]
    return draw


@inlined
def percept_draw(draws: Any, k: int, step: int) -> float:
    """Return the draw of robot k's percept."""
    return drawn(draws, PERCEPT, k, step, 0) if draws.percepts_drawn else 0.0
