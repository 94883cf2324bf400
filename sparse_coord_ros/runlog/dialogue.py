# Copyright 2026 The sparse_coord_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The dialogue of active perception, put together from the recorded service events."""

from collections.abc import Iterable
from dataclasses import dataclass, field
from typing import Any, NamedTuple

from sparse_coord_ros.core.frame import SECOND
from sparse_coord_ros.runlog.difference import Difference

SENT, RECEIVED, ANSWERED, RETURNED = range(4)
"""Event types of service_msgs/ServiceEventInfo: request sent, request received, response sent,
response received."""
EVENT_NAMES = ("request sent", "request received", "response sent", "response received")


class Event(NamedTuple):
    """One service event, as it was recorded.

    Attributes:
        peer: number of the asked robot.
        kind: SENT, RECEIVED, ANSWERED or RETURNED.
        wall_ns: when, by the wall clock of the robot that says it, in nanoseconds.
        client: the client's identity with its request number.
        content: of a request (asker's name, step, x, y); of a response (step, None or (x, y)).
    """

    peer: int
    kind: int
    wall_ns: int
    client: tuple
    content: tuple


@dataclass
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
    answer: tuple | None = None
    said: tuple | None = None

    @property
    def seconds(self) -> float | None:
        """Wall clock from the request to its answer; None where one of them is not recorded."""
        if SENT not in self.wall_ns or RETURNED not in self.wall_ns:
            return None
        return (self.wall_ns[RETURNED] - self.wall_ns[SENT]) / SECOND


def read_event(message: Any, peer: int, frame) -> Event | None:
    """Return a decoded event of GetPlan; None for a request of a person (without a stamp).

    Raises:
        ValueError: it holds neither a request nor a response, or is of no known kind.
    """
    info = message.info
    kind = int(info.event_type)
    client = (bytes(byte & 0xFF for byte in info.client_gid), int(info.sequence_number))
    wall_ns = info.stamp.sec * SECOND + info.stamp.nanosec
    if kind in (SENT, RECEIVED) and message.request:
        start = message.request[0].start
        stamp, position = start.header.stamp, start.pose.position
        step = frame.step(stamp.sec, stamp.nanosec)
        asker = message.request[0].goal.header.frame_id
        return Event(peer, kind, wall_ns, client, (asker, step, position.x, position.y))
    if kind in (ANSWERED, RETURNED) and message.response:
        plan = message.response[0].plan
        step = frame.step(plan.header.stamp.sec, plan.header.stamp.nanosec)
        where = [(p.pose.position.x, p.pose.position.y) for p in plan.poses[:1]]
        return Event(peer, kind, wall_ns, client, (step, where[0] if where else None))
    raise ValueError(f"event of type {kind} holds neither a request nor a response")


def put_together(
    events: Iterable[Event], names: list[str]
) -> tuple[list[Request], list[Difference]]:
    """Return the robots' requests in order of time step, and what does not fit together.

    A client tells of a request and its answer under one identity, the service under another; the
    two meet in (asker, step, number of the request). What persons asked is left out. Each of them
    tells its events in the order of its clock.
    """
    requests: dict[tuple, Request] = {}
    by_client: dict[tuple, Request] = {}
    by_service: dict[tuple, Request] = {}
    strangers: set[tuple] = set()
    problems: list[Difference] = []
    waiting: list[Event] = []

    def place(request: Request, event: Event) -> None:
        if event.kind in request.wall_ns:
            problems.append(_problem(names, request, EVENT_NAMES[event.kind], "twice", "once"))
        request.wall_ns.setdefault(event.kind, event.wall_ns)

    newest: dict[tuple, int] = {}
    for event in events:
        key = (event.peer, event.client)
        server = event.kind in (RECEIVED, ANSWERED)
        writer = (event.peer, None if server else event.client[0])
        late = newest.get(writer, event.wall_ns) - event.wall_ns
        newest[writer] = event.wall_ns + max(late, 0)
        if late > 0:
            step = event.content[0 if event.kind in (ANSWERED, RETURNED) else 1]
            what = f"dialogue {EVENT_NAMES[event.kind]}"
            logged = f"after one that is {late} ns younger"
            problems.append(Difference(step, names[event.peer], what, logged, "before it"))
        if event.kind not in (SENT, RECEIVED):
            waiting.append(event)
            continue
        asker, step, *position = event.content
        if asker not in names or step == 0:
            strangers.add(key)
            continue
        place_of = (names.index(asker), event.peer, step, event.client[1])
        request = requests.setdefault(place_of, Request(*_head(place_of), tuple(position)))
        if request.position != tuple(position):
            said = f"from {request.position}"
            problems.append(
                _problem(names, request, EVENT_NAMES[event.kind], f"from {tuple(position)}", said)
            )
        (by_client if event.kind == SENT else by_service)[key] = request
        place(request, event)
    for event in waiting:
        key = (event.peer, event.client)
        request = (by_client if event.kind == RETURNED else by_service).get(key)
        if request is None:
            if key not in strangers:
                what = EVENT_NAMES[event.kind]
                problems.append(
                    Difference(
                        event.content[0],
                        names[event.peer],
                        f"dialogue {what}",
                        "without its request",
                        "with it",
                    )
                )
            continue
        place(request, event)
        if event.kind == RETURNED:
            request.answer = event.content
        else:
            request.said = event.content
    ordered = sorted(requests.items(), key=lambda item: (item[0][2], item[0][0], item[0][3]))
    return [request for _, request in ordered], problems


def _problem(names, request: Request, what: str, logged: str, computed: str) -> Difference:
    quantity = f"dialogue with {names[request.peer]}, {what}"
    return Difference(request.step, names[request.asker], quantity, logged, computed)


def _head(place_of: tuple) -> tuple[int, int, int]:
    asker, peer, step, _ = place_of
    return asker, peer, step
