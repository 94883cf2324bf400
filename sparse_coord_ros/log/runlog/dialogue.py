# Copyright 2026 The sparse_coord_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The dialogue of active perception, assembled from the recorded service events."""

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from typing import Any, NamedTuple

import numpy as np

from sparse_coord_ros.log.runlog.difference import (
    DIALOGUE,
    NO_REQUEST,
    TWICE,
    Difference,
)
from sparse_coord_ros.log.runlog.timeline import steps_of
from sparse_coord_ros.protocol.wire.events import QUESTIONS, EventKind
from sparse_coord_ros.protocol.wire.frame import SECOND


@dataclass(slots=True)
class Request:
    """One request of a dialogue, with its answer.

    Attributes:
        asker: number of the asking robot.
        peer: number of the asked robot.
        step: the time step of the request.
        position: the asker's position in its request, in metres.
        wall_ns: wall clock of the four events by kind, without events that were not recorded.
        answer: (step, position) of the received response; position None: refused. None: no
            response was received.
        said: the response that the peer sent (kind ANSWERED), as `answer`.
        returned: wall clock and answer of each received response, in the order of the log.
    """

    asker: int
    peer: int
    step: int
    position: tuple[float, float]
    wall_ns: dict[int, int] = field(default_factory=dict)
    answer: tuple[Any, ...] | None = None
    said: tuple[Any, ...] | None = None
    returned: list[tuple[int, tuple[Any, ...]]] = field(default_factory=list)

    @property
    def seconds(self) -> float | None:
        """Wall clock from the request to its answer; None if one of them is not recorded."""
        if EventKind.SENT not in self.wall_ns or EventKind.RETURNED not in self.wall_ns:
            return None
        return (
            self.wall_ns[EventKind.RETURNED] - self.wall_ns[EventKind.SENT]
        ) / SECOND

    def take(
        self,
        kind: EventKind,
        wall_ns: int,
        step: int,
        where: tuple[float, float] | None,
    ) -> list[tuple[str, str]]:
        """Add one of its events; return the event's problems, as (logged, computed)."""
        if kind == EventKind.RETURNED:
            self.returned.append((wall_ns, (step, where)))
            return []
        problems = []
        if kind in self.wall_ns:
            problems.append((TWICE, "once"))
        self.wall_ns.setdefault(kind, wall_ns)
        if kind in QUESTIONS and where != self.position:
            problems.append((f"from {where}", f"from {self.position}"))
        if kind == EventKind.ANSWERED:
            self.said = (step, where)
        return problems

    def choose(self) -> list[tuple[Any, ...]]:
        """Choose as answer the response that the peer sent, else the last; return the others."""
        if not self.returned:
            return []
        own = [one for one in self.returned if one[1] == self.said]
        chosen = (own or self.returned)[-1]
        self.wall_ns[EventKind.RETURNED], self.answer = chosen
        others = list(self.returned)
        others.remove(chosen)
        return [answer for _, answer in others]


def sent_ns(request: Request) -> int:
    """Return the wall clock at which a request was sent; 0 if that is not recorded."""
    return request.wall_ns.get(EventKind.SENT, 0)


def heard(requests: Sequence[Request]) -> list[Request]:
    """Return the requests that the asker had not given up when the answer came.

    A robot that gets no answer for a while asks again, and then waits for the newer answer only. A
    peer that was stopped answers all requests, and only one answer counts.

    Args:
        requests: some requests of one asker.

    Returns:
        The newest first.
    """
    latest: dict[tuple[int, int], float] = {}
    found = []
    for request in sorted(requests[::-1], key=sent_ns, reverse=True):
        place = (request.peer, request.step)
        if request.wall_ns.get(EventKind.RETURNED, 0) < latest.get(place, math.inf):
            found.append(request)
        if EventKind.SENT in request.wall_ns:
            latest[place] = sent_ns(request)
    return found


def times_asked_again(requests: Sequence[Request]) -> int:
    """Return the number of repeated requests of a robot because its peer was a step behind.

    A robot that is too busy to read an answer asks again as well. Then the log contains two
    answers of the same time step, and the robot did not wait for its peer.

    Args:
        requests: the answered requests of `heard`.
    """
    later: set[tuple[int, int]] = set()  # peer and time step of requests sent later
    again = 0
    for request in requests:
        key = request.peer, request.step
        behind = request.answer is not None and request.answer[0] < request.step
        if behind and key in later:
            again += 1
        later.add(key)
    return again


