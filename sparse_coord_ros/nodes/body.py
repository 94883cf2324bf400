# Copyright 2026 The sparse_coord_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The body node: a kinematic simulator of all the robots' bodies of a run."""

import functools
import math
import time
from collections import Counter
from typing import Any, Unpack

import numpy as np
from builtin_interfaces.msg import Time
from diagnostic_msgs.msg import DiagnosticArray
from geometry_msgs.msg import PoseStamped, Twist
from nav_msgs.msg import Odometry
from rclpy.publisher import Publisher
from std_msgs.msg import Header

from sparse_coord_ros.driving.arena import ELSEWHERE, IN_DOORWAY, Arena, Noise
from sparse_coord_ros.driving.ground import Ground, Pose
from sparse_coord_ros.driving.steering import Command
from sparse_coord_ros.learn.run_config import RunConfig
from sparse_coord_ros.lockstep.bodies import BEGIN, Goals, Reached
from sparse_coord_ros.nodes import interface
from sparse_coord_ros.nodes.follower import Follower
from sparse_coord_ros.nodes.messages import Converter, read_goals, read_reached, status
from sparse_coord_ros.nodes.parameters import PARAMETERS, Place
from sparse_coord_ros.nodes.spin import run_node
from sparse_coord_ros.wire import MAP_FRAME
from sparse_coord_ros.wire.frame import SECOND
from sparse_coord_ros.wire.messages import CLOCK_FORM

AGAIN_SECONDS = 0.5
"""After this silence poses are published again: a driver that has just come has none."""

FASTEST = 1000.0
"""Metres or radians a second that no body makes: who tells it more is not listened to."""

MOST_MOMENTS = 1_000_000
"""Ticks of which the paths are kept."""


