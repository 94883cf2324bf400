# Copyright 2026 The sparse_coord_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Conversions between the core's steps, cells and numbers and ROS messages."""

import math
from array import array as packed
from collections.abc import Callable, Iterable, Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np
from builtin_interfaces.msg import Time
from diagnostic_msgs.msg import DiagnosticStatus, KeyValue
from geometry_msgs.msg import PoseStamped
from nav_msgs.msg import OccupancyGrid, Path
from rclpy.serialization import deserialize_message
from rosgraph_msgs.msg import Clock
from sensor_msgs.msg import JointState
from std_msgs.msg import ColorRGBA, Header, MultiArrayDimension, String, UInt8MultiArray
from visualization_msgs.msg import Marker, MarkerArray

from sparse_coord_ros.game.scenario import Scenario
from sparse_coord_ros.game.world import Action, Reward
from sparse_coord_ros.learn.run_config import RunConfig, run_from_yaml
from sparse_coord_ros.lockstep.bodies import LOST, BodyGoal, Goals, Reached
from sparse_coord_ros.lockstep.rollback import NO_ORDER, Order, Progress
from sparse_coord_ros.nodes.cdr import FixedLayout
from sparse_coord_ros.nodes.interface import RosTopic
from sparse_coord_ros.palette import DOORWAY_COLOUR, rgb, robot_colour
from sparse_coord_ros.wire import (
    ACCOUNT_LABELS,
    ACTION_LABELS,
    BODY_GOALS_LABELS,
    CLAIM_RANKS,
    DOORWAYS,
    GOAL_LABELS,
    GOALS,
    MAP_FRAME,
    PARTNERS_LABEL,
    REACHED_LABELS,
    REWARD_LABELS,
    ROBOTS,
    ROLLBACK,
    RUN,
    RUN_ID,
    STATUS_VALUES,
)
from sparse_coord_ros.wire.frame import (
    SECOND,
    Account,
    Frame,
    action_from,
    action_numbers,
    reward_from,
)
from sparse_coord_ros.wire.occupancy import UNKNOWN, OccupancyData


def _header(sec: int, nanosec: int) -> Header:
    return Header(stamp=Time(sec=sec, nanosec=nanosec), frame_id=MAP_FRAME)


def _pose(sec: int, nanosec: int, x: float, y: float) -> PoseStamped:
    message = PoseStamped(header=_header(sec, nanosec))
    message.pose.position.x, message.pose.position.y = x, y
    return message


def _labelled(required: Sequence[str], optional: Sequence[str] = ()) -> FixedLayout:
    """Return the layout of a JointState whose names label its positions.

    Optional ones that a message lacks read as 0.
    """
    labels = (*required, *optional)

    def build(sec: int, nanosec: int, *numbers: float) -> JointState:
        return JointState(header=_header(sec, nanosec), name=list(labels), position=list(numbers))

    def read(message: JointState) -> tuple:
        _check_frame(message.header)
        if len(set(message.name)) < len(message.name):
            raise ValueError(f"labels are given twice: {', '.join(message.name)}")
        said = dict.fromkeys(optional, 0.0) | dict(
            zip(message.name, message.position, strict=False)
        )
        missing = [label for label in required if label not in said]
        if missing:
            raise ValueError(f"no number is labelled {', '.join(missing)}")
        stamp = message.header.stamp
        return (stamp.sec, stamp.nanosec, *(said[label] for label in labels))

    return FixedLayout(JointState, build, read, len(labels))


def _check_frame(header: Header) -> None:
    if header.frame_id != MAP_FRAME:
        raise ValueError(f"frame_id is {header.frame_id!r}, not {MAP_FRAME!r}")


def _read_pose(message: PoseStamped) -> tuple:
    _check_frame(message.header)
    stamp, position = message.header.stamp, message.pose.position
    return (stamp.sec, stamp.nanosec, position.x, position.y)


