# Copyright 2026 The sparse_coord_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The messages of a run, packed and read by the vocabulary, without ROS.

A `MessageForm` has the byte layouts of a topic's messages, and the rows read from them. `Messages`
packs and reads single messages by it; the log reads many at once, by columns.
An error's text continues a sentence about the message, such as "has no number labelled total".
"""

import struct
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cache, cached_property
from math import isfinite
from typing import Any

import numpy as np

from sparse_coord_ros.core.game.actions import DIRECTIONS
from sparse_coord_ros.core.game.grid import GridMap
from sparse_coord_ros.core.game.world import Action, Reward
from sparse_coord_ros.core.learners.rules import asks_surely
from sparse_coord_ros.core.runs.run_config import RunConfig
from sparse_coord_ros.protocol import wire
from sparse_coord_ros.protocol.wire.cdr import (
    Fixed,
    Free,
    Item,
    Layout,
    flat_pose,
    flat_pose_at,
    nothing,
    stamp,
)

SECOND = 1_000_000_000
"""Nanoseconds."""

EAST_NORTH = [(float(column), float(-row)) for row, column in DIRECTIONS]
"""The primitive actions as unit vectors (x east, y north: REP-103) along the map's axes."""

MOVE_OF = {vector: move for move, vector in enumerate(EAST_NORTH)}

UNKNOWN = -1
EMPTY = 0
OCCUPIED = 100
"""The values of an occupancy grid."""

STAMPED = struct.Struct("<4xiI")
"""Beginning of a message with a leading stamp, as CDR: encapsulation, sec, nanosec."""

NS = ("ns", "i8")
"""The first column of every row: the message's stamp in nanoseconds."""

Fill = Callable[[np.ndarray, np.ndarray], np.ndarray | None]
"""Puts the free fields of messages into rows; returns whether each is valid, None: all are."""


def stamps_of(fields: np.ndarray) -> np.ndarray:
    """Return the stamps of messages' fields in nanoseconds, shape (messages,)."""
    seconds = fields["sec"].astype(np.int64)
    return np.asarray(seconds * SECOND + fields["nanosec"])


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
    position = message.pose.position
    turn = message.pose.orientation
    if (position.z, turn.x, turn.y, turn.z, turn.w) != (0.0, 0.0, 0.0, 0.0, 1.0):
        raise ValueError("holds a pose that is not flat on the map")
    return read_header(message.header), (position.x, position.y)


def labelled(labels: Sequence[str]) -> MessageForm:
    """Return the form of a sensor_msgs/JointState with labels for its positions, `numbers`."""
    count = len(labels)

    def read(message: Any) -> tuple[int, list[float]]:
        ns, numbers = read_labelled(message)
        missing = [label for label in labels if label not in numbers]
        if missing:
            raise ValueError(f"has no number labelled {', '.join(missing)}")
        return ns, [numbers[label] for label in labels]

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
POSE_ITEMS = [*header(), *flat_pose()]
"""The fields of a geometry_msgs/PoseStamped."""

POSE_FORM = MessageForm(
    np.dtype([NS, ("xy", "2f8")]), [(Layout(POSE_ITEMS), by_name)], read_pose
)
ACTION_FORM = labelled(wire.ACTION.labels)
REWARD_FORM = labelled(wire.REWARD.labels)


@cache
def path_layout(count: int) -> Layout:
    """Return the layout of a nav_msgs/Path of some poses; the poses may have any stamps."""
    items: list[Item] = [*header(), Fixed("<u4", count)]
    for number in range(count):
        items += [*header(f"{number}_"), *flat_pose(f"{number}_")]
    return Layout(items)


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
        columns, [(path_layout(n), fill(n)) for n in range(1, robots + 1)]
    )


