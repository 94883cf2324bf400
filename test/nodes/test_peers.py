# Copyright 2026 The sparse_coord_ros authors
# SPDX-License-Identifier: Apache-2.0
"""A question to a peer: silent, behind; without middleware."""

import pytest
from nav_msgs.srv import GetPlan

from sparse_coord_ros.core.game.scenario import load_scenario
from sparse_coord_ros.core.runs.run_config import make_run
from sparse_coord_ros.protocol.lockstep.robot_side import Answer
from sparse_coord_ros.ros.nodes import peers
from sparse_coord_ros.ros.nodes.peers import IMMEDIATE_REPEATS, Peer, Peers
from sparse_coord_ros.ros.nodes.ros_messages import cell_path, messages_of

MESSAGES = messages_of(make_run(load_scenario("env1"), {}))


class Future:
    def __init__(self):
        self.callbacks = []
        self.answer = None

    def add_done_callback(self, callback):
        self.callbacks.append(callback)

    def cancelled(self):
        return False

    def cancel(self):
        pass

    def result(self):
        return self.answer

    def done(self):
        return self.answer is not None

    def set_result(self, answer):
        self.answer = answer
        self.look()

    def come(self):
        self.set_result(GetPlan.Response())

    def look(self):
        for callback in self.callbacks:
            callback(self)


class Node:
    """The part of a node for its peers; it is its own client and subscriber.

    Attributes:
        sent: the open and the answered requests.
        dropped: the topics and services of dropped messages.
    """

    def __init__(self):
        self.sent = []
        self.dropped = []
        self.shared_clients = {}
        self.subscriber = self

    def guarded(self, call):
        return call

    def create_service(self, kind, name, answer):
        return self

    def drop(self, name, why, done="message dropped"):
        self.dropped.append(name)

    def get_name(self):
        return "robot_1"

    def get_clock(self):
        return None

    def create_client(self, kind, name):
        return self

    def service_is_ready(self):
        return True

    def remove_pending_request(self, future):
        pass

    def call_async(self, request):
        self.sent.append(Future())
        return self.sent[-1]


@pytest.fixture
def node():
    return Node()


def peer_of(node, answered=lambda step, plan: None):
    return Peer(node, node, MESSAGES, answered)


def test_a_peer_that_gave_up_is_asked_but_not_waited_for(node):
    heard = []
    peer = peer_of(node, lambda step, plan: heard.append(step))
    assert peer.request(1, 3) is True
    peer.gave_up()
    assert peer.request(2, 3) is False
    assert len(node.sent) == 2, "so that its return is noticed"
    node.sent[1].come()
    assert heard == [2]
    assert peer.request(3, 3) is True


def test_what_was_not_sent_to_a_peer_that_gave_up_is_not_sent_later(node):
    peer = peer_of(node)
    node.service_is_ready = lambda: False
    peer.request(1, 3)
    peer.gave_up()
    node.service_is_ready = lambda: True
    peer.send_what_waits()
    assert node.sent == []


def test_an_answer_that_nobody_looked_at_yet_is_not_asked_for_again(node, monkeypatch):
    """It has come, but its callback waits behind the timer that would repeat the request."""
    monkeypatch.setattr(peers, "REPEAT_ASK_SECONDS", 0.0)
    heard = []
    peer = peer_of(node, lambda step, plan: heard.append(step))
    peer.request(7, 3)
    peer.send_what_waits()
    assert len(node.sent) == 2, "nothing has come"
    node.sent[1].answer = GetPlan.Response()
    peer.send_what_waits()
    assert len(node.sent) == 2
    node.sent[1].look()
    peer.send_what_waits()
    assert heard == [7] and len(node.sent) == 2


class Side:
    """The part of a robot's side of the lock step for its peers: it asks robot_2."""

    def __init__(self, waiting):
        self.waiting = waiting
        self.asking = 1
        self.answers = []
        self.expired = 0

    def answer(self, peer, step, answer):
        self.answers.append((peer, step, answer))

    def expire(self):
        self.expired += 1


TIMEOUTS = {"step_timeout": 2.5}


@pytest.fixture
def side():
    return Side(("percept", 7))


@pytest.fixture
def asked(node, side):
    """Return robot_1's peers."""
    run = make_run(load_scenario("env1"), TIMEOUTS)
    return Peers(node, run, messages_of(run), side)


def plan(step, *cells):
    """Return an answer: a peer is in these cells at a step."""
    return GetPlan.Response(plan=cell_path(MESSAGES, step, cells))


def test_an_answer_that_does_not_fit_is_dropped_and_counted(node, side, asked):
    asked.ask(1, 7, 0)
    answer = plan(7, 3)
    answer.plan.poses[0].pose.position.x = 1e9
    node.sent[-1].set_result(answer)
    assert node.dropped == ["robot_2/active_perception"] and side.answers == []
    asked.ask(1, 7, 0)
    node.sent[-1].set_result(plan(7, 3))
    assert side.answers == [(1, 7, Answer(7, 3))]


def test_the_deadline_of_what_is_waited_for(node, side, asked):
    """It begins anew with each new wait; a peer that lets it pass is silent."""
    assert asked.ask(1, 7, 0)
    asked.keep_the_deadline(10.0)
    asked.keep_the_deadline(10.9)
    assert side.expired == 0
    asked.keep_the_deadline(11.0)
    assert side.expired == 1
    assert not asked.ask(1, 8, 0), "nobody waits for a silent peer"
    side.waiting = ("reward", 8)
    side.asking = -1
    asked.keep_the_deadline(11.1)
    asked.keep_the_deadline(12.0)
    assert side.expired == 1
    asked.keep_the_deadline(12.1)
    assert side.expired == 2


def test_after_a_return_to_the_same_step_the_deadline_begins_anew(side, asked):
    for now in (10.0, 10.9):
        asked.keep_the_deadline(now)
    asked.start_anew()
    asked.ask(1, 7, 0)
    for now in (11.1, 12.0):
        asked.keep_the_deadline(now)
    assert side.expired == 0


def test_a_peer_that_is_asked_after_another_one_has_its_own_time(
    node, side, monkeypatch
):
    scenario = load_scenario("env2-4r", peers="all")
    run = make_run(scenario, TIMEOUTS)
    asked = Peers(node, run, messages_of(run), side)
    asked.ask(1, 7, 0)
    asked.keep_the_deadline(10.0)
    monkeypatch.setattr(peers.time, "monotonic", lambda: 10.9)
    node.sent[-1].set_result(plan(7, 3))
    asked.ask(2, 7, 0)
    side.asking = 2
    asked.keep_the_deadline(11.8)
    assert side.expired == 0
    asked.keep_the_deadline(11.9)
    assert side.expired == 1


def test_a_late_reward_is_no_peer_s_fault(node, side, asked):
    side.waiting = ("reward", 7)
    side.asking = -1
    for now in (10.0, 11.0):
        asked.keep_the_deadline(now)
    assert side.expired == 1
    assert asked.ask(1, 8, 0)


def test_a_peer_is_asked_at_once_at_every_step_though_not_for_ever_at_one(node):
    peer = peer_of(node)
    for step in range(1, 2 * IMMEDIATE_REPEATS):
        peer.request(step, 3)
        assert len(node.sent) == step
    before = len(node.sent)
    for _ in range(2 * IMMEDIATE_REPEATS):
        peer.request(step, 3)
    assert len(node.sent) == before + IMMEDIATE_REPEATS - 1
    peer.send_what_waits()  # the node's timer
    assert len(node.sent) == before + IMMEDIATE_REPEATS