POSE_LAYOUT = FixedLayout(PoseStamped, _pose, _read_pose, 2)
REWARD_LAYOUT = _labelled(REWARD_LABELS)
REFEREED_LAYOUT = _labelled((*REWARD_LABELS, PARTNERS_LABEL))
ACTION_LAYOUT = _labelled(ACTION_LABELS, ACCOUNT_LABELS)
CLOCK_LAYOUT = FixedLayout(
    Clock,
    lambda sec, nanosec: Clock(clock=Time(sec=sec, nanosec=nanosec)),
    lambda message: (message.clock.sec, message.clock.nanosec),
    0,
)


FURTHEST_STEP = 2**25
"""No run comes further: it has 10^7 transitions at most, and two time steps between episodes."""

FLAGS = (0.0, 1.0)
"""No and yes as numbers."""


class Converter(Frame):
    """Conversions of one run: its time step, its map and its metres, as messages.

    What is read is checked: the frame, the stamp, the numbers. What does not fit the run raises
    ValueError, and so may whatever cannot be decoded at all, with any exception.

    Args:
        run: the run.
    """

    def __init__(self, run: RunConfig) -> None:
        super().__init__(run)
        self._reward_layout = REFEREED_LAYOUT if self.referee else REWARD_LAYOUT

    def checked_step(self, sec: int, nanosec: int) -> int:
        """Return the time step of a stamp.

        Raises:
            ValueError: it lies before the run's beginning, or is no time.
        """
        if sec < 0 or not 0 <= nanosec < SECOND:
            raise ValueError(f"stamp {sec} s {nanosec} ns is no time of the run")
        return self.step(sec, nanosec)

    def header(self, step: int) -> Header:
        """Return a header in the frame `map`."""
        return _header(*self.stamp(step))

    def pack_state(self, step: int, cell: int) -> bytes:
        """Return X_k(t) as CDR of geometry_msgs/PoseStamped."""
        return POSE_LAYOUT.pack(*self.stamp(step), *self.centres[cell])

    def unpack_state(self, data: bytes) -> tuple[int, int]:
        """Return (step, cell) of a local state.

        Raises:
            ValueError: the pose lies in no free cell.
        """
        sec, nanosec, x, y = POSE_LAYOUT.unpack(data)
        cell = self.cell(x, y)
        if cell is None:
            raise ValueError(f"position ({x:g}, {y:g}) is no free cell of map {self.grid.name}")
        return self.checked_step(sec, nanosec), cell

    def pack_reward(self, step: int, reward: Reward) -> bytes:
        """Return R_k(t) and its parts as CDR of sensor_msgs/JointState."""
        numbers = reward if self.referee else reward[: len(REWARD_LABELS)]
        return self._reward_layout.pack(*self.stamp(step), *numbers)

    def unpack_reward(self, data: bytes) -> tuple[int, Reward]:
        """Return (step, reward) of a reward.

        Raises:
            ValueError: labels are missing or doubled, or a number is none.
        """
        sec, nanosec, *numbers = self._reward_layout.unpack(data)
        if not all(map(math.isfinite, numbers)):
            raise ValueError(f"a reward is {', '.join(map(str, numbers))}: not finite")
        return self.checked_step(sec, nanosec), reward_from(numbers)

    def pack_action(self, step: int, action: Action, account: Account) -> bytes:
        """Return an action as CDR of sensor_msgs/JointState; peers count from 1, 0 is none."""
        return ACTION_LAYOUT.pack(*self.stamp(step), *action_numbers(action), *account)

    def unpack_action(self, data: bytes) -> tuple[int, Action]:
        """Return (step, action).

        Raises:
            ValueError: labels are missing or doubled, (east, north) is no primitive action, or
                another number is none that a robot says.
        """
        sec, nanosec, *numbers, _, _ = ACTION_LAYOUT.unpack(data)
        _, _, asked, peer, perceived = numbers
        if not (asked in FLAGS and perceived in FLAGS and 0 <= peer <= self.robots):
            raise ValueError(f"coordinate {asked}, peer {peer}, perceived {perceived}: no action")
        return self.checked_step(sec, nanosec), action_from(numbers)

    def unpack_account(self, data: bytes) -> tuple[int, Action, Account]:
        """Return (step, action, what the robot says of itself); errors as of `unpack_action`."""
        step, action = self.unpack_action(data)
        percept, learned = ACTION_LAYOUT.unpack(data)[2 + len(ACTION_LABELS) :]
        return step, action, Account(int(percept), bool(learned))

    def pose(self, step: int, cell: int) -> PoseStamped:
        """Return a cell's centre at a time step."""
        return _pose(*self.stamp(step), *self.centres[cell])

    def path(self, step: int, cells: Iterable[int | None]) -> Path:
        """Return the cells' centres as a path, leaving out None."""
        poses = [self.pose(step, cell) for cell in cells if cell is not None]
        return Path(header=self.header(step), poses=poses)

    def occupancy(self, step: int, values: np.ndarray) -> OccupancyGrid:
        """Return values of the free cells (shape (cells,), -1 to 100) as a grid; walls unknown."""
        rows, columns = self.grid.shape
        data = np.full((rows, columns), UNKNOWN, dtype=np.int8)
        data[tuple(np.array(self.grid.cells).T)] = values
        return self._occupancy(step, np.flipud(data).tobytes())

    def map(self) -> OccupancyGrid:
        """Return the map: walls occupied, all else free."""
        return self._occupancy(0, OccupancyData(self).map)

    def _occupancy(self, step: int, southmost_first: bytes) -> OccupancyGrid:
        message = OccupancyGrid(header=self.header(step))
        message.info.resolution = self.resolution
        message.info.height, message.info.width = self.grid.shape
        message.info.origin.position.x, message.info.origin.position.y = self.origin
        message.info.origin.orientation.w = 1.0
        message.data = packed("b", southmost_first)
        return message

    def markers(self, step: int, scenario: Scenario, cells: Sequence[int]) -> MarkerArray:
        """Return doorways, goals and robots."""
        array = MarkerArray()
        for number, cell in enumerate(sorted(self.grid.doorways)):
            colour = rgb(DOORWAY_COLOUR)
            plate = self._marker(step, DOORWAYS, number, cell, colour, Marker.CUBE, 0.05)
            plate.color.a = 0.3  # the map is dark where walls are; the scene's boxes stand on it
            array.markers.append(plate)
        for k, robot in enumerate(scenario.robots):
            colour = rgb(robot_colour(k))
            goal = self._marker(step, GOALS, k, robot.goal, colour, Marker.CYLINDER, 0.04)
            here = self._marker(step, ROBOTS, k, cells[k], colour, Marker.SPHERE, 0.5)
            array.markers += [goal, here]
        return array

    def _marker(self, step, namespace, number, cell, colour, shape, height) -> Marker:
        marker = Marker(header=self.header(step), ns=namespace, id=number, type=shape)
        marker.pose = self.pose(step, cell).pose
        marker.scale.x = marker.scale.y = (
            0.5 if shape == Marker.SPHERE else 0.9
        ) * self.resolution
        marker.scale.z = height * self.resolution
        marker.color = ColorRGBA(r=colour[0], g=colour[1], b=colour[2], a=0.8)
        return marker


