# Copyright 2026 The sparse_coord_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Killed recorders, writers and teams, and full disks: the run continues, the bag is readable."""

import os
import re
import select
import shutil
import signal
import time
from contextlib import closing
from dataclasses import replace
from pathlib import Path

import pytest
import yaml
from live_teams import child_of
from patience import PATIENCE_SECONDS
from recordings import write_run
from teams import tables_in

import sparse_coord_ros
from sparse_coord_ros.base.errors import BagError, RunError
from sparse_coord_ros.core.game.scenario import load_scenario
from sparse_coord_ros.core.runs.history import load_history
from sparse_coord_ros.core.runs.run_config import load_run, make_run
from sparse_coord_ros.log.bags import BagWriter, open_bag
from sparse_coord_ros.protocol.lockstep.world_side import WorldSide
from sparse_coord_ros.ros.nodes.recorder import BagProcess, Recorder
from sparse_coord_ros.ros.nodes.spin import ros_context
from sparse_coord_ros.ros.nodes.team import run_team

FULL = 60_000
"""Bytes of a file at which the disk is full."""
STEPS_UNTIL_FULL = 700
"""More time steps than such a file holds."""
WRITER = "sparse_coord_ros.log.bags.process"
PERIOD_NS = 100_000_000
NEVER = {"flush_seconds": 3600.0, "flush_steps": 10_000_000}
"""Of a recorder that flushes only where a test wants it."""


def last_step(bag):
    """Return the last time step in a bag; 0 without one."""
    if not any(bag.glob("*.mcap*")):
        return 0
    times = (
        message.log_time_ns
        for message in open_bag(bag).messages(["/robot_1/local_state"])
    )
    return max(times, default=0) // PERIOD_NS


def transitions_told(process):
    """Return the numbers of transitions in the progress lines of a run."""
    return [
        int(number) for number in re.findall(r"(\d+) of \d+ steps, ", process.output)
    ]


def assert_ends(pid_file_descriptor):
    """Check that a process that is no child of the test's ends soon."""
    ended, _, _ = select.select([pid_file_descriptor], [], [], PATIENCE_SECONDS)
    assert ended, "it goes on"


def assert_run_is_whole(out, transitions, *, error):
    summary = yaml.safe_load((out / "summary.yaml").read_text())
    assert summary["transitions"] == transitions
    assert summary["timeouts"] == 0
    assert not summary["interrupted"]
    assert re.search(error, summary["recording_error"])
    assert len(tables_in(out)) == 2


def test_a_killed_run_keeps_what_was_recorded_but_for_the_last_second(start, tmp_path):
    """A bag of 20 time steps a second is flushed by time; nothing else would write any of them."""
    out = tmp_path / "out"
    process = start("cli.main", "run", "env1", "--rate", "20", "--out", str(out))
    process.wait_for(" of 10000 steps, ")
    first = transitions_told(process)[0]
    deadline = time.monotonic() + PATIENCE_SECONDS
    while last_step(out / "bag") < first:
        assert time.monotonic() < deadline, "what was told is not flushed"
        time.sleep(0.05)
    writer = os.pidfd_open(child_of(process.pid, WRITER))
    try:
        process.send_signal(signal.SIGKILL)
        assert process.exit_code() == -signal.SIGKILL
        assert_ends(writer)
    finally:
        os.close(writer)
    assert [path.name for path in (out / "bag").iterdir()] == ["bag_0.mcap.partial"]
    bag = open_bag(out / "bag")
    assert (bag.finished, bag.damage) == (False, None)
    assert last_step(out / "bag") >= first >= 15


def test_a_run_goes_on_when_its_writer_is_killed(tmp_path, monkeypatch):
    out = tmp_path / "out"
    killed = []

    def look():
        if not killed and last_step(out / "bag") > 0:
            killed.append(child_of(os.getpid(), WRITER))
            os.kill(killed[0], signal.SIGKILL)
        return False

    values = {"scenario": "env1", "steps": 150, "rate": 150.0, "record": True}
    more = {"out": str(out)}
    monkeypatch.setattr(Recorder, "flush_steps", 10)
    with ros_context() as context:
        summary = run_team({**values, **more}, context=context, stop=look)
    error = f"^the writer process of the bag {out / 'bag'} has ended; the rec"
    assert re.search(error, summary["recording_error"])
    assert_run_is_whole(out, 150, error=error)
    bag = open_bag(out / "bag")
    assert (bag.finished, bag.damage) == (False, None)
    assert 0 < last_step(out / "bag") < 150


@pytest.mark.long
def test_a_run_goes_on_when_its_recorder_is_killed(start, tmp_path):
    out = tmp_path / "out"
    arguments = ["--steps", "60", "--rate", "100", "--out", str(out), "--processes"]
    process = start("cli.main", "run", "env1", *arguments)
    process.wait_for("env1: 2 robots, 60 steps, seed 0")
    process.child("recorder").send_signal(signal.SIGKILL)
    assert process.exit_code() == 2, process.output
    assert "Traceback" not in process.output
    assert process.output.splitlines()[-1].startswith(
        "error: recorder ended with exit code -9"
    )
    assert_run_is_whole(out, 60, error="^recorder ended with exit code -9")
    assert not open_bag(out / "bag").finished


