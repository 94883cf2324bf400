# Copyright 2026 The sparse_coord_ros authors
# SPDX-License-Identifier: Apache-2.0
"""A driver whose moves are goals of a navigation server (Nav2); poses check the server's reports.

Poses decide, not the server's results. After a result, the cell of the next pose counts, whether
the server reports success or not. The driver follows each sent goal until the server reports
its end; it cancels a goal that is no longer needed first.
"""

import math
from collections import Counter
from dataclasses import dataclass
from typing import Protocol

from sparse_coord_ros.core.game.pose import Pose
from sparse_coord_ros.lab.driving.driver import Driver, GoalState
from sparse_coord_ros.lab.driving.metric_map import MetricMap
from sparse_coord_ros.lab.driving.steering import distance
from sparse_coord_ros.protocol.lockstep.bodies import GoalReport

SETTLE_SECONDS = 1.0
"""Longest wait for a newer pose: some localisations are silent while a body does not move."""

BACKOFF_SECONDS = 0.25
LONGEST_BACKOFF = 4.0
"""Longest time until a goal is sent again; the time doubles with each repeat."""

SILENCE_SECONDS = 1.0
"""Longest silence of the server on a goal that it has accepted."""

DETOUR = 3.0
"""Remaining cells of a move beyond which it is given up: the server makes a detour."""

ANSWER_SECONDS = 2.0
"""Longest wait for the server's answer to a goal, and to its cancelling."""


class NavPort(Protocol):
    """Requests to the server. A ticket is this client's number of a goal."""

    def send(self, ticket: int, target: Pose) -> bool:
        """Send a goal; False: no server."""

    def cancel(self, ticket: int) -> None:
        """Ask the server to end a goal that it has accepted."""

    def cancel_all(self) -> object:
        """Ask the server to end all its goals."""

    def say(self, text: str) -> None:
        """Log a problem."""


@dataclass
class _Sent:
    """A goal that the server has, or may have.

    Attributes:
        ticket: its number.
        goals: the number of its goals.
        since: the time of its sending.
        heard: the time of the server's last message on it; None: it has not accepted it.
        cancelled: the time of the request to cancel it.
    """

    ticket: int
    goals: int
    since: float
    heard: float | None = None
    cancelled: float | None = None


