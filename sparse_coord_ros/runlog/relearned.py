# Copyright 2026 The sparse_coord_ros authors
# SPDX-License-Identifier: Apache-2.0
"""What a team had learned at any time step: learned again from the recorded checkpoint before."""

from collections.abc import Callable, Sequence
from typing import NamedTuple

import numpy as np

from sparse_coord_ros import wire
from sparse_coord_ros.game.world import EPISODE_GAP
from sparse_coord_ros.learn.agent import Tables
from sparse_coord_ros.runlog.attached import RecordedTables
from sparse_coord_ros.runlog.replay import Replay, trajectory_of
from sparse_coord_ros.runlog.stretches import Stretch, restored
from sparse_coord_ros.runlog.window import MOVES, LongLog

AT_ONCE = 2000
"""Time steps that are read and learned again at once."""

MOST_BYTES = 100_000_000
"""Of what is kept, about; the oldest of it goes first."""


TablesThen = dict[int, tuple[int, Tables]]
"""By robot up to which time step it had learned, and its tables then."""


class _Part(NamedTuple):
    """A part of a log from a time step on, as it is learned again.

    Attributes:
        first: the time step.
        steps: of each robot's actions.
        replays: of each robot.
    """

    first: int
    steps: list[np.ndarray]
    replays: list[Replay]

    def _places(self, step: int) -> list[tuple[Replay, int]]:
        places = (int(np.searchsorted(steps, step)) for steps in self.steps)
        return list(zip(self.replays, places, strict=True))

    def before(self, step: int) -> bool:
        """Whether no robot has learned from an action of a time step, or a later one."""
        return all(replay.reached <= place for replay, place in self._places(step))

    def advance(self, step: int) -> bool:
        """Go on to a time step; return whether the robots did what their agents choose."""
        return all([replay.advance(place) for replay, place in self._places(step)])


class Relearned:
    """Answers what a team had learned, and keeps what it has computed for the next question.

    Args:
        log: the log.
    """

    def __init__(self, log: LongLog) -> None:
        self._log = log
        self._kept: dict[int, list[RecordedTables]] = {}
        self._part: _Part | None = None
        self._topics = [*MOVES, wire.PERCEPT]
        rule = log.run.known_rule
        if rule is not None and rule.factors is not None:  # who is asked learns from it
            self._topics.append(wire.SERVICE_EVENTS)

    def tables(self, step: int, still: Callable[[], bool] = lambda: True) -> TablesThen:
        """Return by robot up to which time step it had learned, and its tables then.

        That is `step`; where a part of the log is lost or does not tell all, or the learner's code
        may not be imported, it is the time step of the newest recorded tables. A robot without any
        is left out. The next call may change these tables.

        Args:
            step: the time step.
            still: whether that is still wanted; if not, the newest recorded tables will do.

        Raises:
            BagError, TablesError: the log or its tables cannot be read.
        """
        run, robots = self._log.run, range(len(self._log.run.scenario.robots))
        found = {k: self._log.tables_before(k, step) for k in robots}
        recorded = {k: (one.step, one.tables) for k, one in found.items() if one is not None}
        if run.greedy:  # nothing is learned
            return {k: (step, tables) for k, (_, tables) in recorded.items()}
        part = None if run.known_rule is None else self._reached(step, still)
        if part is None:
            return recorded
        return {replay.agent.number: (step, replay.agent.tables) for replay in part.replays}

    def _reached(self, step: int, still: Callable[[], bool]) -> _Part | None:
        """Return a part that has been learned again up to a step; None where that cannot be."""
        common = set.intersection(*map(set, self._log.table_steps()))
        known = [at for at in {*common, *self._kept} if at <= step]
        if not known:
            return None
        first, part = max(known), self._part
        if part is None or part.first != first or not part.before(step):
            saved = self._kept.get(first) or [
                one
                for k in range(len(self._log.run.scenario.robots))
                if (one := self._log.tables_before(k, first)) is not None
            ]
            part = self._begin(saved)
        while part is not None and still() and part.advance(min(step, part.first + AT_ONCE)):
            self._part = part
            if step < part.first + AT_ONCE:
                return part
            part = self._begin(self._keep(part))
        return None

    def _begin(self, saved: Sequence[RecordedTables]) -> _Part | None:
        """Begin a part; None where some of it is lost, or not said what it takes to go on."""
        first, wait = saved[0].step, self._log.run.scenario.max_steps + EPISODE_GAP
        log = self._log.read(first, first + AT_ONCE + wait, self._topics)
        if log.bag.gaps or log.tracks.gaps or any(one.memory is None for one in saved):
            return None
        part = _Part(first, [], [])
        for k, one in enumerate(saved):
            trajectory = trajectory_of(log, k, Stretch(first))
            # Whether it has learned from its very last action no later one says.
            trajectory.learned[-1:] |= trajectory.told[-1:]
            part.steps.append(trajectory.step)
            part.replays.append(Replay(log, trajectory, restored(log, one)))
        return part

    def _keep(self, part: _Part) -> list[RecordedTables]:
        """Keep and return what the robots remember at a part's end."""
        at = part.first + AT_ONCE
        agents = [replay.agent for replay in part.replays]
        saved = [RecordedTables(one.number, at, one.tables, {}, one.memory()) for one in agents]
        self._kept[at] = saved
        size = sum(array.nbytes for one in saved for array in one.tables.arrays().values())
        while len(self._kept) > max(2, MOST_BYTES // (2 * size)):
            del self._kept[next(iter(self._kept))]
        return saved
