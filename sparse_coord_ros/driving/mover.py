# Copyright 2026 The sparse_coord_ros authors
# SPDX-License-Identifier: Apache-2.0
"""What every driver of a body shares: goals and poses in, and how a goal ends."""

import math

from sparse_coord_ros.driving.ground import Ground, Pose
from sparse_coord_ros.driving.steering import distance
from sparse_coord_ros.lockstep.bodies import LOST, BodyGoal, Goals, Reached

SLACK = 1e-6
"""Seconds: stamps are whole nanoseconds."""

BACK = 1.0
"""Seconds that a pose may be older than the newest one; one that is older is of a new clock."""

REPEATS = 4
"""After so many poses of the same time it is believed, even if newer ones were seen before: the
simulator was started again."""


class Mover:
    """Takes one robot's body from cell to cell; how, a subclass says.

    A body is in the free cell whose square its pose lies in; off the grid, in the nearest one
    within a cell's side. Where it ends counts, whatever moved it: it has arrived, stayed or
    drifted.

    Args:
        ground: the floor.
        robot: whose body, from 0.

    Attributes:
        pose: the newest pose; None: none has come.
        ignored: poses that were no places, or older than one before.
    """

    def __init__(self, ground: Ground, robot: int) -> None:
        self._ground, self._robot = ground, robot
        self._goals: Goals | None = None
        self._goal: BodyGoal | None = None
        self._began: float | None = None
        self._seconds: float | None = None
        self._ended: Reached | None = None
        self._heard = math.nan
        self._repeats = 0
        self.pose: Pose | None = None
        self.ignored = 0

    @property
    def busy(self) -> bool:
        """Whether the body is under way to a goal."""
        return self._goal is not None

    @property
    def _unheard(self) -> bool:
        """Whether the simulator of the body stands still, as if it had missed the last command."""
        return self._repeats > 0 and self._repeats % REPEATS == 0

    def take(self, goals: Goals) -> bool:
        """Take goals, and return whether they are new; those before them are given up."""
        if self._goals is not None and goals.number == self._goals.number:
            return False
        self._goals = goals
        mine = [goal for goal in goals.bodies if goal.robot == self._robot]
        self._goal = mine[0] if mine else None
        self._began = self._ended = None
        return True

    def sees(self, seconds: float, pose: Pose) -> None:
        """Take in a pose and its time, in seconds of any clock."""
        before = seconds if self._seconds is None else self._seconds
        self._repeats = self._repeats + 1 if seconds == self._heard else 0
        self._heard = seconds
        late = 0.0 < before - seconds <= BACK and self._repeats < REPEATS
        if late or not all(map(math.isfinite, (seconds, *pose))):
            self.ignored += 1
            return
        if seconds < before:
            self._began = None
        self._seconds, self.pose = seconds, pose

    def _newer(self, goals: Goals, now: float) -> bool:
        """Whether a pose is newer than those that goals knew of."""
        return not 0.0 <= goals.since - now + SLACK <= BACK or self._repeats >= REPEATS

    def _placed(self, goals: Goals, goal: BodyGoal, pose: Pose, now: float) -> Reached | None:
        """Say that the body is where it was to be put; None while it is not."""
        place = self._ground.place(self._robot, goal.end)
        close = distance(pose, place) <= self._ground.side / 2
        if close or self._ground.inside(goal.end, pose.x, pose.y):
            return self._end(goals, pose, now, there=True)
        return None

    def _end(self, goals: Goals, pose: Pose, now: float, *, there: bool) -> Reached:
        cell = self._ground.cell(pose.x, pose.y)
        took = 0.0 if self._began is None else now - self._began
        self._goal = None
        self._ended = Reached(
            self._robot, goals.number, LOST if cell is None else cell, there, round(took, 9), now
        )
        return self._ended