def typed(topic: RosTopic, read: Callable[[Any], Any]) -> Callable[[bytes], Any]:
    """Return `read`, which takes a topic's message objects, as a function of their bytes."""
    return lambda data: read(deserialize_message(data, topic.type))


class Announced(NamedTuple):
    """A run that a world has announced, and the text of it."""

    run: RunConfig
    text: str


def read_run(message: String) -> Announced:
    """Return the run that a world announces.

    Raises:
        SparseCoordError: it is none, or one of a newer version.
    """
    return Announced(run_from_yaml(message.data, where=f"topic {RUN.name}"), message.data)


class Said(NamedTuple):
    """What `status` says.

    Attributes:
        run: the identity of the world's run; empty of a world that has none.
        state: one of the states of `wire`.
        step: the time step.
        transitions: how many were made.
        order: to go back to a checkpoint, where one stands.
        left_out: (robot, step) pairs of them without the robot's action.
    """

    run: str
    state: str
    step: int
    transitions: int
    order: Order = Order()
    left_out: int = 0


def read_status(message: DiagnosticStatus) -> Said:
    """Return what the world says on `status`.

    Raises:
        ValueError: step or transitions are missing, or no number.
    """
    values = status_values(message)
    try:
        step, transitions = (int(values[name]) for name in STATUS_VALUES[:2])
    except KeyError as error:
        raise ValueError(f"no value is called {error.args[0]!r}") from None
    if step < 0 or transitions < 0:
        raise ValueError(f"step {step} with {transitions} transitions")
    name, *steps = values.get(ROLLBACK, "").split() or [NO_ORDER]
    if len(steps) != (2 if name else 0):
        raise ValueError(f"{ROLLBACK} is {values[ROLLBACK]!r}")
    order = Order(name, *map(int, steps)) if name else Order()
    left_out = int(values.get(STATUS_VALUES[2], 0))
    return Said(values.get(RUN_ID, ""), message.message, step, transitions, order, left_out)


