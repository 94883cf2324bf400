# Copyright 2026 The sparse_coord_ros authors
# SPDX-License-Identifier: Apache-2.0
"""What every driver of a body does: "go to this cell; tell when you are there, or why not".

A `Driver` gets goals and poses, and returns the end of each goal. It has three users: `DrivenTeam`
(`trials.py`) drives simulated unicycles, the node `driver` drives a base by cmd_vel, both by a
`CmdVelDriver`; the node `nav2_driver` drives by goals of NavigateToPose, by a `Nav2Driver`.
"""

import math
from typing import NamedTuple

from sparse_coord_ros.core.game.pose import Pose
from sparse_coord_ros.lab.driving.metric_map import MetricMap
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
"""Seconds that a pose may be older than the newest one; an older one has a new clock."""

BACKLOG = 20
"""After so many poses no pose can be from before a goal: no queue of poses is longer. If all of
them are older than the goal by more than `BACK`, they have another clock than the goal."""

REPEATS = 4
"""After so many poses of the same time, the time is valid even if newer ones came before: the
simulator was started again."""


class GoalState(NamedTuple):
    """The state of a goal.

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


class Driver:
    """Takes one robot's body from cell to cell, in a way that subclasses define.

    Call `take` with each goal, `sees` with each pose, then `next`, at any time and as often as you
    like: it does the work that is due, and returns the end of the goal when it has ended.

    A body is in the free cell whose square contains its pose; off the grid, in the nearest one
    within a cell's side. Only its final cell counts, for any cause: it has arrived, stayed or
    drifted.

    Args:
        metric_map: the floor.
        robot: the robot, from 0.

    Attributes:
        held: whether the body has to stand, whatever its goal is.
        pose: the newest pose; None: no pose has come.
        heard: the time of the last pose, also of a rejected one; NaN: no pose has come.
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
        self.held = False
        self.pose: Pose | None = None

    @property
    def busy(self) -> bool:
        """True if the body is under way to a goal."""
        return self._goal is not None

    @property
    def stands(self) -> bool:
        """True if the body has been stopped, as far as is known."""
        raise NotImplementedError

    def next(self, now: float) -> GoalReport | None:
        """Do the work that is due; return the end of the goal if it has ended.

        Args:
            now: the time, in seconds of a clock that does not go back.
        """
        raise NotImplementedError

    def stop(self, now: float) -> None:
        """Stop the body."""
        raise NotImplementedError

    def lose_sight(self, now: float) -> None:
        """Stop the body, as its poses do not come any more."""
        self.stop(now)

    def take(self, goals: Goals) -> bool:
        """Set the goals, and return whether they are new; they replace earlier ones."""
        if goals.number == self._goals.number:
            return False
        self._goals = goals
        mine = [goal for goal in goals.bodies if goal.robot == self._robot]
        self._goal = mine[0] if mine else None
        self._began = self._ended = None
        self._since_goals = 0
        return True

    def begin_again(self) -> None:
        """Begin the current goal anew, after the body was stopped."""
        self._began = None

    def sees(self, seconds: float, pose: Pose) -> None:
        """Note a pose and its time, in seconds of any clock; it may be too old, or invalid."""
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
        """Return whether the pose is newer than the goals' `since`.

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
        """Return the report that the body is at its goal; None while it is not."""
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
