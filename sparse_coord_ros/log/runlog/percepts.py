# Copyright 2026 The sparse_coord_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Check of percepts against the perception model's draws and the dialogue."""

from collections.abc import Iterator, Sequence
from typing import Any, NamedTuple

import numpy as np

from sparse_coord_ros.core.game.percepts import Percepts
from sparse_coord_ros.log.runlog.dialogue import Request, heard
from sparse_coord_ros.log.runlog.difference import DIALOGUE, MISSING, Difference
from sparse_coord_ros.log.runlog.log import NONE, RunLog
from sparse_coord_ros.log.runlog.replay import Trajectory
from sparse_coord_ros.protocol.wire import ACTION, PERCEPT, PerceptEnd
from sparse_coord_ros.protocol.wire.events import EventKind

Place = tuple[float, float]


def percept_end(code: float) -> str:
    """Return the end of a percept in the words of `PerceptEnd`, from the number in the action."""
    end = PerceptEnd.said(code)
    return f"percept={code:g}" if end is None else end.words


def check_percepts(log: RunLog, trajectories: Sequence[Trajectory]) -> list[Difference]:
    """Return the differences in percepts and dialogue.

    Args:
        log: the log.
        trajectories: each robot's actions in the time steps to check.
    """
    return list(_PerceptCheck(log, trajectories).differences())


class _DueAnswer(NamedTuple):
    """The answer that a peer must give.

    Attributes:
        peer: its number.
        cell: its cell.
        where: the position of the cell; None: it refuses.
    """

    peer: int
    cell: int
    where: Place | None

    @property
    def words(self) -> str:
        """The answer in words."""
        return "a refusal" if self.where is None else f"the answer {self.where}"


