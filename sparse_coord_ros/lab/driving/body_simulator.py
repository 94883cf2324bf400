# Copyright 2026 The sparse_coord_ros authors
# SPDX-License-Identifier: Apache-2.0
"""A kinematic simulator of bodies: differential drives among walls, with seeded noise.

It leaves out inertia, sensors, and the physics of collisions. Bodies that touch each other are
counted, and drive on through each other; walls stop them.
"""

import itertools
import math
from collections.abc import Mapping
from typing import NamedTuple

import numpy as np

from sparse_coord_ros.core.game.pose import Pose
from sparse_coord_ros.lab.driving.metric_map import MetricMap
from sparse_coord_ros.lab.driving.steering import STOP, Command
from sparse_coord_ros.protocol.lockstep.bodies import BEGIN, Goals

TRACK = 1.6
"""Metres between the wheels, in radii of the body."""

BIAS = 0.25
"""Difference of the wheels' size from the size in the odometry, as a share of the noise."""

PERIOD = 0.1
"""Simulated seconds a tick."""

IN_DOORWAY = "doorway"
ELSEWHERE = "elsewhere"


class Noise(NamedTuple):
    """Noise of bodies' motion and poses; standard deviations.

    Attributes:
        wheels: of a wheel's speed in a tick, as a share of it; a quarter of it is constant for
            each wheel, so the odometry drifts.
        pose: of a localised position, in metres; of its yaw, the same number of radians.
    """

    wheels: float = 0.1
    pose: float = 0.01


NOISE = Noise()


class Collision(NamedTuple):
    """The beginning of a collision of two bodies.

    Attributes:
        seconds: its time.
        robots: the two robots, from 0.
        where: `IN_DOORWAY` if the centre of one body is in a doorway, else `ELSEWHERE`.
        place: (x, y) between them.
    """

    seconds: float
    robots: tuple[int, int]
    where: str
    place: tuple[float, float]


class Body:
    """A differential drive.

    Args:
        metric_map: the floor.
        noise: its noise.
        seed: the run's seed.
        robot: its number, from 0.

    Attributes:
        pose: its true pose.
        odometry: its pose by the commands of its wheels since it was placed.
        command: its last command.
        bumps: number of times that it drove against a wall.
    """

    def __init__(
        self, metric_map: MetricMap, noise: Noise, seed: int, robot: int
    ) -> None:
        self._metric_map = metric_map
        self._noise = noise
        self._wheels, self._sensors = np.random.default_rng([seed, robot]).spawn(2)
        self._bias = 1.0 + BIAS * noise.wheels * self._wheels.standard_normal(2)
        self._track = TRACK * metric_map.radius
        self._against = False
        self.pose = self.odometry = Pose(0.0, 0.0, 0.0)
        self.command = STOP
        self.bumps = 0

    def put(self, x: float, y: float) -> None:
        """Put the body at a place, with its yaw unchanged; its odometry begins there."""
        self.pose = self.odometry = Pose(x, y, self.pose.yaw)
        self.command = STOP

    def tick(self, seconds: float) -> None:
        """Let time pass."""
        ahead, turn = self.command
        if not (ahead or turn):
            return
        self.odometry = _arc(self.odometry, ahead, turn, seconds)
        errors = self._bias * (
            1.0 + self._noise.wheels * self._wheels.standard_normal(2)
        )
        left = (ahead - turn * self._track / 2) * float(errors[0])
        right = (ahead + turn * self._track / 2) * float(errors[1])
        wanted = _arc(
            self.pose, (left + right) / 2, (right - left) / self._track, seconds
        )
        x, y = self._metric_map.slide(self.pose, wanted.x, wanted.y)
        against = (x, y) != wanted[:2]
        self.bumps += against and not self._against
        self._against = against
        self.pose = Pose(x, y, wanted.yaw)

    def seen(self) -> Pose:
        """Return the pose of its localisation; each call draws new noise."""
        dx, dy, turn = (self._noise.pose * self._sensors.standard_normal(3)).tolist()
        return Pose(self.pose.x + dx, self.pose.y + dy, self.pose.yaw + turn)


def _arc(pose: Pose, ahead: float, turn: float, seconds: float) -> Pose:
    """Return the pose of a body after driving an arc."""
    angle = turn * seconds
    yaw = math.remainder(pose.yaw + angle, math.tau)
    middle = pose.yaw + angle / 2
    chord = (
        ahead
        * seconds
        * (math.sin(angle / 2) / (angle / 2) if abs(angle) > 1e-9 else 1.0)
    )
    return Pose(
        pose.x + chord * math.cos(middle), pose.y + chord * math.sin(middle), yaw
    )


