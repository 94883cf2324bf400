# Copyright 2026 The sparse_coord_ros authors
# SPDX-License-Identifier: Apache-2.0
"""One time step of a team as data, from a log or as it happens: all that shows a team reads it."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from sparse_coord_ros.game.actions import ACTIONS
from sparse_coord_ros.game.miscoordination import miscoordinations
from sparse_coord_ros.game.world import Action
from sparse_coord_ros.learn.agent import NOBODY
from sparse_coord_ros.learn.simulation import Glimpse
from sparse_coord_ros.palette import ANSWERED, FAILED, REFUSED
from sparse_coord_ros.runlog.log import NONE, RunLog
from sparse_coord_ros.wire import PerceptEnd


class Question(NamedTuple):
    """One COORDINATE.

    Attributes:
        asker: number of the robot that asks, from 0.
        peers: whom it asks.
        end: how its percept ended.
        move: the primitive action that it became.
    """

    asker: int
    peers: tuple[int, ...]
    end: PerceptEnd
    move: int

    @property
    def outcome(self) -> str:
        """How it is shown: ANSWERED, REFUSED or FAILED."""
        return self.end.outcome

    def in_words(self, names: Sequence[str]) -> str:
        """Return it as a sentence."""
        whom = ", ".join(names[peer] for peer in self.peers) or "nobody"
        if len(self.peers) == len(names) - 1 > 1:
            whom = "all others"
        ended = "no answer" if self.outcome == FAILED else self.outcome
        return f"{names[self.asker]} asks {whom}: {ended}, goes {ACTIONS[self.move]}"


@dataclass(frozen=True)
class TimeStep:
    """What K robots did at one time step; None where nobody says it.

    Attributes:
        step: t.
        cells: X_k(t).
        moves: the primitive actions; None of robots that did not act.
        questions: who asked whom.
        rewards: R_k(t) as (individual, common, cost of asking, total).
        after: where it led, X_k(t+1).
        miscoordination: whether it ended in one.
    """

    step: int
    cells: tuple[int | None, ...]
    moves: tuple[int | None, ...] = ()
    questions: tuple[Question, ...] = ()
    rewards: tuple[tuple[float, ...] | None, ...] = ()
    after: tuple[int | None, ...] | None = None
    miscoordination: bool = False


def logged_step(log: RunLog, row: int) -> TimeStep:
    """Return a time step of a log, given by its row."""
    questions = tuple(
        Question(
            k,
            _peers(k, int(log.peer[row, k]), len(log.names)),
            _logged_end(log, row, k),
            int(log.move[row, k]),
        )
        for k in np.flatnonzero(log.asked[row]).tolist()
    )
    rewards = tuple(None if r[-1] != r[-1] else tuple(r) for r in log.reward[row].tolist())
    followed = row + 1 < len(log.step) and log.step[row + 1] == log.step[row] + 1
    acted = any(reward is not None for reward in rewards)
    return TimeStep(
        step=int(log.step[row]),
        cells=_known(log.cells[row]),
        moves=_known(log.move[row]),
        questions=questions,
        rewards=rewards,
        after=_known(log.cells[row + 1]) if followed else None,
        miscoordination=bool(
            followed and acted and miscoordinations(log.run.scenario, log.cells[[row + 1]])[0]
        ),
    )


def seen_step(seen: Glimpse) -> TimeStep:
    """Return a time step that was seen as it happened."""
    rewards = seen.rewards or (None,) * len(seen.actions)
    return TimeStep(
        step=seen.step,
        cells=seen.cells,
        moves=tuple(None if action is None else action.move for action in seen.actions),
        questions=tuple(
            Question(
                k,
                peers := _peers(k, action.peer, len(seen.actions)),
                _seen_end(seen, k, action, peers),
                action.move,
            )
            for k, action in enumerate(seen.actions)
            if action is not None and action.asked
        ),
        rewards=tuple(
            None if action is None or reward is None else tuple(reward[:4])
            for action, reward in zip(seen.actions, rewards, strict=True)
        ),
        after=seen.after,
        miscoordination=seen.miscoordination,
    )


def ended(log: RunLog) -> dict[str, np.ndarray]:
    """Return where in a log, shape (T, K), bool, questions ended so, by each outcome."""
    answered = log.asked & log.perceived
    refused = log.asked & (log.ended == PerceptEnd.REFUSED) & ~answered
    return {ANSWERED: answered, REFUSED: refused, FAILED: log.asked & ~answered & ~refused}


def _logged_end(log: RunLog, row: int, k: int) -> PerceptEnd:
    """Return how a percept ended as the robot says; LATE where that is nothing known."""
    if log.perceived[row, k]:
        return PerceptEnd.ANSWERED
    end = PerceptEnd.said(log.ended[row, k])
    return PerceptEnd.LATE if end is None else end


def _seen_end(seen: Glimpse, k: int, action: Action, peers: tuple[int, ...]) -> PerceptEnd:
    """Return how a percept ended; where nobody tells it, as in one process, where none is late."""
    told = seen.ends[k] if seen.ends else None
    if told is not None and not action.perceived:
        return PerceptEnd(told)
    return PerceptEnd.untold(perceived=action.perceived, peers=len(peers))


def _peers(robot: int, peer: int, robots: int) -> tuple[int, ...]:
    """Return whom a robot asks: one peer, or (NOBODY) all others."""
    return (peer,) if peer != NOBODY else tuple(k for k in range(robots) if k != robot)


def _known(numbers: np.ndarray) -> tuple[int | None, ...]:
    """Return cells or moves, shape (K,), with None in place of NONE."""
    return tuple(None if number == NONE else number for number in numbers.tolist())
