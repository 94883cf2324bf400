# Copyright 2026 The sparse_coord_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The messages of `protocol.wire.messages` as objects of rclpy."""

from array import array as packed
from collections.abc import Iterable, Mapping

from diagnostic_msgs.msg import DiagnosticStatus, KeyValue
from geometry_msgs.msg import PoseStamped
from nav_msgs.msg import Path
from rclpy.serialization import deserialize_message
from std_msgs.msg import Header, MultiArrayDimension, String, UInt8MultiArray

from sparse_coord_ros.base.errors import RunError, did_you_mean
from sparse_coord_ros.core.runs.run_config import RunConfig, run_from_yaml
from sparse_coord_ros.protocol.wire import MAP_FRAME, RUN
from sparse_coord_ros.protocol.wire.messages import Messages
from sparse_coord_ros.ros.nodes.ros_topics import bind

TEXT = 8
"""Offset of the text in the bytes of a std_msgs/String."""


def messages_of(run: RunConfig) -> Messages:
    """Return the messages of a run; rclpy decodes those that other programs have packed."""
    return Messages(
        run, lambda topic, data: deserialize_message(data, bind(topic).type)
    )


def set_cell(pose: PoseStamped, messages: Messages, step: int, cell: int) -> None:
    """Set a pose to a cell's centre at a time step."""
    set_header(pose.header, messages.stamp(step))
    pose.pose.position.x, pose.pose.position.y = messages.centres[cell]


def cell_path(messages: Messages, step: int, cells: Iterable[int | None]) -> Path:
    """Return the cells' centres as a path, leaving out None; all poses have its header."""
    path = Path(header=map_header(messages.stamp(step)))
    for cell in cells:
        if cell is not None:
            pose = PoseStamped(header=path.header)
            pose.pose.position.x, pose.pose.position.y = messages.centres[cell]
            path.poses.append(pose)
    return path


def map_header(stamp: tuple[int, int]) -> Header:
    """Return a header in the frame `map`; `stamp`: (sec, nanosec)."""
    header = Header()
    set_header(header, stamp)
    return header


def set_header(header: Header, stamp: tuple[int, int]) -> None:
    """Set a message's header: a message is slow to make, and makes its own anyway."""
    header.frame_id = MAP_FRAME
    header.stamp.sec, header.stamp.nanosec = stamp


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
    made = DiagnosticStatus(name=name, message=message, hardware_id="sparse_coord_ros")
    made.level = DiagnosticStatus.WARN if warn else DiagnosticStatus.OK
    made.values = [KeyValue(key=key, value=str(value)) for key, value in values.items()]
    return made
