# Copyright 2026 The sparse_coord_ros authors
# SPDX-License-Identifier: Apache-2.0
"""A robot's trajectory in a log, and an agent that follows it.

Random draws belong to time steps: an agent may begin with recorded tables at any time step.
"""

import struct
from typing import NamedTuple

import numpy as np

from sparse_coord_ros.core.game.draws import LEARNING, PEER, ROBOT, draw, key_of
from sparse_coord_ros.core.game.perception import asked_peers
from sparse_coord_ros.core.game.world import Action, Reward
from sparse_coord_ros.core.learners.agent import Agent, Choice, Decision
from sparse_coord_ros.core.learners.mind import Memory
from sparse_coord_ros.log.runlog.log import NONE, RunLog
from sparse_coord_ros.protocol.wire import (
    ACTION,
    ACTION_LABELS,
    LOCAL_STATE,
    PERCEPT,
)
from sparse_coord_ros.protocol.wire.messages import action_numbers


def agent_with(log: RunLog, k: int, memory: Memory) -> Agent:
    """Return robot k's agent with a memory."""
    run = log.run
    return Agent(
        run.rule, run.scenario, k, run.seed, memory=memory, learning=not run.greedy
    )


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
        told: whether the log contains the reward and both states, those of all robots if they
            learn from them, shape (n,).
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


def trajectory_of(log: RunLog, k: int, first: int = 0) -> Trajectory:
    """Return robot k's trajectory from a time step on; malformed actions are left out."""
    acted = np.isin(log.step, log.series[ACTION, k].step)
    known = (log.cells[:, k] != NONE) & (log.move[:, k] != NONE)
    rows = np.flatnonzero(acted & known & (log.step >= first))
    step = log.step[rows]
    next_cell = _next_cells(log, k, rows)
    peers = _peers_to_ask(log, k, step)
    told = (next_cell != NONE) & ~np.isnan(log.column("individual")[rows, k])
    if log.run.sees_all:
        for peer in range(len(log.names)):
            told &= log.cells[rows, peer] != NONE
            told &= _next_cells(log, peer, rows) != NONE
    return Trajectory(
        row=rows,
        step=step,
        cell=log.cells[rows, k],
        next_cell=next_cell,
        peers=peers,
        seen=_seen_cells(log, k, rows, peers),
        told=told,
        learned=_learned(log, k, rows),
        begins=~np.isin(step - 1, log.series[LOCAL_STATE, k].step),
    )


def _next_cells(log: RunLog, k: int, rows: np.ndarray) -> np.ndarray:
    """Return a robot's cells a time step later, shape (n,); NONE if they are not logged."""
    after = np.minimum(rows + 1, len(log.step) - 1)
    follows = log.step[after] == log.step[rows] + 1
    return np.where(follows, log.cells[after, k], NONE)


def _learned(log: RunLog, k: int, rows: np.ndarray) -> np.ndarray:
    """Return whether a robot learned from each of its actions, shape (n,).

    The next action reports it; for the last action the counts beside the tables show it.
    """
    learned = np.zeros(len(rows), dtype=bool)
    if not len(rows):
        return learned
    learned[:-1] = log.column("learned")[rows[1:], k] == 1.0
    before = int(learned.sum())
    last_step = log.step[rows[-1]]
    for entry in log.all_tables:
        if entry.robot == k and entry.step > last_step:
            learned[-1] = entry.counts.get("learned", 0) > before
    return learned


def _peers_to_ask(log: RunLog, k: int, step: np.ndarray) -> np.ndarray:
    """Return the peers that a robot asks if it chooses COORDINATE, shape (n, number of them)."""
    scenario = log.run.scenario
    key = key_of(log.run.seed, LEARNING, k, ROBOT)
    asked = [
        asked_peers(scenario.peers, k, len(log.names), draw(key, at, PEER))
        for at in step.tolist()
    ]
    count = len(asked_peers(scenario.peers, k, len(log.names), 0.0))
    return np.array(asked, dtype=np.int64).reshape(len(step), count)


def _seen_cells(log: RunLog, k: int, rows: np.ndarray, peers: np.ndarray) -> np.ndarray:
    """Return the cells in which a robot perceived its peers; all NONE if it did not."""
    percepts = log.series[PERCEPT, k]
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
        self._trajectory = trajectory
        rows = trajectory.row
        k = agent.number
        self._begins = trajectory.begins.tolist()
        self._steps = trajectory.step.tolist()
        self._cells = trajectory.cell.tolist()
        self._next_cells = trajectory.next_cell.tolist()
        self._rows = rows.tolist()
        self._log = log
        self._learned = (trajectory.learned & trajectory.told).tolist()
        self._logged = log.numbers[rows, k, : len(ACTION_LABELS)]
        self._rewards = log.rewards[rows, k]
        self._decision: Decision | None = None
        self._action: Action | None = None

    def decide(self) -> Decision:
        """Return what the agent chooses at `reached`, before active perception."""
        if self._decision is None:
            i = self.reached
            if self._begins[i]:
                self.agent.begin_episode()
            self._decision = self.agent.decide(self._steps[i], self._cells[i])
        return self._decision

    def act(self) -> Action:
        """Return what the agent does at `reached`."""
        if self._action is None:
            i = self.reached
            decision = self.decide()
            perceived = self._trajectory.perceived_at(i) if decision.peers else None
            self._action = self.agent.act(
                self._steps[i], self._cells[i], decision, perceived
            )
        return self._action

    def advance(self, to: int) -> bool:
        """Advance to an action; return whether the agent chose all logged actions before it."""
        while self.reached < to and self.other is None:
            self._follow()
        return self.other is None

    def _follow(self) -> None:
        """Choose an action and learn from it; note it in `other` if it is not the logged one."""
        i = self.reached
        agent = self.agent
        step = self._steps[i]
        cell = self._cells[i]
        decision = self.decide()
        action = self.act()
        if BITS.pack(*action_numbers(action)) != self._logged[i].tobytes():
            self.other = action
            return
        if self._learned[i]:
            perceived = self._trajectory.perceived_at(i) if decision.peers else None
            choice = Choice(cell, decision, action, perceived)
            reward = _reward(self._rewards[i])
            row = self._rows[i]
            team = None
            if self._log.run.sees_all:
                team = (
                    self._log.cells[row].tolist(),
                    self._log.cells[row + 1].tolist(),
                )
            agent.learn(step, choice, reward, self._next_cells[i], team)
        self.reached = i + 1
        self._decision = None
        self._action = None


def _reward(logged: np.ndarray) -> Reward:
    """Return a logged reward in the form that agents take."""
    individual, common, cost, total, partners = logged.tolist()
    return Reward(individual, common, cost, total, int(partners))