def order_text(order: Order) -> str:
    """Return what `status` says of the order that stands."""
    return f"{order.name} {order.step} {order.first}" if order.name else ""


def progress_message(name: str, said: Progress) -> DiagnosticStatus:
    """Return what a robot says of its checkpoints as a message."""
    values: dict[str, object] = {**said._asdict(), "resumed": int(said.resumed)}
    values["checkpoints"] = " ".join(map(str, said.checkpoints))
    return status(name, "progress", values)


def read_progress(message: DiagnosticStatus) -> Progress:
    """Return what a robot says of its checkpoints.

    Raises:
        ValueError: it is malformed.
    """
    values = status_values(message)
    missing = [name for name in Progress._fields if name not in values]
    if missing:
        raise ValueError(f"no value is called {missing[0]!r}")
    step, transitions = int(values["step"]), int(values["transitions"])
    checkpoints = tuple(int(text) for text in values["checkpoints"].split())
    if not all(0 <= number <= FURTHEST_STEP for number in (step, transitions, *checkpoints)):
        raise ValueError(f"step {step} with {transitions} transitions: no run comes there")
    return Progress(
        values["life"],
        step,
        transitions,
        checkpoints,
        values["obeyed"],
        values["resumed"] == "1",
    )


def goals_message(convert: Converter, goals: Goals, names: Sequence[str]) -> JointState:
    """Return what bodies are told as a message; names of the robots."""
    labels = list(BODY_GOALS_LABELS)
    numbers = [float(goals.number), float(goals.place), goals.since]
    for robot, *cells in goals.bodies:
        labels += [f"{names[robot]}/{label}" for label in GOAL_LABELS]
        numbers += map(float, cells)
    return JointState(header=convert.header(goals.step), name=labels, position=numbers)


def read_goals(convert: Converter, names: Sequence[str], message: JointState) -> Goals:
    """Return what bodies are told.

    Raises:
        ValueError: it is malformed, or of other robots or cells.
    """
    _check_frame(message.header)
    said = _by_label(message)
    number, place = _whole(said, "number", 1, 2**53), _whole(said, "place", 0, 1)
    cells = len(convert.grid.cells)
    goals = []
    for k, name in enumerate(names):
        if f"{name}/{GOAL_LABELS[0]}" in said:
            ends = [_whole(said, f"{name}/{label}", 0, cells - 1) for label in GOAL_LABELS]
            goals.append(BodyGoal(k, *ends))
    stamp = message.header.stamp
    step = convert.checked_step(stamp.sec, stamp.nanosec)
    return Goals(number, step, bool(place), _time(said, "since"), tuple(goals))


