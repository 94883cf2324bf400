# Copyright 2026 The sparse_coord_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The dialogue of active perception, assembled from the recorded service events."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from sparse_coord_ros.protocol.wire.events import EventKind
from sparse_coord_ros.protocol.wire.frame import SECOND


@dataclass(slots=True)
class Request:
    """One request of a robot, with its answer.

    Attributes:
        asker: number of the asking robot.
        peer: number of the asked robot.
        step: the time step of the request.
        answer: (step, position) of the received response; position None: refused. None: no
            response was received.
        seconds: wall clock from the request to its answer; None: no response was received.
    """

    asker: int
    peer: int
    step: int
    answer: tuple[int, tuple[float, float] | None] | None = None
    seconds: float | None = None


def steps_of(rows: np.ndarray, period: int) -> np.ndarray:
    """Return the time steps of rows with the field `ns`."""
    return np.asarray((rows["ns"] + period // 2) // period)


def put_together(events: Sequence[np.ndarray], period: int) -> list[Request]:
    """Return the robots' requests in the order of time steps; those of persons are left out.

    Args:
        events: for each asked robot its events, of type `protocol.wire.events.EVENT`, in the order
            of the log.
        period: nanoseconds of a time step.
    """
    found: list[Request] = []
    for peer, rows in enumerate(events):
        found += _requests_to(peer, rows, period)
    return sorted(found, key=lambda one: (one.step, one.asker))


def _requests_to(peer: int, rows: np.ndarray, period: int) -> list[Request]:
    """Return the requests to one robot, as their senders saw them."""
    found: list[Request] = []
    sent: dict[tuple[bytes, int], tuple[Request, int]] = {}
    for step, row in zip(steps_of(rows, period).tolist(), rows, strict=True):
        key = row["client"].tobytes(), int(row["number"])
        wall_ns = int(row["wall_ns"])
        asker = int(row["asker"])
        if row["kind"] == EventKind.SENT and asker >= 0 and step > 0:
            request = Request(asker, peer, step)
            sent[key] = request, wall_ns
            found.append(request)
        elif row["kind"] == EventKind.RETURNED and key in sent:
            request, sent_ns = sent[key]
            x, y = row["xy"].tolist()
            request.answer = step, (x, y) if row["seen"] else None
            request.seconds = (wall_ns - sent_ns) / SECOND
    return found
