# Copyright 2026 The sparse_coord_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The messages of a run, packed and read by the vocabulary, without ROS.

A `MessageForm` has the byte layouts of a topic's messages, and the rows read from them. The nodes
pack and read single messages by it (`Messages`), the log many at once, by columns.
An error's text continues a sentence about the message, such as "has no number labelled total".
"""

import struct
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cached_property
from math import isfinite
from typing import Any, get_type_hints

import numpy as np

from sparse_coord_ros.base.palette import DOORWAY_COLOUR, rgb, robot_colour
from sparse_coord_ros.core.game.scenario import Scenario
from sparse_coord_ros.core.game.world import Action, Reward
from sparse_coord_ros.core.runs.run_config import RunConfig
from sparse_coord_ros.protocol import wire
from sparse_coord_ros.protocol.wire.cdr import (
    Fixed,
    Free,
    Item,
    Layout,
    nothing,
    place,
    place_at,
    stamp,
)
from sparse_coord_ros.protocol.wire.frame import EAST_NORTH, MOVE_OF, SECOND, Frame
from sparse_coord_ros.protocol.wire.occupancy import OccupancyData

STAMPED = struct.Struct("<4xiI")
"""Beginning of a message with a leading stamp, as CDR: encapsulation, sec, nanosec."""

NS = ("ns", "i8")
"""The first column of every row: the message's stamp in nanoseconds."""

Fill = Callable[[np.ndarray, np.ndarray], np.ndarray | None]
"""Puts the free fields of messages into rows; returns whether each is valid, None: all are."""


def stamps_of(fields: np.ndarray, prefix: str = "") -> np.ndarray:
    """Return the stamps of messages' fields in nanoseconds, shape (messages,)."""
    seconds = fields[f"{prefix}sec"].astype(np.int64)
    return np.asarray(seconds * SECOND + fields[f"{prefix}nanosec"])


def by_name(rows: np.ndarray, fields: np.ndarray) -> None:
    """Fill rows whose columns have the names of the fields."""
    rows["ns"] = stamps_of(fields)
    for name in (rows.dtype.names or ())[1:]:
        rows[name] = fields[name]


def no_other_form(message: Any) -> tuple[Any, ...]:
    """Refuse a message that has no known layout."""
    raise ValueError("has another form than those of the run")


@dataclass(frozen=True)
class MessageForm:
    """The byte layouts of one topic's messages, and the rows read from them.

    Attributes:
        columns: structured type of a row: "ns" first, then the message's content.
        layouts: byte layouts, each with a function that fills rows from its fields.
        read: for messages that other programs publish in other layouts: returns the row of a
            decoded message, as a tuple; ValueError if it is invalid.
    """

    columns: np.dtype
    layouts: Sequence[tuple[Layout, Fill]]
    read: Callable[[Any], tuple[Any, ...]] = no_other_form

    @cached_property
    def layout(self) -> Layout:
        """The layout of a form with a single one."""
        return self.layouts[0][0]

    def rows(
        self, content: bytes, begins: np.ndarray, sizes: np.ndarray
    ) -> tuple[np.ndarray, np.ndarray]:
        """Return the rows of many messages, and whether each has this form; both (messages,).

        Args:
            content: bytes that contain the messages.
            begins: offset of each, shape (messages,).
            sizes: size of each in bytes, shape (messages,).
        """
        rows = np.zeros(len(begins), dtype=self.columns)
        left = np.ones(len(begins), dtype=bool)
        for layout, fill in self.layouts:
            mine = np.flatnonzero(left & (sizes >= layout.size))
            fits, fields = layout.read(content, begins[mine])
            mine = mine[fits]
            filled = rows[mine]
            taken = fill(filled, fields[fits])
            rows[mine] = filled
            left[mine if taken is None else mine[taken]] = False
        return rows, ~left


def nanoseconds(time: Any) -> int:
    """Return a decoded time in nanoseconds; ValueError if it is invalid."""
    if not 0 <= time.nanosec < SECOND:
        raise ValueError(
            f"is stamped {time.sec} s {time.nanosec} ns, outside of the run"
        )
    return int(time.sec) * SECOND + int(time.nanosec)


def header(prefix: str = "") -> list[Item]:
    """Return a header's fields in the frame `map`."""
    return [*stamp(prefix), wire.MAP_FRAME]