class BodySimulator:
    """The bodies of a team.

    In step with the drivers, time passes by a tick with all goals, and then each time that every
    moving body has its next command; otherwise time stops. So the result depends only on the seed,
    not on the nodes' speed. Not in step, time passes with each call of `tick`, as on a real floor.

    Args:
        metric_map: the floor.
        count: number of bodies.
        seed: the run's seed.
        noise: their noise.
        period: seconds a tick.

    Attributes:
        bodies: one a robot.
        ticks: number of ticks so far.
        touches: the collisions of bodies.
    """

    def __init__(
        self,
        metric_map: MetricMap,
        count: int,
        seed: int,
        noise: Noise = NOISE,
        period: float = PERIOD,
    ) -> None:
        self.metric_map = metric_map
        self.period = period
        self.bodies = [Body(metric_map, noise, seed, k) for k in range(count)]
        self.ticks = self._number = 0
        self.touches: list[Collision] = []
        self._under_way: set[int] = set()
        self._told: dict[int, Command] = {}
        self._touching: set[tuple[int, int]] = set()

    @property
    def seconds(self) -> float:
        """The simulated time."""
        return BEGIN + self.ticks * self.period

    @property
    def bumps(self) -> int:
        """The number of times that bodies drove against walls."""
        return sum(body.bumps for body in self.bodies)

    def put(self, cells: Mapping[int, int]) -> None:
        """Put bodies into cells."""
        for robot, cell in cells.items():
            self.bodies[robot].put(*self.metric_map.place(robot, cell))
        self._touching = set(self._touching_now())

    def send(self, goals: Goals) -> bool:
        """Set the bodies' goals; return whether they are new, and time has passed."""
        if goals.number == self._number:
            return False
        self._number = goals.number
        # After a restart of the simulator, drivers wait for poses newer than those that they have.
        self.ticks = max(self.ticks, round((goals.since - BEGIN) / self.period))
        self._told.clear()
        self._under_way = set()
        for body in self.bodies:
            body.command = STOP
        if goals.placing:
            self.put({goal.robot: goal.end for goal in goals.bodies})
        else:
            self._under_way = {goal.robot for goal in goals.bodies}
        self.tick()
        return True

    @property
    def waits_for(self) -> set[int]:
        """The robots whose commands or reports are awaited; all while no body drives."""
        return self._under_way - self._told.keys() or set(range(len(self.bodies)))

    def reached(self, robot: int, number: int) -> bool:
        """Note the end of a body's goal; return whether time has passed."""
        if number != self._number or robot not in self._under_way:
            return False
        self._under_way.discard(robot)
        self._told.pop(robot, None)
        self.bodies[robot].command = STOP
        return self._tick_when_told()

    def told(self, robot: int, command: Command) -> bool:
        """Set a body's command, in step; return whether time has passed.

        A stop is ignored: no body moves while no time passes.
        """
        if not any(command):
            return False
        self._told[robot] = command
        return self._tick_when_told()

    def _tick_when_told(self) -> bool:
        if not self._under_way or not self._under_way <= self._told.keys():
            return False
        for robot, body in enumerate(self.bodies):
            body.command = self._told[robot] if robot in self._under_way else STOP
        self._told.clear()
        self.tick()
        return True

    def tick(self) -> None:
        """Let one tick of time pass."""
        self.ticks += 1
        for body in self.bodies:
            body.tick(self.period)
        now = set(self._touching_now())
        for pair in sorted(now - self._touching):
            (x, y), (x2, y2) = (self.bodies[k].pose[:2] for k in pair)
            inside = self.metric_map.in_doorway(x, y) or self.metric_map.in_doorway(
                x2, y2
            )
            where = IN_DOORWAY if inside else ELSEWHERE
            self.touches.append(
                Collision(self.seconds, pair, where, ((x + x2) / 2, (y + y2) / 2))
            )
        self._touching = now

    def _touching_now(self) -> list[tuple[int, int]]:
        reach = 2 * self.metric_map.radius
        places = enumerate(body.pose[:2] for body in self.bodies)
        pairs = itertools.combinations(places, 2)
        return [
            (j, k) for (j, here), (k, there) in pairs if math.dist(here, there) < reach
        ]
