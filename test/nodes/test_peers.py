# Copyright 2026 The sparse_coord_ros authors
# SPDX-License-Identifier: Apache-2.0
"""A peer that fell silent, and a robot that leaves: without any middleware."""

from types import SimpleNamespace

import pytest
from geometry_msgs.msg import PoseStamped
from nav_msgs.srv import GetPlan

from sparse_coord_ros.core.game.scenario import load_scenario
from sparse_coord_ros.core.runs.run_config import make_run
from sparse_coord_ros.protocol.lockstep.timeouts import Deadline, WorldPresence
from sparse_coord_ros.ros.nodes import peers
from sparse_coord_ros.ros.nodes.messages import Converter
from sparse_coord_ros.ros.nodes.peers import IMMEDIATE_REPEATS, Peer, Peers
from sparse_coord_ros.ros.nodes.robot import LAST_REWARD_SECONDS, Member


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

    def come(self):
        self.answer = GetPlan.Response()
        self.look()

    def look(self):
        for callback in self.callbacks:
            callback(self)


class Node:
    """Of a node what a peer needs; its own client."""

    def __init__(self):
        self.sent = []

    def get_name(self):
        return "robot_1"

    def get_clock(self):
        return None

    def create_client(self, kind, name):
        return self

    def configure_introspection(self, *of_what):
        pass

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


def test_a_peer_that_gave_up_is_asked_but_not_waited_for(node):
    heard = []
    peer = Peer(node, node, lambda step, plan: heard.append(step))
    assert peer.request(PoseStamped(), 1) is True
    peer.gave_up()
    assert peer.request(PoseStamped(), 2) is False
    assert len(node.sent) == 2, "so that its return is noticed"
    node.sent[1].come()
    assert heard == [2]
    assert peer.request(PoseStamped(), 3) is True


def test_what_was_not_sent_to_a_peer_that_gave_up_is_not_sent_later(node):
    peer = Peer(node, node, lambda step, plan: None)
    node.service_is_ready = lambda: False
    peer.request(PoseStamped(), 1)
    peer.gave_up()
    node.service_is_ready = lambda: True
    peer.send_what_waits()
    assert node.sent == []


def test_an_answer_that_nobody_looked_at_yet_is_not_asked_for_again(node, monkeypatch):
    """It has come, but its callback waits behind the timer that would send the request again."""
    monkeypatch.setattr(peers, "REPEAT_ASK_SECONDS", 0.0)
    heard = []
    peer = Peer(node, node, lambda step, plan: heard.append(step))
    peer.request(PoseStamped(), 7)
    peer.send_what_waits()
    assert len(node.sent) == 2, "nothing has come"
    node.sent[1].answer = GetPlan.Response()
    peer.send_what_waits()
    assert len(node.sent) == 2
    node.sent[1].look()
    peer.send_what_waits()
    assert heard == [7] and len(node.sent) == 2


@pytest.mark.parametrize(("repeats", "believed"), [(0, True), (9, True), (10, False)])
def test_a_doubted_peer_is_not_behind_for_ever(repeats, believed):
    """Who serves its place might say so each time, and first: the request stays open then."""
    convert = Converter(make_run(load_scenario("env1"), {}))
    side = SimpleNamespace(waiting=("percept", 7))
    peers = SimpleNamespace(_side=side, _convert=convert, _peers={1: SimpleNamespace()})
    peers._peers[1].repeats = repeats
    told = []
    peers._on_answer = lambda *what: told.append(what)
    behind = convert.path(6, ())
    assert Peers._fits(peers, 1, 7, behind) is believed
    assert told == [(1, 7, behind)] * (not believed), (
        "it is asked again, and that is counted"
    )


