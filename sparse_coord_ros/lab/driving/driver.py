# Copyright 2026 The sparse_coord_ros authors
# SPDX-License-Identifier: Apache-2.0
"""One body's driver as a state machine: goals and poses in, commands and reports out."""

import math

from sparse_coord_ros.core.game.pose import Pose
from sparse_coord_ros.lab.driving.metric_map import MetricMap
from sparse_coord_ros.lab.driving.mover import SLACK, GoalState, Mover
from sparse_coord_ros.lab.driving.steering import STOP, Command, Limits, distance, steer
from sparse_coord_ros.protocol.lockstep.bodies import GoalReport, Goals

ASTRAY = 0.25
"""Largest distance of a body from the line to its next place, as a share of a cell; beyond it the
body goes back to the line."""


class Driver(Mover):
    """Steers one robot's body from cell to cell.

    The body has arrived when it is near its place in the goal's cell. At the time limit it stops,
    and its current cell counts. Call `next` after goals and poses.

    Args:
        metric_map: the floor.
        limits: the body's limits.
        robot: the robot, from 0.
    """

    def __init__(self, metric_map: MetricMap, limits: Limits, robot: int) -> None:
        super().__init__(metric_map, robot)
        self._limits = limits
        self._way: list[tuple[float, float]] = []
        self._answered = math.nan

    def take(self, goals: Goals) -> bool:
        """As of `Mover`."""
        new = super().take(goals)
        if new:
            self._way = []
            self._answered = math.nan
        return new

    def begin_again(self) -> None:
        """As of `Mover`."""
        super().begin_again()
        self._answered = math.nan

    def next(self) -> tuple[Command | None, GoalReport | None]:
        """Return the command for the body now, and the end of its goal if it has ended.

        None for both if no work is due, or no new pose has come. If the same pose comes
        repeatedly, the last command was lost, and is returned again.
        """
        state = self._goal_state()
        if self._goal is None:
            return None, self._ended if self._unheard else None
        if state is None or not self._newer(state):
            return None, None  # wait for a newer pose
        if state.goals.place:
            return None, self._placed(state)
        if state.stamp == self._answered and not self._unheard:
            return None, None
        self._answered = state.stamp
        return self._steered(state)

    def _steered(self, state: GoalState) -> tuple[Command, GoalReport | None]:
        """Steer to the next place of the way; stop at its end, or at the time limit."""
        if self._began is None:
            self._began = state.stamp
        self._way = way = self._way or self._find_way(state)
        pose = state.pose
        near = self._limits.near
        while len(way) > 1 and distance(pose, way[0]) <= near:
            way.pop(0)
        if distance(pose, way[0]) <= near:
            return STOP, self._end(state, there=True)
        if state.stamp - self._began >= self._limits.seconds - SLACK:
            return STOP, self._end(state, there=False)
        return steer(pose, way[0], self._limits), None

    def _find_way(self, state: GoalState) -> list[tuple[float, float]]:
        """Return the places to pass, the goal last: through free cells, from any place."""
        metric_map = self._metric_map
        robot = self._robot
        (_, goal, pose, _, target) = state
        here = metric_map.cell(pose.x, pose.y)
        if here is None or here == goal.end:
            return [target]
        grid = metric_map.grid
        if goal.end in grid.next_cell[here].tolist():
            place = metric_map.place(robot, here)
            astray = _off_line(pose, place, target) > ASTRAY * metric_map.side
            return [place, target] if astray else [target]
        ways = grid.distances_to(goal.end)
        if ways[here] < 0:
            return [target]
        cells = [here]
        while cells[-1] != goal.end:
            cells.append(
                min(grid.next_cell[cells[-1]].tolist(), key=lambda x: int(ways[x]))
            )
        return [metric_map.place(robot, cell) for cell in cells]


def _off_line(
    pose: Pose, start: tuple[float, float], end: tuple[float, float]
) -> float:
    """Return the metres from a pose to the line through two places."""
    dx = end[0] - start[0]
    dy = end[1] - start[1]
    return abs(dx * (pose.y - start[1]) - dy * (pose.x - start[0])) / math.hypot(dx, dy)
