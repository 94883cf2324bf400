# Copyright 2026 The sparse_coord_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Base of all drivers of a body: goals and poses in, ends of goals out."""

import math
from typing import NamedTuple

from sparse_coord_ros.lab.driving.metric_map import MetricMap, Pose
from sparse_coord_ros.lab.driving.steering import distance
from sparse_coord_ros.protocol.lockstep.bodies import (
    NO_CELL,
    NO_GOALS,
    BodyGoal,
    GoalReport,
    Goals,
)

SLACK = 1e-6
"""Seconds: stamps are whole nanoseconds."""

BACK = 1.0
"""Seconds that a pose may be older than the newest one; one that is older is of a new clock."""

BACKLOG = 20
"""So many poses after a goal none can be from before it: no queue of poses holds more. Where they
all are older than the goal by more than `BACK`, their clock is another one than the goal's."""

REPEATS = 4
"""After so many poses of the same time it is believed, even if newer ones were seen before: the
simulator was started again."""


class GoalState(NamedTuple):
    """The state of a goal, to judge it by.

    Attributes:
        goals, goal: the goals of all bodies, and this body's.
        pose, stamp: the body's pose, and its time stamp.
        target: its place in the goal's cell, (x, y) in metres.
    """

    goals: Goals
    goal: BodyGoal
    pose: Pose
    stamp: float
    target: tuple[float, float]


class Mover:
    """Moves one robot's body from cell to cell, in a way that subclasses define.

    A body is in the free cell whose square its pose lies in; off the grid, in the nearest one
    within a cell's side. Where it ends counts, whatever moved it: it has arrived, stayed or
    drifted.

    Args:
        metric_map: the floor.
        robot: the robot, from 0.

    Attributes:
        pose: the newest pose; None: none has come.
        heard: the time of the last pose that came, whatever it was; NaN: none has come.
    """

    def __init__(self, metric_map: MetricMap, robot: int) -> None:
        self._metric_map = metric_map
        self._robot = robot
        self._goals = NO_GOALS
        self._goal: BodyGoal | None = None
        self._began: float | None = None
        self._ended: GoalReport | None = None
        self._stamp = self.heard = math.nan
        self._repeats = 0
        self._since_goals = 0
        self._other_clock = False
        self.pose: Pose | None = None

    @property
    def busy(self) -> bool:
        """True if the body is under way to a goal."""
        return self._goal is not None

    @property
    def _unheard(self) -> bool:
        """True if the simulator of the body stands still, as if it had missed the last command."""
        return self._repeats > 0 and self._repeats % REPEATS == 0

    def take(self, goals: Goals) -> bool:
        """Take goals, and return whether they are new; those before them are given up."""
        if goals.number == self._goals.number:
            return False
        self._goals = goals
        mine = [goal for goal in goals.bodies if goal.robot == self._robot]
        self._goal = mine[0] if mine else None
        self._began = self._ended = None
        self._since_goals = 0
        return True

    def begin_again(self) -> None:
        """Begin anew with the goal that there is: the body has been made to stand meanwhile."""
        self._began = None

    def sees(self, seconds: float, pose: Pose) -> None:
        """Take in a pose and its time, in seconds of any clock; it may be too old, or no place."""
        self._repeats = self._repeats + 1 if seconds == self.heard else 0
        self.heard = seconds
        late = 0.0 < self._stamp - seconds <= BACK and self._repeats < REPEATS
        if late or not all(map(math.isfinite, (seconds, *pose))):
            return
        if seconds < self._stamp:
            self._began = None
            self._other_clock = True
        self._since_goals += 1
        self._stamp = seconds
        self.pose = pose

    def _goal_state(self) -> GoalState | None:
        """Return the state of the goal; None: no goal, or no pose."""
        if self._goal is None or self.pose is None:
            return None
        target = self._metric_map.place(self._robot, self._goal.end)
        return GoalState(self._goals, self._goal, self.pose, self._stamp, target)

    def _newer(self, state: GoalState) -> bool:
        """Return whether the pose is newer than those that the goals knew of.

        A goal may overtake poses that were published before it. So a pose that is much older than
        the goal does not show by itself that the clock of the poses began anew.
        """
        if self._repeats >= REPEATS:
            return True
        older = state.goals.since - state.stamp
        if older < -SLACK:
            self._other_clock = False
            return True
        if self._since_goals >= BACKLOG:
            self._other_clock = True
        return self._other_clock and older > BACK

    def _placed(self, state: GoalState) -> GoalReport | None:
        """Say that the body is where it was to be put; None while it is not."""
        close = distance(state.pose, state.target) <= self._metric_map.side / 2
        there = close or self._metric_map.inside(
            state.goal.end, state.pose.x, state.pose.y
        )
        return self._end(state, there=True) if there else None

    def _end(self, state: GoalState, *, there: bool) -> GoalReport:
        cell = self._metric_map.cell(state.pose.x, state.pose.y)
        took = 0.0 if self._began is None else round(state.stamp - self._began, 9)
        where = NO_CELL if cell is None else cell
        self._goal = None
        self._ended = GoalReport(
            self._robot, state.goals.number, where, there, took, state.stamp
        )
        return self._ended
