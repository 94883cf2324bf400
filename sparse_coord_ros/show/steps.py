# Copyright 2026 The sparse_coord_ros authors
# SPDX-License-Identifier: Apache-2.0
"""One time step of a team as data, from a log or live: every display of a team reads it."""

from collections.abc import Iterator, Sequence
from itertools import combinations, permutations
from typing import NamedTuple

import numpy as np

from sparse_coord_ros.base.palette import FAILED
from sparse_coord_ros.core.game.actions import ACTIONS
from sparse_coord_ros.core.game.interactions import (
    Interactions,
    exchanged,
    interactions_of,
    miscoordinates,
    stops,
    together,
)
from sparse_coord_ros.core.game.world import Action, Reward
from sparse_coord_ros.core.learners.agent import NOBODY
from sparse_coord_ros.core.runs.run import TeamTransition
from sparse_coord_ros.log.runlog.log import NONE, RunLog
from sparse_coord_ros.protocol.wire import PERCEPT, PerceptEnd

TRAIL = 60
"""Length of a trail in time steps."""


class Question(NamedTuple):
    """One COORDINATE.

    Attributes:
        asker: number of the robot that asks, from 0.
        peers: numbers of the robots that it asks.
        end: the end of its percept.
        move: the primitive action after it.
    """

    asker: int
    peers: tuple[int, ...]
    end: PerceptEnd
    move: int

    @property
    def outcome(self) -> str:
        """Its display: ANSWERED, REFUSED or FAILED."""
        return self.end.outcome

    def is_mutual_with(self, other: "Question") -> bool:
        """Return whether two robots ask each other."""
        return other.asker in self.peers and self.asker in other.peers

    def in_words(self, names: Sequence[str]) -> str:
        """Return it as a sentence."""
        whom = ", ".join(names[peer] for peer in self.peers) or "no peer"
        if len(self.peers) == len(names) - 1 > 1:
            whom = "all others"
        ended = "no answer" if self.outcome == FAILED else self.outcome
        return f"{names[self.asker]} asks {whom}: {ended}, goes {ACTIONS[self.move]}"


def questions_of(seen: TeamTransition) -> tuple[Question, ...]:
    """Return the questions of a time step, with asker and asked robot.

    Without a record of a percept's end, no answer was late: all robots were in one process.
    """
    questions = []
    for k, action in enumerate(seen.actions):
        if action is None or not action.asked:
            continue
        others = tuple(peer for peer in range(len(seen.actions)) if peer != k)
        peers = others if action.peer == NOBODY else (action.peer,)
        end = seen.ends[k] if seen.ends and not action.perceived else None
        if end is None:
            end = PerceptEnd.untold(perceived=action.perceived, peers=len(peers))
        questions.append(Question(k, peers, PerceptEnd(end), action.move))
    return tuple(questions)


def logged_step(log: RunLog, row: int) -> TeamTransition:
    """Return a time step of a log, given by its row; None for missing values.

    The end of a percept is the one that the robot recorded; an unknown end counts as late.
    """
    logged = zip(
        log.move[row], log.asked[row], log.peer[row], log.perceived[row], strict=True
    )
    rewards = [
        None if np.isnan(numbers).any() else Reward(*numbers.tolist())
        for numbers in log.rewards[row]
    ]
    followed = row + 1 < len(log.step) and log.step[row + 1] == log.step[row] + 1
    acted = followed and any(reward is not None for reward in rewards)
    actions = tuple(
        None
        if move == NONE
        else Action(int(move), bool(asked), int(peer), bool(perceived))
        for move, asked, peer, perceived in logged
    )
    after = _known(log.cells[row + 1]) if followed else None
    met = False
    if acted:
        inter = interactions_of(log.run.scenario)
        met = miscoordinates(inter, log.cells[row], log.cells[row + 1])
    codes = [PerceptEnd.from_number(end) for end in log.column(PERCEPT.name)[row]]
    ends = [PerceptEnd.LATE if end is None else end for end in codes]
    step = int(log.step[row])
    cells = _known(log.cells[row])
    return TeamTransition(step, cells, actions, after, met, rewards, ends)


class Interacting(NamedTuple):
    """The interactions of robots in one time step; robots count from 0.

    Attributes:
        together: the cells of robots that end the step together, ascending.
        exchanges: pairs of robots that exchange their cells.
        stopped: robots that try to enter a cell and stay: the robot, the robot in its way, and the
            cell.
    """

    together: tuple[int, ...]
    exchanges: tuple[tuple[int, int], ...]
    stopped: tuple[tuple[int, int, int], ...]


NOT_INTERACTING = Interacting((), (), ())


