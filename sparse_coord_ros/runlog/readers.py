# Copyright 2026 The sparse_coord_ros authors
# SPDX-License-Identifier: Apache-2.0
"""How the messages of each topic of a team become rows of numbers.

A message of the usual layout is read as it lies in the file, any other by the bag's definition.
"""

from collections.abc import Callable, Sequence
from typing import Any, NamedTuple

import numpy as np

from sparse_coord_ros import wire
from sparse_coord_ros.game.scenario import Scenario
from sparse_coord_ros.learn.run_config import RunConfig
from sparse_coord_ros.runlog import layouts
from sparse_coord_ros.runlog.columns import Reader
from sparse_coord_ros.runlog.decode import check_frame, nanoseconds_of, place_of
from sparse_coord_ros.runlog.dialogue import EVENT, event_row
from sparse_coord_ros.runlog.layouts import Layout, nanoseconds
from sparse_coord_ros.wire import ACCOUNT_LABELS, ACTION_LABELS, PARTNERS_LABEL, REWARD_LABELS
from sparse_coord_ros.wire.frame import Frame, flat_position
from sparse_coord_ros.wire.occupancy import OccupancyData

STAMP = ("ns", "i8")
NUMBERS = (*ACTION_LABELS, *ACCOUNT_LABELS)
"""What the numbers of an action's message are called."""

Fill = Callable[[np.ndarray, np.ndarray], np.ndarray | None]
"""Puts the fields of messages into rows; see `Reader`."""

KEEPER = Reader(np.dtype([("message", "O")]), lambda message: (message,), [])
"""Keeps messages as they are decoded."""


class Status(NamedTuple):
    """What the world said of itself; None: it did not.

    Attributes:
        state: one of `wire.STATES`.
        step, transitions, left_out, began: as of `wire.STATUS_VALUES`.
    """

    state: str
    step: int
    transitions: int
    left_out: int | None
    began: str | None


def team_readers(run: RunConfig, frame: Frame) -> dict[wire.Topic, Reader]:
    """Return the readers of the team's topics; rows of `status` hold a `Status` each."""
    statuses = Reader(np.dtype([("status", "O")]), lambda message: (_status(message),), [])
    return {
        wire.CLOCK: Reader(
            np.dtype([STAMP]),
            lambda message: (nanoseconds_of(message.clock),),
            [(Layout(layouts.stamp()), _stamps)],
        ),
        wire.MAP: _grid(frame, OccupancyData(frame).map),
        wire.MARKERS: _markers(frame, run.scenario),
        wire.STATUS: statuses,
    }


def robot_readers(run: RunConfig, frame: Frame) -> dict[wire.Topic, Reader]:
    """Return the readers of each robot's topics.

    Rows of states have `xy`; of rewards and actions `numbers`, in the order of their labels; of
    percepts `count` positions `places`, the own one first; of maps their `data`; of service events
    the fields of `EVENT`.
    """
    names = [robot.name for robot in run.scenario.robots]
    partners = (PARTNERS_LABEL,) if run.scenario.referee else ()
    requests = [(layouts.request(name), _event(asker)) for asker, name in enumerate(names)]
    responses = [(layouts.response(count), _event(None)) for count in range(2)]
    return {
        wire.LOCAL_STATE: Reader(
            np.dtype([STAMP, ("xy", "2f8")]),
            lambda message: (_stamp(message), place_of(message)),
            [(Layout(layouts.pose_stamped()), _fields("xy"))],
        ),
        wire.REWARD: _numbers((*REWARD_LABELS, *partners)),
        wire.ACTION: _numbers(NUMBERS),
        wire.PERCEPT: _percept(len(names)),
        wire.COORDINATION_MAP: _grid(frame, None),
        wire.SERVICE_EVENTS: Reader(
            EVENT, lambda message: event_row(message, names), [*requests, *responses]
        ),
    }


def _numbers(labels: Sequence[str]) -> Reader:
    """Return the reader of a JointState with these labels, in any order."""

    def slow(message: Any) -> tuple[Any, ...]:
        found = [str(label) for label in message.name]
        missing = [label for label in labels if label not in found]
        if missing:
            raise ValueError(f"labels no number {', '.join(missing)}")
        if sorted(found) != sorted(labels):
            raise ValueError(f"labels its numbers {', '.join(found)[:200]}")
        if len(found) != len(message.position):
            raise ValueError(f"has {len(found)} labels and {len(message.position)} numbers")
        said = dict(zip(found, message.position, strict=True))
        return _stamp(message), [said[label] for label in labels]

    kind = np.dtype([STAMP, ("numbers", f"{len(labels)}f8")])
    return Reader(kind, slow, [(layouts.labelled(labels), _fields("numbers"))])


def _percept(robots: int) -> Reader:
    def slow(message: Any) -> tuple[Any, ...]:
        places = [place_of(pose) for pose in message.poses]
        padded = [*places, *[(np.nan, np.nan)] * robots][:robots]
        return _stamp(message), len(places), padded

    def fill(count: int) -> Fill:
        def fields_of(rows: np.ndarray, fields: np.ndarray) -> None:
            _stamps(rows, fields)
            rows["count"], rows["places"] = count, np.nan
            for number in range(count):
                rows["places"][:, number] = fields[f"{number}_xy"]

        return fields_of

    kind = np.dtype([STAMP, ("count", "i4"), ("places", "f8", (robots, 2))])
    return Reader(kind, slow, [(Layout(layouts.path(n)), fill(n)) for n in range(1, robots + 1)])


