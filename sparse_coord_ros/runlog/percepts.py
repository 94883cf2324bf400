# Copyright 2026 The sparse_coord_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Whether percepts ended as the robots say: by the perception model's draws and the dialogue."""

from collections.abc import Iterator, Sequence
from typing import Any, NamedTuple

import numpy as np

from sparse_coord_ros.game.links import Percepts
from sparse_coord_ros.runlog.dialogue import Request, heard
from sparse_coord_ros.runlog.difference import DIALOGUE, MISSING, Difference
from sparse_coord_ros.runlog.log import NONE, RunLog
from sparse_coord_ros.runlog.replay import trajectory_of
from sparse_coord_ros.wire import ACTION, PERCEPT, PerceptEnd
from sparse_coord_ros.wire.events import EventKind
from sparse_coord_ros.wire.frame import Frame

Place = tuple[float, float]


def percept_end(code: float) -> str:
    """Return how a percept ended in the words of `PerceptEnd`, by the number in the action."""
    end = PerceptEnd.said(code)
    return f"percept={code:g}" if end is None else end.words


def check_percepts(log: RunLog, last: int | None) -> list[Difference]:
    """Return in what percepts and dialogue differ from what they must be.

    Args:
        log: the log.
        last: the last time step to check; None: all.
    """
    return list(_Judge(log, log.step[-1] if last is None and len(log.step) else last or 0).all())


class _Due(NamedTuple):
    """What a peer must answer: the cell that it is in, and where that is, None: it refuses."""

    peer: int
    cell: int
    where: Place | None


