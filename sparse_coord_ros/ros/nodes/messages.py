# Copyright 2026 The sparse_coord_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The messages of `protocol.wire.messages` as objects of rclpy."""

import math
from array import array as packed
from collections.abc import Iterable, Mapping

from builtin_interfaces.msg import Time
from diagnostic_msgs.msg import DiagnosticStatus, KeyValue
from geometry_msgs.msg import PoseStamped
from nav_msgs.msg import Path
from rclpy.serialization import deserialize_message
from sensor_msgs.msg import JointState
from std_msgs.msg import Header, MultiArrayDimension, String, UInt8MultiArray

from sparse_coord_ros.base.errors import RunError, did_you_mean
from sparse_coord_ros.core.runs.run_config import RunConfig, run_from_yaml
from sparse_coord_ros.protocol.lockstep.bodies import (
    NO_CELL,
    BodyGoal,
    GoalReport,
    Goals,
)
from sparse_coord_ros.protocol.wire import (
    BODY_GOALS,
    GOAL_LABELS,
    MAP_FRAME,
    REACHED,
    RUN,
)
from sparse_coord_ros.protocol.wire.messages import Messages, read_labelled
from sparse_coord_ros.ros.nodes.ros_topics import bind

TEXT = 8
"""Offset of the text in the bytes of a std_msgs/String."""


class Converter(Messages):
    """The messages of one run, with rclpy, which also decodes other layouts.

    Args:
        run: the run.
    """

    def __init__(self, run: RunConfig) -> None:
        super().__init__(
            run, lambda topic, data: deserialize_message(data, bind(topic).type)
        )

    def header(self, step: int) -> Header:
        """Return a header in the frame `map`, stamped with a time step."""
        return map_header(self.stamp(step))

    def pose(self, step: int, cell: int) -> PoseStamped:
        """Return a cell's centre at a time step."""
        message = PoseStamped(header=self.header(step))
        message.pose.position.x, message.pose.position.y = self.centres[cell]
        return message

    def path(self, step: int, cells: Iterable[int | None]) -> Path:
        """Return the cells' centres as a path, leaving out None."""
        poses = [self.pose(step, cell) for cell in cells if cell is not None]
        return Path(header=self.header(step), poses=poses)

    def goals_message(self, goals: Goals) -> JointState:
        """Return the goals of bodies as a message."""
        labels = list(BODY_GOALS.labels)
        numbers = [float(goals.number), float(goals.place), goals.since]
        for robot, *cells in goals.bodies:
            labels += [f"{self.names[robot]}/{label}" for label in GOAL_LABELS]
            numbers += map(float, cells)
        return JointState(header=self.header(goals.step), name=labels, position=numbers)

    def read_goals(self, message: JointState) -> Goals:
        """Return the goals of bodies.

        Raises:
            ValueError: it is malformed, or of other robots or cells.
        """
        ns, said = read_labelled(message)
        bodies = []
        last_cell = len(self.grid.cells) - 1
        for k, name in enumerate(self.names):
            if f"{name}/{GOAL_LABELS[0]}" in said:
                ends = [
                    _whole(said, f"{name}/{label}", 0, last_cell)
                    for label in GOAL_LABELS
                ]
                bodies.append(BodyGoal(k, *ends))
        return Goals(
            number=_whole(said, "number", 1, 2**53),
            step=self.step(0, ns),
            place=bool(_whole(said, "place", 0, 1)),
            since=_time(said, "since"),
            bodies=tuple(bodies),
        )

    def reached_message(self, step: int, reached: GoalReport) -> JointState:
        """Return a driver's report as a message."""
        labels = list(REACHED.labels)
        numbers = list(map(float, reached[1:]))
        return JointState(header=self.header(step), name=labels, position=numbers)

    def read_reached(self, robot: int, message: JointState) -> GoalReport:
        """Return the report of a robot's driver.

        Raises:
            ValueError: it is malformed, or of another map.
        """
        _, said = read_labelled(message)
        number = _whole(said, "number", 1, 2**53)
        cell = _whole(said, "cell", NO_CELL, len(self.grid.cells) - 1)
        times = (_time(said, label) for label in REACHED.labels[-2:])
        return GoalReport(robot, number, cell, said.get("there") == 1.0, *times)


def map_header(stamp: tuple[int, int]) -> Header:
    """Return a header in the frame `map`; `stamp`: (sec, nanosec)."""
    sec, nanosec = stamp
    return Header(stamp=Time(sec=sec, nanosec=nanosec), frame_id=MAP_FRAME)


def run_announced(data: bytes) -> str:
    """Return the identity of the run that a world announces; the rest is not read."""
    return RunConfig.identity(data[TEXT : TEXT + 200])


def read_run(data: bytes) -> RunConfig:
    """Return the run that a world announces.

    Raises:
        SparseCoordError: the text is no run, or has another format.
    """
    return run_from_yaml(
        deserialize_message(data, String).data, where=f"topic {RUN.name}"
    )


def robot_number(run: RunConfig, name: str, remedy: str) -> int:
    """Return a robot's number in the scenario, from 0.

    Raises:
        RunError: the scenario has no such robot; `remedy` says what to do.
    """
    names = run.scenario.names
    if name not in names:
        raise RunError(
            f"robot {name!r}: scenario {run.scenario.name} has no such robot"
            f"{did_you_mean(name, names)}; its robots are {', '.join(names)}; {remedy}"
        )
    return names.index(name)


def _time(said: Mapping[str, float], label: str) -> float:
    value = said.get(label, math.nan)
    if not 0.0 <= value < 2**31:  # the seconds of a stamp
        raise ValueError(f"says {label} {value:g}, no time in seconds")
    return value


def _whole(said: Mapping[str, float], label: str, low: int, high: int) -> int:
    value = said.get(label, math.nan)
    if not low <= value <= high or value != int(value):
        raise ValueError(
            f"says {label} {value:g}, no whole number from {low} to {high}"
        )
    return int(value)


def tables_message(
    data: bytes, step: int, occasion: str, attempt: str
) -> UInt8MultiArray:
    """Return tables, the bytes of an .npz file, as a message.

    Args:
        data: the bytes.
        step: the tables contain all learning before this time step.
        occasion: one of `wire.Occasion`.
        attempt: the attempt of the run (`Order.attempt`).
    """
    message = UInt8MultiArray(data=packed("B", data))
    npz = MultiArrayDimension(label="npz", size=len(data), stride=len(data))
    when = MultiArrayDimension(label=occasion, size=step, stride=1)
    message.layout.dim = [npz, when, MultiArrayDimension(label=attempt)]
    return message


def status(
    name: str, message: str, values: Mapping[str, object], *, warn: bool = False
) -> DiagnosticStatus:
    """Return a diagnostic status with its values as texts."""
    said = DiagnosticStatus(name=name, message=message, hardware_id="sparse_coord_ros")
    said.level = DiagnosticStatus.WARN if warn else DiagnosticStatus.OK
    said.values = [KeyValue(key=key, value=str(value)) for key, value in values.items()]
    return said
