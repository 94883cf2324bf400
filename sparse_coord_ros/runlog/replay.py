# Copyright 2026 The sparse_coord_ros authors
# SPDX-License-Identifier: Apache-2.0
"""One robot's trajectory, as the log tells it, and its agent, which does the same once more."""

import struct
from functools import partial
from typing import NamedTuple

import numpy as np

from sparse_coord_ros.game.perception import asked_peers
from sparse_coord_ros.game.streams import PEER, POLICY, Stream
from sparse_coord_ros.game.world import UNKNOWN_PARTNERS, Action, Reward
from sparse_coord_ros.learn.agent import Agent, Choice
from sparse_coord_ros.runlog.log import NONE, RunLog
from sparse_coord_ros.runlog.stretches import Stretch
from sparse_coord_ros.wire import ACTION_LABELS
from sparse_coord_ros.wire.messages import action_numbers

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
    """

    row: np.ndarray
    step: np.ndarray
    cell: np.ndarray
    next_cell: np.ndarray
    peers: np.ndarray
    seen: np.ndarray
    told: np.ndarray
    learned: np.ndarray

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
    rows = rows[~odd] if stretch.lost else rows[: int(np.argmax(odd))] if odd.any() else rows
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
    seen = np.where(np.isin(step, right)[:, None], log.percept[rows[:, None], k, peers], NONE)
    seen[(seen == NONE).any(axis=1)] = NONE
    told = (next_cell != NONE) & ~np.isnan(log.reward[rows, k, 0])
    return Trajectory(rows, step, log.cells[rows, k], next_cell, peers, seen, told, learned)


def heard_askers(log: RunLog, k: int) -> dict[int, list[tuple[int, int]]]:
    """Return who asked robot k at which time step, and from which cell: those that it heard."""
    heard: dict[int, list[tuple[int, int]]] = {}
    for request in log.requests:
        answer = request.said or request.answer
        cell = log.frame.cell(*request.position)
        if request.peer == k and cell is not None and answer and answer[0] == request.step:
            heard.setdefault(request.step, []).append((request.asker, cell))
    return heard


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
        self._log, self._trajectory = log, trajectory
        self._askers = heard_askers(log, agent.number)

    def advance(self, to: int) -> bool:
        """Go on to an action; return whether all before it are the logged ones."""
        if self.reached >= to or self.other is not None:
            return self.other is None
        agent, done, k = self.agent, self._trajectory, self.agent.number
        part = slice(self.reached, to)
        at = done.row[part]
        columns = (done.step[part], done.cell[part], done.learned[part], done.next_cell[part])
        numbers = self._log.numbers[at, k, : len(ACTION_LABELS)]
        rewards = _rewards(self._log.rewards[at, k])
        rows = zip(*(column.tolist() for column in columns), numbers, rewards, strict=True)
        for step, cell, learned, next_cell, logged, reward in rows:
            decision = agent.decide(step, cell)
            perceived = done.perceived_at(self.reached) if decision.peers else None
            action = agent.act(step, cell, decision, perceived)
            if BITS.pack(*action_numbers(action)) != logged.tobytes():
                self.other = action
                return False
            if learned:
                self.hear(step)
                choice = Choice(cell, decision, action, perceived)
                agent.learn(step, choice, reward, next_cell)
            self.reached += 1
        return True

    def hear(self, step: int) -> None:
        """Let the agent know who asked it in a time step."""
        for peer, cell in self._askers.get(step, ()):
            self.agent.asked(step, peer, cell)


def _rewards(logged: np.ndarray) -> list[Reward]:
    """Return logged rewards, shape (n, 5), as agents take them."""
    partners = logged[:, -1]
    said = (partners >= 0) & (partners < 2.0**53)  # a forged log may say anything
    known = np.where(said, partners, UNKNOWN_PARTNERS).astype(np.int64)
    columns = (*logged[:, :-1].T.tolist(), known.tolist())
    return list(map(Reward._make, zip(*columns, strict=True)))
