# Copyright 2026 The sparse_coord_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Whether percepts ended as the robots say: by the perception model's draws and the dialogue."""

from collections.abc import Iterator, Sequence
from typing import NamedTuple

import numpy as np

from sparse_coord_ros.core.game.percepts import Percepts
from sparse_coord_ros.log.runlog.dialogue import Request, heard
from sparse_coord_ros.log.runlog.difference import DIALOGUE, MISSING, Difference
from sparse_coord_ros.log.runlog.log import NONE, RunLog
from sparse_coord_ros.log.runlog.replay import Stretch, trajectory_of
from sparse_coord_ros.protocol.wire import ACTION, PERCEPT, PerceptEnd
from sparse_coord_ros.protocol.wire.events import EventKind

Place = tuple[float, float]


def percept_end(code: float) -> str:
    """Return how a percept ended in the words of `PerceptEnd`, by the number in the action."""
    end = PerceptEnd.said(code)
    return f"percept={code:g}" if end is None else end.words


def check_percepts(log: RunLog, stretch: Stretch) -> list[Difference]:
    """Return in what percepts and dialogue differ from what they must be from a stretch on."""
    return list(_Judge(log, stretch).all())


class _Due(NamedTuple):
    """What a peer must answer: the cell that it is in, and where that is, None: it refuses."""

    peer: int
    cell: int
    where: Place | None

    @property
    def words(self) -> str:
        """What it must say."""
        return "a refusal" if self.where is None else f"the answer {self.where}"