class _PerceptCheck:
    """Compares percepts and dialogue with the perception model.

    Args:
        log: the log.
        trajectories: as in `check_percepts`.
    """

    def __init__(self, log: RunLog, trajectories: Sequence[Trajectory]) -> None:
        self.log = log
        self.trajectories = trajectories
        self.frame = log.frame
        self.difference = log.messages.difference
        self.percepts = Percepts(log.run.scenario, log.run.seed)
        self.heard: dict[tuple[int, int, int], list[Request]] = {}
        for k in range(len(log.names)):
            for request in heard([one for one in log.requests if one.asker == k]):
                key = k, request.peer, request.step
                self.heard.setdefault(key, []).append(request)

    def differences(self) -> Iterator[Difference]:
        """Yield the differences of percepts, then those of requests."""
        for k in range(len(self.log.names)):
            yield from self._robot(k)
        for request in self.log.requests:
            yield from self._request(request)

    def _robot(self, k: int) -> Iterator[Difference]:
        log = self.log
        trajectory = self.trajectories[k]
        percepts = log.messages.percepts[k]
        rows = dict(zip(percepts.step.tolist(), percepts.rows, strict=True))
        asked = set(log.step[log.asked[:, k]].tolist())
        yield from self._unpaired(k, set(rows), asked)
        ends = log.ended[trajectory.row, k].tolist()
        peers = trajectory.peers.tolist()
        for i, step in enumerate(trajectory.step.tolist()):
            if step not in asked:
                yield from self._ended(k, step, ends[i], PerceptEnd.DID_NOT_ASK)
            elif step in rows:
                yield from self._percept(k, step, rows[step], peers[i], ends[i])

    def _unpaired(
        self, k: int, perceived: set[int], asked: set[int]
    ) -> Iterator[Difference]:
        """Yield percepts without COORDINATE, and COORDINATE without a percept."""
        acted = set(self.log.messages.actions[k].step.tolist())
        for step in sorted(perceived ^ asked):
            if step in asked:
                yield self.difference(step, k, PERCEPT.name, MISSING, "one")
            elif step in acted:
                yield self.difference(step, k, PERCEPT.name, "a percept", "none")
            else:
                yield self.difference(step, k, ACTION.name, MISSING, "COORDINATE")

    def _percept(
        self, k: int, step: int, row: np.ndarray, peers: list[int], end: float
    ) -> Iterator[Difference]:
        """Check one percept: its positions, its logged end, and the answers."""
        places = [tuple(place) for place in row["places"].tolist()]
        own, *seen = places[: int(row["count"])]
        here = self._cell(k, step)
        due = self._due_answers(k, step, peers)
        if here is None or own != self.frame.centres[here]:
            yield self.difference(step, k, "percept own", f"{own}", f"cell {here}")
            return
        if due is None:  # the world's check reports the missing state
            return
        where = [one.where for one in due]
        if not seen or seen == where:
            yield from self._end_of_percept(k, step, end, due, perceived=bool(seen))
            return
        computed = _words([one.cell for one in due])
        if None in where or not due:
            computed = PerceptEnd.REFUSED.words
        logged = _words([self.frame.cell(*place) for place in seen])
        yield self.difference(step, k, PERCEPT.name, logged, computed)

    def _end_of_percept(
        self,
        k: int,
        step: int,
        end: float,
        due: Sequence[_DueAnswer],
        *,
        perceived: bool,
    ) -> Iterator[Difference]:
        """Check the logged end of a percept by its positions and the answers."""
        if perceived:
            yield from self._ended(k, step, end, PerceptEnd.ANSWERED)
            if end == PerceptEnd.ANSWERED:
                for one in due:
                    yield from self._answer(k, step, one)
        elif not due:
            yield from self._ended(k, step, end, PerceptEnd.NOBODY_TO_ASK)
        else:
            yield from self._ended(k, step, end, PerceptEnd.REFUSED, PerceptEnd.LATE)
            if end == PerceptEnd.REFUSED:
                yield from self._refused(k, step, due)

    def _ended(
        self, k: int, step: int, end: float, *allowed: PerceptEnd
    ) -> Iterator[Difference]:
        """Check that the logged end of a percept is an allowed one, bit for bit."""
        if repr(end) not in [repr(float(one)) for one in allowed]:
            words = " or ".join(one.words for one in allowed)
            yield self.difference(step, k, PERCEPT.name, percept_end(end), words)

    def _due_answers(
        self, k: int, step: int, peers: Sequence[int]
    ) -> list[_DueAnswer] | None:
        """Return the answers that peers must give; None if the log lacks a state."""
        here = self._cell(k, step)
        found = []
        for peer in peers:
            cell = self._cell(peer, step)
            if here is None or cell is None:
                return None
            sees = self.percepts.sees(step, k, here, cell)
            where = self.frame.centres[cell] if sees else None
            found.append(_DueAnswer(peer, cell, where))
        return found

    def _refused(
        self, k: int, step: int, due: Sequence[_DueAnswer]
    ) -> Iterator[Difference]:
        """Check that peers answered in order, up to one that refused or was at a later step."""
        for one in due:
            answers = self._answers(k, one.peer, step)
            if any(answer is not None and answer[0] > step for answer in answers):
                return
            yield from self._answer(k, step, one)
            if not any(answers) or one.where is None:
                return
        cells = _words([one.cell for one in due])
        yield self.difference(step, k, PERCEPT.name, PerceptEnd.REFUSED.words, cells)

    def _answer(self, k: int, step: int, due: _DueAnswer) -> Iterator[Difference]:
        """Check that a peer gave the due answer to one of the requests.

        A robot that is too busy to read an answer asks again, and then reads the earlier answer.
        """
        answers = self._answers(k, due.peer, step)
        if (step, due.where) in answers:
            return
        logged = MISSING
        if answers:
            logged = f"{answers[0] or f'{EventKind.RETURNED.words} {MISSING}'}"
        yield self.difference(step, k, self._dialogue_with(due.peer), logged, due.words)

    def _answers(self, k: int, peer: int, step: int) -> list[tuple[Any, ...] | None]:
        """Return a peer's answers to a robot's requests of a time step; None: no answer came."""
        return [request.answer for request in self.heard.get((k, peer, step), [])]

    def _request(self, request: Request) -> Iterator[Difference]:
        """Check that the four events of an answered request exist, agree and are true."""
        k = request.asker
        step = request.step
        quantity = self._dialogue_with(request.peer)
        if EventKind.RETURNED in request.wall_ns:
            for kind in sorted(set(EventKind) - request.wall_ns.keys()):
                words = f"{quantity}, {kind.words}", MISSING, "one"
                yield self.difference(step, k, *words)
        if request.answer is not None and request.said not in (None, request.answer):
            received = f"{request.answer}, as it was received"
            yield self.difference(step, k, quantity, f"{request.said}", received)
        here = self._cell(k, step)
        if here is not None and request.position != self.frame.centres[here]:
            logged = f"asked from {request.position}"
            computed = f"{self.frame.centres[here]}"
            yield self.difference(step, k, quantity, logged, computed)
            return
        due = self._due_answers(k, step, [request.peer])
        if request.answer is None or due is None:
            return
        [must] = due
        at, where = request.answer
        if at != step:  # a peer at another time step refuses
            must = must._replace(where=None)
        if where != must.where:
            yield self.difference(step, k, quantity, f"{request.answer}", must.words)

    def _dialogue_with(self, peer: int) -> str:
        return f"{DIALOGUE} with {self.log.names[peer]}"

    def _cell(self, k: int, step: int) -> int | None:
        """Return a robot's cell; None if the log does not contain it."""
        row = self.log.row_of.get(step)
        if row is None:
            return None
        cell = int(self.log.cells[row, k])
        return None if cell == NONE else cell


def _words(cells: Sequence[int | None]) -> str:
    return ", ".join(
        "no free cell" if cell is None else f"cell {cell}" for cell in cells
    )
