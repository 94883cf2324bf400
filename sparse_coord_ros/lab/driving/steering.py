# Copyright 2026 The sparse_coord_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Steering of a differential drive to a place, and the time that it may take."""

import math
from typing import NamedTuple

from sparse_coord_ros.core.game.pose import Pose

TURN_FIRST = 0.5
"""Radians off the bearing beyond which the body turns on the spot; nearer, it drives faster."""

TURN_GAIN = 3.0
SPEED_GAIN = 3.0
"""Per second: speed for a remaining angle or distance, in proportion to it."""

CRAWL = 0.1
"""Least share of the speed at the end of a way."""

SPARE = 2.0
"""Default time limit of a move, in times for half a turn and a cell."""


class Limits(NamedTuple):
    """The limits of a body.

    Attributes:
        speed: metres a second.
        turn: radians a second.
        near: metres from a place within which the body has arrived.
        seconds: longest time of a move, by the clock of the poses.
    """

    speed: float
    turn: float
    near: float
    seconds: float


class Command(NamedTuple):
    """A body's command: metres a second ahead, radians a second counterclockwise."""

    ahead: float
    turn: float


STOP = Command(0.0, 0.0)


SLOWING_SECONDS = 3.0
"""Additional time for slowing down at the end of a way."""


def move_seconds(side: float, speed: float, turn: float) -> float:
    """Return the default time limit of a move, in seconds."""
    return SPARE * (side / speed + math.pi / turn) + SLOWING_SECONDS


def distance(pose: Pose, place: tuple[float, float]) -> float:
    """Return the metres from a body to a place."""
    return math.hypot(place[0] - pose.x, place[1] - pose.y)


def steer(pose: Pose, place: tuple[float, float], limits: Limits) -> Command:
    """Return the next command for a body to reach a place: turn, then drive and correct."""
    bearing = math.atan2(place[1] - pose.y, place[0] - pose.x)
    off = math.remainder(bearing - pose.yaw, math.tau)
    turn = max(-limits.turn, min(limits.turn, TURN_GAIN * off))
    if abs(off) > TURN_FIRST:
        return Command(0.0, math.copysign(max(abs(turn), CRAWL * limits.turn), off))
    ahead = min(limits.speed, SPEED_GAIN * distance(pose, place)) * (
        1.0 - abs(off) / TURN_FIRST
    )
    return Command(max(CRAWL * limits.speed, ahead), turn)