def interacting_in(
    inter: Interactions, next_cell: np.ndarray, seen: TeamTransition
) -> Interacting:
    """Return the interactions of robots in a time step.

    Args:
        inter: the interactions of the scenario.
        next_cell: the cell to which each move leads, shape (cells, 4).
        seen: the time step.
    """
    if seen.after is None:
        return NOT_INTERACTING
    if not (seen.miscoordination or inter.blocks):
        return NOT_INTERACTING
    before = _column(seen.cells)
    after = _column(seen.after)
    moves = _column(
        [None if action is None else action.move for action in seen.actions]
    )
    shared: tuple[int, ...] = ()
    pairs: list[tuple[int, int]] = []
    if seen.miscoordination:
        known = [cell for cell in seen.after if cell is not None]
        shared = _shared(inter, known)
        exchanges = exchanges_in(inter, before, after)
        pairs = [(k, j) for k, j, happened in exchanges if happened[0]]
    blocked = []
    for k, j, happened in stops_in(inter, next_cell, before, moves, after):
        if happened[0]:
            blocked.append((k, j, int(next_cell[before[k, 0], moves[k, 0]])))
    return Interacting(shared, tuple(pairs), tuple(blocked))


def _shared(inter: Interactions, cells: Sequence[int]) -> tuple[int, ...]:
    """Return the cells of robots that are together, ascending."""
    cells_together = set()
    for x, y in combinations(cells, 2):
        if together(inter.places[x], inter.places[y]):
            cells_together |= {x, y}
    return tuple(sorted(cells_together))


def _column(values: Sequence[int | None]) -> np.ndarray:
    """Return numbers, shape (K, 1), with NONE in place of None."""
    return np.array([[NONE if value is None else value] for value in values])


def exchanges_in(
    inter: Interactions, before: np.ndarray, after: np.ndarray
) -> Iterator[tuple[int, int, np.ndarray]]:
    """Yield each pair of robots, and whether it exchanges its cells in each step, shape (T,).

    Args:
        inter: the interactions of the scenario.
        before: the cell of each robot before each step, shape (K, T); NONE: not known.
        after: the cell in which it ended, same shape.
    """
    if not inter.swaps:
        return
    for k, j in combinations(range(len(before)), 2):
        yield k, j, exchanged(inter.passages, before[k], after[k], before[j], after[j])


def stops_in(
    inter: Interactions,
    next_cell: np.ndarray,
    before: np.ndarray,
    moves: np.ndarray,
    after: np.ndarray,
) -> Iterator[tuple[int, int, np.ndarray]]:
    """Yield each two robots, and whether the second stops the first in each step, shape (T,).

    A move of a stopped robot may have failed as well: it could not have succeeded.

    Args:
        inter: the interactions of the scenario.
        next_cell: the cell to which each move leads, shape (cells, 4).
        before: the cell of each robot before each step, shape (K, T); NONE: not known.
        moves: the move that it chose, same shape; NONE: it did not act.
        after: the cell in which it ended, same shape.

    Yields:
        Numbers of the two robots, and bools of shape (T,).
    """
    if not inter.blocks:
        return
    known = (before != NONE) & (after != NONE)
    wanted = np.where(known & (moves != NONE), next_cell[before, moves], before)
    stays = known & (after == before) & (wanted != before) & inter.narrow[wanted]
    for k, j in permutations(range(len(before)), 2):
        stopped = stops(wanted[k], before[k], before[j], after[j], j < k)
        yield k, j, stopped & stays[k] & known[j]


def trails_of(
    passed: Sequence[Sequence[int | None]], next_cell: np.ndarray
) -> list[list[int]]:
    """Return the last cells of each robot, the oldest first, its current cell last.

    A trail begins after the last cell that is unknown, or not beside the next one.

    Args:
        passed: the robots' cells at successive time steps, the newest last.
        next_cell: the cell to which each move leads, shape (cells, 4).
    """
    trails = []
    for cells in zip(*passed, strict=True):
        trail: list[int] = []
        for cell in reversed(cells):
            if cell is None:
                break
            if trail and cell == trail[0]:
                continue
            if trail and cell not in next_cell[trail[0]]:
                break
            trail.insert(0, cell)
        trails.append(trail)
    return trails


def logged_trails(log: RunLog, row: int) -> list[list[int]]:
    """Return the trails of the robots at a time step of a log, given by its row."""
    begin = int(np.searchsorted(log.episode, log.episode[row]))
    cells = log.cells[max(begin, row + 1 - TRAIL) : row + 1]
    return trails_of(
        [_known(row_cells) for row_cells in cells], log.run.scenario.map.next_cell
    )


def _known(cells: np.ndarray) -> tuple[int | None, ...]:
    """Return cells, shape (K,), with None in place of NONE."""
    return tuple(None if cell == NONE else cell for cell in cells.tolist())
