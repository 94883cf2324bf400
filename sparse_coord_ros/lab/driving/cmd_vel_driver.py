# Copyright 2026 The sparse_coord_ros authors
# SPDX-License-Identifier: Apache-2.0
"""A driver that steers a body by commands of velocity: of a simulated unicycle, or of cmd_vel."""

import math
from collections.abc import Callable

from sparse_coord_ros.core.game.pose import Pose
from sparse_coord_ros.lab.driving.driver import REPEATS, SLACK, Driver, GoalState
from sparse_coord_ros.lab.driving.metric_map import MetricMap
from sparse_coord_ros.lab.driving.steering import STOP, Command, Limits, distance, steer
from sparse_coord_ros.protocol.lockstep.bodies import GoalReport, Goals

ASTRAY = 0.25
"""Largest distance of a body from the line to its next place, as a share of a cell; beyond it the
body goes back to the line."""


class CmdVelDriver(Driver):
    """Steers one robot's body from cell to cell.

    The body has arrived when it is near its place in the goal's cell. At the time limit it stops,
    and its current cell counts. Each new pose gets one command. If the same pose comes repeatedly,
    the last command was lost, and is sent again.

    Args:
        metric_map: the floor.
        limits: the body's limits.
        robot: the robot, from 0.
        send: sends the body a command.
    """

    stands = True  # the command to stop was sent

    def __init__(
        self,
        metric_map: MetricMap,
        limits: Limits,
        robot: int,
        send: Callable[[Command], None],
    ) -> None:
        super().__init__(metric_map, robot)
        self._limits = limits
        self._send = send
        self._way: list[tuple[float, float]] = []
        self._answered = math.nan
        self._unheard = False

    def take(self, goals: Goals) -> bool:
        """Set the goals, and return whether they are new; the way to them is planned anew."""
        new = super().take(goals)
        if new:
            self._way = []
            self._answered = math.nan
        return new

    def begin_again(self) -> None:
        """Begin the current goal anew, after the body was stopped."""
        super().begin_again()
        self._answered = math.nan

    def sees(self, seconds: float, pose: Pose) -> None:
        """Note a pose; of the same time again and again: the simulator missed the last command."""
        super().sees(seconds, pose)
        self._unheard = self._repeats > 0 and self._repeats % REPEATS == 0

    def stop(self, now: float) -> None:
        """Send the command to stop."""
        self._send(STOP)

    def next(self, now: float) -> GoalReport | None:
        """Send the command that is due; return the end of the goal if it has ended."""
        if self.held:
            return None
        unheard = self._unheard
        self._unheard = False
        if self._goal is None:
            return self._ended if unheard else None
        state = self._goal_state()
        if state is None or not self._newer(state):
            return None  # wait for a newer pose
        if state.goals.placing:
            return self._placed(state)
        if state.stamp == self._answered and not unheard:
            return None
        self._answered = state.stamp
        return self._steer(state)

    def _steer(self, state: GoalState) -> GoalReport | None:
        """Steer to the next place of the way; stop at its end, or at the time limit."""
        if self._began is None:
            self._began = state.stamp
        self._way = way = self._way or self._find_way(state)
        pose = state.pose
        near = self._limits.near
        while len(way) > 1 and distance(pose, way[0]) <= near:
            way.pop(0)
        there = distance(pose, way[0]) <= near
        if there or state.stamp - self._began >= self._limits.seconds - SLACK:
            self._send(STOP)
            return self._end(state, there=there)
        self._send(steer(pose, way[0], self._limits))
        return None

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
