# Copyright 2026 The sparse_coord_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The dialogue of active perception, put together from the recorded service events."""

from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from sparse_coord_ros.runlog.difference import DIALOGUE, Difference
from sparse_coord_ros.runlog.timeline import steps_of
from sparse_coord_ros.wire.events import EventKind
from sparse_coord_ros.wire.frame import SECOND, Frame

NO_REQUEST = "without its request"


@dataclass(slots=True)
class Request:
    """One request of a dialogue and what came of it.

    Attributes:
        asker: number of the asking robot.
        peer: number of the asked robot.
        step: the time step of the request.
        position: where the asker said it is, in metres.
        wall_ns: wall clock of the four events by kind; those that were not recorded are missing.
        answer: (step, position) of the response; position None: refused. None: no response.
        said: the response by the peer's own account (kind ANSWERED), as `answer`.
    """

    asker: int
    peer: int
    step: int
    position: tuple[float, float]
    wall_ns: dict[int, int] = field(default_factory=dict)
    answer: tuple[Any, ...] | None = None
    said: tuple[Any, ...] | None = None

    @property
    def seconds(self) -> float | None:
        """Wall clock from the request to its answer; None where one of them is not recorded."""
        if EventKind.SENT not in self.wall_ns or EventKind.RETURNED not in self.wall_ns:
            return None
        return (self.wall_ns[EventKind.RETURNED] - self.wall_ns[EventKind.SENT]) / SECOND


def heard(requests: Sequence[Request]) -> list[Request]:
    """Return the requests but those that the asker had given up when their answer came.

    A robot that gets no answer for a while asks again, and then listens only to the newer request:
    of a peer that stood still all answers come, but one of them counts.

    Args:
        requests: some of one asker's.

    Returns:
        The newest first.
    """
    latest: dict[tuple[int, int], int] = {}
    found = []
    ordered = sorted(
        requests[::-1], key=lambda one: one.wall_ns.get(EventKind.SENT, 0), reverse=True
    )
    for request in ordered:
        place, sent = (request.peer, request.step), request.wall_ns.get(EventKind.SENT)
        if request.wall_ns.get(EventKind.RETURNED, 0) < latest.get(place, _NEVER):
            found.append(request)
        if sent is not None:
            latest[place] = sent
    return found


_NEVER = 2**63


def times_asked_again(requests: Sequence[Request]) -> int:
    """Return how often a robot must have asked again as its peer was a step behind.

    Where it asked again for another reason, as it was too busy to look at an answer that had come,
    two answers of the very step are there, and it did not wait for its peer.

    Args:
        requests: the answered ones of `heard`.
    """
    places: set[tuple[int, int]] = set()
    again = 0
    for request in requests:
        place = request.peer, request.step
        behind = request.answer is not None and request.answer[0] < request.step
        again += behind and place in places
        places.add(place)
    return again


def put_together(
    events: Sequence[np.ndarray], names: Sequence[str], frame: Frame
) -> tuple[list[Request], list[Difference]]:
    """Return the robots' requests in order of time step, and what does not fit together.

    A client tells of a request and its answer under one identity, the service under another; the
    two meet in (asker, step, number of the request). What persons asked is left out. Each of them
    tells its events in the order of its clock.

    Args:
        events: those of each asked robot, of type `EVENT`, in the order of the log.
        names: the robots.
        frame: the run's clock.
    """
    dialogue = _Dialogue(names)
    for peer, rows in enumerate(events):
        dialogue.add(peer, rows, steps_of(rows, frame.period))
    ordered = sorted(dialogue.requests.items(), key=lambda one: (one[0][2], one[0][0], one[0][3]))
    return [request for _, request in ordered], dialogue.problems


class _Dialogue:
    """Requests by (asker, peer, step, number), and what does not fit together."""

    def __init__(self, names: Sequence[str]) -> None:
        self.requests: dict[tuple[int, int, int, int], Request] = {}
        self.problems: list[Difference] = []
        self._names = names

    def add(self, peer: int, rows: np.ndarray, steps: np.ndarray) -> None:
        """Add what one asked robot's topic says, at these time steps."""
        codes = {one: code for code, one in enumerate(dict.fromkeys(rows["client"].tolist()))}
        client = np.array([codes[one] for one in rows["client"].tolist()], dtype=np.int64)
        server = (rows["kind"] == EventKind.RECEIVED) | (rows["kind"] == EventKind.ANSWERED)
        self._check_clocks(peer, rows, steps, np.where(server, -1, client))
        fields = [rows[name].tolist() for name in ("kind", "wall_ns", "asker", "xy", "seen")]
        events = list(
            zip(steps.tolist(), client.tolist(), rows["number"].tolist(), *fields, strict=True)
        )
        asked: dict[
            tuple[Any, ...], Request | None
        ] = {}  # by (whether of the service, client, number)
        for place in np.flatnonzero(rows["request"]).tolist():
            step, who, number, kind, wall_ns, asker, xy, _ = events[place]
            request = None  # of a person
            if asker >= 0 and step != 0:
                key = (asker, peer, step, number)
                request = self.requests.setdefault(key, Request(asker, peer, step, tuple(xy)))
                if request.position != tuple(xy):
                    said = f"from {request.position}"
                    self._problem(request, kind, f"from {tuple(xy)}", said)
                self._note(request, kind, wall_ns)
            asked[kind == EventKind.RECEIVED, who, number] = request
        for place in np.flatnonzero(~rows["request"]).tolist():
            step, who, number, kind, wall_ns, _, xy, seen = events[place]
            key_of = (kind == EventKind.ANSWERED, who, number)
            request = asked.get(key_of)
            if request is not None:
                self._note(request, kind, wall_ns)
                content = (step, tuple(xy) if seen else None)
                if kind == EventKind.RETURNED:
                    request.answer = content
                else:
                    request.said = content
            elif key_of not in asked:
                what = f"{DIALOGUE} {EventKind(kind).words}"
                self.problems.append(
                    Difference(step, self._names[peer], what, NO_REQUEST, "with it")
                )

    def _check_clocks(
        self, peer: int, rows: np.ndarray, steps: np.ndarray, writers: np.ndarray
    ) -> None:
        """Each writer tells its events in the order of its clock."""
        for writer in np.unique(writers).tolist():
            mine = np.flatnonzero(writers == writer)
            wall = rows["wall_ns"][mine]
            late = np.maximum.accumulate(wall) - wall
            for place in np.flatnonzero(late > 0).tolist():
                what = f"{DIALOGUE} {EventKind(rows['kind'][mine[place]]).words}"
                logged = f"after one that is {late[place]} ns younger"
                step = int(steps[mine[place]])
                self.problems.append(
                    Difference(step, self._names[peer], what, logged, "before it")
                )

    def _note(self, request: Request, kind: int, wall_ns: int) -> None:
        if kind in request.wall_ns:
            self._problem(request, kind, "twice", "once")
        else:
            request.wall_ns[kind] = wall_ns

    def _problem(self, request: Request, kind: int, logged: str, computed: str) -> None:
        quantity = f"{DIALOGUE} with {self._names[request.peer]}, {EventKind(kind).words}"
        name = self._names[request.asker]
        self.problems.append(Difference(request.step, name, quantity, logged, computed))
