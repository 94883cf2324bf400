# Copyright 2026 The sparse_coord_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Moves as goals of a navigation server: every fault of it, without ROS."""

import math

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from sparse_coord_ros.core.game.pose import Pose
from sparse_coord_ros.core.game.scenario import load_scenario
from sparse_coord_ros.core.runs.run_config import make_run
from sparse_coord_ros.lab.driving.metric_map import MetricMap
from sparse_coord_ros.lab.driving.nav2_driver import (
    ANSWER_SECONDS,
    SETTLE_SECONDS,
    SILENCE_SECONDS,
    Nav2Driver,
)
from sparse_coord_ros.protocol.lockstep.bodies import NO_CELL, BodyGoal, Goals

RUN = make_run(load_scenario("env1"), {})
CELLS = RUN.scenario.map.number
START = CELLS[0, 0]
END = CELLS[1, 0]
GROUND = MetricMap(RUN)
NEAR = 0.1
SECONDS = 10.0


class Server:
    """The port, and a clock: keeps what was asked for."""

    def __init__(self, near=NEAR, seconds=SECONDS):
        self.sent = []
        self.cancelled = []
        self.said = []
        self.all = 0
        self.there = True
        self.now = 100.0
        self.driver = Nav2Driver(GROUND, near, seconds, 0, self)

    def send(self, ticket, target):
        if self.there:
            self.sent.append((ticket, target))
        return self.there

    def cancel(self, ticket):
        self.cancelled.append(ticket)

    def cancel_all(self):
        self.all += 1

    def say(self, text):
        self.said.append(text)

    def go(self, number=1, *, place=False, start=START, end=END):
        self.driver.take(Goals(number, 5, place, -9.0, (BodyGoal(0, start, end),)))
        return self.driver.next(self.now)

    def pose(self, cell, dx=0.0, *, later=0.1, stamp=None):
        """Time passes, and a pose comes."""
        self.now += later
        x, y = GROUND.place(0, cell)
        self.driver.sees(self.now if stamp is None else stamp, Pose(x + dx, y, 0.0))
        return self.driver.next(self.now)

    def wait(self, seconds, *, feedback=False):
        """Time passes in ticks; return what was reported in it."""
        found = None
        for _ in range(round(seconds / 0.1)):
            self.now += 0.1
            if feedback and self.sent:
                self.driver.feedback(self.sent[-1][0], 0.5, self.now)
            found = self.driver.next(self.now) or found
        return found

    def tell(self, event, *more):
        """The server says something of the newest goal."""
        ticket = self.sent[-1][0]
        if event == "ended":
            self.driver.ended(ticket, self.now, *more)
        elif event == "feedback":
            self.driver.feedback(ticket, *more, self.now)
        else:
            getattr(self.driver, event)(ticket, self.now)
        return self.driver.next(self.now)


@pytest.fixture
def server():
    """A server with a goal under way, accepted."""
    made = Server()
    made.pose(START)
    made.go()
    made.tell("accepted")
    return made


def test_one_goal_a_cell_with_its_yaw_along_the_travel(server):
    [(_, target)] = server.sent
    assert target[:2] == pytest.approx(GROUND.place(0, END))
    assert target.yaw == pytest.approx(-math.pi / 2)
    assert server.go() is None and len(server.sent) == 1  # the same goals again


def test_an_arrival_in_a_newer_pose_is_reported_before_the_result(server):
    reached = server.pose(END, 0.05)
    assert (reached.cell, reached.there, reached.number) == (END, True, 1)
    assert server.cancelled == [1] and not server.driver.busy
    server.tell("ended", "canceled", "")
    assert server.driver.stands


def test_the_next_goal_waits_until_the_last_one_is_over(server):
    server.pose(END)
    server.go(2, start=END, end=CELLS[1, 1])
    server.pose(END)
    assert len(server.sent) == 1
    server.tell("ended", "canceled", "")
    assert len(server.sent) == 2


@pytest.mark.parametrize(
    ("cell", "there"),
    [(END, True), (START, False)],
    ids=["inside", "success elsewhere"],
)
def test_after_a_success_the_cell_of_a_newer_pose_counts(server, cell, there):
    server.pose(END, 0.2)
    assert server.tell("ended", "succeeded", "") is None
    reached = server.pose(cell, 0.2)
    assert (reached.cell, reached.there) == (cell, there)
    assert not server.said


