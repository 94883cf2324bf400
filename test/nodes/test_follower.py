# Copyright 2026 The sparse_coord_ros authors
# SPDX-License-Identifier: Apache-2.0
"""A node that follows a run: whose run it stays with, and how long it waits at a signal."""

from dataclasses import replace

import pytest

from sparse_coord_ros.game.scenario import load_scenario
from sparse_coord_ros.learn.run_config import make_run
from sparse_coord_ros.nodes import follower as module
from sparse_coord_ros.nodes.follower import Follower
from sparse_coord_ros.nodes.parameters import PARAMETERS
from sparse_coord_ros.nodes.spin import ros_context
from sparse_coord_ros.wire import RunState
from sparse_coord_ros.wire.status import Said


@pytest.fixture
def node(own_domain):
    """Return a follower that has begun with a run."""
    with ros_context() as context:
        node = Follower("robot_1", PARAMETERS["robot"], context=context, values={})
        node._tick()
        node._on_run(announced("first"))
        node._tick()
        yield node
        node.destroy_node()


def announced(name):
    return replace(make_run(load_scenario("env1"), {}), id=name)


def test_it_stays_with_its_run_when_another_one_is_announced(node):
    others = []
    node.another_run = others.append
    node._on_run(announced("first"))
    assert not others, "a world repeats what it announces"
    node._on_run(announced("second"))
    assert [other.id for other in others] == ["second"]
    assert node.run.id == "first"


def test_what_it_waits_for_next_is_counted_anew(node):
    assert node.reminder.due(1e12) == 0.0


def test_it_says_that_its_world_is_silent(node):
    said = []
    node.remind = lambda reminder, for_whom: said.append(for_whom)
    now = module.time.monotonic()
    node.look_for_the_world(now)
    assert said == []
    node.look_for_the_world(now + 4.0)
    assert said == ["a word of the world"]


def test_at_a_signal_it_waits_for_the_world_s_last_word_but_not_for_ever(node, monkeypatch):
    now = 1000.0
    monkeypatch.setattr(module.time, "monotonic", lambda: now)
    assert not node.may_stop()
    now += module.STOP_SECONDS / 2
    assert not node.may_stop()
    now += module.STOP_SECONDS
    assert node.may_stop()


def test_at_a_signal_it_stops_at_once_when_the_world_has_said_that_it_stopped(node):
    node._on_status(Said("first", RunState.STOPPED, 7, 7))
    assert node.may_stop()
    node.all_done = lambda now: False
    assert not node.may_stop(), "something is left to do"
