# Copyright 2026 The sparse_coord_ros authors
# SPDX-License-Identifier: Apache-2.0
"""One episode as data: who was where, who asked whom, and how each question ended.

Either from a run's log, or played greedily on learned tables.
"""

import re
from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from sparse_coord_ros.errors import RunError
from sparse_coord_ros.game.actions import ACTIONS
from sparse_coord_ros.game.miscoordination import miscoordinations
from sparse_coord_ros.game.scenario import Scenario
from sparse_coord_ros.game.streams import EVALUATION
from sparse_coord_ros.game.world import World
from sparse_coord_ros.learn.agent import NOBODY, Tables
from sparse_coord_ros.learn.evaluation import greedy_team
from sparse_coord_ros.learn.learners import Learner
from sparse_coord_ros.learn.simulation import Team
from sparse_coord_ros.palette import ANSWERED, FAILED, REFUSED
from sparse_coord_ros.runlog.log import RunLog
from sparse_coord_ros.runlog.percepts import ENDED
from sparse_coord_ros.wire import REFUSED as NOT_PERCEIVED

LAST, BEST = "last", "best"
PLAYED = 100
"""Greedy episodes among which `best` and `last` choose."""

BUSIEST = "asks"
"""Besides: the episode with the most questions among those that end well."""


class Ask(NamedTuple):
    """One question.

    Attributes:
        asker: number of the robot that asks, from 0.
        peers: whom it asks.
        outcome: ANSWERED, REFUSED or FAILED.
        move: the primitive action that it became.
    """

    asker: int
    peers: tuple[int, ...]
    outcome: str
    move: int

    def in_words(self, names: Sequence[str]) -> str:
        """Return it as a sentence."""
        whom = ", ".join(names[peer] for peer in self.peers) or "nobody"
        if len(self.peers) == len(names) - 1 > 1:
            whom = "all others"
        ended = {ANSWERED: "answered", REFUSED: "refused", FAILED: "no answer"}[self.outcome]
        return f"{names[self.asker]} asks {whom}: {ended}, goes {ACTIONS[self.move]}"


@dataclass(frozen=True)
class Episode:
    """T transitions of K robots.

    Attributes:
        number: of the episode, from 0, among `of`.
        of: how many episodes there are.
        greedy: whether it was played on learned tables, not learned in.
        first_step: time step at which it begins.
        cells: where each robot is before each transition and after the last, shape (T + 1, K);
            NONE (-1) where the log does not say.
        asks: the questions of each time step, T tuples.
        conflicts: whether a transition ended in a miscoordination, shape (T,), bool.
        reward: undiscounted sum of each robot's rewards until its arrival, shape (K,).
        arrived: which robots reached their goals, shape (K,), bool.
    """

    number: int
    of: int
    greedy: bool
    first_step: int
    cells: np.ndarray
    asks: tuple[tuple[Ask, ...], ...]
    conflicts: np.ndarray
    reward: np.ndarray
    arrived: np.ndarray

    @property
    def length(self) -> int:
        """Transitions, T."""
        return len(self.conflicts)


def episode_number(text: str) -> int | str:
    """Return what `--episode` says: a number from 0, LAST, BEST or BUSIEST.

    Raises:
        RunError: none of these.
    """
    if text in (LAST, BEST, BUSIEST):
        return text
    if not re.fullmatch("[0-9]{1,9}", text):
        raise RunError(
            f"--episode is {text[:40]!r}: give the number of an episode, from 0, or one of "
            f"{LAST}, {BEST}, {BUSIEST}"
        )
    return int(text)


def logged_episode(log: RunLog, wanted: int | str) -> Episode:
    """Return an episode of a run's log.

    Args:
        log: the log.
        wanted: its number; LAST: the last whole one; BEST: of those from the scenario's own starts
            (of all, where there is none) in which all arrive, the one of the highest reward, then
            the shortest, then the latest; BUSIEST: the same by the number of questions.

    Raises:
        RunError: there is no such episode.
    """
    history = log.history()
    if not history.episodes:
        raise RunError(
            f"{log.bag.path}: holds no episode to show: no transition is in the log; see "
            "'sparse_coord info'"
        )
    first = np.searchsorted(log.step, history.first_step)
    starts = [robot.start for robot in log.run.scenario.robots]
    whole = np.asarray(history.arrived.all(axis=1))
    place = _chosen(
        wanted,
        whole=whole if whole.any() else np.ones(history.episodes, dtype=bool),
        own=(log.cells[first] == starts).all(axis=1),
        reward=history.reward.sum(axis=1),
        length=history.length,
        asks=history.asks.sum(axis=1),
        where=str(log.bag.path),
    )
    begin, length = int(first[place]), int(history.length[place])
    cells = log.cells[begin : begin + length + 1]
    return Episode(
        number=place,
        of=history.episodes,
        greedy=log.run.greedy,
        first_step=int(history.first_step[place]),
        cells=cells,
        asks=tuple(logged_asks(log, row) for row in range(begin, begin + length)),
        conflicts=miscoordinations(log.run.scenario, cells[1:]),
        reward=history.reward[place],
        arrived=history.arrived[place],
    )