def read_header(header: Any) -> int:
    """Return a decoded header's stamp in nanoseconds; ValueError in another frame than `map`."""
    if header.frame_id != wire.MAP_FRAME:
        raise ValueError(f"is in the frame {header.frame_id!r}, not {wire.MAP_FRAME!r}")
    return nanoseconds(header.stamp)


def read_pose(message: Any) -> tuple[int, tuple[float, float]]:
    """Return (nanoseconds, (x, y)) of a decoded geometry_msgs/PoseStamped.

    Raises:
        ValueError: another frame than `map`, or a pose that is turned or off the ground.
    """
    place = message.pose.position
    turn = message.pose.orientation
    if (place.z, turn.x, turn.y, turn.z, turn.w) != (0.0, 0.0, 0.0, 0.0, 1.0):
        raise ValueError("holds a pose that is not flat on the map")
    return read_header(message.header), (place.x, place.y)


def labelled(labels: Sequence[str]) -> MessageForm:
    """Return the form of a sensor_msgs/JointState with labels for its positions, `numbers`."""
    count = len(labels)

    def read(message: Any) -> tuple[int, list[float]]:
        ns, said = read_labelled(message)
        missing = [label for label in labels if label not in said]
        if missing:
            raise ValueError(f"has no number labelled {', '.join(missing)}")
        return ns, [said[label] for label in labels]

    numbers = Free("numbers", f"({count},)<f8")
    items: list[Item] = [Fixed("<u4", count), *labels, Fixed("<u4", count), numbers]
    layout = Layout([*header(), *items, *nothing("<u4", "<u4")])
    return MessageForm(
        np.dtype([NS, ("numbers", "f8", (count,))]), [(layout, by_name)], read
    )


def read_labelled(message: Any) -> tuple[int, dict[str, float]]:
    """Return (nanoseconds, numbers by their labels) of a decoded sensor_msgs/JointState.

    Raises:
        ValueError: another frame, a label that is given twice, or labels without numbers.
    """
    ns = read_header(message.header)
    labels = [str(label) for label in message.name]
    if len(set(labels)) < len(labels):
        raise ValueError(f"labels a number twice: {', '.join(labels)[:200]}")
    if len(labels) != len(message.position):
        raise ValueError(
            f"has {len(labels)} labels and {len(message.position)} numbers"
        )
    return ns, dict(zip(labels, message.position, strict=True))


CLOCK_FORM = MessageForm(np.dtype([NS]), [(Layout(stamp()), by_name)])
POSE_ITEMS = [*header(), *place()]
"""The fields of a geometry_msgs/PoseStamped."""

POSE_FORM = MessageForm(
    np.dtype([NS, ("xy", "2f8")]), [(Layout(POSE_ITEMS), by_name)], read_pose
)
ACTION_FORM = labelled(wire.ACTION.labels)
REWARD_FORM = labelled(wire.REWARD.labels)


def path(count: int) -> list[Item]:
    """Return the fields of a nav_msgs/Path of some poses; the poses may have any stamps."""
    items: list[Item] = [*header(), Fixed("<u4", count)]
    for number in range(count):
        items += [*header(f"{number}_"), *place(f"{number}_")]
    return items


def percept_form(robots: int) -> MessageForm:
    """Return the form of a percept: `count` positions `places`, the own one first, then NaN."""

    def fill(count: int) -> Fill:
        def put(rows: np.ndarray, fields: np.ndarray) -> None:
            rows["ns"] = stamps_of(fields)
            rows["count"] = count
            rows["places"] = np.nan
            for number in range(count):
                rows["places"][:, number] = fields[f"{number}_xy"]

        return put

    columns = np.dtype([NS, ("count", "i4"), ("places", "f8", (robots, 2))])
    return MessageForm(
        columns, [(Layout(path(n)), fill(n)) for n in range(1, robots + 1)]
    )


def grid_form(frame: Frame) -> MessageForm:
    """Return the form of an occupancy grid on the map: its `data`, southmost first."""
    rows, columns = frame.grid.shape
    count = rows * columns
    size = [Fixed("<f4", frame.resolution), Fixed("<u4", columns), Fixed("<u4", rows)]
    data = Free("data", f"({count},)i1")
    items = [
        *nothing("<i4", "<u4"),
        *size,
        *place_at(*frame.origin),
        Fixed("<u4", count),
        data,
    ]
    row = np.dtype([NS, ("data", "i1", (count,))])
    return MessageForm(row, [(Layout([*header(), *items]), by_name)])