class _Judge:
    def __init__(self, log: RunLog, last: int) -> None:
        self.log, self.last, self.frame = log, last, Frame(log.run)
        self.percepts = Percepts(log.run.scenario, log.run.seed)
        self.heard: dict[tuple[int, int, int], list[Request]] = {}
        for k in self.robots:
            for request in heard([r for r in log.requests if r.asker == k]):
                self.heard.setdefault((k, request.peer, request.step), []).append(request)
        self.row = {step: row for row, step in enumerate(log.step.tolist())}

    @property
    def robots(self) -> range:
        """The robots' numbers."""
        return range(len(self.log.names))

    def all(self) -> Iterator[Difference]:
        """Yield what is odd about percepts, then about requests."""
        for k in self.robots:
            yield from self._robot(k)
        for request in self.log.requests:
            if request.step <= self.last:
                yield from self._request(request)

    def _robot(self, k: int) -> Iterator[Difference]:
        log, name = self.log, self.log.names[k]
        actions, percepts = log.tracks.actions[k], log.tracks.percepts[k]
        asked = log.step[log.asked[:, k]]
        for step in percepts.step[~np.isin(percepts.step, asked)].tolist():
            if step <= self.last and actions.has(np.array([step]))[0]:
                yield Difference(step, name, PERCEPT.name, "a percept", "none")
            elif step <= self.last:
                yield Difference(step, name, ACTION.name, MISSING, "COORDINATE")
        for step in asked[~np.isin(asked, percepts.step)].tolist():
            if step <= self.last:
                yield Difference(step, name, PERCEPT.name, MISSING, "one")
        trajectory = trajectory_of(log, k)
        codes = log.ended[trajectory.row, k]
        coordinates = log.asked[trajectory.row, k]
        lies = (codes != PerceptEnd.DID_NOT_ASK) & ~coordinates
        lies &= trajectory.step <= self.last
        for step, code in zip(trajectory.step[lies].tolist(), codes[lies].tolist(), strict=True):
            yield self._code(step, k, code, PerceptEnd.DID_NOT_ASK.words)
        places = dict(zip(percepts.step.tolist(), range(len(percepts.step)), strict=True))
        for i in np.flatnonzero(coordinates & (trajectory.step <= self.last)).tolist():
            step = int(trajectory.step[i])
            if step in places:
                row = percepts.rows[places[step]]
                peers = trajectory.peers[i].tolist()
                yield from self._percept(k, step, row, peers, float(codes[i]))

    def _percept(
        self, k: int, step: int, row: np.ndarray, peers: list[int], code: float
    ) -> Iterator[Difference]:
        """Judge one percept: what it shows, how it is said to have ended, what was answered."""
        name, count = self.log.names[k], int(row["count"])
        places = [tuple(place) for place in row["places"].tolist()][:count]
        here = self._cell(k, step)
        if here is None or places[:1] != [self.frame.centres[here]]:
            yield Difference(step, name, "percept own", f"{places[:1]}", f"cell {here}")
            return
        due = self._due(k, step, peers)
        if due is None:
            return  # the world's check names the missing state
        expected = [one.where for one in due]
        if count > 1 and (None in expected or [count, *places[1:]] != [1 + len(due), *expected]):
            found = _words([self.frame.cell(*place) for place in places[1:]])
            refused = None in expected or not due
            words = PerceptEnd.REFUSED.words if refused else _words([one.cell for one in due])
            yield Difference(step, name, PERCEPT.name, found, words)
            return
        yield from self._end(k, step, code, due, shown=count > 1)

    def _end(
        self, k: int, step: int, code: float, due: Sequence[_Due], *, shown: bool
    ) -> Iterator[Difference]:
        """Judge how a percept is said to have ended, by what it shows and the dialogue."""
        allowed = [PerceptEnd.ANSWERED]
        if not shown:
            allowed = [PerceptEnd.REFUSED, PerceptEnd.LATE] if due else [PerceptEnd.NOBODY_TO_ASK]
        if code not in allowed:
            yield self._code(step, k, code, " or ".join(end.words for end in allowed))
        elif code == PerceptEnd.ANSWERED:
            for one in due:
                yield from self._answer(k, step, one)
        elif code == PerceptEnd.REFUSED:
            yield from self._refused(k, step, due)

    def _due(self, k: int, step: int, peers: Sequence[int]) -> list[_Due] | None:
        """Return what peers must answer a robot; None where the log lacks a state of theirs."""
        here, found = self._cell(k, step), []
        for peer in peers:
            cell = self._cell(peer, step)
            if here is None or cell is None:
                return None
            sees = self.percepts.sees(step, k, here, cell)
            found.append(_Due(peer, cell, self.frame.centres[cell] if sees else None))
        return found

    def _refused(self, k: int, step: int, due: Sequence[_Due]) -> Iterator[Difference]:
        """One peer after the other has answered, up to one that refused or was further."""
        for one in due:
            answers = [request.answer for request in self.heard.get((k, one.peer, step), [])]
            if any(answer is not None and answer[0] > step for answer in answers):
                return
            yield from self._answer(k, step, one)
            if not any(answers) or one.where is None:
                return
        name, cells = self.log.names[k], _words([one.cell for one in due])
        yield Difference(step, name, PERCEPT.name, PerceptEnd.REFUSED.words, cells)

    def _answer(self, k: int, step: int, due: _Due) -> Iterator[Difference]:
        """Compare the dialogue with what a peer must have answered."""
        request = self._counting(k, due.peer, step, (step, due.where))
        if request is not None and request.answer == (step, due.where):
            return
        logged = MISSING
        if request is not None:
            logged = (
                f"{request.answer}" if request.answer else f"{EventKind.RETURNED.words} {MISSING}"
            )
        quantity = f"{DIALOGUE} with {self.log.names[due.peer]}"
        yield Difference(step, self.log.names[k], quantity, logged, _said(due.where))

    def _counting(self, k: int, peer: int, step: int, due: tuple[int, Any]) -> Request | None:
        """Return the request of several to a peer at a step that counts: the last one.

        Or one before it that brought what is due: a robot that is too busy to look at an answer
        asks again, and then looks at the answer that had come.
        """
        requests = self.heard.get((k, peer, step), [])
        return next((r for r in requests if r.answer == due), requests[0] if requests else None)

    def _request(self, request: Request) -> Iterator[Difference]:
        """Judge whether the four sides of an answered request are there, agree and are true."""
        log, step = self.log, request.step
        quantity = f"{DIALOGUE} with {log.names[request.peer]}"
        who = log.names[request.asker]
        if EventKind.RETURNED in request.wall_ns:
            for kind in EventKind:
                if kind not in request.wall_ns:
                    yield Difference(step, who, f"{quantity}, {kind.words}", MISSING, "one")
        if request.answer is not None and request.said not in (None, request.answer):
            said, heard = f"{request.said}", f"{request.answer}"
            yield Difference(step, who, quantity, said, f"{heard}, as it was received")
        here, due = self._cell(request.asker, step), self._due(request.asker, step, [request.peer])
        if here is not None and request.position != self.frame.centres[here]:
            logged = f"asked from {request.position}"
            yield Difference(step, who, quantity, logged, f"{self.frame.centres[here]}")
        elif request.answer is not None and due is not None:
            at, where = request.answer
            must = due[0].where if at == step else None
            if where != must:
                yield Difference(step, who, quantity, f"{request.answer}", _said(must))

    def _code(self, step: int, k: int, code: float, computed: str) -> Difference:
        return Difference(step, self.log.names[k], PERCEPT.name, percept_end(code), computed)

    def _cell(self, k: int, step: int) -> int | None:
        row = self.row.get(step)
        cell = NONE if row is None else int(self.log.cells[row, k])
        return None if cell == NONE else cell


def _words(cells: Sequence[int | None]) -> str:
    return ", ".join("no free cell" if cell is None else f"cell {cell}" for cell in cells)


def _said(where: Place | None) -> str:
    return "a refusal" if where is None else f"the answer {where}"
