# Copyright 2026 The sparse_coord_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The stand-in for Nav2 with the failures of Nav2, for the tests of its driver."""

import time

from action_msgs.msg import GoalStatus
from rclpy.action import GoalResponse
from rclpy.task import Future

from sparse_coord_ros.ros.driving.nav2_stand_in import Base, Nav2StandIn

LATE_SECONDS = 3.0
"""Delay after which a goal is accepted too late: a nav2_driver has given it up by then."""

NEVER_SECONDS = 3600.0
"""Delay after which a server that does not answer accepts a goal."""

DETOUR_METRES = 50.0

NONE = "none"
AT_ONCE = {
    "abort": GoalStatus.STATUS_ABORTED,
    "take_away": GoalStatus.STATUS_ABORTED,
    "lie": GoalStatus.STATUS_SUCCEEDED,
}


class FaultyBase(Base):
    """A base whose next goals may fail.

    The faults: the goal is aborted at once (abort); rejected (reject); accepted much too late
    (late); never answered (deaf); accepted without feedback (silent); its feedback says that 50 m
    are left (detour); it succeeds although the base is not there (lie); it ends as if another
    client had cancelled it (take_away); the base does not move (stuck).

    Attributes:
        faults: the faults of its next goals; later ones have none.
        goals: number of goals received.
        fault: the fault of the goal in progress.
        ended: the statuses with which its goals ended, in order.
        lost: whether its pose is not published.
    """

    def __init__(self, *place):
        self.faults = []
        self.goals = 0
        self.fault = NONE
        self.ended = []
        self.lost = False
        self._accepted = []
        self._waiting = []
        super().__init__(*place)

    async def answer(self, goal):
        """Accept or reject a goal; maybe much later."""
        self.goals += 1
        fault = self.faults.pop(0) if self.faults else NONE
        if fault in ("late", "deaf"):
            seconds = LATE_SECONDS if fault == "late" else NEVER_SECONDS
            answer = Future()
            self._waiting.append((time.monotonic() + seconds, answer))
            await answer
        if fault == "reject":
            return GoalResponse.REJECT
        self._accepted.append(fault)
        return GoalResponse.ACCEPT

    async def execute(self, handle):
        """Drive to a goal; return its result."""
        self.fault = self._accepted.pop(0)
        result = await super().execute(handle)
        self.ended.append(handle.status)
        return result

    def tick(self):
        """Let a tick pass."""
        now = time.monotonic()
        for waiting in list(self._waiting):
            due, answer = waiting
            if now >= due:
                self._waiting.remove(waiting)
                answer.set_result(None)
        super().tick()

    def drive(self):
        """Drive on, unless the goal has a fault."""
        if self.fault in AT_ONCE:
            self.end(AT_ONCE[self.fault])
        elif self.fault == "detour":
            self.say_left(DETOUR_METRES)
        elif self.fault == "stuck":
            self.say_left(self.left)
        elif self.fault != "silent":
            super().drive()

    def say_where(self):
        """Publish the base's pose, unless it is lost."""
        if not self.lost:
            super().say_where()


class FaultyNav2(Nav2StandIn):
    """Such bases by name."""

    base = FaultyBase

    @property
    def driving(self):
        """The bases that have a goal."""
        return [name for name, base in self.bases.items() if base.active is not None]