CUBE = 1
SPHERE = 2
CYLINDER = 3
SHOW = 0
"""Shapes and actions of visualization_msgs/Marker."""


def markers_layout(frame: Frame, scenario: Scenario) -> Layout:
    """Return the layout of the markers: doorways, then each robot's goal and itself.

    The map is dark where walls are; the scene's boxes stand on the doorways' plates.
    """
    # Namespace, number, cell (None: it moves); shape; width and height in cells; colour, opacity.
    marks: list[tuple[str, int, int | None, int, float, float, str, float]] = [
        (wire.DOORWAYS, number, cell, CUBE, 0.9, 0.05, DOORWAY_COLOUR, 0.3)
        for number, cell in enumerate(sorted(frame.grid.doorways))
    ]
    for k, robot in enumerate(scenario.robots):
        marks.append(
            (wire.GOALS, k, robot.goal, CYLINDER, 0.9, 0.04, robot_colour(k), 0.8)
        )
        marks.append((wire.ROBOTS, k, None, SPHERE, 0.5, 0.5, robot_colour(k), 0.8))
    items: list[Item] = [Fixed("<u4", len(marks))]
    for i, (space, number, cell, shape, width, height, colour, opacity) in enumerate(
        marks
    ):
        items += [
            *header(f"{i}_"),
            space,
            *(Fixed("<i4", n) for n in (number, shape, SHOW)),
        ]
        items += (
            place(f"{i}_")
            if cell is None
            else place_at(*frame.centres[cell], frame.origin.yaw)
        )
        items += [
            Fixed("<f8", size * frame.resolution) for size in (width, width, height)
        ]
        items += [Fixed("<f4", share) for share in (*rgb(colour), opacity)]
        items += [*nothing("<i4", "<u4", "u1", "<u4", "<u4"), ""]  # lifetime to texture
        items += [*nothing("<i4", "<u4"), "", "", *nothing("<u4", "<u4"), "", "", ""]
        items += nothing("<u4", "u1")
    return Layout(items)


def action_numbers(action: Action) -> tuple[float, ...]:
    """Return the numbers of an `action` up to the self-report; peers count from 1, 0 is none."""
    east, north = EAST_NORTH[action.move]
    return (
        east,
        north,
        float(action.asked),
        float(action.peer + 1),
        float(action.perceived),
    )


def action_from(numbers: Sequence[float]) -> Action:
    """Return the action from the numbers of an `action`, without the self-report.

    Raises:
        ValueError: (east, north) is no primitive action, or peer is not a number.
    """
    east, north, asked, peer, perceived = numbers[:5]
    move = MOVE_OF.get((east, north))
    if move is None:
        raise ValueError(
            f"says (east, north) = ({east:g}, {north:g}), no primitive action"
        )
    if not isfinite(peer):
        raise ValueError(f"says peer {peer:g}, no robot's number")
    return Action(move, bool(asked), int(peer) - 1, bool(perceived))


SELF_REPORT_TYPES = tuple(get_type_hints(wire.SelfReport).values())
"""The types of a self-report's numbers."""


FLAGS = (0.0, 1.0)
"""No and yes as numbers."""