def test_where_no_newer_pose_comes_the_newest_one_counts(server):
    """AMCL says nothing while a body stands."""
    server.pose(END, 0.2)
    server.tell("ended", "succeeded", "")
    assert server.wait(SETTLE_SECONDS - 0.2) is None
    assert server.wait(0.4).cell == END


def test_how_long_a_move_took_is_told(server):
    began = server.now
    server.pose(START)
    server.pose(START, 0.2)
    reached = server.pose(END)
    assert (
        reached.seconds == pytest.approx(server.now - began, abs=0.11)
        and reached.seconds > 0.1
    )


def test_an_abort_is_said_and_learned_as_stayed(server):
    server.tell("ended", "aborted", "Nav2 aborted: code 105")
    reached = server.pose(START)
    assert (reached.cell, reached.there) == (START, False)
    assert (
        server.said == ["Nav2 aborted: code 105"]
        and server.driver.counts["aborted"] == 1
    )


def test_a_rejected_goal_is_sent_again_with_backoff_until_time_is_over():
    server = Server()
    reached = None
    server.pose(START)
    server.go()
    times = [server.now]
    while reached is None:
        assert server.now < 130.0
        before = len(server.sent)
        server.tell("rejected")
        while len(server.sent) == before and reached is None:
            reached = server.pose(START)
        times.append(server.now)
    gaps = [b - a for a, b in zip(times, times[1:-1], strict=False)]
    assert gaps == sorted(gaps) and gaps[0] < 0.5 and len(gaps) >= 4
    assert server.now - times[0] == pytest.approx(SECONDS, abs=0.3)
    assert reached.cell == START and not reached.there and server.driver.stands


def test_a_server_that_is_not_there_is_asked_again():
    server = Server()
    server.there = False
    server.pose(START)
    server.go()
    server.wait(1.0)
    server.there = True
    server.wait(2.0)
    assert len(server.sent) == 1


def test_a_late_acceptance_is_cancelled_not_lost():
    server = Server()
    server.pose(START)
    server.go()
    server.wait(ANSWER_SECONDS + 0.1)
    assert server.all == 1
    server.wait(1.0)
    assert [ticket for ticket, _ in server.sent] == [1, 2]
    server.driver.accepted(1, server.now)
    assert server.cancelled == [1]
    server.tell("accepted")
    assert server.cancelled == [1] and server.pose(END).there


def test_a_goal_that_was_given_up_before_its_acceptance_is_cancelled_then():
    server = Server()
    server.pose(START)
    server.go()
    server.go(2, end=START)
    assert server.cancelled == []
    server.tell("accepted")
    assert server.cancelled == [1]


def test_silence_of_feedback_ends_the_move(server):
    assert server.wait(0.9) is None and not server.cancelled
    server.wait(0.3)
    assert server.cancelled == [1] and "said nothing for 1 s" in server.said[0]
    assert server.pose(START) is None  # its end is not known yet
    assert server.wait(ANSWER_SECONDS).cell == START and server.all == 1


def test_a_killed_server_costs_a_bounded_time(server):
    found = None
    begin = server.now
    while found is None:
        assert server.now - begin < SILENCE_SECONDS + ANSWER_SECONDS + 0.5
        found = server.pose(START)
    assert found.cell == START and server.driver.stands


def test_a_detour_is_given_up(server):
    server.tell("feedback", 2.9)
    assert not server.cancelled
    server.tell("feedback", 3.1)
    assert server.cancelled == [1] and "detour" in server.said[0]
    server.tell("ended", "canceled", "")
    assert server.pose(START).cell == START


def test_lost_poses_end_the_move_where_the_body_is_seen_again(server):
    server.driver.lose_sight(server.now)
    assert server.cancelled == [1]
    server.tell("ended", "canceled", "")
    assert server.wait(20.0) is None and len(server.sent) == 1
    assert server.pose(END, 0.2).cell == END