def grid_form(run: RunConfig) -> MessageForm:
    """Return the form of an occupancy grid on a run's map: its `data`, southmost first."""
    grid = run.scenario.map
    rows, columns = grid.shape
    count = rows * columns
    size = [Fixed("<f4", run.resolution), Fixed("<u4", columns), Fixed("<u4", rows)]
    data = Free("data", f"({count},)i1")
    items = [
        *nothing("<i4", "<u4"),
        *size,
        *flat_pose_at(*grid.origin),
        Fixed("<u4", count),
        data,
    ]
    row = np.dtype([NS, ("data", "i1", (count,))])
    return MessageForm(row, [(Layout([*header(), *items]), by_name)])


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


FLAGS = (0.0, 1.0)
"""No and yes as numbers."""


class Messages:
    """The messages of one run, as CDR: its steps and cells as seconds and metres, and back.

    Time step t has the stamp t * step_period seconds. In the frame `map` the map lies at its
    `origin`; if that has no yaw, east is along x, north along y.
    Reading checks the frame and the numbers: a message that does not fit the run raises
    ValueError; one that cannot be decoded may raise any exception.

    Args:
        run: the run.
        decode: returns the message from a topic's bytes without a known layout; None: such
            messages do not come.

    Attributes:
        grid: the map.
        resolution: metres a cell.
        origin: the pose of the map's lower left corner.
        period: nanoseconds a time step.
        centres: (x, y) of the middle of each free cell, in metres.
        places: index of each free cell in the data of an occupancy grid, shape (cells,).
        names: the robots' names; robots: their number.
    """

    def __init__(
        self,
        run: RunConfig,
        decode: Callable[[wire.Topic, bytes], Any] | None = None,
    ) -> None:
        self.grid: GridMap = run.scenario.map
        self.resolution = run.resolution
        self.origin = self.grid.origin
        self.names = run.scenario.names
        self.robots = len(self.names)
        self.period = round(run.step_period * SECOND)
        self._half = self.period // 2
        rows, columns = self.grid.shape
        cells = self.grid.cells
        self.centres = [self.grid.squares.centre(*cell) for cell in cells]
        self.places = np.array([(rows - 1 - r) * columns + c for r, c in cells])
        self._cells = {centre: cell for cell, centre in enumerate(self.centres)}
        self._decode = decode
        self._grid = grid_form(run).layout

    def stamp(self, step: int) -> tuple[int, int]:
        """Return (sec, nanosec) of a time step."""
        return divmod(step * self.period, SECOND)

    def step(self, sec: int, nanosec: int) -> int:
        """Return the time step of a stamp (the nearest one)."""
        return (sec * SECOND + nanosec + self._half) // self.period

    def cell(self, x: float, y: float) -> int | None:
        """Return the free cell at a position in metres, or None."""
        cell = self._cells.get((x, y))
        return self.grid.cell_at(x, y) if cell is None else cell

    def _decoded(
        self, topic: wire.Topic, form: MessageForm, data: bytes
    ) -> tuple[Any, ...]:
        """Return (sec, nanosec, *numbers) of a message that another program has packed."""
        if self._decode is None:
            return no_other_form(data)
        ns, numbers = form.read(self._decode(topic, data))
        return *divmod(ns, SECOND), *numbers

    # Of each time step.

    def pack_clock(self, step: int) -> bytes:
        """Return the time of a time step as CDR of rosgraph_msgs/Clock."""
        return CLOCK_FORM.layout.pack(*divmod(step * self.period, SECOND))

    def pack_state(self, step: int, cell: int) -> bytes:
        """Return X_k(t) as CDR of geometry_msgs/PoseStamped."""
        return POSE_FORM.layout.pack(
            *divmod(step * self.period, SECOND), *self.centres[cell]
        )

    def unpack_state(self, data: bytes) -> tuple[int, int]:
        """Return (step, cell) of a local state.

        Raises:
            ValueError: the pose lies in no free cell.
        """
        fields = POSE_FORM.layout.unpack(data)
        if fields is None:
            fields = self._decoded(wire.LOCAL_STATE, POSE_FORM, data)
        sec, nanosec, x, y = fields
        cell = self.cell(x, y)
        if cell is None:
            raise ValueError(
                f"is at ({x:g}, {y:g}), no free cell of map {self.grid.name}"
            )
        return (sec * SECOND + nanosec + self._half) // self.period, cell

    def pack_reward(self, step: int, reward: Reward) -> bytes:
        """Return R_k(t) and its parts as CDR of sensor_msgs/JointState."""
        return REWARD_FORM.layout.pack(*divmod(step * self.period, SECOND), *reward)

    def unpack_reward(self, data: bytes) -> tuple[int, Reward]:
        """Return (step, reward) of a reward.

        Raises:
            ValueError: labels are missing or doubled, or a part is no finite number.
        """
        fields = REWARD_FORM.layout.unpack(data)
        if fields is None:
            fields = self._decoded(wire.REWARD, REWARD_FORM, data)
        sec, nanosec, individual, common, cost, total, partners = fields
        if not isfinite(individual + common + cost):
            raise ValueError(f"says {individual:g}, {common:g}, {cost:g}: no reward")
        reward = Reward(individual, common, cost, total, int(partners))
        return (sec * SECOND + nanosec + self._half) // self.period, reward

    def pack_action(self, step: int, action: Action, report: wire.SelfReport) -> bytes:
        """Return an action as CDR of sensor_msgs/JointState; peers count from 1, 0 is none."""
        return ACTION_FORM.layout.pack(
            *divmod(step * self.period, SECOND), *action_numbers(action), *report
        )

    def unpack_action(self, data: bytes) -> tuple[int, Action, wire.SelfReport]:
        """Return (step, action, self-report).

        Raises:
            ValueError: labels are missing or doubled, (east, north) is no primitive action, or
                another number is invalid.
        """
        fields = ACTION_FORM.layout.unpack(data)
        if fields is None:
            fields = self._decoded(wire.ACTION, ACTION_FORM, data)
        sec, nanosec, *numbers = fields
        _, _, asked, peer, perceived, percept, learned = numbers
        if not (asked in FLAGS and perceived in FLAGS and 0 <= peer <= self.robots):
            raise ValueError(
                f"says coordinate {asked}, peer {peer}, perceived {perceived}: no action"
            )
        report = wire.SelfReport(int(percept), bool(learned))
        return (
            (sec * SECOND + nanosec + self._half) // self.period,
            action_from(numbers),
            report,
        )

    def pack_percept(self, step: int, cells: Sequence[int]) -> bytes:
        """Return a percept as CDR of nav_msgs/Path: the own cell, then the perceived ones."""
        stamp = self.stamp(step)
        poses = [number for cell in cells for number in (*stamp, *self.centres[cell])]
        return path_layout(len(cells)).pack(*stamp, *poses)

    # Now and then.

    def pack_map(self, step: int) -> bytes:
        """Return the map as CDR of nav_msgs/OccupancyGrid: walls occupied, all else empty."""
        walls = [[OCCUPIED * (sign == "#") for sign in row] for row in self.grid.rows]
        data = np.flipud(np.array(walls, dtype=np.int8)).tobytes()
        return self._grid.pack(*self.stamp(step), data)

    def asking_cells(self, q_star: np.ndarray) -> bytes:
        """Return where a greedy robot with this Q* asks, as data of an occupancy grid.

        The value is 100 there, 0 elsewhere, -1 in walls.
        """
        rows, columns = self.grid.shape
        data = np.full(rows * columns, UNKNOWN, dtype=np.int8)
        data[self.places] = np.where(asks_surely(q_star.T), OCCUPIED, EMPTY)
        return data.tobytes()

    def pack_coordination_map(self, step: int, asking: bytes) -> bytes:
        """Return `asking_cells` as CDR of nav_msgs/OccupancyGrid."""
        return self._grid.pack(*self.stamp(step), asking)