class Messages(Frame):
    """The messages of one run: its time steps, its map and its metres, as CDR.

    Reading checks the frame, the stamp and the numbers. A message that does not fit the run
    raises ValueError; one that cannot be decoded may raise any exception.

    Args:
        run: the run.
        decode: returns the message from a topic's bytes without a known layout.
    """

    def __init__(
        self, run: RunConfig, decode: Callable[[wire.Topic, bytes], Any]
    ) -> None:
        super().__init__(run)
        self._decode = decode
        self._grids = OccupancyData(self)
        self._grid = grid_form(self).layout
        self._markers = markers_layout(self, run.scenario)

    def _read(
        self, topic: wire.Topic, form: MessageForm, data: bytes
    ) -> tuple[Any, ...]:
        """Return (sec, nanosec, *numbers) of a message."""
        said = form.layout.unpack(data)
        if said is None:
            ns, numbers = form.read(self._decode(topic, data))
            said = *divmod(ns, SECOND), *numbers
        return said

    def checked_step(self, sec: int, nanosec: int) -> int:
        """Return the time step of a stamp.

        Raises:
            ValueError: it lies before the run's beginning, or is not a valid time.
        """
        if sec < 0 or not 0 <= nanosec < SECOND:
            raise ValueError(f"is stamped {sec} s {nanosec} ns, outside of the run")
        return self.step(sec, nanosec)

    def pack_clock(self, step: int) -> bytes:
        """Return the time of a time step as CDR of rosgraph_msgs/Clock."""
        return CLOCK_FORM.layout.pack(*self.stamp(step))

    def pack_state(self, step: int, cell: int) -> bytes:
        """Return X_k(t) as CDR of geometry_msgs/PoseStamped."""
        return POSE_FORM.layout.pack(*self.stamp(step), *self.centres[cell])

    def unpack_state(self, data: bytes) -> tuple[int, int]:
        """Return (step, cell) of a local state.

        Raises:
            ValueError: the pose lies in no free cell.
        """
        sec, nanosec, x, y = self._read(wire.LOCAL_STATE, POSE_FORM, data)
        cell = self.cell(x, y)
        if cell is None:
            raise ValueError(
                f"is at ({x:g}, {y:g}), no free cell of map {self.grid.name}"
            )
        return self.checked_step(sec, nanosec), cell

    def pack_reward(self, step: int, reward: Reward) -> bytes:
        """Return R_k(t) and its parts as CDR of sensor_msgs/JointState."""
        return REWARD_FORM.layout.pack(*self.stamp(step), *reward)

    def unpack_reward(self, data: bytes) -> tuple[int, Reward]:
        """Return (step, reward) of a reward.

        Raises:
            ValueError: labels are missing or doubled, or a value is not a number.
        """
        sec, nanosec, *numbers = self._read(wire.REWARD, REWARD_FORM, data)
        if not all(map(isfinite, numbers)):
            raise ValueError(
                f"says the rewards {', '.join(map(str, numbers))}: not finite"
            )
        individual, common, cost, total, partners = numbers
        reward = Reward(individual, common, cost, total, int(partners))
        return self.checked_step(sec, nanosec), reward

    def pack_action(self, step: int, action: Action, report: wire.SelfReport) -> bytes:
        """Return an action as CDR of sensor_msgs/JointState; peers count from 1, 0 is none."""
        return ACTION_FORM.layout.pack(
            *self.stamp(step), *action_numbers(action), *report
        )

    def unpack_action(self, data: bytes) -> tuple[int, Action]:
        """Return (step, action).

        Raises:
            ValueError: labels are missing or doubled, (east, north) is no primitive action, or
                another number is invalid.
        """
        step, action, _ = self._action(data)
        return step, action

    def unpack_self_report(self, data: bytes) -> tuple[int, Action, wire.SelfReport]:
        """Return (step, action, self-report); errors as in `unpack_action`."""
        step, action, numbers = self._action(data)
        said = numbers[-len(SELF_REPORT_TYPES) :]
        if not all(map(isfinite, said)):
            raise ValueError(f"says {', '.join(map(str, said))} of itself: not finite")
        kinds = zip(SELF_REPORT_TYPES, said, strict=True)
        return step, action, wire.SelfReport(*(kind(number) for kind, number in kinds))

    def _action(self, data: bytes) -> tuple[int, Action, Sequence[float]]:
        sec, nanosec, *numbers = self._read(wire.ACTION, ACTION_FORM, data)
        _, _, asked, peer, perceived = numbers[:5]
        if not (asked in FLAGS and perceived in FLAGS and 0 <= peer <= self.robots):
            raise ValueError(
                f"says coordinate {asked}, peer {peer}, perceived {perceived}: no action"
            )
        return self.checked_step(sec, nanosec), action_from(numbers), numbers

    def pack_map(self, step: int) -> bytes:
        """Return the map as CDR of nav_msgs/OccupancyGrid."""
        return self._grid.pack(*self.stamp(step), self._grids.map)

    def pack_coordination_map(self, step: int, q_star: np.ndarray) -> bytes:
        """Return the cells where a robot asks as CDR of nav_msgs/OccupancyGrid.

        The value is 100 there, 0 elsewhere, -1 in walls.
        """
        return self._grid.pack(*self.stamp(step), self._grids.coordination(q_star))

    def pack_markers(self, stamp: tuple[int, int], cells: Sequence[int]) -> bytes:
        """Return doorways, goals and robots as CDR of visualization_msgs/MarkerArray.

        Args:
            stamp: (sec, nanosec).
            cells: the robots' cells.
        """
        doorways = stamp * len(self.grid.doorways)
        robots = (
            number for cell in cells for number in (*stamp, *stamp, *self.centres[cell])
        )
        return self._markers.pack(*doorways, *robots)
