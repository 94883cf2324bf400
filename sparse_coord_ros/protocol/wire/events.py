# Copyright 2026 The sparse_coord_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Service introspection of active perception by rclpy: the messages of `SERVICE_EVENTS`."""

from collections.abc import Sequence
from enum import IntEnum

import numpy as np

from sparse_coord_ros.protocol.wire.cdr import (
    Fixed,
    Free,
    Item,
    Layout,
    nothing,
    place_at,
    stamp,
)
from sparse_coord_ros.protocol.wire.messages import (
    POSE_ITEMS,
    Fill,
    MessageForm,
    path,
    stamps_of,
)


class EventKind(IntEnum):
    """The kinds of service_msgs/ServiceEventInfo: client and server publish two each.

    Attributes:
        words: the same in words.
    """

    SENT = 0
    RECEIVED = 1
    ANSWERED = 2
    RETURNED = 3

    @property
    def words(self) -> str:
        """The same in words."""
        side = "request" if self in QUESTIONS else "response"
        return f"{side} {'received' if self % 2 else 'sent'}"


QUESTIONS = EventKind.SENT, EventKind.RECEIVED
ANSWERS = EventKind.ANSWERED, EventKind.RETURNED

EVENT = np.dtype(
    [
        ("ns", "i8"),
        ("kind", "u1"),
        ("wall_ns", "i8"),
        ("client", "V16"),
        ("number", "i8"),
        ("request", "?"),
        ("asker", "i4"),
        ("xy", "2f8"),
        ("seen", "?"),
    ]
)
"""One event: stamp of the request or the answer; its `EventKind`; its time by the wall clock of
the publishing robot; the client's identity and its request's number; whether it contains a
request; of a request the asker (-1: no robot) and its position; of a response whether it has a
position, and the asked robot's position."""


def event_form(names: Sequence[str]) -> MessageForm:
    """Return the form of the events of nav_msgs/GetPlan in a team of robots.

    A person's request may have any form: then only its beginning is read.
    """
    info: list[Item] = [Free("kind", "u1"), *stamp("wall_")]
    info += [Free("client", "V16"), Free("number", "<i8")]
    found = []
    for asker, name in enumerate(names):
        goal = [*nothing("<i4", "<u4"), name, *place_at(0.0, 0.0)]
        request = [Fixed("<u4", 1), *POSE_ITEMS, *goal, *nothing("<f4", "<u4")]
        found.append((Layout([*info, *request]), _fill(asker, QUESTIONS)))
    for places in (0, 1):
        response = [*nothing("<u4"), Fixed("<u4", 1), *path(places)]
        found.append((Layout([*info, *response]), _fill(-1, ANSWERS)))
    return MessageForm(EVENT, [*found, (Layout(info), _fill(-1, QUESTIONS))])


def _fill(asker: int, kinds: tuple[EventKind, ...]) -> Fill:
    def fill(rows: np.ndarray, fields: np.ndarray) -> np.ndarray:
        known = fields.dtype.names or ()
        rows["kind"] = fields["kind"]
        rows["client"] = fields["client"]
        rows["number"] = fields["number"]
        rows["wall_ns"] = stamps_of(fields, "wall_")
        rows["ns"] = stamps_of(fields) if "sec" in known else 0
        rows["request"] = kinds is QUESTIONS
        rows["asker"] = asker
        rows["seen"] = "0_xy" in known
        rows["xy"] = np.nan
        for name in {"xy", "0_xy"}.intersection(known):
            rows["xy"] = fields[name]
        return np.isin(fields["kind"], kinds)

    return fill