def reached_message(convert: Converter, step: int, reached: Reached) -> JointState:
    """Return a driver's report as a message."""
    numbers = list(map(float, reached[1:]))
    return JointState(header=convert.header(step), name=list(REACHED_LABELS), position=numbers)


def read_reached(convert: Converter, robot: int, message: JointState) -> Reached:
    """Return the report of a robot's driver.

    Raises:
        ValueError: it is malformed, or of another map.
    """
    _check_frame(message.header)
    said = _by_label(message)
    number = _whole(said, "number", 1, 2**53)
    cell = _whole(said, "cell", LOST, len(convert.grid.cells) - 1)
    times = (_time(said, label) for label in REACHED_LABELS[-2:])
    return Reached(robot, number, cell, said.get("there") == 1.0, *times)


def _by_label(message: JointState) -> dict[str, float]:
    if len(message.name) != len(message.position) or len(set(message.name)) < len(message.name):
        raise ValueError("its labels and numbers do not belong together")
    return dict(zip(message.name, message.position, strict=True))


def _time(said: Mapping[str, float], label: str) -> float:
    value = said.get(label, math.nan)
    if not 0.0 <= value < 2**31:  # the seconds of a stamp
        raise ValueError(f"{label} is {value:g}, no time in seconds")
    return value


def _whole(said: Mapping[str, float], label: str, low: int, high: int) -> int:
    value = said.get(label, math.nan)
    if not low <= value <= high or value != int(value):
        raise ValueError(f"{label} is {value:g}, no whole number from {low} to {high}")
    return int(value)


def read_claim(header: Header) -> tuple[str, int]:
    """Return (identity, how far the node has come: a place in `CLAIM_RANKS`) of a claim.

    Raises:
        ValueError: it is no claim.
    """
    identity, _, rank = header.frame_id.partition(" ")
    if not identity or rank not in CLAIM_RANKS:
        raise ValueError(f"frame_id {header.frame_id!r} is no claim")
    return identity, CLAIM_RANKS.index(rank)


def tables_message(data: bytes, step: int, occasion: str) -> UInt8MultiArray:
    """Return tables, the bytes of an .npz file, as a message.

    Args:
        data: the bytes.
        step: all is learned that happened before this time step.
        occasion: `wire.INITIAL`, `CHECKPOINT` or `FINAL`.
    """
    message = UInt8MultiArray(data=packed("B", data))
    message.layout.dim = [
        MultiArrayDimension(label="npz", size=len(data), stride=len(data)),
        MultiArrayDimension(label=occasion, size=step, stride=1),
    ]
    return message


def read_tables_message(message: UInt8MultiArray) -> tuple[bytes, int, str]:
    """Return (data, step, occasion) of what `tables_message` made.

    Raises:
        ValueError: the message has another layout.
    """
    labels = [dimension.label for dimension in message.layout.dim]
    if len(labels) != 2 or labels[0] != "npz":
        raise ValueError(f"its dimensions are {labels}, not 'npz' and an occasion")
    return message.data.tobytes(), message.layout.dim[1].size, labels[1]


def status(name: str, message: str, values: Mapping[str, object], *, warn: bool = False):
    """Return a diagnostic status with its values as texts."""
    return DiagnosticStatus(
        level=DiagnosticStatus.WARN if warn else DiagnosticStatus.OK,
        name=name,
        message=message,
        hardware_id="sparse_coord_ros",
        values=[KeyValue(key=key, value=str(value)) for key, value in values.items()],
    )


def status_values(message: DiagnosticStatus) -> dict[str, str]:
    """Return the values of a diagnostic status."""
    return {value.key: value.value for value in message.values}