class BodyNode(Follower):
    """Hears what bodies are to do (Twist), and says where they are (PoseStamped, Odometry).

    Args:
        place: where the node is made, and with what: see `Place`.

    Attributes:
        arena: the bodies; None: no run has begun.

    Raises:
        SparseCoordError: a bad parameter, a body that does not fit its cells.
    """

    def __init__(self, **place: Unpack[Place]) -> None:
        super().__init__("body", PARAMETERS["body"], **place)
        self.arena: Arena | None = None
        self._said = time.monotonic()
        self._paths: list[list[float]] = []
        self._time_publisher: Publisher | None = None
        if self.values["clock"]:
            self._time_publisher = self.announce(interface.CLOCK)

    def begin(self, run: RunConfig) -> None:
        """Put the bodies at the scenario's starts."""
        names = [robot.name for robot in run.scenario.robots]
        self._names = names
        ground = Ground(run, self.values["radius"])
        noise = Noise(self.values["wheel_noise"], self.values["pose_noise"])
        arena = Arena(ground, len(names), run.seed, noise, self.values["period"])
        arena.put({k: robot.start for k, robot in enumerate(run.scenario.robots)})
        self.arena = arena
        self._diagnostics = self.announce(interface.DIAGNOSTICS)
        self._pose_publishers = [self.announce(interface.POSE, name) for name in names]
        self._odometry_publishers = [self.announce(interface.ODOMETRY, name) for name in names]
        convert = Converter(run)
        read = functools.partial(read_goals, convert, names)
        self.intake.listen(
            interface.BODY_GOALS, functools.partial(self._on_goals, arena), read=read
        )
        for k, name in enumerate(names):
            take = functools.partial(self._on_command, arena, k)
            self.intake.listen(interface.CMD_VEL, take, name, read=read_command)
            report = functools.partial(read_reached, convert, k)
            reached = functools.partial(self._on_reached, arena)
            self.intake.listen(interface.REACHED, reached, name, read=report)
        if self.values["body_rate"] > 0:
            seconds = self.values["period"] / self.values["body_rate"]
            self.create_timer(seconds, functools.partial(self._on_time, arena))
        self._say(arena, look=True)

    def _on_goals(self, arena: Arena, goals: Goals) -> None:
        if self.values["body_rate"] == 0:
            if arena.send(goals):
                self._say(arena, look=True)
        elif goals.place:
            arena.put({goal.robot: goal.end for goal in goals.bodies})

    def _on_command(self, arena: Arena, robot: int, command: Command) -> None:
        if self.values["body_rate"] > 0:
            arena.bodies[robot].command = command
        elif arena.told(robot, command):
            self._say(arena, look=True)

    def _on_reached(self, arena: Arena, reached: Reached) -> None:
        if self.values["body_rate"] == 0 and arena.reached(reached.robot, reached.number):
            self._say(arena, look=True)

    def _on_time(self, arena: Arena) -> None:
        arena.tick()
        self._say(arena, look=True)

    def _say(self, arena: Arena, *, look: bool) -> None:
        """Publish where the bodies are; `look`: they are looked at anew, else as last time."""
        self._said = time.monotonic()
        if look:
            self._looks = [body.seen() for body in arena.bodies]
            if self.values["paths"] and len(self._paths) < MOST_MOMENTS:
                places = [number for body in arena.bodies for number in body.pose]
                self._paths.append([arena.seconds, *places])
        sec, nanosec = divmod(round(arena.seconds * SECOND), SECOND)
        stamp = Time(sec=sec, nanosec=nanosec)
        if self._time_publisher is not None:
            self._time_publisher.publish(CLOCK_FORM.layout.pack(sec, nanosec))
        for k, body in enumerate(arena.bodies):
            if not look and k not in arena.waits_for:
                continue  # its driver would take it for unheard, and say too much
            name = self._names[k]
            seen = PoseStamped(header=Header(stamp=stamp, frame_id=MAP_FRAME))
            _write(seen.pose, self._looks[k])
            header = Header(stamp=stamp, frame_id=f"{name}/odom")
            odometry = Odometry(header=header, child_frame_id=f"{name}/base_link")
            _write(odometry.pose.pose, body.odometry)
            odometry.twist.twist.linear.x, odometry.twist.twist.angular.z = body.command
            self._odometry_publishers[k].publish(odometry)
            self._pose_publishers[k].publish(seen)

    def go_on(self, now: float) -> None:
        """Say again where the bodies are, where nobody drives."""
        stands = now - self._said >= AGAIN_SECONDS
        if self.arena is not None and stands and self.values["body_rate"] == 0:
            self._say(self.arena, look=False)

    def report(self) -> None:
        """Publish how often bodies touched each other and the walls."""
        message = DiagnosticArray()
        message.status = [status(f"{self.full_name}: bodies", "driving", self.summary())]
        self._diagnostics.publish(message)

    def summary(self) -> dict[str, Any]:
        """Return what happened, as plain data."""
        arena = self.arena
        if arena is None:
            return {}
        where = Counter(touch.where for touch in arena.touches)
        return {
            "seconds": round(arena.seconds - BEGIN, 3),
            "touches_in_doorways": where[IN_DOORWAY],
            "touches_elsewhere": where[ELSEWHERE],
            "bumps": sum(body.bumps for body in arena.bodies),
        }

    def finish(self, *, interrupted: bool) -> None:
        """Say what happened, and write the paths."""
        if self.arena is None:
            return
        said = ", ".join(f"{name} {value}" for name, value in self.summary().items())
        self.get_logger().info(f"bodies: {said}")
        if self.values["paths"]:
            rows = np.array(self._paths)
            places = rows[:, 1:].reshape(len(rows), len(self._names), 3)
            np.savez_compressed(self.values["paths"], seconds=rows[:, 0], poses=places)


def read_command(message: Twist) -> Command:
    """Return what a body is told to do.

    Raises:
        ValueError: a speed is no number, or beyond what any body does.
    """
    command = Command(message.linear.x, message.angular.z)
    if not all(abs(speed) <= FASTEST for speed in command):
        raise ValueError(
            f"linear.x is {command.ahead:g}, angular.z {command.turn:g}; allowed: numbers up to "
            f"{FASTEST:g}"
        )
    return command


def _write(pose: Any, where: Pose) -> None:
    pose.position.x, pose.position.y = where.x, where.y
    pose.orientation.z, pose.orientation.w = math.sin(where.yaw / 2), math.cos(where.yaw / 2)


def main(args: list[str] | None = None) -> int:
    """Run the node `body`."""
    return run_node(lambda context: BodyNode(context=context), args)
