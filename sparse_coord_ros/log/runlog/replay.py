# Copyright 2026 The sparse_coord_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Replays a log: intervals between gaps, a robot's trajectory in one, and its agent.

Learning in a gap is unknown. The computation continues at the next time step for which the log
contains all robots' tables with their counts of updates: the recorded tables are its beginning.
The world's position then follows from states and status. Random draws belong to time steps.
"""

import struct
from collections import Counter
from collections.abc import Mapping
from typing import NamedTuple

import numpy as np

from sparse_coord_ros.core.game.perception import asked_peers
from sparse_coord_ros.core.game.rules import EPISODE_GAP, UNKNOWN_PARTNERS
from sparse_coord_ros.core.game.streams import PEER, POLICY, Stream
from sparse_coord_ros.core.game.world import Action, Position, Reward
from sparse_coord_ros.core.learners.agent import Agent, Choice
from sparse_coord_ros.core.learners.mind import Memory
from sparse_coord_ros.log.runlog.attached import RecordedTables
from sparse_coord_ros.log.runlog.log import NONE, RunLog
from sparse_coord_ros.log.runlog.timeline import MARGIN
from sparse_coord_ros.protocol.wire import ACTION_LABELS
from sparse_coord_ros.protocol.wire.messages import action_numbers


class Start(NamedTuple):
    """The beginning of an interval after a gap.

    Attributes:
        position: the world's position.
        left_out: number of (robot, step) pairs without the robot's action until then.
        recorded: each robot's tables.
    """

    position: Position
    left_out: int
    recorded: tuple[RecordedTables, ...]


class Interval(NamedTuple):
    """Time steps that can be computed again, or that cannot because of a gap.

    Attributes:
        first: the first time step; 0: from the run's beginning.
        last: the last time step; None: up to the run's end.
        start: its beginning; None: the run's beginning.
        lost: the steps cannot be computed: they are between a gap and the next checkpoint.
    """

    first: int = 0
    last: int | None = None
    start: Start | None = None
    lost: bool = False

    def holds(self, step: int) -> bool:
        """Return whether a time step belongs to it."""
        return self.first <= step and (self.last is None or step <= self.last)

    def counts(self, k: int) -> Mapping[str, int]:
        """Return the counts beside a robot's tables at the beginning."""
        return Counter() if self.start is None else self.start.recorded[k].counts


def fresh_agent(log: RunLog, k: int, memory: Memory, interval: Interval) -> Agent:
    """Return robot k's agent at the beginning of an interval.

    Args:
        log: the log.
        k: its number.
        memory: its memory at the run's beginning.
        interval: the interval.
    """
    if interval.start is not None:
        return restored(log, interval.start.recorded[k])
    run = log.run
    return Agent(
        run.rule, run.scenario, k, run.seed, memory=memory, learning=not run.greedy
    )


def restored(log: RunLog, recorded: RecordedTables) -> Agent:
    """Return an agent that continues from recorded tables."""
    return fresh_agent(log, recorded.robot, recorded.tables.memory, Interval())


def intervals(log: RunLog) -> list[Interval]:
    """Return the intervals of a log in order, lost ones included; without gaps there is one."""
    found: list[Interval] = []
    open_interval = Interval()
    for gap in log.gaps:
        if gap.last is not None and gap.last + MARGIN < open_interval.first:
            continue
        last = gap.first - 1 - MARGIN
        if open_interval.first <= last:
            found.append(open_interval._replace(last=last))
            begin = last + 1
        else:  # no interval lies between this gap and the one before it
            begin = found.pop().first if found else 0
        after = None if gap.last is None else _after(log, gap.last + MARGIN)
        if after is None:
            return [*found, Interval(begin, lost=True)]
        found.append(Interval(begin, after.first - 1, lost=True))
        open_interval = after
    return [*found, open_interval]


def _after(log: RunLog, step: int) -> Interval | None:
    """Return the interval from the next checkpoint after a time step, or None."""
    tables = {(one.robot, one.step): one for one in log.all_tables}
    for at in sorted({at for _, at in tables if at > step}):
        recorded = [tables[k, at] for k in range(len(log.names)) if (k, at) in tables]
        if len(recorded) == len(log.names):
            start = _start(log, at, step, tuple(recorded))
            if start is not None:
                return Interval(at, None, start)
    return None