def test_a_robot_that_is_lifted_away_is_lost_and_found(server):
    server.pose(START, 50.0)
    server.tell("feedback", 50.0)
    server.tell("ended", "canceled", "")
    assert server.pose(START, 50.0).cell == NO_CELL
    server.go(2)
    reached = server.pose(CELLS[0, 1])
    while reached is None:
        if server.sent[-1][0] == 2:
            server.tell("feedback", 9.0)
            server.tell("ended", "canceled", "")
        reached = server.pose(CELLS[0, 1])
    assert reached.cell == CELLS[0, 1]


def test_to_its_first_cell_a_body_is_brought_however_long_it_takes():
    server = Server()
    server.pose(CELLS[0, 3])
    server.go(place=True, end=START)
    server.tell("accepted")
    server.tell("feedback", 12.0)
    assert not server.cancelled
    server.tell("ended", "aborted", "Nav2 aborted: code 204")
    server.wait(0.5)
    assert [ticket for ticket, _ in server.sent] == [1, 2]
    server.tell("accepted")
    server.tell("ended", "succeeded", "")
    server.wait(1.0)
    assert len(server.sent) == 3  # it is not there: again
    server.tell("accepted")
    assert server.wait(60.0, feedback=True) is None
    reached = server.pose(START, 0.2)
    assert reached.there and reached.cell == START and server.cancelled == [3]
    assert server.driver.counts["out of time"] == 0


def test_held_it_cancels_and_sends_nothing(server):
    server.driver.held = True
    server.pose(START)
    assert server.cancelled == [1]
    server.tell("ended", "canceled", "")
    server.pose(START)
    assert len(server.sent) == 1 and server.driver.stands and server.driver.busy
    server.driver.held = False
    server.pose(START)
    assert len(server.sent) == 2


def test_what_is_said_of_old_goals_is_ignored(server):
    server.driver.rejected(99, server.now)
    server.driver.ended(99, server.now, "aborted", "x")
    server.driver.feedback(99, 50.0, server.now)
    assert server.pose(START) is None and not server.said and not server.cancelled


def test_a_goal_that_somebody_else_cancelled_ends_the_move(server):
    server.tell("ended", "canceled", "somebody else cancelled the goal")
    assert not server.pose(START).there


def test_a_pose_of_before_the_goal_is_no_reason_to_drive():
    """But it is waited for a newer one only for a while: a body that stands may be silent."""
    server = Server()
    server.pose(START, stamp=50.0)
    bodies = (BodyGoal(0, START, END),)
    server.driver.take(Goals(1, 5, False, 50.0, bodies))
    assert server.wait(SETTLE_SECONDS - 0.2) is None and not server.sent
    server.wait(0.4)
    assert len(server.sent) == 1


def test_each_goal_is_sent_again_as_soon_as_the_one_before_was():
    server = Server()
    server.pose(START)
    server.go()
    for _ in range(4):
        server.tell("rejected")
        server.wait(4.0)
    server.go(2)
    before = len(server.sent)
    server.tell("rejected")
    server.wait(0.4)
    assert len(server.sent) == before + 1


def test_while_it_is_held_the_time_of_a_move_does_not_pass(server):
    server.driver.held = True
    server.pose(START)
    server.tell("ended", "canceled", "")
    assert server.wait(3 * SECONDS) is None
    server.driver.held = False
    server.pose(START)
    server.wait(1.5)
    assert not server.said and len(server.sent) == 2


@settings(max_examples=5)
@given(near=st.floats(0.02, 0.4))
def test_a_body_within_near_has_arrived(near):
    made = Server(near=near)
    made.pose(START)
    made.go()
    made.tell("accepted")
    assert made.pose(END, near * 1.01) is None
    assert made.pose(END, near * 0.99).there


@settings(max_examples=5)
@given(seconds=st.floats(1.0, 30.0))
def test_a_move_lasts_so_many_seconds(seconds):
    made = Server(seconds=seconds)
    made.pose(START)
    made.go()
    made.tell("accepted")
    made.wait(seconds - 0.2, feedback=True)
    assert not made.cancelled
    made.wait(0.4, feedback=True)
    assert made.cancelled and "step_seconds" in made.said[0]
