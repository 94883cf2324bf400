# Copyright 2026 The sparse_coord_ros authors
# SPDX-License-Identifier: Apache-2.0
"""One robot's trajectory: its actions, percepts and rewards, as the log tells them."""

from typing import NamedTuple

import numpy as np

from sparse_coord_ros.game.actions import COORDINATE
from sparse_coord_ros.game.perception import asked_peers
from sparse_coord_ros.game.streams import PEER, POLICY
from sparse_coord_ros.runlog.draws import draws_at
from sparse_coord_ros.runlog.log import NONE, RunLog
from sparse_coord_ros.wire import ACTION_LABELS
from sparse_coord_ros.wire.frame import EAST_NORTH, Frame


class Trajectory(NamedTuple):
    """One robot's actions in the log, and what came of them; n actions.

    Attributes:
        row: which time step of the log, shape (n,).
        step: the time step.
        cell: where it was, next_cell: where it was a step later; NONE where the log does not say.
        action, move: A_k(t), and the primitive action that it became.
        peers: whom it asks if it chooses COORDINATE, shape (n, number of them).
        seen: in which cells it perceived them, shape (n, number of them); NONE in all where not.
        told: whether the log holds the reward and both states.
        learned: whether it has learned from the action.
        reward: shape (n, 4); partners: shape (n,), as of `RunLog`.
    """

    row: np.ndarray
    step: np.ndarray
    cell: np.ndarray
    next_cell: np.ndarray
    action: np.ndarray
    move: np.ndarray
    peers: np.ndarray
    seen: np.ndarray
    told: np.ndarray
    learned: np.ndarray
    reward: np.ndarray
    partners: np.ndarray

    @property
    def perceived(self) -> np.ndarray:
        """Whether it chose COORDINATE and perceived its peers, shape (n,)."""
        asked: np.ndarray = (self.action == COORDINATE) & (self.seen.shape[1] > 0)
        asked &= (self.seen != NONE).all(axis=1)
        return asked

    def perceived_at(self, i: int) -> tuple[int, ...] | None:
        """Return the cells in which it perceived its peers at an action; None where not."""
        seen = tuple(self.seen[i].tolist())
        return seen if seen and NONE not in seen else None


def trajectory_of(log: RunLog, k: int) -> Trajectory:
    """Return robot k's trajectory, up to an action or a state that makes no sense.

    Whether it has learned from an action its next one says; from the last one the numbers beside
    the tables.
    """
    rows = np.searchsorted(log.step, log.tracks.actions[k].step)
    odd = (log.cells[rows, k] == NONE) | (log.move[rows, k] == NONE)
    if odd.any():
        rows = rows[: int(np.argmax(odd))]
    step, count = log.step[rows], len(rows)
    after = np.minimum(rows + 1, len(log.step) - 1)
    followed = (rows + 1 < len(log.step)) & (log.step[after] == step + 1)
    next_cell = np.where(followed, log.cells[after, k], NONE)
    told = (next_cell != NONE) & ~np.isnan(log.reward[rows, k, 0])
    said = log.has_learned[rows, k]
    learned = np.zeros(count, dtype=bool)
    learned[:-1] = said[1:] == 1.0
    for entry in log.all_tables:
        if entry.robot == k and count and entry.step > step[-1]:
            learned[-1] = entry.counts.get("learned", 0) > int(learned[:-1].sum())
    peers = _peers(log, k, step)
    seen = np.full(peers.shape, NONE, dtype=np.int64)
    percepts = log.tracks.percepts[k]
    right = percepts.step[percepts.rows["count"] == 1 + peers.shape[1]]
    if peers.size:
        seen = np.where(
            np.isin(step, right)[:, None], log.percept[rows[:, None], k, peers], NONE
        ).astype(np.int64)
        seen[(seen == NONE).any(axis=1)] = NONE
    return Trajectory(
        row=rows,
        step=step,
        cell=log.cells[rows, k].astype(np.int64),
        next_cell=next_cell.astype(np.int64),
        action=log.action[rows, k].astype(np.int64),
        move=log.move[rows, k].astype(np.int64),
        peers=peers,
        seen=seen,
        told=told,
        learned=learned,
        reward=log.reward[rows, k],
        partners=log.partners[rows, k],
    )


def _peers(log: RunLog, k: int, step: np.ndarray) -> np.ndarray:
    """Return whom robot k asks at some time steps if it chooses COORDINATE."""
    peers, robots = log.run.scenario.peers, len(log.names)
    draws = draws_at(log.run.seed, k, POLICY, step)[:, PEER]
    asked = [asked_peers(peers, k, robots, draw) for draw in draws.tolist()]
    width = len(asked_peers(peers, k, robots, 0.0))
    return np.array(asked, dtype=np.int64).reshape(len(step), width)


def due_numbers(trajectory: Trajectory) -> np.ndarray:
    """Return the numbers of the logged actions as they must be, by `ACTION_LABELS`."""
    asked = trajectory.action == COORDINATE
    numbers = np.zeros((len(trajectory.step), len(ACTION_LABELS)))
    numbers[:, :2] = np.array(EAST_NORTH)[trajectory.move]
    numbers[:, 2] = asked
    if trajectory.peers.shape[1] == 1:
        numbers[:, 3] = np.where(asked, trajectory.peers[:, 0] + 1, 0)
    numbers[:, 4] = asked & (trajectory.seen != NONE).all(axis=1) & (trajectory.seen.shape[1] > 0)
    return numbers


def heard_askers(log: RunLog, k: int) -> dict[int, list[tuple[int, int]]]:
    """Return who asked robot k at which time step, and from which cell: those that it heard."""
    frame = Frame(log.run)
    heard: dict[int, list[tuple[int, int]]] = {}
    for request in log.requests:
        answer = request.said or request.answer
        cell = frame.cell(*request.position)
        if request.peer == k and cell is not None and answer and answer[0] == request.step:
            heard.setdefault(request.step, []).append((request.asker, cell))
    return heard
