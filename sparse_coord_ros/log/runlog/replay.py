# Copyright 2026 The sparse_coord_ros authors
# SPDX-License-Identifier: Apache-2.0
"""What of a log can be computed again: stretches, a robot's trajectory in one, and its agent.

A gap takes away what the robots learned in it. Where the log holds all robots' tables of a later
time step with their counts of updates, it goes on from these as they are recorded. Where the world
is then follows from its states and status; random draws belong to time steps.
"""

import struct
from collections import Counter
from collections.abc import Mapping
from functools import partial
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


def fresh_agent(log: RunLog, k: int, memory: Memory, stretch: Stretch) -> Agent:
    """Return robot k's agent as it began a stretch.

    Args:
        log: the log.
        k: its number.
        memory: what it began the run with.
        stretch: the stretch.
    """
    if stretch.start is not None:
        return restored(log, stretch.start.recorded[k])
    run = log.run
    return Agent(
        run.rule, run.scenario, k, run.seed, memory=memory, learning=not run.greedy
    )


def restored(log: RunLog, recorded: RecordedTables) -> Agent:
    """Return an agent that goes on with what was recorded."""
    return fresh_agent(log, recorded.robot, recorded.tables.memory, Stretch())


def stretches(log: RunLog) -> list[Stretch]:
    """Return the stretches of a log in order, also those that are lost; without gaps it is one."""
    found = []
    stretch = Stretch()
    for gap in log.gaps:
        if gap.last is not None and gap.last + MARGIN < stretch.first:
            continue
        last = gap.first - 1 - MARGIN
        if stretch.first <= last:
            found.append(stretch._replace(last=last))
            begin = last + 1
        else:  # nothing is left between this gap and the one before it
            begin = found.pop().first if found else 0
        after = None if gap.last is None else _after(log, gap.last + MARGIN)
        if after is None:
            return [*found, Stretch(begin, lost=True)]
        found.append(Stretch(begin, after.first - 1, lost=True))
        stretch = after
    return [*found, stretch]


def _after(log: RunLog, step: int) -> Stretch | None:
    """Return the stretch from the next checkpoint after a time step on; None: there is none."""
    tables = {(one.robot, one.step): one for one in log.all_tables}
    for at in sorted({at for _, at in tables if at > step}):
        recorded = [tables[k, at] for k in range(len(log.names)) if (k, at) in tables]
        if len(recorded) == len(log.names):
            start = _start(log, at, step, tuple(recorded))
            if start is not None:
                return Stretch(at, None, start)
    return None


def _start(
    log: RunLog, at: int, after: int, recorded: tuple[RecordedTables, ...]
) -> Start | None:
    """Return where the world is at a checkpoint; None where the log does not say it.

    Its states say where the robots are and when the episode began, and the next status how many
    transitions there have been, no fewer than before the gap.
    """
    step = log.step
    statuses = log.tracks.statuses
    breaks = np.flatnonzero(np.diff(step[step <= at]) != 1)[-1:].tolist()
    said = next((one for one in statuses if one.step >= at), None)
    if at not in step or not breaks or said is None:
        return None
    before, episode_start = step[breaks[0] : breaks[0] + 2].tolist()
    if before <= after or episode_start - before != EPISODE_GAP:
        return None
    row, end = np.searchsorted(step, [at, said.step]).tolist()
    cells = log.cells[row]
    goals = np.array([robot.goal for robot in log.run.scenario.robots])
    if NONE in cells:
        return None
    rewarded = ~np.isnan(log.reward[row:end, :, 0])
    made = rewarded.any(axis=1)
    left = (~rewarded & (log.cells[row:end] != goals))[made]
    transitions = said.transitions - int(made.sum())
    left_out = said.left_out - int(left.sum())
    earlier = [one for one in statuses if one.step <= after]
    if any(transitions < one.transitions or left_out < one.left_out for one in earlier):
        return None
    places = tuple(cells.tolist()), tuple((cells == goals).tolist())
    position = Position(transitions, at, at != episode_start, episode_start, *places)
    return Start(position, left_out, recorded)


BITS = struct.Struct(f"={len(ACTION_LABELS)}d")
"""An action's own numbers."""