def _start(
    log: RunLog, at: int, after: int, recorded: tuple[RecordedTables, ...]
) -> Start | None:
    """Return the beginning of an interval at a checkpoint.

    Args:
        log: the log.
        at: the time step of the checkpoint.
        after: the last time step that a gap may touch.
        recorded: each robot's tables of the checkpoint.

    Returns:
        None if the log does not contain the world's position then.
    """
    episode_start = _episode_start(log, at, after)
    counts = _counts_at(log, at, after)
    if episode_start is None or counts is None:
        return None
    cells = log.cells[log.row_of[at]]
    if NONE in cells:
        return None
    transitions, left_out = counts
    goals = [robot.goal for robot in log.run.scenario.robots]
    position = Position(
        transitions,
        at,
        at != episode_start,
        episode_start,
        tuple(cells.tolist()),
        tuple((cells == goals).tolist()),
    )
    return Start(position, left_out, recorded)


def _episode_start(log: RunLog, at: int, after: int) -> int | None:
    """Return the first time step of the episode of a time step; None: it is unknown.

    Args:
        log: the log.
        at: the time step.
        after: the episode must begin after this time step.
    """
    if at not in log.row_of:
        return None
    steps = log.step[: log.row_of[at] + 1]
    breaks = np.flatnonzero(np.diff(steps) != 1)
    if not len(breaks):
        return None
    before, start = steps[breaks[-1] : breaks[-1] + 2].tolist()
    if before <= after or start - before != EPISODE_GAP:
        return None
    return int(start)


def _counts_at(log: RunLog, at: int, after: int) -> tuple[int, int] | None:
    """Return the numbers of transitions, and of steps without a robot's action, up to a time step.

    The next status has both, and the log contains the transitions between.

    Args:
        log: the log.
        at: the time step.
        after: counts of a status up to this time step must not be higher.

    Returns:
        None if the log does not contain them, or contradicts itself.
    """
    statuses = log.messages.statuses
    later = [one for one in statuses if one.step >= at]
    if not later:
        return None
    status = later[0]
    begin, end = np.searchsorted(log.step, [at, status.step]).tolist()
    rewarded = ~np.isnan(log.reward[begin:end, :, 0])
    made = rewarded.any(axis=1)
    goals = np.array([robot.goal for robot in log.run.scenario.robots])
    under_way = log.cells[begin:end] != goals
    left_out = (under_way & ~rewarded)[made]
    counts = (
        status.transitions - int(made.sum()),
        status.left_out - int(left_out.sum()),
    )
    for one in statuses:
        if one.step <= after and (
            counts[0] < one.transitions or counts[1] < one.left_out
        ):
            return None
    return counts


BITS = struct.Struct(f"={len(ACTION_LABELS)}d")
"""An action's own numbers."""


class Trajectory(NamedTuple):
    """One robot's actions in the log with their outcomes; n actions.

    Attributes:
        row: the row of the time step in the log's arrays, shape (n,).
        step: the time step, shape (n,).
        cell, next_cell: the robot's cell then and a step later; NONE if the log does not contain
            it; shape (n,).
        peers: the peers that it asks if it chooses COORDINATE, shape (n, number of them).
        seen: the cells in which it perceived them, shape (n, number of them); all NONE if it did
            not.
        told: whether the log contains the reward and both states, shape (n,).
        learned: whether the robot learned from the action, shape (n,).
        begins: whether an episode begins with the action, shape (n,).
    """

    row: np.ndarray
    step: np.ndarray
    cell: np.ndarray
    next_cell: np.ndarray
    peers: np.ndarray
    seen: np.ndarray
    told: np.ndarray
    learned: np.ndarray
    begins: np.ndarray

    def perceived_at(self, i: int) -> tuple[int, ...] | None:
        """Return the cells in which it perceived its peers at an action; None: it did not."""
        seen = tuple(self.seen[i].tolist())
        return seen if seen and NONE not in seen else None


def trajectory_of(log: RunLog, k: int, interval: Interval) -> Trajectory:
    """Return robot k's trajectory from an interval's beginning on.

    It ends before the first malformed action or missing state. If time steps are lost, such
    actions are left out.
    """
    rows = _rows_of_actions(log, k, interval)
    step = log.step[rows]
    cell = log.cells[rows, k]
    next_cell = _next_cells(log, k, rows)
    peers = _peers_to_ask(log, k, step)
    rewarded = ~np.isnan(log.reward[rows, k, 0])
    begins = ~np.isin(step - 1, log.messages.states[k].step)
    if interval.start is not None:
        at_start = interval.start.position.episode_start == interval.first
        begins[step == interval.first] = at_start
    return Trajectory(
        row=rows,
        step=step,
        cell=cell,
        next_cell=next_cell,
        peers=peers,
        seen=_seen_cells(log, k, rows, peers),
        told=(next_cell != NONE) & rewarded,
        learned=_learned(log, k, rows, interval),
        begins=begins,
    )


