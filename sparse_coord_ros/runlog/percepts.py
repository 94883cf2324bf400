# Copyright 2026 The sparse_coord_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Whether percepts ended as the robots say: by the perception model's draws and the dialogue."""

from collections.abc import Iterator, Sequence
from typing import Any

import numpy as np

from sparse_coord_ros.game.perception import percept_probabilities, succeeds
from sparse_coord_ros.runlog.dialogue import Request, heard
from sparse_coord_ros.runlog.difference import DIALOGUE, MISSING, Difference
from sparse_coord_ros.runlog.draws import percept_draws
from sparse_coord_ros.runlog.log import NONE, RunLog
from sparse_coord_ros.runlog.trajectory import trajectory_of
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


class _Judge:
    def __init__(self, log: RunLog, last: int) -> None:
        self.log, self.last, self.frame = log, last, Frame(log.run)
        scenario = log.run.scenario
        self.probabilities = percept_probabilities(scenario.perception, scenario.map).tolist()
        self.heard: dict[tuple[int, int, int], list[Request]] = {}
        for k in self.robots:
            for request in heard([r for r in log.requests if r.asker == k]):
                self.heard.setdefault((k, request.peer, request.step), []).append(request)
        self.row = {step: row for row, step in enumerate(log.step.tolist())}
        steps = [sorted({r.step for r in log.requests if r.asker == k}) for k in self.robots]
        self.draws = []
        for k in self.robots:
            asked = set(log.step[log.asked[:, k]].tolist()) | set(steps[k])
            wanted = np.array(sorted(step for step in asked if step >= 0), dtype=np.int64)
            values = percept_draws(log.run, k, wanted)
            self.draws.append(dict(zip(wanted.tolist(), values.tolist(), strict=True)))

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
        name, centres = self.log.names[k], self.frame.centres
        count = int(row["count"])
        places = [tuple(place) for place in row["places"].tolist()][:count]
        here = self._cell(k, step)
        if here is None or places[:1] != [centres[here]]:
            yield Difference(step, name, "percept own", f"{places[:1]}", f"cell {here}")
            return
        known = [self._cell(peer, step) for peer in peers]
        cells = [cell for cell in known if cell is not None]
        if len(cells) < len(known):
            return  # the world's check names the missing state
        sees = [succeeds(self.draws[k][step], self.probabilities[here][cell]) for cell in cells]
        where = [centres[cell] if seen else None for cell, seen in zip(cells, sees, strict=True)]
        due = list(zip(peers, where, strict=True))
        answered = bool(peers) and all(sees)
        expected = _words(cells) if answered else PerceptEnd.REFUSED.words
        allowed: tuple[PerceptEnd, ...] = (PerceptEnd.ANSWERED,)
        if count == 1:
            allowed = (
                (PerceptEnd.REFUSED, PerceptEnd.LATE) if peers else (PerceptEnd.NOBODY_TO_ASK,)
            )
        elif not answered or places[1:] != where or count != 1 + len(peers):
            found = _words([self.frame.cell(*place) for place in places[1:]])
            yield Difference(step, name, PERCEPT.name, found, expected)
            return
        if code not in allowed:
            yield self._code(step, k, code, " or ".join(end.words for end in allowed))
        elif code == PerceptEnd.ANSWERED:
            yield from self._answers(k, step, due)
        elif code == PerceptEnd.REFUSED:
            yield from self._refused(k, step, due, expected=_words(cells))

    def _refused(
        self, k: int, step: int, due: Sequence[tuple[int, Place | None]], *, expected: str
    ) -> Iterator[Difference]:
        """One peer after the other has answered, up to one that refused or was further."""
        for peer, where in due:
            answers = [request.answer for request in self.heard.get((k, peer, step), [])]
            if any(answer is not None and answer[0] > step for answer in answers):
                return
            yield from self._answers(k, step, [(peer, where)])
            if not any(answers) or where is None:
                return
        yield Difference(step, self.log.names[k], PERCEPT.name, PerceptEnd.REFUSED.words, expected)

    def _answers(
        self, k: int, step: int, due: Sequence[tuple[int, Place | None]]
    ) -> Iterator[Difference]:
        """Compare the dialogue with what peers must have answered: where they are; None: no."""
        name = self.log.names[k]
        for peer, where in due:
            quantity = f"{DIALOGUE} with {self.log.names[peer]}"
            said = "a refusal" if where is None else f"the answer {where}"
            request = self._counting(k, peer, step, (step, where))
            if request is None:
                yield Difference(step, name, quantity, MISSING, said)
            elif request.answer is None:
                yield Difference(
                    step, name, quantity, f"{EventKind.RETURNED.words} {MISSING}", said
                )
            elif request.answer != (step, where):
                yield Difference(step, name, quantity, f"{request.answer}", said)

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
        here, there = self._cell(request.asker, step), self._cell(request.peer, step)
        if here is not None and request.position != self.frame.centres[here]:
            logged = f"asked from {request.position}"
            yield Difference(step, who, quantity, logged, f"{self.frame.centres[here]}")
        elif request.answer is not None and here is not None and there is not None:
            at, where = request.answer
            sees = succeeds(self.draws[request.asker][step], self.probabilities[here][there])
            due = self.frame.centres[there] if sees and at == step else None
            if where != due:
                computed = "a refusal" if due is None else f"the answer {due}"
                yield Difference(step, who, quantity, f"{request.answer}", computed)

    def _code(self, step: int, k: int, code: float, computed: str) -> Difference:
        return Difference(step, self.log.names[k], PERCEPT.name, percept_end(code), computed)

    def _cell(self, k: int, step: int) -> int | None:
        row = self.row.get(step)
        cell = NONE if row is None else int(self.log.cells[row, k])
        return None if cell == NONE else cell


def _words(cells: Sequence[int | None]) -> str:
    return ", ".join("no free cell" if cell is None else f"cell {cell}" for cell in cells)