def logged_asks(log: RunLog, row: int) -> tuple[Ask, ...]:
    """Return the questions of a time step of a log, given by its row."""
    robots = range(len(log.names))
    return tuple(
        Ask(
            asker=k,
            peers=(
                tuple(other for other in robots if other != k)
                if log.peer[row, k] == NOBODY
                else (int(log.peer[row, k]),)
            ),
            outcome=_outcome(log, row, k),
            move=int(log.move[row, k]),
        )
        for k in np.flatnonzero(log.asked[row]).tolist()
    )


def _outcome(log: RunLog, row: int, k: int) -> str:
    if log.perceived[row, k]:
        return ANSWERED
    if log.tracks.format > 1:
        return REFUSED if log.numbers[row, k, ENDED] == NOT_PERCEIVED else FAILED
    step = int(log.step[row])
    last = next((r for r in reversed(log.requests) if (r.asker, r.step) == (k, step)), None)
    return FAILED if last is None or last.answer is None or last.answer[0] < step else REFUSED


def outcomes(log: RunLog) -> dict[str, np.ndarray]:
    """Return where in a log, shape (T, K), bool, questions ended so, by each outcome."""
    answered = log.asked & log.perceived
    refused = log.asked & (log.numbers[..., ENDED] == NOT_PERCEIVED) & ~answered
    if log.tracks.format == 1:
        for row, k in np.argwhere(log.asked & ~log.perceived).tolist():
            refused[row, k] = _outcome(log, row, k) == REFUSED
    return {ANSWERED: answered, REFUSED: refused, FAILED: log.asked & ~answered & ~refused}


def _chosen(
    wanted: int | str,
    *,
    whole: np.ndarray,
    own: np.ndarray,
    reward: np.ndarray,
    length: np.ndarray,
    asks: np.ndarray,
    where: str,
) -> int:
    count = len(length)
    if isinstance(wanted, int):
        if wanted >= count:
            raise RunError(
                f"{where}: --episode is {wanted}, there are {count}; allowed: 0 to {count - 1}, "
                f"{LAST}, {BEST} or {BUSIEST}"
            )
        return wanted
    if wanted == LAST:
        return int(np.flatnonzero(whole)[-1])
    among = np.flatnonzero(whole & own) if (whole & own).any() else np.flatnonzero(whole)
    keys = (among, -length[among], reward[among])
    return int(among[np.lexsort((*keys, asks[among]) if wanted == BUSIEST else keys)[-1]])


def played_episode(
    scenario: Scenario,
    tables: Sequence[Tables],
    wanted: int | str,
    *,
    seed: int,
    learner: Learner | None = None,
) -> Episode:
    """Return a greedy episode from the scenario's starts, as `learn.evaluation.play` plays it.

    Args:
        scenario: the problem.
        tables: of every robot.
        wanted: its number, below `PLAYED`, or what `logged_episode` takes.
        seed: of its draws.
        learner: whose greedy policy acts; None: the one that the tables are for.

    Raises:
        TablesError: the tables do not fit the scenario.
        RunError: there is no such episode.
    """
    team = greedy_team(scenario, tables, seed, learner)
    world = World(scenario, seed, phase=EVALUATION, max_steps=scenario.horizon)
    count = wanted + 1 if isinstance(wanted, int) and wanted < PLAYED else PLAYED
    played = [_play(world, team, number) for number in range(count)]
    whole = np.array([one.arrived.all() for one in played])
    place = _chosen(
        wanted,
        whole=whole if whole.any() else np.ones(count, dtype=bool),
        own=np.ones(count, dtype=bool),
        reward=np.array([one.reward.sum() for one in played]),
        length=np.array([one.length for one in played]),
        asks=np.array([sum(map(len, one.asks)) for one in played]),
        where="greedy episodes",
    )
    return played[place]


def _play(world: World, team: Team, number: int) -> Episode:
    world.begin_episode()
    first, cells, asks, conflicts = world.step, [list(world.cells)], [], []
    reward, over = np.zeros(len(world.cells)), False
    while not over:
        choices, actions = team.act(world)
        asked = []
        for k, (choice, action) in enumerate(zip(choices, actions, strict=True)):
            if choice is not None and action is not None and action.asked:
                peers = choice[1].peers
                outcome = FAILED if not peers else ANSWERED if action.perceived else REFUSED
                asked.append(Ask(k, peers, outcome, action.move))
        outcome_of_step = world.advance(actions)
        cells.append(list(world.cells))
        asks.append(tuple(asked))
        conflicts.append(outcome_of_step.miscoordination)
        for k, action in enumerate(actions):
            if action is not None:
                reward[k] += outcome_of_step.rewards[k].total
        over = outcome_of_step.episode_over
    return Episode(
        number=number,
        of=PLAYED,
        greedy=True,
        first_step=first,
        cells=np.array(cells),
        asks=tuple(asks),
        conflicts=np.array(conflicts, dtype=bool),
        reward=reward,
        arrived=np.array(world.arrived),
    )