@pytest.mark.parametrize(
    ("waiting", "newest", "done"),
    [
        (None, 9, True),
        (("reward", 8), 9, False),
        (None, 8, False),
        (("percept", 9), 9, False),
    ],
)
def test_a_robot_leaves_when_all_is_learned(waiting, newest, done):
    """Not with a reward pending, or before it has the last state: or some seconds later.

    They count from the first time that it hears of the run's end.
    """
    presence = WorldPresence("this", 9, 0.0, 0.0)
    presence.hear("this", "finished", 9, 9, 1.0)
    presence.hear("this", "finished", 9, 9, 2.0)
    lockstep = SimpleNamespace(waiting=waiting, newest=(newest, 3))
    member = SimpleNamespace(
        joined=True, lockstep=lockstep, _presence=presence, _exchange=None
    )
    assert Member.all_done(member, 1.0 + LAST_REWARD_SECONDS) is done
    assert Member.all_done(member, 1.0 + LAST_REWARD_SECONDS + 0.1)


def test_a_robot_that_plans_leaves_when_the_exchange_is_over():
    presence = WorldPresence("this", 9, 0.0, 0.0)
    presence.hear("this", "finished", 9, 9, 1.0)
    lockstep = SimpleNamespace(waiting=None, newest=(9, 3))
    exchange = SimpleNamespace()
    member = SimpleNamespace(
        joined=True, lockstep=lockstep, _presence=presence, _finished=True
    )
    member._exchange = exchange
    for over in (False, True):
        exchange.over = lambda over=over: over
        assert Member.all_done(member, 1.1) is over


def test_the_deadline_of_what_is_waited_for():
    """It begins anew with whatever else is waited for; a peer that lets it pass is silent."""
    done = []
    lockstep = SimpleNamespace(
        waiting=("percept", 4), asking=1, expire=lambda: done.append("expired")
    )
    peer = SimpleNamespace(gave_up=lambda: done.append("gave up"), heard=0.0)
    peer.send_what_waits = lambda: None
    peers = SimpleNamespace(
        _side=lockstep, _deadline=Deadline(1.0, 5.0), _peers={1: peer}
    )
    Peers.keep_the_deadline(peers, 10.0)
    Peers.keep_the_deadline(peers, 10.9)
    assert done == []
    Peers.keep_the_deadline(peers, 11.0)
    assert done == ["gave up", "expired"]
    lockstep.waiting = ("reward", 4)
    lockstep.asking = -1
    Peers.keep_the_deadline(peers, 11.1)
    Peers.keep_the_deadline(peers, 12.0)
    assert done == ["gave up", "expired"]
    Peers.keep_the_deadline(peers, 12.1)
    assert done == ["gave up", "expired", "expired"], (
        "no peer is to blame for a late reward"
    )


@pytest.mark.parametrize(
    ("there", "said", "fits"),
    [
        ((7, 3), (7, (3,)), True),
        ((7, 3), (7, (4,)), False),  # a lie
        ((7, 3), (7, ()), False),
        ((8, 3), (7, (4,)), True),  # too late to tell
        ((6, 3), (7, (3,)), False),  # the world is about to say where it is
    ],
)
def test_an_answer_of_a_doubted_peer_is_what_the_world_says(there, said, fits):
    convert = Converter(make_run(load_scenario("env1"), {}))
    dropped = []
    again = []
    side = SimpleNamespace(waiting=("percept", 7), due=lambda cell: cell)
    subscriber = SimpleNamespace(drop=lambda *what: dropped.append(what))
    peer = SimpleNamespace(send_again=lambda: again.append(True))
    peers = SimpleNamespace(
        _side=side, _convert=convert, _subscriber=subscriber, _peers={1: peer}
    )
    peers._places = {1: there}
    peers._names = convert.names
    assert Peers._fits(peers, 1, 7, convert.path(*said)) is fits
    assert bool(dropped) == (not fits and there[0] == 7)
    assert bool(again) == (there[0] == 6)


def test_a_peer_is_asked_at_once_at_every_step_though_not_for_ever_at_one(node):
    peer = Peer(node, node, lambda step, plan: None)
    for step in range(1, 2 * IMMEDIATE_REPEATS):
        peer.request(PoseStamped(), step)
        assert len(node.sent) == step
    before = len(node.sent)
    for _ in range(2 * IMMEDIATE_REPEATS):
        peer.request(PoseStamped(), step)
    assert len(node.sent) == before + IMMEDIATE_REPEATS - 1
    peer.send_what_waits()  # the node's timer
    assert len(node.sent) == before + IMMEDIATE_REPEATS
