# Copyright 2026 The sparse_coord_ros authors
# SPDX-License-Identifier: Apache-2.0
"""A team's tables at any time step, learned again from the recorded checkpoint before it."""

from collections.abc import Callable, Sequence
from typing import NamedTuple

import numpy as np

from sparse_coord_ros.core.game.rules import EPISODE_GAP
from sparse_coord_ros.core.learners.tables import Tables
from sparse_coord_ros.log.runlog.explain import Reason, reason_of
from sparse_coord_ros.log.runlog.growing import GrowingLog
from sparse_coord_ros.log.runlog.log import RecordedTables
from sparse_coord_ros.log.runlog.replay import Replay, agent_with, trajectory_of

AT_ONCE = 2000
"""Number of time steps that are read and learned again at once."""

MOST_BYTES = 100_000_000
"""Approximate limit of the bytes of kept tables; the oldest ones are dropped first."""


class AskedQuestion(NamedTuple):
    """A question and its percept.

    Attributes:
        robot: the asking robot, from 0.
        cell: its cell.
        perceived: the cells of the peers that it perceived; None: the percept failed.
    """

    robot: int
    cell: int
    perceived: tuple[int, ...] | None


class _Part(NamedTuple):
    """A part of a log that is learned again.

    Attributes:
        first: its first time step.
        steps: for each robot the time steps of its actions.
        replays: for each robot its replay.
    """

    first: int
    steps: list[np.ndarray]
    replays: list[Replay]

    def advance(self, step: int) -> bool:
        """Advance to a time step; return whether the agents chose all logged actions."""
        pairs = zip(self.steps, self.replays, strict=True)
        return all(
            [
                replay.advance(int(np.searchsorted(steps, step)))
                for steps, replay in pairs
            ]
        )


class Relearned:
    """Computes a team's tables at any time step, and keeps some for the next call.

    Args:
        log: the log.
    """

    def __init__(self, log: GrowingLog) -> None:
        self._log = log
        self._kept: dict[int, list[RecordedTables]] = {}
        self._at = 0
        self._part: _Part | None = None

    def _recorded(self, step: int) -> list[RecordedTables]:
        """Return each robot's newest recorded tables up to a time step, if it has any."""
        robots = range(len(self._log.run.scenario.robots))
        newest = (self._log.so_far.tables_before(k, step) for k in robots)
        return [tables for tables in newest if tables is not None]

    def tables(
        self, step: int, still: Callable[[], bool] = lambda: True
    ) -> dict[int, tuple[int, Tables]]:
        """Return, by robot, the time step up to which it had learned, and its tables then.

        The time step is `step`. If a part of the log is lost or incomplete, or the learner's code
        may not be imported, it is that of the newest recorded tables. A robot without any is left
        out. The next call may change these tables.

        Args:
            step: the time step.
            still: returns whether the tables are still needed; if not, the newest recorded tables
                are returned.

        Raises:
            BagError, TablesError: the log or its tables cannot be read.
        """
        run = self._log.run
        recorded = self._recorded(step)
        if run.greedy or all(entry.step == step for entry in recorded):
            return {entry.robot: (step, entry.tables) for entry in recorded}
        part = None if run.known_rule is None else self._reached(step, still)
        if part is None:
            return {entry.robot: (entry.step, entry.tables) for entry in recorded}
        agents = [replay.agent for replay in part.replays]
        return {agent.number: (step, agent.tables) for agent in agents}

    def begin(self, step: int) -> int:
        """Return the first time step of the log that is learned again for the tables of `step`."""
        first = self._first(step)
        if first is None:
            return step
        if self._part is not None and first <= self._at <= step:
            return self._at
        return first

    def _first(self, step: int) -> int | None:
        """Return the newest time step, up to a given one, with known tables of all robots."""
        common = set.intersection(*map(set, self._log.so_far.table_steps()))
        return max((at for at in {*common, *self._kept} if at <= step), default=None)

    def reasons(
        self,
        step: int,
        asked: Sequence[AskedQuestion],
        still: Callable[[], bool] = lambda: True,
    ) -> list[Reason] | None:
        """Return the reasons for the moves of robots that ask at a time step.

        Args:
            step: the time step.
            asked: the questions then, with their percepts.
            still: as in `tables`.

        Returns:
            The reason for each question; None if the tables of that time step cannot be learned
            again.

        Raises:
            BagError, TablesError: the log or its tables cannot be read.
        """
        if self._log.run.known_rule is None:
            return None
        part = self._reached(step, still)
        if part is None:
            return None
        replays = {replay.agent.number: replay for replay in part.replays}
        if any(question.robot not in replays for question in asked):
            return None
        return [
            reason_of(replays[question.robot], step, question.cell, question.perceived)
            for question in asked
        ]

    def _reached(self, step: int, still: Callable[[], bool]) -> _Part | None:
        """Return a part that has been learned again up to a step; None if that is impossible."""
        first = self._first(step)
        if first is None:
            return None
        part = self._part
        self._part = None
        sought = False
        if part is None or not first <= self._at <= step:
            part = self._begin(self._kept.get(first) or self._recorded(first))
            sought = True
        while (
            part is not None
            and still()
            and part.advance(min(step, part.first + AT_ONCE))
        ):
            if step < part.first + AT_ONCE:
                # the tables of this time step may be needed again
                if sought and step > part.first:
                    self._keep(part, step)
                self._part = part
                self._at = step
                return part
            part = self._begin(self._keep(part, part.first + AT_ONCE))
        return None

    def _begin(self, saved: Sequence[RecordedTables]) -> _Part | None:
        """Begin a part; None if some of it is lost."""
        first = saved[0].step
        wait = self._log.run.scenario.max_steps + EPISODE_GAP
        # The state before the first one shows whether an episode begins there.
        log = self._log.so_far.between(max(0, first - 1), first + AT_ONCE + wait)
        if not log.whole:
            return None
        steps = []
        replays = []
        for robot, _, tables, *_ in saved:
            trajectory = trajectory_of(log, robot, first)
            # No later action shows whether the robot learned from the last one.
            trajectory.learned[-1:] |= trajectory.told[-1:]
            agent = agent_with(log, robot, tables.memory)
            steps.append(trajectory.step)
            replays.append(Replay(log, trajectory, agent))
        return _Part(first, steps, replays)

    def _keep(self, part: _Part, step: int) -> list[RecordedTables]:
        """Keep and return the robots' tables at a time step that a part has reached."""
        team = [replay.agent for replay in part.replays]
        saved = [
            RecordedTables(agent.number, step, agent.tables, {}, {}) for agent in team
        ]
        self._kept[step] = saved
        size = sum(
            array.nbytes for agent in team for array in agent.tables.memory.values()
        )
        while len(self._kept) > max(2, MOST_BYTES // (2 * size)):
            del self._kept[next(iter(self._kept))]
        return saved
