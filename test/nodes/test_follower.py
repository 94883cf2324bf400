# Copyright 2026 The sparse_coord_ros authors
# SPDX-License-Identifier: Apache-2.0
"""A node that follows a run: whose run it stays with, and how long it waits at a signal."""

from dataclasses import replace
from pathlib import Path

import pytest
from rclpy.serialization import serialize_message
from std_msgs.msg import String

from sparse_coord_ros.core.game.scenario import load_scenario
from sparse_coord_ros.core.runs.run_config import make_run
from sparse_coord_ros.protocol.lockstep import timeouts
from sparse_coord_ros.protocol.wire import RunState
from sparse_coord_ros.protocol.wire.status import Order, RunStatus
from sparse_coord_ros.ros.nodes import follower as module
from sparse_coord_ros.ros.nodes.follower import Follower
from sparse_coord_ros.ros.nodes.parameters import PARAMETERS
from sparse_coord_ros.ros.nodes.spin import ros_context


@pytest.fixture
def node(own_domain):
    """Return a follower that has begun with a run."""
    with ros_context() as context:
        node = Follower("robot_1", PARAMETERS["robot"], context=context, values={})
        node._tick()
        hear(node, announced("first"))
        node._tick()
        yield node
        node.destroy_node()


def hear(node, run):
    """Let a node hear a run."""
    node._on_run(node._read_run(serialize_message(String(data=run.to_yaml()))))


def announced(name):
    return replace(make_run(load_scenario("env1"), {}), id=name)


def test_it_stays_with_its_run_when_another_one_is_announced(node):
    hear(node, announced("first"))
    assert not node.subscriber.dropped, "a world repeats what it announces"
    hear(node, announced("second"))
    assert node.subscriber.dropped == {"run": 1}
    assert node.run.id == "first"


@pytest.mark.parametrize(
    "identity", ["first", "second", None], ids=["own", "another", "none"]
)
def test_a_node_under_way_reads_no_run(node, monkeypatch, identity):
    """Not even its own again: megabytes of YAML cost it no time."""
    monkeypatch.setattr(module, "read_run", None)
    text = "x: [" + 2_000_000 * "1," + "]\n"
    data = serialize_message(
        String(data=text if identity is None else f"id: {identity}\n{text}")
    )
    before = module.time.process_time()
    if identity is None:
        with pytest.raises(ValueError, match="names no run"):
            node._read_run(data)
    else:
        assert node._read_run(data) is None
    assert module.time.process_time() - before < 0.02


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
    node._on_status(RunStatus("first", RunState.STOPPED, 7, 7))
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
    bench.world(out="out", set=["steps=20000"], recorded=True)
    bench.spin_until(lambda: recorder.recording is not None, "it records")
    assert "[recorder]: records env1 from now on\n" in capfd.readouterr().err


def test_a_recorder_that_goes_on_says_what_it_waits_for(
    bench, tmp_path, capfd, monkeypatch
):
    """It knows the run at once, but not yet from where that goes on."""
    monkeypatch.setattr(timeouts, "REMIND_SECONDS", 0.1)
    recorder = bench.recorder(tmp_path / "bag", resume=True)
    said = []

    def look():
        said.append(capfd.readouterr().err)
        return "".join(said)

    run = serialize_message(String(data=announced("first").to_yaml()))
    recorder._on_run(recorder._read_run(run))
    wanted = "waiting for the world to say from where the run goes on ("
    bench.spin_until(lambda: wanted in look(), "it says what it waits for")
    status = RunStatus("first", RunState.RESUMING, 0, 0, order=Order("back", 0, 1))
    recorder._on_status(status)
    bench.spin_until(lambda: "records env1 from now on\n" in look(), "it records")
