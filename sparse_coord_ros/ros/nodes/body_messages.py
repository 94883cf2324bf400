# Copyright 2026 The sparse_coord_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The messages between world and drivers: goals of bodies, and how they ended.

They are numbers with names, not PoseStamped: drivers answer a goal by its number, and all goals of
a moment come at once, as the simulator of bodies waits for just those robots.
"""

import math
from collections.abc import Mapping

from sensor_msgs.msg import JointState

from sparse_coord_ros.protocol.lockstep.bodies import (
    NO_CELL,
    BodyGoal,
    GoalReport,
    Goals,
)
from sparse_coord_ros.protocol.wire import BODY_GOALS, GOAL_LABELS, REACHED
from sparse_coord_ros.protocol.wire.messages import Messages, read_labelled
from sparse_coord_ros.ros.nodes.ros_messages import map_header


def goals_message(messages: Messages, goals: Goals) -> JointState:
    """Return the goals of bodies as a message."""
    labels = list(BODY_GOALS.labels)
    numbers = [float(goals.number), float(goals.placing), goals.since]
    for robot, *cells in goals.bodies:
        labels += [f"{messages.names[robot]}/{label}" for label in GOAL_LABELS]
        numbers += map(float, cells)
    header = map_header(messages.stamp(goals.step))
    return JointState(header=header, name=labels, position=numbers)


def read_goals(messages: Messages, message: JointState) -> Goals:
    """Return the goals of bodies.

    Raises:
        ValueError: it is malformed, or of other robots or cells.
    """
    ns, numbers = read_labelled(message)
    bodies = []
    last_cell = len(messages.grid.cells) - 1
    for k, name in enumerate(messages.names):
        if f"{name}/{GOAL_LABELS[0]}" in numbers:
            ends = [
                _whole(numbers, f"{name}/{label}", 0, last_cell)
                for label in GOAL_LABELS
            ]
            bodies.append(BodyGoal(k, *ends))
    return Goals(
        number=_whole(numbers, "number", 1, 2**53),
        step=messages.step(0, ns),
        placing=bool(_whole(numbers, "place", 0, 1)),
        since=_time(numbers, "since"),
        bodies=tuple(bodies),
    )


def reached_message(messages: Messages, step: int, reached: GoalReport) -> JointState:
    """Return a driver's report as a message."""
    labels = list(REACHED.labels)
    numbers = list(map(float, reached[1:]))
    header = map_header(messages.stamp(step))
    return JointState(header=header, name=labels, position=numbers)


def read_reached(messages: Messages, robot: int, message: JointState) -> GoalReport:
    """Return the report of a robot's driver.

    Raises:
        ValueError: it is malformed, or of another map.
    """
    _, numbers = read_labelled(message)
    number = _whole(numbers, "number", 1, 2**53)
    cell = _whole(numbers, "cell", NO_CELL, len(messages.grid.cells) - 1)
    times = (_time(numbers, label) for label in REACHED.labels[-2:])
    return GoalReport(robot, number, cell, numbers.get("there") == 1.0, *times)


def _time(numbers: Mapping[str, float], label: str) -> float:
    value = numbers.get(label, math.nan)
    if not 0.0 <= value < 2**31:  # the seconds of a stamp
        raise ValueError(f"says {label} {value:g}, no time in seconds")
    return value


def _whole(numbers: Mapping[str, float], label: str, low: int, high: int) -> int:
    value = numbers.get(label, math.nan)
    if not low <= value <= high or value != int(value):
        raise ValueError(
            f"says {label} {value:g}, no whole number from {low} to {high}"
        )
    return int(value)