def _grid(frame: Frame, due: bytes | None) -> Reader:
    """Return the reader of an occupancy grid on the map; `due`: what its data must be."""
    rows_, columns = frame.grid.shape
    size = rows_ * columns
    described = (float(np.float32(frame.resolution)), columns, rows_, 0, 0)

    def slow(message: Any) -> tuple[Any, ...]:
        info = message.info
        time = info.map_load_time
        if (info.resolution, info.width, info.height, time.sec, time.nanosec) != described:
            raise ValueError("has another resolution or size than the map")
        if flat_position(info.origin) != frame.origin:
            raise ValueError("has another origin than the map")
        data = bytes(value & 0xFF for value in message.data)
        if len(data) != size:
            raise ValueError(f"has {len(data)} cells, not {size}")
        if due is not None and data != due:
            raise ValueError("is not the scenario's map")
        return _stamp(message), np.frombuffer(data, dtype=np.int8)

    items = layouts.occupancy(frame.resolution, rows_, columns, frame.origin)
    fill: Fill
    if due is None:
        items.append(layouts.Free("data", f"({size},)i1"))
        fill = _fields("data")
    else:
        items += [layouts.Fixed("i1", value) for value in np.frombuffer(due, np.int8).tolist()]
        fill = _stamps
    return Reader(np.dtype([STAMP, ("data", "i1", (size,))]), slow, [(Layout(items), fill)])


def _markers(frame: Frame, scenario: Scenario) -> Reader:
    """Return the reader of the markers, as the robots' positions `places`.

    Doorways and goals must be the scenario's, in its order. How markers look is free, but it stays
    as the first message has it: its layout is known from then on.
    """
    due: list[tuple[str, int, tuple[float, float] | None]] = [
        (wire.DOORWAYS, number, frame.centres[cell])
        for number, cell in enumerate(sorted(frame.grid.doorways))
    ]
    for k, robot in enumerate(scenario.robots):
        due += [(wire.GOALS, k, frame.centres[robot.goal]), (wire.ROBOTS, k, None)]
    robots = [place for place, (_, _, where) in enumerate(due) if where is None]
    looks: list[tuple[Any, ...]] = []
    fast: list[tuple[Layout, Fill]] = []

    def slow(message: Any) -> tuple[Any, ...]:
        stamps = {(m.header.stamp.sec, m.header.stamp.nanosec) for m in message.markers}
        said = [(m.ns, m.id, flat_position(m.pose)) for m in message.markers]
        shown = [(ns, k, None if ns == wire.ROBOTS else place) for ns, k, place in said]
        if shown != due:
            raise ValueError("shows other doorways, goals or robots than the scenario's")
        if len(stamps) != 1 or any(m.header.frame_id != wire.MAP_FRAME for m in message.markers):
            raise ValueError("holds several stamps, or another frame")
        mine = list(map(_look, message.markers))
        if looks and mine != looks:
            raise ValueError("looks otherwise than those before it")
        looks[:] = mine
        places = [said[place][2] for place in robots]
        return nanoseconds_of(message.markers[0].header.stamp), places

    def fill(rows: np.ndarray, fields: np.ndarray) -> np.ndarray:
        rows["ns"] = nanoseconds(fields, "0_")
        for number, place in enumerate(robots):
            rows["places"][:, number] = fields[f"{place}_xy"]
        stamps = [nanoseconds(fields, f"{place}_") for place in range(len(due))]
        return np.asarray(np.all([one == stamps[0] for one in stamps], axis=0))

    def learn() -> None:
        if not fast and looks:
            fast.append((layouts.markers(looks, due), fill))

    kind = np.dtype([STAMP, ("places", "f8", (len(robots), 2))])
    return Reader(kind, slow, fast, learn)


def _look(marker: Any) -> tuple[Any, ...]:
    size, colour = marker.scale, marker.color
    return (
        *(marker.type, marker.action, size.x, size.y, size.z),
        *(colour.r, colour.g, colour.b, colour.a),
    )


def _status(message: Any) -> Status:
    said = {pair.key: pair.value for pair in message.values}
    step, transitions = (int(said[name]) for name in wire.STATUS_VALUES[:2])
    left_out, began = (said.get(name) for name in wire.STATUS_VALUES[2:])
    known = None if left_out is None else int(left_out)
    return Status(str(message.message), step, transitions, known, began)


def _stamp(message: Any) -> int:
    check_frame(message.header)
    return nanoseconds_of(message.header.stamp)


def _stamps(rows: np.ndarray, fields: np.ndarray) -> None:
    rows["ns"] = nanoseconds(fields)


def _fields(name: str) -> Fill:
    def fill(rows: np.ndarray, fields: np.ndarray) -> None:
        rows["ns"] = nanoseconds(fields)
        rows[name] = fields[name]

    return fill


def _event(asker: int | None) -> Fill:
    def fill(rows: np.ndarray, fields: np.ndarray) -> None:
        rows["kind"], rows["client"] = fields["kind"], fields["client"]
        rows["number"], rows["wall_ns"] = fields["number"], nanoseconds(fields, "wall_")
        rows["ns"], rows["xy"] = nanoseconds(fields), np.nan
        rows["asker"] = -1 if asker is None else asker
        rows["request"] = asker is not None
        if asker is not None:
            rows["xy"] = fields["xy"]
        elif "0_xy" in (fields.dtype.names or ()):
            rows["xy"], rows["seen"] = fields["0_xy"], True

    return fill
