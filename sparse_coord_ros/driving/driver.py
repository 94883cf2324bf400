# Copyright 2026 The sparse_coord_ros authors
# SPDX-License-Identifier: Apache-2.0
"""One body's driver as a state machine: goals and poses in, commands and reports out."""

import math

from sparse_coord_ros.driving.ground import Ground, Pose
from sparse_coord_ros.driving.steering import STOP, Command, Limits, distance, steer
from sparse_coord_ros.lockstep.bodies import LOST, BodyGoal, Goals, Reached

SLACK = 1e-6
"""Seconds: stamps are whole nanoseconds."""

BACK = 1.0
"""Seconds that a pose may be older than the newest one; one that is older is of a new clock."""

REPEATS = 4
"""After so many poses of the same time it is believed, even if newer ones were seen before: the
simulator was started again."""

ASTRAY = 0.25
"""Share of a cell that a body may be off the line to its next place before it goes back to it."""


class Driver:
    """Drives one robot's body from cell to cell.

    A body is in the free cell whose square its pose lies in; off the grid, in the nearest one
    within a cell's side. It is where it was to go when it is near its place there. When time is
    over the body stops, and the cell that it is in counts: it has stayed, or drifted.

    Args:
        ground: the floor.
        limits: what the body may do.
        robot: whose body, from 0.

    Attributes:
        pose: the newest pose; None: none has come.
        ignored: poses that were no places, or older than one before.
    """

    def __init__(self, ground: Ground, limits: Limits, robot: int) -> None:
        self._ground, self._limits, self._robot = ground, limits, robot
        self._goals: Goals | None = None
        self._goal: BodyGoal | None = None
        self._way: list[tuple[float, float]] | None = None
        self._began: float | None = None
        self._seconds: float | None = None
        self._answered: float | None = None
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

    def take(self, goals: Goals) -> None:
        """Take goals; those before them are given up. Then ask what is `next`."""
        if self._goals is not None and goals.number == self._goals.number:
            return
        self._goals = goals
        mine = [goal for goal in goals.bodies if goal.robot == self._robot]
        self._goal = mine[0] if mine else None
        self._way = self._began = self._answered = self._ended = None

    def sees(self, seconds: float, pose: Pose) -> None:
        """Take in a pose and its time, in seconds of any clock; then ask what is `next`."""
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

    def next(self) -> tuple[Command | None, Reached | None]:
        """Return what the body is to do now, and how its goal ended if it has.

        None for both where there is nothing to do, or nothing new was seen since. Where the same
        pose comes again and again, the last answer was lost, and is given again.
        """
        goal, goals, pose, now = self._goal, self._goals, self.pose, self._seconds
        if goal is None:
            return None, self._ended if self._unheard else None
        if goals is None or pose is None or now is None:
            return None, None
        if 0.0 <= goals.since - now + SLACK <= BACK and self._repeats < REPEATS:
            return None, None  # a newer pose is to come
        if goals.place:
            return None, self._placed(goals, goal, pose, now)
        if now == self._answered and not self._unheard:
            return None, None
        self._answered = now
        return self._steered(goals, goal, pose, now)

    def _steered(
        self, goals: Goals, goal: BodyGoal, pose: Pose, now: float
    ) -> tuple[Command, Reached | None]:
        """Steer to the next place of the way; stop where it ends, or when time is over."""
        if self._began is None:
            self._began = now
        if self._way is None:
            self._way = self._find_way(goal, pose)
        way, near = self._way, self._limits.near
        while len(way) > 1 and distance(pose, way[0]) <= near:
            way.pop(0)
        if distance(pose, way[0]) <= near:
            return STOP, self._end(goals, pose, now, there=True)
        if now - self._began >= self._limits.seconds - SLACK:
            return STOP, self._end(goals, pose, now, there=False)
        return steer(pose, way[0], self._limits), None

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
            self._robot,
            goals.number,
            LOST if cell is None else cell,
            there,
            round(took, 9),
            now,
        )
        return self._ended

    def _find_way(self, goal: BodyGoal, pose: Pose) -> list[tuple[float, float]]:
        """Return the places to pass, the goal last: through free cells, wherever the body is."""
        ground, robot = self._ground, self._robot
        target = ground.place(robot, goal.end)
        here = ground.cell(pose.x, pose.y)
        if here is None or here == goal.end:
            return [target]
        grid = ground.grid
        if goal.end in grid.next_cell[here].tolist():
            place = ground.place(robot, here)
            astray = _off_line(pose, place, target) > ASTRAY * ground.side
            return [place, target] if astray else [target]
        ways = grid.distances_to(goal.end)
        if ways[here] < 0:
            return [target]
        cells = [here]
        while cells[-1] != goal.end:
            cells.append(min(grid.next_cell[cells[-1]].tolist(), key=lambda x: int(ways[x])))
        return [ground.place(robot, cell) for cell in cells]


def _off_line(pose: Pose, start: tuple[float, float], end: tuple[float, float]) -> float:
    """Return the metres from a pose to the line through two places."""
    dx, dy = end[0] - start[0], end[1] - start[1]
    length = math.hypot(dx, dy)
    return abs(dx * (pose.y - start[1]) - dy * (pose.x - start[0])) / length