class Nav2Driver(Driver):
    """Sends one robot's body from cell to cell by a navigation server, one goal a cell.

    All times `now` are seconds of one monotonic clock. Call `next` after each event, and from time
    to time.

    Args:
        metric_map: the floor.
        near: metres from a place within which the body has arrived, with any result of the server.
        seconds: longest time of a move.
        robot: the robot, from 0.
        port: the connection to the server.

    Attributes:
        counts: numbers of moves by their ends, and of goals given up by their reasons.
    """

    def __init__(
        self,
        metric_map: MetricMap,
        near: float,
        seconds: float,
        robot: int,
        port: NavPort,
    ) -> None:
        super().__init__(metric_map, robot)
        self._near = near
        self._seconds = seconds
        self._port = port
        self._sent: _Sent | None = None
        self._tickets = self._number = self._tries = 0
        self._taken = self._again = 0.0
        self._blind = False
        self._over: tuple[float, float] | None = (
            None  # since when, and the newest pose's stamp
        )
        self.counts: Counter[str] = Counter()

    @property
    def stands(self) -> bool:
        """True if the server has no goal of this client, as far as is known."""
        return self._sent is None

    def sees(self, seconds: float, pose: Pose) -> None:
        """Note a pose: the body is in sight again."""
        super().sees(seconds, pose)
        self._blind = False

    def stop(self, now: float) -> None:
        """Cancel the goal that the server has."""
        self._leave(now)

    def lose_sight(self, now: float) -> None:
        """Cancel the goal; the move ends where the next pose is."""
        self._blind = True
        self.give_up(now, "poses lost", "")

    def give_up(self, now: float, kind: str, why: str) -> None:
        """Cancel the current goal, and end the move at the body's current place.

        A body on its way to an episode's first cell is sent again.

        Args:
            now: the time.
            kind: the kind of end that is counted.
            why: the reason, for the log; empty: the caller logs it.
        """
        self._leave(now)
        if self._goal is None or self._over is not None:
            return
        self.counts[kind] += 1
        if why:
            self._port.say(why)
        if self._goals.placing:
            self._wait(now)
        else:
            self._over = now, self._stamp

    def accepted(self, ticket: int, now: float) -> None:
        """The server has accepted a goal; cancel it if it is no longer needed."""
        sent = self._sent
        if sent is None or sent.ticket != ticket:
            self.counts["late acceptances"] += 1
            self._port.say("Nav2 accepted a goal too late: it is cancelled")
            self._port.cancel(ticket)
            return
        sent.heard = now
        if sent.cancelled is not None:
            self._port.cancel(ticket)

    def rejected(self, ticket: int, now: float) -> None:
        """The server has rejected a goal: send it again, a little later."""
        if self._sent is not None and self._sent.ticket == ticket:
            self._sent = None
            self.counts["rejected"] += 1
            self._port.say(
                "Nav2 rejected the goal (is its navigator active?): it is sent again"
            )
            self._wait(now)

    def feedback(self, ticket: int, left: float, now: float) -> None:
        """The server works at a goal; `left`: the remaining metres."""
        sent = self._sent
        if sent is None or sent.ticket != ticket:
            return
        sent.heard = now
        if left > DETOUR * self._metric_map.side and not self._goals.placing:
            why = f"Nav2 makes a detour of {left:.1f} m: the goal is cancelled"
            self.give_up(now, "detours", why)

    def ended(self, ticket: int, now: float, kind: str, why: str) -> None:
        """The server has ended a goal.

        Args:
            ticket: the goal's ticket.
            now: the time.
            kind: the kind of end that is counted.
            why: the reason, for the log; empty: success.
        """
        sent = self._sent
        if sent is None or sent.ticket != ticket:
            return
        self._sent = None
        if (
            sent.cancelled is not None
            or sent.goals != self._number
            or self._goal is None
        ):
            return
        if why:
            self.give_up(now, kind, why)
        elif self._goals.placing:
            self._wait(now)
        else:
            self._over = now, self._stamp

    def next(self, now: float) -> GoalReport | None:
        """Do the due work; return the end of the goal if it has ended."""
        self._watch(now)
        self._take_new_goals(now)
        if self.held:
            self._taken = (
                now  # a move's time does not pass while driving is not allowed
            )
        busy_with_old = self._sent is not None and self._sent.goals != self._number
        if self.held or self._goal is None or busy_with_old:
            self._leave(now)
            return None
        state = self._goal_state()
        if state is None or not self._believes(state, now):
            return None
        if self._began is None:
            self._began = state.stamp
        reached = self._arrives(state)
        if reached is not None:
            self.counts["arrived"] += 1
            self._leave(now)
            return reached
        self._give_up_in_time(state, now)
        if self._over is not None:
            return self._settles(state, *self._over, now)
        self._send(state, now)
        return None

    def _take_new_goals(self, now: float) -> None:
        """Begin with the last goals, if they are new."""
        if self._goals.number != self._number:
            self._number = self._goals.number
            self._taken = now
            self._again = now
            self._tries = 0
            self._over = None

    def _believes(self, state: GoalState, now: float) -> bool:
        """Return whether the pose is valid for a decision: newer than the goal, or long due."""
        late = now - self._taken >= SETTLE_SECONDS
        return not self._blind and (late or self._newer(state))

    def _give_up_in_time(self, state: GoalState, now: float) -> None:
        """Give up a move that has lasted too long."""
        limit = self._seconds
        if not state.goals.placing and now - self._taken >= limit:
            why = f"the move was not made within {limit:g} s (step_seconds)"
            self.give_up(now, "out of time", why)

    def _arrives(self, state: GoalState) -> GoalReport | None:
        """Return the end of the goal if the body is there, regardless of the server; else None."""
        if state.goals.placing:
            return self._placed(state)
        near = distance(state.pose, state.target) <= self._near
        return self._end(state, there=True) if near else None

    def _settles(
        self, state: GoalState, since: float, before: float, now: float
    ) -> GoalReport | None:
        """Return the end of a move that is over, once the server and a newer pose confirm it.

        Args:
            state: the state of the goal.
            since: the time of the move's end.
            before: the newest pose's stamp then.
            now: the time.
        """
        unseen = state.stamp == before and now - since < SETTLE_SECONDS
        if self._sent is not None or unseen:
            return None
        there = self._metric_map.inside(state.goal.end, state.pose.x, state.pose.y)
        self.counts["arrived" if there else "not there"] += 1
        return self._end(state, there=there)

    def _send(self, state: GoalState, now: float) -> None:
        """Send the goal if the server has none, unless a waiting time runs."""
        pose = state.pose
        x, y = state.target
        if self._sent is None and now >= self._again:
            self._tickets += 1
            ahead = math.atan2(y - pose.y, x - pose.x)
            if self._port.send(self._tickets, Pose(x, y, ahead)):
                self._sent = _Sent(self._tickets, self._number, now)
            else:
                self._wait(now)

    def _leave(self, now: float) -> None:
        """Ask for the end of the goal that the server has, once."""
        sent = self._sent
        if sent is not None and sent.cancelled is None:
            sent.cancelled = now
            if sent.heard is not None:
                self._port.cancel(sent.ticket)

    def _wait(self, now: float) -> None:
        self._again = now + min(BACKOFF_SECONDS * 2**self._tries, LONGEST_BACKOFF)
        self._tries += 1

    def _watch(self, now: float) -> None:
        """Check whether the server still answers."""
        sent = self._sent
        if sent is None:
            return
        since = sent.since if sent.cancelled is None else sent.cancelled
        if (
            sent.heard is None or sent.cancelled is not None
        ) and now - since >= ANSWER_SECONDS:
            self._sent = None
            self.counts["unanswered"] += 1
            why = f"Nav2 has not answered for {ANSWER_SECONDS:g} s: its goals are cancelled"
            self._port.say(why)
            self._port.cancel_all()
            self._wait(now)
        elif sent.heard is not None and now - sent.heard > SILENCE_SECONDS:
            why = f"Nav2 has said nothing for {SILENCE_SECONDS:g} s: the goal is cancelled"
            self.give_up(now, "silent", why)
