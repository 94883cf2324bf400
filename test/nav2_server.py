# Copyright 2026 The sparse_coord_ros authors
# SPDX-License-Identifier: Apache-2.0
"""A stand-in for Nav2 and the robots that it drives: as good, or as bad, as it is told to be.

Its robots are points that go straight to their goal at a constant speed. As in Nav2 a new goal
pre-empts the one before it. Alone: `python nav2_server.py robot_1 robot_2`; its robots then also
say where they are as Nav2's do, each on a /tf of its own.
"""

import math
import sys
import time

import rclpy
from geometry_msgs.msg import PoseStamped, TransformStamped
from nav2_msgs.action import NavigateToPose
from rclpy.action import ActionServer, CancelResponse, GoalResponse
from rclpy.node import Node
from rclpy.task import Future
from tf2_msgs.msg import TFMessage

TICK = 0.02
SPEED = 20.0
ABORT_CODE = 105

REACH, ABORT, REJECT, LATE, DEAF = "reach", "abort", "reject", "late", "deaf"
SILENT, DETOUR, LIE, TAKE_AWAY, STUCK = "silent", "detour", "lie", "take away", "stuck"
"""What becomes of a goal: it is reached; aborted at once; rejected; accepted much too late; never
answered; accepted, and nothing is said of it; a way of 50 m is driven; it is said to be reached,
and is not; somebody else cancels it; feedback comes, and nothing moves."""


class Robot:
    """One robot, and its navigator.

    Attributes:
        place: (x, y); speed: metres a second.
        fates: what becomes of its next goals; after them all are reached.
        goals: how many came; active: the one that is driven; ended: how each ended.
    """

    def __init__(self, node, name, place, late):
        self.name, self.place, self.late, self.speed = name, place, late, SPEED
        self.fates: list[str] = []
        self.goals = 0
        self.active = self.fate = self.target = self._over = None
        self.ended: list[str] = []
        self.asleep: list[tuple[float, Future]] = []
        self._answers: list[str] = []
        self.lost = False
        self.transforms = None
        self._poses = node.create_publisher(PoseStamped, f"{name}/pose", 10)
        self.server = ActionServer(
            node,
            NavigateToPose,
            f"{name}/navigate_to_pose",
            execute_callback=self._execute,
            goal_callback=self._answer,
            cancel_callback=lambda handle: CancelResponse.ACCEPT,
        )

    async def _answer(self, goal):
        self.goals += 1
        fate = self.fates.pop(0) if self.fates else REACH
        if fate in (LATE, DEAF):
            waiting = Future()
            self.asleep.append((time.monotonic() + (self.late if fate == LATE else 3600), waiting))
            await waiting
        self._answers.append(fate)
        return GoalResponse.REJECT if fate == REJECT else GoalResponse.ACCEPT

    async def _execute(self, handle):
        fate = self._answers[-1]
        if self._over is not None:
            self._over.set_result("abort")  # pre-empted
        self._over = over = Future()
        where = handle.request.pose.pose.position
        self.active, self.fate, self.target = handle, fate, (where.x, where.y)
        if fate in (ABORT, LIE, TAKE_AWAY):
            over.set_result("succeed" if fate == LIE else "abort")
        how = await over
        result = NavigateToPose.Result()
        if fate == ABORT:
            result.error_code, result.error_msg = ABORT_CODE, "no progress"
        getattr(handle, how)()
        self.ended.append(how)
        if self.active is handle:
            self.active = self._over = None
        return result

    def tick(self, now):
        """Let a tick pass."""
        for due, waiting in list(self.asleep):
            if now >= due:
                self.asleep.remove((due, waiting))
                waiting.set_result(None)
        handle, over = self.active, self._over
        if handle is not None and not over.done():
            (x, y), (goal_x, goal_y) = self.place, self.target
            left = math.dist(self.place, self.target)
            if handle.is_cancel_requested:
                over.set_result("canceled")
            elif self.fate != SILENT:
                said = 50.0 if self.fate == DETOUR else left
                feedback = NavigateToPose.Feedback(distance_remaining=said)
                handle.publish_feedback(feedback)
                step = 0.0 if self.fate in (DETOUR, STUCK) else min(left, self.speed * TICK)
                if left > 1e-6:
                    self.place = (x + (goal_x - x) * step / left, y + (goal_y - y) * step / left)
                elif self.fate == REACH or self.fate == LATE:
                    over.set_result("succeed")
        if not self.lost:
            pose = PoseStamped()
            pose.header.frame_id = "map"
            sec, part = divmod(time.time(), 1.0)
            pose.header.stamp.sec, pose.header.stamp.nanosec = int(sec), int(part * 1e9)
            pose.pose.position.x, pose.pose.position.y = self.place
            pose.pose.orientation.w = 1.0
            self._poses.publish(pose)
            if self.transforms is not None:
                link = TransformStamped(header=pose.header, child_frame_id="base_link")
                link.transform.translation.x, link.transform.translation.y = self.place
                link.transform.rotation.w = 1.0
                self.transforms.publish(TFMessage(transforms=[link]))


class FakeNav2(Node):
    """Robots by name; `look` is called at each tick."""

    look = staticmethod(lambda: None)

    def __init__(self, names, place=(0.5, 0.5), *, late=3.0, **more):
        super().__init__("fake_nav2", **more)
        self.robots = {name: Robot(self, name, place, late) for name in names}
        self.create_timer(TICK, self._tick)

    def _tick(self):
        now = time.monotonic()
        for robot in self.robots.values():
            robot.tick(now)
        self.look()

    @property
    def driving(self):
        """The robots that have a goal."""
        return [name for name, robot in self.robots.items() if robot.active is not None]


def main():
    """Run until it is killed."""
    rclpy.init()
    node = FakeNav2(sys.argv[1:])
    for robot in node.robots.values():
        robot.transforms = node.create_publisher(TFMessage, f"{robot.name}/tf", 10)
    print("serving", flush=True)
    rclpy.spin(node)


if __name__ == "__main__":
    main()