def _rows_of_actions(log: RunLog, k: int, interval: Interval) -> np.ndarray:
    """Return the rows of a robot's actions, shape (n,)."""
    acted = np.isin(log.step, log.messages.actions[k].step)
    rows = np.flatnonzero(acted & (log.step >= interval.first))
    malformed = (log.cells[rows, k] == NONE) | (log.move[rows, k] == NONE)
    if not malformed.any():
        return rows
    if interval.lost:
        return np.asarray(rows[~malformed])
    return rows[: int(np.argmax(malformed))]


def _next_cells(log: RunLog, k: int, rows: np.ndarray) -> np.ndarray:
    """Return a robot's cells a time step later, shape (n,); NONE if they are not logged."""
    after = np.minimum(rows + 1, len(log.step) - 1)
    follows = log.step[after] == log.step[rows] + 1
    return np.where(follows, log.cells[after, k], NONE)


def _learned(log: RunLog, k: int, rows: np.ndarray, interval: Interval) -> np.ndarray:
    """Return whether a robot learned from each of its actions, shape (n,).

    The next action reports it; for the last action the counts beside the tables show it.
    """
    learned = np.zeros(len(rows), dtype=bool)
    if not len(rows):
        return learned
    learned[:-1] = log.has_learned[rows[1:], k] == 1.0
    before = interval.counts(k).get("learned", 0) + int(learned.sum())
    last_step = log.step[rows[-1]]
    for entry in log.all_tables:
        if entry.robot == k and entry.step > last_step:
            learned[-1] = entry.counts.get("learned", 0) > before
    return learned


def _peers_to_ask(log: RunLog, k: int, step: np.ndarray) -> np.ndarray:
    """Return the peers that a robot asks if it chooses COORDINATE, shape (n, number of them)."""
    scenario = log.run.scenario
    draws = Stream(log.run.seed, k, POLICY)
    found = [
        asked_peers(scenario.peers, k, len(log.names), draws.at(at)[PEER])
        for at in step.tolist()
    ]
    count = len(asked_peers(scenario.peers, k, len(log.names), 0.0))
    return np.array(found, dtype=np.int64).reshape(len(step), count)


def _seen_cells(log: RunLog, k: int, rows: np.ndarray, peers: np.ndarray) -> np.ndarray:
    """Return the cells in which a robot perceived its peers; all NONE if it did not."""
    percepts = log.messages.percepts[k]
    whole = percepts.step[percepts.rows["count"] == 1 + peers.shape[1]]
    perceived = np.isin(log.step[rows], whole)[:, None]
    seen = np.where(perceived, log.percept[rows[:, None], k, peers], NONE)
    seen[(seen == NONE).any(axis=1)] = NONE
    return seen


class Replay:
    """An agent that follows a robot's trajectory as long as it chooses the logged actions.

    Args:
        log: the log.
        trajectory: the robot's trajectory.
        agent: the robot's agent at the beginning.

    Attributes:
        agent: it has learned from all actions before `reached` from which the robot learned.
        reached: the next action, not yet chosen.
        other: the agent's action at `reached` if the log contains another one; else None.
    """

    def __init__(self, log: RunLog, trajectory: Trajectory, agent: Agent) -> None:
        self.agent = agent
        self.reached = 0
        self.other: Action | None = None
        self._log = log
        self._trajectory = trajectory

    def advance(self, to: int) -> bool:
        """Advance to an action; return whether the agent chose all logged actions before it."""
        if self.reached >= to or self.other is not None:
            return self.other is None
        agent = self.agent
        done = self._trajectory
        k = self.agent.number
        part = slice(self.reached, to)
        at = done.row[part]
        columns = (
            done.begins[part],
            done.step[part],
            done.cell[part],
            done.learned[part],
            done.next_cell[part],
        )
        numbers = self._log.numbers[at, k, : len(ACTION_LABELS)]
        rewards = _rewards(self._log.rewards[at, k])
        rows = zip(
            *(column.tolist() for column in columns), numbers, rewards, strict=True
        )
        for begins, step, cell, learned, next_cell, logged, reward in rows:
            if begins:
                agent.begin_episode()
            decision = agent.decide(step, cell)
            perceived = done.perceived_at(self.reached) if decision.peers else None
            action = agent.act(step, cell, decision, perceived)
            if BITS.pack(*action_numbers(action)) != logged.tobytes():
                self.other = action
                return False
            if learned:
                agent.learn(
                    step, Choice(cell, decision, action, perceived), reward, next_cell
                )
            self.reached += 1
        return True


def _rewards(logged: np.ndarray) -> list[Reward]:
    """Return logged rewards, shape (n, 5), in the form that agents take."""
    partners = logged[:, -1]
    # a forged log may contain any number
    possible = (partners >= 0) & (partners < 2.0**53)
    known = np.where(possible, partners, UNKNOWN_PARTNERS).astype(np.int64)
    columns = (*logged[:, :-1].T.tolist(), known.tolist())
    return list(map(Reward._make, zip(*columns, strict=True)))