@pytest.fixture
def full_disk(tmp_path, monkeypatch):
    """Let the disk be full for the processes of a test: a limit of a file's size stands for it."""
    limit = (
        "import resource, signal; signal.signal(signal.SIGXFSZ, signal.SIG_IGN); "
        f"resource.setrlimit(resource.RLIMIT_FSIZE, ({FULL}, {FULL}))\n"
    )
    (tmp_path / "site").mkdir()
    (tmp_path / "site" / "sitecustomize.py").write_text(limit)
    path = f"{tmp_path / 'site'}:{Path(sparse_coord_ros.__file__).parents[1]}"
    monkeypatch.setenv("PYTHONPATH", path)


def assert_bag_is_cut(bag):
    bag = open_bag(bag)
    assert (bag.finished, bag.damage) == (False, None)
    assert sum(1 for _ in bag.messages()) > 100


def test_a_full_disk_ends_the_recording_but_not_the_run(start, tmp_path, full_disk):
    out = tmp_path / "out"
    arguments = [
        "--steps",
        str(STEPS_UNTIL_FULL),
        "--out",
        str(out),
    ]
    process = start("cli.main", "run", "env1", *arguments)
    assert process.exit_code() == 2, process.output
    assert "Traceback" not in process.output
    assert process.output.count("cannot write") >= 1
    assert process.output.splitlines()[-1].startswith("error: ")
    error = "^cannot write .*File too large"
    assert_run_is_whole(out, STEPS_UNTIL_FULL, error=error)
    assert_bag_is_cut(out / "bag")


def test_a_bag_that_breaks_before_the_first_step_does_not_hold_up_the_run(
    tmp_path, monkeypatch
):
    class Broken(BagProcess):
        def flush(self):
            raise BagError("cannot write")

    monkeypatch.setattr("sparse_coord_ros.ros.nodes.recorder.BagProcess", Broken)
    out = tmp_path / "out"
    values = {"scenario": "env1", "steps": 30, "out": str(out), "record": True}
    with ros_context() as context:
        summary = run_team(values, context=context)
    assert (summary["transitions"], summary["recording_error"]) == (30, "cannot write")
    assert open_bag(out / "bag").metadata["sparse_coord_ros"]["scenario"] == "env1"


def a_recorded_bench(bench, bag, steps, **flush):
    """Run that many steps or a few more, then let the world stand still; return its time step."""
    world = bench.world(recorded=True)
    recorder = bench.recorder(bag)
    vars(recorder).update({**NEVER, **flush})
    bench.robots()
    bench.spin_until(lambda: world.lockstep.world.step >= steps, "steps")
    world.values["rate"] = 0.001
    bench.spin_until(lambda: world.lockstep.complete, "all have acted")
    return world.lockstep.world.step, recorder


def test_flush_steps_bounds_what_an_unfinished_bag_lacks(bench, tmp_path):
    step, recorder = a_recorded_bench(bench, tmp_path / "bag", 30, flush_steps=10)
    bench.spin_until(lambda: step - last_step(tmp_path / "bag") < 10, "flushed")
    assert recorder.error is None


def test_flush_seconds_bounds_what_an_unfinished_bag_lacks(bench, tmp_path):
    step, recorder = a_recorded_bench(bench, tmp_path / "bag", 30, flush_seconds=0.1)
    bench.spin_until(lambda: last_step(tmp_path / "bag") == step, "flushed")
    assert recorder.error is None


def test_a_bag_of_another_run_is_not_continued(bench, tmp_path):
    run = replace(make_run(load_scenario("env1"), {}), id="another")
    with closing(BagWriter(tmp_path / "bag")) as writer:
        write_run(writer, run)
    bench.world(recorded=True)
    bench.recorder(tmp_path / "bag")
    with pytest.raises(RunError, match=str(tmp_path / "bag")):
        bench.spin_until(lambda: False)


def test_a_recording_leaves_room_for_the_tables(bench, tmp_path, monkeypatch):
    monkeypatch.setattr("sparse_coord_ros.ros.nodes.recorder.KEPT_FREE", 1 << 60)
    world = bench.world(recorded=True, steps=60)
    recorder = bench.recorder(tmp_path / "bag")
    recorder.flush_steps = 5
    bench.robots()
    with pytest.raises(BagError, match=r"its disk has \d+ MiB left"):
        bench.spin_until(lambda: False)  # the recorder's exit code is 2
    assert world.done and world.summary()["transitions"] == 60
    assert open_bag(tmp_path / "bag").finished


def test_an_output_directory_that_is_deleted_is_made_again(
    tmp_path, capfd, monkeypatch
):
    """Tables, history and summary are all there, the bag is lost; one line a node says so."""
    out = tmp_path / "out"

    deleted = []

    class Deleting(WorldSide):
        def advance(self):
            super().advance()
            if self.world.transitions == 20:
                deleted.append(shutil.rmtree(out))

    values = {"scenario": "env1", "out": str(out), "record": True}
    monkeypatch.setattr(
        "sparse_coord_ros.ros.nodes.world_simulator.WorldSide", Deleting
    )
    with ros_context() as context:
        summary = run_team({**values, "steps": 40}, context=context)
    assert deleted
    assert summary["recording_error"].endswith("was deleted while it was recorded")
    assert load_run(out).scenario.name == "env1"
    assert len(tables_in(out)) == 2
    assert load_history(out).length.sum() == 40
    assert "it was gone and was made again" in capfd.readouterr().err
