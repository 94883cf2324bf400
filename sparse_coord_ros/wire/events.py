# Copyright 2026 The sparse_coord_ros authors
# SPDX-License-Identifier: Apache-2.0
"""What rclpy tells of the requests of active perception: the messages of `SERVICE_EVENTS`."""

from collections.abc import Sequence
from enum import IntEnum
from typing import Any

import numpy as np

from sparse_coord_ros.wire.cdr import Fixed, Free, Item, Layout, no_stamp, nothing, place_at, stamp
from sparse_coord_ros.wire.messages import (
    POSE_ITEMS,
    Fill,
    Form,
    nanoseconds,
    path,
    read_header,
    read_pose,
    stamps_of,
)


class EventKind(IntEnum):
    """The kinds of service_msgs/ServiceEventInfo: who asks and who is asked tell two each.

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
        side = "request" if self in (EventKind.SENT, EventKind.RECEIVED) else "response"
        return f"{side} {'received' if self % 2 else 'sent'}"


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
"""One event: stamp of the request or the answer; its `EventKind`; when, by the wall clock of the
robot that says it; the client's identity and its request's number; whether it holds a request; of
a request the asker (-1: no robot) and where it is, of a response whether and where the asked robot
is."""


def event_form(names: Sequence[str]) -> Form:
    """Return the form of the events of nav_msgs/GetPlan in a team of robots."""

    def read(message: Any) -> tuple[Any, ...]:
        info = message.info
        kind = int(info.event_type)
        client = bytes(byte & 0xFF for byte in info.client_gid)
        head = kind, nanoseconds(info.stamp), client, int(info.sequence_number)
        if kind in (EventKind.SENT, EventKind.RECEIVED) and message.request:
            start = message.request[0].start
            asker = message.request[0].goal.header.frame_id
            number = names.index(asker) if asker in names else -1
            ns = nanoseconds(start.header.stamp)
            if number >= 0 and ns:
                read_pose(start)  # what persons ask may be anything
            return ns, *head, True, number, (start.pose.position.x, start.pose.position.y), False
        if kind in (EventKind.ANSWERED, EventKind.RETURNED) and message.response:
            plan = message.response[0].plan
            if len(plan.poses) > 1:
                raise ValueError(f"answers with {len(plan.poses)} places")
            where = [read_pose(pose)[1] for pose in plan.poses] or [(np.nan, np.nan)]
            return read_header(plan.header), *head, False, -1, where[0], bool(plan.poses)
        raise ValueError(f"is an event of type {kind}, with neither a request nor a response")

    info: list[Item] = [Free("kind", "u1"), *stamp("wall_")]
    info += [Free("client", "V16"), Free("number", "<i8")]
    found = []
    for asker, name in enumerate(names):
        goal = [*no_stamp(), name, *place_at(0.0, 0.0)]
        request = [Fixed("<u4", 1), *POSE_ITEMS, *goal, *nothing("<f4", "<u4")]
        found.append((Layout([*info, *request]), _fill(asker)))
    for places in (0, 1):
        response = [*nothing("<u4"), Fixed("<u4", 1), *path(places)]
        found.append((Layout([*info, *response]), _fill(None)))
    return Form(EVENT, read, found)


def _fill(asker: int | None) -> Fill:
    def fill(rows: np.ndarray, fields: np.ndarray) -> None:
        rows["kind"], rows["client"] = fields["kind"], fields["client"]
        rows["number"], rows["wall_ns"] = fields["number"], stamps_of(fields, "wall_")
        rows["ns"], rows["xy"] = stamps_of(fields), np.nan
        rows["asker"] = -1 if asker is None else asker
        rows["request"] = asker is not None
        if asker is not None:
            rows["xy"] = fields["xy"]
        elif "0_xy" in (fields.dtype.names or ()):
            rows["xy"], rows["seen"] = fields["0_xy"], True

    return fill
