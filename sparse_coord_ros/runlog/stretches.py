# Copyright 2026 The sparse_coord_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Stretches of a log that can be computed again: from its beginning, and from checkpoints on.

A gap takes away what the robots learned in it. Where the log holds all robots' tables of a later
time step with their counts of updates, it goes on from these as they are recorded. Where the world
is then follows from its states and status; random draws belong to time steps.
"""

from collections import Counter
from collections.abc import Mapping
from copy import deepcopy
from typing import NamedTuple

import numpy as np

from sparse_coord_ros.game.world import EPISODE_GAP, Position
from sparse_coord_ros.learn.agent import Agent, Tables
from sparse_coord_ros.learn.simulation import tables_equal
from sparse_coord_ros.runlog.attached import RecordedTables
from sparse_coord_ros.runlog.log import NONE, RunLog
from sparse_coord_ros.runlog.timeline import MARGIN

UNFIT = (KeyError, ValueError, IndexError, TypeError)
"""What `restored` may raise where a log is forged, or of another version."""


class Start(NamedTuple):
    """Where a stretch begins that is not the first.

    Attributes:
        position: where the world is.
        left_out: how many robots' steps it had made without them.
        recorded: each robot's tables.
    """

    position: Position
    left_out: int
    recorded: tuple[RecordedTables, ...]


class Stretch(NamedTuple):
    """Time steps of which nothing is missing, or those between two such stretches.

    Attributes:
        first, last: its time steps; 0: from the run's beginning, None: to the run's end.
        start: None at the run's beginning.
        lost: they are missing, or lie between what is missing and the next checkpoint.
    """

    first: int = 0
    last: int | None = None
    start: Start | None = None
    lost: bool = False

    def holds(self, step: int) -> bool:
        """Whether a time step is one of it."""
        return self.first <= step and (self.last is None or step <= self.last)

    def counts(self, k: int) -> Mapping[str, int]:
        """Return what stood beside a robot's tables where the stretch begins."""
        return Counter() if self.start is None else self.start.recorded[k].counts


def fresh_agent(log: RunLog, k: int, tables: Tables, stretch: Stretch) -> Agent:
    """Return robot k's agent as it began a stretch.

    Args:
        log: the log.
        k: its number.
        tables: what it began the run with; it gets a copy of them.
        stretch: the stretch.
    """
    run = log.run
    if stretch.start is not None:
        return restored(log, stretch.start.recorded[k])
    return run.rule.agent(
        run.scenario, k, run.seed, tables=deepcopy(tables), learning=not run.greedy
    )


def restored(log: RunLog, recorded: RecordedTables) -> Agent:
    """Return an agent that goes on with recorded tables; any exception where they do not fit."""
    agent = fresh_agent(log, recorded.robot, recorded.tables, Stretch())
    assert recorded.memory is not None
    agent.go_on_from(recorded.memory)
    return agent


def stretches(log: RunLog) -> list[Stretch]:
    """Return the stretches of a log in order, also those that are lost; without gaps it is one."""
    found, stretch = [], Stretch()
    for gap in log.gaps:
        if gap.last is not None and gap.last + MARGIN < stretch.first:
            continue
        last = gap.first - 1 - MARGIN
        if stretch.first <= last:
            found.append(stretch._replace(last=last))
            begin = last + 1
        else:  # nothing is left between this gap and the one before it
            begin = found.pop().first if found else 0
        after = _after(log, gap.last + MARGIN) if gap.last is not None else None
        end = None if after is None else after.first - 1
        found.append(Stretch(begin, end, lost=True))
        if after is None:
            return found
        stretch = after
    return [*found, stretch]


def _after(log: RunLog, step: int) -> Stretch | None:
    """Return the stretch from the next checkpoint after a time step on; None: there is none."""
    tables = {(one.robot, one.step): one for one in log.all_tables if one.memory is not None}
    for at in sorted({at for _, at in tables if at > step}):
        recorded = [tables[k, at] for k in range(len(log.names)) if (k, at) in tables]
        if len(recorded) == len(log.names):
            start = _start(log, at, step, tuple(recorded))
            if start is not None and all(_fits(log, one) for one in recorded):
                return Stretch(at, None, start)
    return None


def _fits(log: RunLog, recorded: RecordedTables) -> bool:
    """Whether what an agent remembers beside its tables is that of these tables."""
    if log.run.known_rule is None:  # nobody goes on with it
        return True
    try:
        return tables_equal([restored(log, recorded).tables], [recorded.tables])
    except UNFIT:
        return False


def _start(log: RunLog, at: int, after: int, recorded: tuple[RecordedTables, ...]) -> Start | None:
    """Return where the world is at a checkpoint; None where the log does not say it.

    Its states say where the robots are and when the episode began, and the next status how many
    transitions there have been, no fewer than before the gap.
    """
    step, statuses = log.step, log.tracks.statuses
    breaks = np.flatnonzero(np.diff(step[step <= at]) != 1)[-1:].tolist()
    said = next((one for one in statuses if one.step >= at), None)
    if at not in step or not breaks or said is None:
        return None
    before, episode_start = step[breaks[0] : breaks[0] + 2].tolist()
    if before <= after or episode_start - before != EPISODE_GAP:
        return None
    row, end = np.searchsorted(step, [at, said.step]).tolist()
    cells, goals = log.cells[row], np.array([robot.goal for robot in log.run.scenario.robots])
    if NONE in cells:
        return None
    rewarded = ~np.isnan(log.reward[row:end, :, 0])
    made = rewarded.any(axis=1)
    left = (~rewarded & (log.cells[row:end] != goals))[made]
    transitions, left_out = said.transitions - int(made.sum()), said.left_out - int(left.sum())
    earlier = [one for one in statuses if one.step <= after]
    if any(transitions < one.transitions or left_out < one.left_out for one in earlier):
        return None
    places = tuple(cells.tolist()), tuple((cells == goals).tolist())
    position = Position(transitions, at, at != episode_start, episode_start, *places)
    return Start(position, left_out, recorded)