class Trajectory(NamedTuple):
    """One robot's actions in the log, and what came of them; n actions.

    Attributes:
        row: which time step of the log, shape (n,).
        step: the time step, shape (n,).
        cell: where it was, next_cell: where it was a step later; NONE where the log does not say;
            shape (n,).
        peers: whom it asks if it chooses COORDINATE, shape (n, number of them).
        seen: in which cells it perceived them, shape (n, number of them); NONE in all where not.
        told: whether the log holds the reward and both states, shape (n,).
        learned: whether it has learned from the action, shape (n,).
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
        """Return the cells in which it perceived its peers at an action; None where not."""
        seen = tuple(self.seen[i].tolist())
        return seen if seen and NONE not in seen else None


def trajectory_of(log: RunLog, k: int, stretch: Stretch) -> Trajectory:
    """Return robot k's trajectory from a time step on, up to what makes no sense.

    Where time steps are lost what makes no sense is left out.

    Whether it has learned from an action its next one says; from the last one the numbers beside
    the tables.
    """
    acted = log.tracks.actions[k].step
    rows = np.flatnonzero((log.step >= stretch.first) & np.isin(log.step, acted))
    odd = (log.cells[rows, k] == NONE) | (log.move[rows, k] == NONE)
    rows = (
        rows[~odd]
        if stretch.lost
        else rows[: int(np.argmax(odd))]
        if odd.any()
        else rows
    )
    step = log.step[rows]
    after = np.minimum(rows + 1, len(log.step) - 1)
    followed = (rows + 1 < len(log.step)) & (log.step[after] == step + 1)
    next_cell = np.where(followed, log.cells[after, k], NONE)
    learned = np.zeros(len(rows), dtype=bool)
    learned[:-1] = log.has_learned[rows, k][1:] == 1.0
    for entry in log.all_tables:
        if entry.robot == k and len(step) and entry.step > step[-1]:
            before = stretch.counts(k).get("learned", 0) + int(learned[:-1].sum())
            learned[-1] = entry.counts.get("learned", 0) > before
    whom = partial(asked_peers, log.run.scenario.peers, k, len(log.names))
    draws = Stream(log.run.seed, k, POLICY)
    asked = [whom(draws.at(at)[PEER]) for at in step.tolist()]
    count = len(whom(0.0))
    peers = np.array(asked, dtype=np.int64).reshape(len(rows), count)
    percepts = log.tracks.percepts[k]
    right = percepts.step[percepts.rows["count"] == 1 + count]
    seen = np.where(
        np.isin(step, right)[:, None], log.percept[rows[:, None], k, peers], NONE
    )
    seen[(seen == NONE).any(axis=1)] = NONE
    told = (next_cell != NONE) & ~np.isnan(log.reward[rows, k, 0])
    begins = ~np.isin(step - 1, log.tracks.states[k].step)
    if stretch.start is not None:
        begins[step == stretch.first] = (
            stretch.start.position.episode_start == stretch.first
        )
    return Trajectory(
        row=rows,
        step=step,
        cell=log.cells[rows, k],
        next_cell=next_cell,
        peers=peers,
        seen=seen,
        told=told,
        learned=learned,
        begins=begins,
    )


class Replay:
    """An agent that is fed one robot's trajectory, as long as it chooses what the robot chose.

    Args:
        log: the log.
        trajectory: the robot's.
        agent: the robot's, as it began.

    Attributes:
        agent: it has learned from all actions before `reached`, as far as the robot has.
        reached: the action that is next; it is not yet chosen.
        other: None, or what the agent chooses at `reached` where the log says another action.
    """

    def __init__(self, log: RunLog, trajectory: Trajectory, agent: Agent) -> None:
        self.agent = agent
        self.reached = 0
        self.other: Action | None = None
        self._log = log
        self._trajectory = trajectory

    def advance(self, to: int) -> bool:
        """Go on to an action; return whether all before it are the logged ones."""
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
    """Return logged rewards, shape (n, 5), as agents take them."""
    partners = logged[:, -1]
    said = (partners >= 0) & (partners < 2.0**53)  # a forged log may say anything
    known = np.where(said, partners, UNKNOWN_PARTNERS).astype(np.int64)
    columns = (*logged[:, :-1].T.tolist(), known.tolist())
    return list(map(Reward._make, zip(*columns, strict=True)))
