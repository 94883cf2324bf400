# Copyright 2026 The sparse_coord_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Time steps and cells as the seconds and metres that messages speak of, and back.

The nodes and whoever reads their log use this same object, so that both mean the same.
"""

import struct
from collections.abc import Sequence
from math import isfinite
from typing import Any, NamedTuple

from sparse_coord_ros.game.actions import DIRECTIONS
from sparse_coord_ros.game.grid import GridMap
from sparse_coord_ros.game.world import Action, Reward
from sparse_coord_ros.learn.run_config import RunConfig

SECOND = 1_000_000_000
"""Nanoseconds."""

STAMPED = struct.Struct("<4xiI")
"""How a message that begins with its stamp begins as CDR: encapsulation, sec, nanosec."""

EAST_NORTH = [(float(column), float(-row)) for row, column in DIRECTIONS]
"""The primitive actions as unit vectors (x east, y north: REP-103)."""
MOVE_OF = {vector: move for move, vector in enumerate(EAST_NORTH)}


class Frame:
    """The frame `map` and the clock of one run.

    Args:
        run: the run; time step t is stamped t * step_period seconds, the map's lower left corner
            lies at its `origin`, x points east, y north.

    Attributes:
        grid: the map.
        resolution: metres a cell.
        origin: (x, y) of the map's lower left corner, in metres.
        period: nanoseconds a time step.
        centres: (x, y) of the middle of each free cell, in metres.
        referee: whether rewards say with whom a robot was in a miscoordination.
        robots: how many robots there are.
    """

    def __init__(self, run: RunConfig) -> None:
        self.grid: GridMap = run.scenario.map
        self.resolution = run.resolution
        self.origin = x, y = self.grid.origin
        self.referee = run.scenario.referee
        self.robots = len(run.scenario.robots)
        self.period = round(run.step_period * SECOND)
        rows = self.grid.shape[0]
        self.centres = [
            (x + (column + 0.5) * self.resolution, y + (rows - row - 0.5) * self.resolution)
            for row, column in self.grid.cells
        ]
        self._cells = {centre: cell for cell, centre in enumerate(self.centres)}

    def stamp(self, step: int) -> tuple[int, int]:
        """Return (sec, nanosec) of a time step."""
        return divmod(step * self.period, SECOND)

    def step(self, sec: int, nanosec: int) -> int:
        """Return the time step of a stamp (the nearest one)."""
        return (sec * SECOND + nanosec + self.period // 2) // self.period

    def cell(self, x: float, y: float) -> int | None:
        """Return the free cell at a position in metres, or None where there is none."""
        cell = self._cells.get((x, y))
        if cell is None:
            column = (x - self.origin[0]) // self.resolution
            south = (y - self.origin[1]) // self.resolution
            if isfinite(column) and isfinite(south):  # of a place far off they may overflow
                position = (self.grid.shape[0] - 1 - int(south), int(column))
                cell = self.grid.number.get(position)
        return cell


def flat_position(pose: Any) -> tuple[float, float]:
    """Return (x, y) of a pose message; ValueError where it is turned or off the ground."""
    place, turn = pose.position, pose.orientation
    if (place.z, turn.x, turn.y, turn.z, turn.w) != (0.0, 0.0, 0.0, 0.0, 1.0):
        raise ValueError("holds a pose that is not flat on the map")
    return place.x, place.y


def action_numbers(action: Action) -> tuple[float, ...]:
    """Return the numbers of `ACTION_LABELS`; peers count from 1, 0 is none."""
    return (
        *EAST_NORTH[action.move],
        float(action.asked),
        float(action.peer + 1),
        float(action.perceived),
    )


def reward_from(numbers: Sequence[float]) -> Reward:
    """Return the reward that the numbers of `REWARD_LABELS` say, and `PARTNERS_LABEL` if there.

    Raises:
        ValueError: the partners are no number.
    """
    individual, common, ask_cost, total, *partners = numbers
    if not partners:
        return Reward(individual, common, ask_cost, total)
    if not isfinite(partners[0]):
        raise ValueError(f"partners is {partners[0]:g}, no sum of powers of two")
    return Reward(individual, common, ask_cost, total, int(partners[0]))


class Account(NamedTuple):
    """What a robot says of itself beside its action.

    Attributes:
        percept: how its percept ended: one of `wire.PERCEPT_ENDS`, by number.
        learned: whether it has learned from its action before this one.
    """

    percept: int
    learned: bool


def action_from(numbers: Sequence[float]) -> Action:
    """Return the action that the numbers of `ACTION_LABELS` say.

    Raises:
        ValueError: (east, north) is no primitive action, or peer is no number.
    """
    east, north, asked, peer, perceived = numbers
    move = MOVE_OF.get((east, north))
    if move is None:
        raise ValueError(f"(east, north) is ({east:g}, {north:g}), no primitive action")
    if not isfinite(peer):
        raise ValueError(f"peer is {peer:g}, no robot's number")
    return Action(move, bool(asked), int(peer) - 1, bool(perceived))