class _Judge:
    def __init__(self, log: RunLog, stretch: Stretch) -> None:
        self.log = log
        self.stretch = stretch
        self.frame = log.frame
        self.odd = log.tracks.odd
        self.percepts = Percepts(log.run.scenario, log.run.seed)
        self.heard: dict[tuple[int, int, int], list[Request]] = {}
        for k in range(len(log.names)):
            for request in heard([r for r in log.requests if r.asker == k]):
                self.heard.setdefault((k, request.peer, request.step), []).append(
                    request
                )

    def all(self) -> Iterator[Difference]:
        """Yield what is odd about percepts, then about requests."""
        for k in range(len(self.log.names)):
            yield from self._robot(k)
        for request in self.log.requests:
            yield from self._request(request)

    def _robot(self, k: int) -> Iterator[Difference]:
        log = self.log
        trajectory = trajectory_of(self.log, k, self.stretch)
        acted = set(log.tracks.actions[k].step.tolist())
        percepts = log.tracks.percepts[k]
        rows = dict(zip(percepts.step.tolist(), percepts.rows, strict=True))
        asked = set(log.step[log.asked[:, k]].tolist())
        for step in sorted({*rows} ^ asked):
            if step in asked:
                yield self.odd(step, k, PERCEPT.name, MISSING, "one")
            elif step in acted:
                yield self.odd(step, k, PERCEPT.name, "a percept", "none")
            else:
                yield self.odd(step, k, ACTION.name, MISSING, "COORDINATE")
        ends = zip(
            trajectory.step.tolist(), log.ended[trajectory.row, k].tolist(), strict=True
        )
        for i, (step, code) in enumerate(ends):
            if step in asked and step in rows:
                yield from self._percept(
                    k, step, rows[step], trajectory.peers[i].tolist(), code
                )
            elif step not in asked:
                yield from self._ended(k, step, code, PerceptEnd.DID_NOT_ASK)

    def _percept(
        self, k: int, step: int, row: np.ndarray, peers: list[int], code: float
    ) -> Iterator[Difference]:
        """Judge one percept: what it shows, how it is said to have ended, what was answered."""
        own, *seen = [tuple(place) for place in row["places"].tolist()][
            : int(row["count"])
        ]
        here = self._cell(k, step)
        due = self._due(k, step, peers)
        where = [] if due is None else [one.where for one in due]
        if here is None or own != self.frame.centres[here]:
            yield self.odd(step, k, "percept own", f"{own}", f"cell {here}")
        elif due is None:
            return  # the world's check names the missing state
        elif seen and seen != where:
            refused = None in where or not due
            words = (
                PerceptEnd.REFUSED.words
                if refused
                else _words([one.cell for one in due])
            )
            found = _words([self.frame.cell(*place) for place in seen])
            yield self.odd(step, k, PERCEPT.name, found, words)
        else:
            yield from self._dialogue(k, step, code, due, shown=bool(seen))

    def _dialogue(
        self, k: int, step: int, code: float, due: Sequence[_Due], *, shown: bool
    ) -> Iterator[Difference]:
        """Judge how a percept is said to have ended, by what it shows and what was answered."""
        if shown:
            yield from self._ended(k, step, code, PerceptEnd.ANSWERED)
            for one in due if code == PerceptEnd.ANSWERED else ():
                yield from self._answer(k, step, one)
        elif not due:
            yield from self._ended(k, step, code, PerceptEnd.NOBODY_TO_ASK)
        else:
            yield from self._ended(k, step, code, PerceptEnd.REFUSED, PerceptEnd.LATE)
            if code == PerceptEnd.REFUSED:
                yield from self._refused(k, step, due)

    def _ended(
        self, k: int, step: int, code: float, *allowed: PerceptEnd
    ) -> Iterator[Difference]:
        """Judge how a percept is said to have ended."""
        if repr(code) not in [repr(float(end)) for end in allowed]:
            words = " or ".join(end.words for end in allowed)
            yield self.odd(step, k, PERCEPT.name, percept_end(code), words)

    def _due(self, k: int, step: int, peers: Sequence[int]) -> list[_Due] | None:
        """Return what peers must answer a robot; None where the log lacks a state of theirs."""
        here = self._cell(k, step)
        found = []
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
            answers = [
                request.answer for request in self.heard.get((k, one.peer, step), [])
            ]
            if any(answer is not None and answer[0] > step for answer in answers):
                return
            yield from self._answer(k, step, one)
            if not any(answers) or one.where is None:
                return
        cells = _words([one.cell for one in due])
        yield self.odd(step, k, PERCEPT.name, PerceptEnd.REFUSED.words, cells)

    def _answer(self, k: int, step: int, due: _Due) -> Iterator[Difference]:
        """Compare the dialogue with what a peer must have answered.

        Of several requests the last one counts, or one before it that brought what is due: a robot
        that is too busy to look at an answer asks again, and then looks at the answer that had
        come.
        """
        answers = [
            request.answer for request in self.heard.get((k, due.peer, step), [])
        ]
        if (step, due.where) not in answers:
            silent = f"{EventKind.RETURNED.words} {MISSING}"
            logged = f"{answers[0] or silent}" if answers else MISSING
            yield self.odd(step, k, self._with(due.peer), logged, due.words)

    def _request(self, request: Request) -> Iterator[Difference]:
        """Judge whether the four sides of an answered request are there, agree and are true."""
        k = request.asker
        step = request.step
        quantity = self._with(request.peer)
        answered = EventKind.RETURNED in request.wall_ns
        for kind in sorted(set(EventKind) - request.wall_ns.keys()) if answered else ():
            yield self.odd(step, k, f"{quantity}, {kind.words}", MISSING, "one")
        if request.answer is not None and request.said not in (None, request.answer):
            received = f"{request.answer}, as it was received"
            yield self.odd(step, k, quantity, f"{request.said}", received)
        here = self._cell(k, step)
        due = self._due(k, step, [request.peer])
        if here is not None and request.position != self.frame.centres[here]:
            logged = f"asked from {request.position}"
            yield self.odd(step, k, quantity, logged, f"{self.frame.centres[here]}")
        elif request.answer is not None and due is not None:
            at, where = request.answer
            [must] = due if at == step else [due[0]._replace(where=None)]
            if where != must.where:
                yield self.odd(step, k, quantity, f"{request.answer}", must.words)

    def _with(self, peer: int) -> str:
        return f"{DIALOGUE} with {self.log.names[peer]}"

    def _cell(self, k: int, step: int) -> int | None:
        row = self.log.row_of.get(step)
        cell = NONE if row is None else int(self.log.cells[row, k])
        return None if cell == NONE else cell


def _words(cells: Sequence[int | None]) -> str:
    return ", ".join(
        "no free cell" if cell is None else f"cell {cell}" for cell in cells
    )
