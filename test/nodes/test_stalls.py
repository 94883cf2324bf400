# Copyright 2026 The sparse_coord_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Processes that stand still for a while: the run goes on, and its log lacks nothing."""

import signal
import time

import pytest

from sparse_coord_ros.log.runlog import verify
from sparse_coord_ros.protocol.lockstep import attempts
from sparse_coord_ros.protocol.lockstep.attempts import MOST_BEHIND
from sparse_coord_ros.ros.nodes import ros_topics
from sparse_coord_ros.ros.nodes.recorder import Recorder


def test_publishers_keep_more_than_a_recorder_may_be_behind():
    assert ros_topics.kept_qos(ros_topics.ACTION).depth >= 2 * MOST_BEHIND


def test_the_world_waits_for_a_recorder_that_is_behind(bench, tmp_path, monkeypatch):
    monkeypatch.setattr(attempts, "MOST_BEHIND", 40)
    writes = Recorder.say_progress
    mute = lambda *_: None  # noqa: E731
    world = bench.world(steps=200, recorded=True)
    bench.robots()
    recorder = bench.recorder(tmp_path / "bag")
    bench.spin_until(lambda: world.lockstep.world.transitions > 0, "it has begun")
    monkeypatch.setattr(Recorder, "say_progress", mute)
    limit = world.restart.limit
    bench.spin_until(lambda: world.lockstep.world.step >= limit, "it waits")
    until = time.monotonic() + 0.3
    bench.spin_until(lambda: time.monotonic() > until)
    assert world.lockstep.world.step == limit == world.restart.limit
    monkeypatch.setattr(Recorder, "say_progress", writes)
    recorder.recording.flush()
    bench.spin_until_done()
    assert verify(tmp_path / "bag").same


def test_the_world_goes_on_without_a_recorder_that_is_lost(
    bench, tmp_path, monkeypatch, capfd
):
    monkeypatch.setattr(attempts, "MOST_BEHIND", 40)
    world = bench.world(steps=200, recorded=True)
    world.lost_timeout = 0.2
    bench.robots()
    recorder = bench.recorder(tmp_path / "bag")
    bench.spin_until(lambda: world.lockstep.world.transitions > 0, "it has begun")
    bench.destroy(recorder)
    bench.spin_until(lambda: world.done)
    assert "recorder is lost; continuing without it" in capfd.readouterr().err


@pytest.mark.long
@pytest.mark.timeout(600)
@pytest.mark.parametrize(
    ("node", "seconds"), [("recorder", 2.0), ("robot", 5.0), ("world_simulator", 8.0)]
)
def test_a_process_that_stands_still_costs_no_message(start, tmp_path, node, seconds):
    """At full speed. A robot is left out after `step_timeout`, and comes back."""
    out = tmp_path / "run"
    words = ("run", "env1", "--processes", "--steps", "6000", "--out", str(out))
    team = start("cli.main", *words)
    team.wait_for("steps, seed")
    time.sleep(1.0)
    process = team.child(node)
    process.send_signal(signal.SIGSTOP)
    time.sleep(seconds)
    process.send_signal(signal.SIGCONT)
    assert team.exit_code() == 0, team.output
    found = verify(out)
    assert found.same, found.first