def put_together(
    events: Sequence[np.ndarray], names: Sequence[str], period: int
) -> tuple[list[Request], list[Difference], list[Difference]]:
    """Return the robots' requests in the order of time steps, problems, and foreign responses.

    If a robot's service has two servers, both respond; the robot's own response is the answer.

    The events of a client and of a service have different identities. Both contain (asker, step,
    number of the request). Requests by persons are left out. Each writer sends its events in the
    order of its clock.

    Args:
        events: for each asked robot its events, of type `EVENT`, in the order of the log.
        names: the robots.
        period: nanoseconds of a time step.
    """
    dialogue = _Dialogue(names, period)
    for peer, rows in enumerate(events):
        dialogue.take(peer, rows)
    ordered = [dialogue.requests[key] for key in sorted(dialogue.requests)]
    return ordered, dialogue.problems, list(_other_answers(ordered, names))


class _Event(NamedTuple):
    """A row of `protocol.wire.events.EVENT`."""

    ns: int
    kind: int
    wall_ns: int
    client: bytes
    number: int
    is_request: bool
    asker: int
    xy: np.ndarray
    seen: bool

    @property
    def place(self) -> tuple[float, float]:
        """The position of the asker, or of the asked robot."""
        x, y = self.xy.tolist()
        return x, y

    @property
    def said(self) -> tuple[float, float] | None:
        """The same; None if the asked robot refuses to answer."""
        return self.place if self.is_request or self.seen else None


class _Dialogue:
    """Assembles requests from events, robot by robot.

    Args:
        names: the robots.
        period: nanoseconds of a time step.

    Attributes:
        requests: by (time step, asker, peer, number of the request).
        problems: the errors in the events.
    """

    def __init__(self, names: Sequence[str], period: int) -> None:
        self._names = names
        self._period = period
        self.requests: dict[tuple[int, int, int, int], Request] = {}
        self.problems: list[Difference] = []

    def take(self, peer: int, rows: np.ndarray) -> None:
        """Add the events of the requests to one robot, in the order of the log."""
        asked: dict[tuple[bool, bytes, int], Request | None] = {}
        newest: dict[bytes | None, int] = {}
        steps = steps_of(rows, self._period).tolist()
        events = map(_Event._make, rows.tolist())
        for step, event in zip(steps, events, strict=True):
            of_client = event.kind in (EventKind.SENT, EventKind.RETURNED)
            key = of_client, event.client, event.number
            if event.is_request:
                asked[key] = self._asked(peer, step, event)
            if key not in asked:
                words = EventKind(event.kind).words
                self._note(step, peer, f"{DIALOGUE} {words}", NO_REQUEST, "with it")
                continue
            request = asked[key]
            if request is None:  # a person asked
                continue
            writer = event.client if of_client else None
            before = newest.get(writer, 0)
            newest[writer] = max(before, event.wall_ns)
            self._take_event(request, step, event, before)

    def _asked(self, peer: int, step: int, event: "_Event") -> Request | None:
        """Return the request of an event; None: a person's."""
        if event.asker < 0 or step == 0:
            return None
        key = step, event.asker, peer, event.number
        return self.requests.setdefault(
            key, Request(event.asker, peer, step, event.place)
        )

    def _take_event(
        self, request: Request, step: int, event: "_Event", newest: int
    ) -> None:
        """Add an event of a robot's request.

        Args:
            request: the request.
            step: the time step of the event.
            event: the event.
            newest: the newest clock of its writer before.
        """
        kind = EventKind(event.kind)
        due = step * self._period
        problems = request.take(kind, event.wall_ns, step, event.said)
        if event.ns != due:
            problems.append((f"stamp {event.ns} ns", f"{due} ns"))
        if newest > event.wall_ns:
            younger = f"{newest - event.wall_ns} ns younger"
            problems.append((f"after one that is {younger}", "before it"))
        what = f"{DIALOGUE} with {self._names[request.peer]}, {kind.words}"
        for words in problems:
            self._note(request.step, request.asker, what, *words)

    def _note(self, step: int, robot: int, *words: str) -> None:
        self.problems.append(Difference(step, self._names[robot], *words))


def _other_answers(
    requests: Sequence[Request], names: Sequence[str]
) -> Iterator[Difference]:
    """Choose the answer of each request; yield the other responses."""
    for one in requests:
        what = f"{DIALOGUE} with {names[one.peer]}, {EventKind.RETURNED.words}"
        for other in one.choose():
            words = f"{other} too", f"{one.answer} only"
            yield Difference(one.step, names[one.asker], what, *words)
