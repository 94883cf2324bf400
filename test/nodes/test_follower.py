# Copyright 2026 The sparse_coord_ros authors
# SPDX-License-Identifier: Apache-2.0
"""A node that follows a run: the choice of its run, and its wait after a signal."""

from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace

import pytest
from std_msgs.msg import String

from sparse_coord_ros.core.game.scenario import load_scenario
from sparse_coord_ros.core.runs.run_config import make_run
from sparse_coord_ros.protocol.lockstep import timeouts
from sparse_coord_ros.protocol.wire import RunState
from sparse_coord_ros.protocol.wire.status import Order, RunStatus
from sparse_coord_ros.ros.nodes import follower as module
from sparse_coord_ros.ros.nodes.follower import Follower
from sparse_coord_ros.ros.nodes.parameters import PARAMETERS
from sparse_coord_ros.ros.nodes.recorder import Recorder
from sparse_coord_ros.ros.nodes.ros_messages import status
from sparse_coord_ros.ros.nodes.spin import ros_context

from .puppet import puppet


@pytest.fixture
def node(own_domain):
    """Return a follower that has begun with a run."""
    with ros_context() as context:
        node = puppet(Follower)(
            "robot_1", PARAMETERS["robot"], context=context, values={}
        )
        node.tick()
        node.hear("run", announced("first"))
        node.tick()
        yield node
        node.destroy_node()


def announced(name):
    """Return the message that announces a run of this identity."""
    run = replace(make_run(load_scenario("env1"), {}), id=name)
    return String(data=run.to_yaml())


def say(node, *said):
    """Send the world's status to a node."""
    status_of = RunStatus(*said)
    node.hear("status", status("env1", status_of.state, status_of.values()))


def test_a_hint_comes_when_there_is_no_world_for_a_time(own_domain, monkeypatch):
    with ros_context() as context:
        node = puppet(Follower)(
            "robot_1", PARAMETERS["robot"], context=context, values={}
        )
        said = []
        logger = SimpleNamespace(info=said.append)
        monkeypatch.setattr(node, "get_logger", lambda: logger)
        node.tick()
        assert not any("so far" in line for line in said)
        node.born -= module.ALONE_SECONDS
        node.tick()
        node.tick()
        assert sum("no world simulator on /run" in line for line in said) == 1
        node.destroy_node()


def test_it_stays_with_its_run_when_another_one_is_announced(node):
    node.hear("run", announced("first"))
    assert not node.subscriber.dropped, "a world repeats what it announces"
    node.hear("run", announced("second"))
    assert node.subscriber.dropped == {"run": 1}
    assert node.run.id == "first"


@pytest.mark.parametrize(
    ("first_line", "drops"),
    [("id: first\n", 0), ("id: second\n", 1), ("", 1)],
    ids=["own", "another", "none"],
)
def test_a_node_under_way_reads_no_run(node, monkeypatch, first_line, drops):
    """Not even its own again: megabytes of YAML cost it no time."""
    read = []
    monkeypatch.setattr(module, "read_run", read.append)
    text = String(data=f"{first_line}x: [" + 100_000 * "1," + "]\n")
    node.hear("run", text)
    assert node.subscriber.dropped.total() == drops
    assert not read and node.run.id == "first"


def test_what_it_waits_for_next_is_counted_anew(node):
    assert node.reminder.due(1e12) == 0.0


def test_it_says_that_its_world_is_silent(node):
    said = []
    node.remind = lambda reminder, for_whom: said.append(for_whom)
    now = module.time.monotonic()
    node.look_for_the_world(now)
    assert said == []
    node.look_for_the_world(now + 4.0)
    assert said == ["a message of the world"]


def test_at_a_signal_it_waits_for_the_world_s_last_word_but_not_for_ever(
    node, monkeypatch
):
    now = 1000.0
    monkeypatch.setattr(module.time, "monotonic", lambda: now)
    assert not node.may_stop()
    now += module.STOP_SECONDS / 2
    assert not node.may_stop()
    now += module.STOP_SECONDS
    assert node.may_stop()


def test_at_a_signal_it_stops_at_once_when_the_world_has_said_that_it_stopped(node):
    say(node, "first", RunState.STOPPED, 7, 7)
    assert node.may_stop()
    node.all_done = lambda now: False
    assert not node.may_stop(), "something is left to do"


def test_a_recorder_says_where_it_records_what_it_waits_for_and_when_it_begins(
    bench, tmp_path, capfd, monkeypatch
):
    monkeypatch.chdir(tmp_path)
    recorder = bench.recorder(Path("out/bag"))
    where = tmp_path / "out" / "bag"
    said = capfd.readouterr().err
    assert f"will record to {where}; waiting for a world simulator on /run\n" in said
    bench.world(out="out", steps=20000, recorded=True)
    bench.robots()
    bench.spin_until(lambda: recorder.recording is not None, "it records")
    assert "[recorder]: records env1 from now on\n" in capfd.readouterr().err
    recorder.finish(interrupted=True)
    assert f"closed {where}: " in capfd.readouterr().err


def test_a_node_that_waits_for_a_world_says_how_to_start_one(
    own_domain, capfd, monkeypatch
):
    monkeypatch.setattr(timeouts, "REMIND_SECONDS", 0.0)
    with ros_context() as context:
        node = puppet(Follower)(
            "robot_1", PARAMETERS["robot"], context=context, values={}
        )
        node.tick()
        node.tick()
        said = capfd.readouterr().err
        assert (
            "waiting for a world simulator on /run (0 s); start one: ros2 run " in said
        )
        node.destroy_node()


def test_a_recorder_that_goes_on_says_what_it_waits_for(
    own_domain, tmp_path, capfd, monkeypatch
):
    """It knows the run at once, but not yet where it begins."""
    monkeypatch.setattr(timeouts, "REMIND_SECONDS", 0.0)
    values = {"out": str(tmp_path / "bag")}
    with ros_context() as context:
        recorder = puppet(Recorder)(context=context, values=values)
        recorder.hear("run", announced("first"))
        say(recorder, "first", RunState.RESUMING, 0, 0)
        for _ in range(3):
            recorder.tick()
        said = capfd.readouterr().err
        assert "waiting for the world to say where the run begins (" in said
        order = Order("an attempt", 0)
        say(recorder, "first", RunState.RESUMING, 0, 0, 0, "", order)
        recorder.tick()
        assert "records env1 from now on\n" in capfd.readouterr().err
        recorder.finish(interrupted=True)
        recorder.destroy_node()
