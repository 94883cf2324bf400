# Copyright 2026 The sparse_coord_ros authors
# SPDX-License-Identifier: Apache-2.0
"""One episode as data, from a run's log, or played greedily on learned tables."""

import re
from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from sparse_coord_ros.base.errors import RunError
from sparse_coord_ros.core.game.draws import EVALUATION
from sparse_coord_ros.core.game.scenario import Scenario
from sparse_coord_ros.core.game.world import World
from sparse_coord_ros.core.learners.learner import Learner
from sparse_coord_ros.core.learners.tables import Tables
from sparse_coord_ros.core.runs.evaluation import GreedyTeam, greedy_team
from sparse_coord_ros.core.runs.history import History, HistoryRecorder
from sparse_coord_ros.core.runs.run import TeamTransition
from sparse_coord_ros.log.runlog.log import RunLog
from sparse_coord_ros.show.steps import logged_step

LAST = "last"
BEST = "best"
BUSIEST = "asks"
"""The episode with the most questions among those that end well."""

PLAYED = 100
PLAYED_STEPS = 2500
"""Number of greedy episodes for LAST, BEST and BUSIEST; fewer if they take more time steps, as a
failing team's do."""


@dataclass(frozen=True)
class Episode:
    """The transitions of one episode.

    Attributes:
        number: its number, from 0.
        greedy: True: played on learned tables; False: an episode of learning.
        steps: its transitions; each leads to `after`.
        arrived: whether all robots reached their goals.
    """

    number: int
    greedy: bool
    steps: tuple[TeamTransition, ...]
    arrived: bool


def episode_number(text: str) -> int | str:
    """Return the value of `--episode`: a number from 0, LAST, BEST or BUSIEST.

    Raises:
        RunError: any other text.
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
        wanted: its number; LAST: the last whole one; BEST: the one with the highest sum of
            rewards, then the shortest, then the latest, among those from the scenario's own starts
            (else among all) in which all arrive; BUSIEST: the same with the number of questions in
            place of the sum.

    Raises:
        RunError: the episode does not exist.
    """
    history = log.history()
    if not history.episodes:
        raise RunError(
            f"{log.path}: holds no episode to show: no transition is in the log; see "
            "'sparse_coord info'"
        )
    first = np.searchsorted(log.step, history.first_step)
    starts = [robot.start for robot in log.run.scenario.robots]
    from_starts = (log.cells[first] == starts).all(axis=1)
    number = chosen(wanted, history, from_starts, str(log.path))
    rows = range(first[number], first[number] + history.length[number])
    steps = tuple(logged_step(log, row) for row in rows)
    return Episode(number, log.run.greedy, steps, bool(history.arrived[number].all()))


def played_episode(
    scenario: Scenario,
    tables: Sequence[Tables],
    wanted: int | str,
    *,
    seed: int,
    learner: Learner | None = None,
) -> Episode:
    """Return a greedy episode from the scenario's starts, as `core.runs.evaluation.play` plays it.

    Args:
        scenario: the problem.
        tables: the tables of every robot.
        wanted: its number, below `PLAYED`, or a word as in `logged_episode`.
        seed: seed of its draws.
        learner: the learner whose greedy policy acts; None: that of the tables.

    Raises:
        TablesError: the tables do not fit the scenario.
        RunError: the episode does not exist.
    """
    team = greedy_team(scenario, tables, seed, learner)
    world = World(scenario, seed, phase=EVALUATION, max_steps=scenario.horizon)
    recorder = HistoryRecorder(scenario)
    played: list[tuple[TeamTransition, ...]] = []
    while len(played) < PLAYED and world.step < PLAYED_STEPS:
        played.append(tuple(_play(world, team, recorder)))
    history = recorder.so_far
    number = chosen(
        wanted, history, np.ones(len(played), dtype=bool), "greedy episodes"
    )
    return Episode(number, True, played[number], bool(history.arrived[number].all()))


def _play(
    world: World, team: GreedyTeam, recorder: HistoryRecorder
) -> Iterator[TeamTransition]:
    """Play an episode."""
    team.begin_episode(world)
    while not world.episode_over:
        step = world.step
        cells = tuple(world.cells)
        actions = team.act(world)
        outcome = world.advance(actions)
        recorder.add(world.episode, step, actions, outcome)
        after = tuple(world.cells)
        yield TeamTransition(
            step, cells, tuple(actions), after, outcome.miscoordination, outcome.rewards
        )


def chosen(
    wanted: int | str, history: History, from_starts: np.ndarray, source: str
) -> int:
    """Return an episode's number.

    Args:
        wanted: as in `logged_episode`.
        history: the episodes.
        from_starts: whether each began at the scenario's starts, shape (episodes,), bool.
        source: the name of their source, for an error.
    """
    count = history.episodes
    if isinstance(wanted, int):
        if wanted >= count:
            raise RunError(
                f"{source}: --episode is {wanted}, there are {count}; allowed: 0 to {count - 1}, "
                f"{LAST}, {BEST} or {BUSIEST}"
            )
        return wanted
    whole = np.asarray(history.arrived.all(axis=1))
    if not whole.any():
        whole = ~whole
    if wanted == LAST:
        return int(np.flatnonzero(whole)[-1])
    if (whole & from_starts).any():
        whole &= from_starts
    numbers = np.flatnonzero(whole)
    keys = [numbers, -history.length[numbers], history.returns[numbers].sum(axis=1)]
    if wanted == BUSIEST:
        keys.append(history.asks[numbers].sum(axis=1))
    return int(numbers[np.lexsort(keys)[-1]])
