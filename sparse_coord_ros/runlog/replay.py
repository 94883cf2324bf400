# Copyright 2026 The sparse_coord_ros authors
# SPDX-License-Identifier: Apache-2.0
"""A robot once more, from the log alone: its agent chooses and learns from what it was told."""

from copy import deepcopy

import numpy as np

from sparse_coord_ros.game.world import UNKNOWN_PARTNERS, Action, Reward
from sparse_coord_ros.learn.agent import Agent, Tables
from sparse_coord_ros.runlog.log import RunLog
from sparse_coord_ros.runlog.trajectory import Trajectory, heard_askers


def fresh_agent(log: RunLog, k: int, tables: Tables) -> Agent:
    """Return robot k's agent as it began, with these tables; it gets a copy of them."""
    run = log.run
    return run.rule.agent(
        run.scenario, k, run.seed, tables=deepcopy(tables), learning=not run.greedy
    )


class Replay:
    """An agent that is fed one robot's trajectory, as long as it chooses what the robot chose.

    Args:
        log: the log.
        trajectory: the robot's.
        agent: the robot's, with all that it had learned before the trajectory's action `begin`.
        begin: the action with which to begin.

    Attributes:
        agent: it has learned from all actions before `reached`, as far as the robot has.
        reached: the action that is next; it is not yet chosen.
        other: None, or what the agent chooses at `reached` where the log says another action.
    """

    def __init__(self, log: RunLog, trajectory: Trajectory, agent: Agent, begin: int = 0) -> None:
        self.agent = agent
        self.reached = begin
        self.other: Action | None = None
        self._trajectory = trajectory
        self._askers = heard_askers(log, agent.number)

    def advance(self, to: int) -> bool:
        """Go on to an action; return whether all before it are the logged ones."""
        if self.reached >= to or self.other is not None:
            return self.other is None
        agent, done = self.agent, self._trajectory
        part = slice(self.reached, to)
        columns = (done.step, done.cell, done.action, done.move, done.learned, done.next_cell)
        rewards = _rewards(done.reward[part], done.partners[part])
        rows = zip(*(column[part].tolist() for column in columns), rewards, strict=True)
        for step, cell, logged_action, logged_move, learned, next_cell, reward in rows:
            decision = agent.decide(step, cell)
            perceived = done.perceived_at(self.reached) if decision.peers else None
            action = agent.act(step, cell, decision, perceived)
            if decision.action != logged_action or action.move != logged_move:
                self.other = action
                return False
            if learned:
                self.hear(step)
                agent.learn(step, cell, decision, action, perceived, reward, next_cell)
            self.reached += 1
        return True

    def hear(self, step: int) -> None:
        """Let the agent know who asked it in a time step."""
        for peer, cell in self._askers.get(step, ()):
            self.agent.asked(step, peer, cell)


def _rewards(reward: np.ndarray, partners: np.ndarray) -> list[Reward]:
    """Return logged rewards, shape (n, 4), and partners, shape (n,), as agents take them."""
    said = (partners >= 0) & (partners < 2.0**53)  # a forged log may say anything
    known = np.where(said, partners, UNKNOWN_PARTNERS).astype(np.int64)
    columns = (*reward[:, :4].T.tolist(), known.tolist())
    return list(map(Reward._make, zip(*columns, strict=True)))
