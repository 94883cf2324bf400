# Copyright 2026 The sparse_coord_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Nodes that are killed, restarted or interrupted: the others continue, without a loss."""

import re
import signal
import subprocess
import sys

import pytest
import yaml
from rosbags.highlevel import AnyReader
from teams import tables_in

from sparse_coord_ros.base.errors import RunError
from sparse_coord_ros.core.runs.history import load_history
from sparse_coord_ros.core.runs.saved_tables import load_saved, robot_file
from sparse_coord_ros.protocol.lockstep import timeouts
from sparse_coord_ros.ros.nodes import follower, recorder, robot, world_simulator


def assert_bag_is_whole(bag):
    assert (bag / "metadata.yaml").exists()
    with AnyReader([bag]) as reader:
        count = sum(1 for _ in reader.messages())
        assert count == reader.message_count > 0


def assert_tables(path, number):
    q_star = load_saved(path, [number])[0].memory["q_star"]
    assert q_star.shape[1] == 5
    assert (q_star != 0).any()


def test_who_is_stopped_saves_what_it_has_and_the_others_go_on(
    bench, tmp_path, monkeypatch
):
    monkeypatch.setattr(follower, "STOP_SECONDS", 0.1)
    out = str(tmp_path)
    world = bench.world(out=out, recorded=True, rate=100.0, step_timeout=2.5)
    recorder = bench.recorder(tmp_path / "bag")
    one, other = bench.robots(out=out)

    def wait_for_steps(count=5):
        then = world.lockstep.world.step + count
        bench.spin_until(lambda: world.lockstep.world.step >= then, "steps go on")

    wait_for_steps(20)
    bench.stop(recorder)
    assert_bag_is_whole(tmp_path / "bag")
    wait_for_steps()

    bench.stop(other)
    assert_tables(robot_file(tmp_path, "robot_2"), 2)
    wait_for_steps()

    bench.stop(world)
    assert yaml.safe_load((tmp_path / "summary.yaml").read_text())["transitions"] >= 25
    bench.spin_until_done(one)
    assert_tables(robot_file(tmp_path, "robot_1"), 1)
    assert len(tables_in(tmp_path)) == 2


def test_a_world_that_lost_all_robots_says_that_it_waits_and_for_whom(
    bench, capfd, monkeypatch
):
    monkeypatch.setattr(timeouts, "REMIND_SECONDS", 0.3)
    world = bench.world(step_timeout=0.2)
    robots = bench.robots()
    bench.spin_until(lambda: world.lockstep.world.step > 9, "the run is under way")
    for one in robots:
        bench.destroy(one)
    said = []

    def reminded():
        said.append(capfd.readouterr().err)
        return re.search(r"\([1-9]\d* s\)", "".join(said))

    bench.spin_until(reminded, "it waits")
    text = "".join(said)
    step = world.lockstep.world.transitions
    assert re.search(
        rf"waiting for robot_1, robot_2 at step {step} \([1-9]\d* s\)", text
    )
    assert "continuing without" not in text


def test_the_team_ends_when_the_world_fails(bench, tmp_path):
    """One robot never comes: the world gives up, and the waiting nodes end too."""
    recorder = bench.recorder(tmp_path / "bag")
    robot = bench.robot("robot_1", out=str(tmp_path))
    world = bench.world()
    bench.spin_until(lambda: robot.presence and recorder.run, "they follow the run")
    world.startup_timeout = 0.001
    with pytest.raises(RunError, match="^after .* robot_2"):
        bench.spin_until(lambda: False)
    world.finish(interrupted=True)  # as `run_node` does
    bench.destroy(world)
    bench.spin_until_done(robot, recorder)
    assert not (tmp_path / "bag").exists()


MAINS = {
    "world_simulator": (world_simulator.main, ["scenario:=env1"]),
    "robot_1": (robot.main, []),
    "recorder": (recorder.main, ["out:={out}"]),
}
"""For each node its executable and its parameters."""


@pytest.mark.parametrize(
    ("name", "number"),
    [
        ("world_simulator", signal.SIGINT),
        ("robot_1", signal.SIGTERM),
        ("recorder", signal.SIGHUP),
    ],
)
def test_a_waiting_node_ends_well_on_a_signal(ended_by, tmp_path, name, number):
    main, parameters = MAINS[name]
    given = [one.format(out=tmp_path / "bag") for one in parameters]
    code, said = ended_by(main, number, name, *given)
    assert code == 0
    assert "Traceback" not in said and "FATAL" not in said
    assert not (tmp_path / "bag").exists()  # no world, no run, no bag


@pytest.mark.parametrize(
    ("name", "code", "number", "said"),
    [
        ("robot", 0, signal.SIGTERM, ""),
        ("robot", 0, signal.SIGHUP, ""),
        ("sparse_coord", 130, signal.SIGINT, "interrupted\n"),
    ],
)
def test_a_signal_while_modules_are_imported(name, code, number, said):
    """It comes before the import of ROS and NumPy; the signal replaces the import."""
    program = (
        "import os, sys, time; import sparse_coord_ros.executables as e\n"
        "e.importlib.import_module = lambda module: "
        f"(os.kill(os.getpid(), {int(number)}), time.sleep(3600))\n"
        f"sys.exit(e.main({name!r}))"
    )
    done = subprocess.run(
        [sys.executable, "-c", program], capture_output=True, text=True
    )
    assert (done.returncode, done.stdout, done.stderr) == (code, "", said)


def test_a_signal_while_a_verb_imports_ros_is_not_taken_for_a_missing_ros(tmp_path):
    """What rclpy raises where its C extension cannot be imported, even by an exception of ours."""
    program = (
        "import importlib.abc, os, signal, sys\n"
        "class Interrupted(importlib.abc.MetaPathFinder):\n"
        "    def find_spec(self, name, *more):\n"
        "        if name == 'rclpy':\n"
        "            try: os.kill(os.getpid(), signal.SIGINT)\n"
        "            except BaseException as error: raise ImportError(name) from error\n"
        "sys.meta_path.insert(0, Interrupted())\n"
        "import sparse_coord_ros.executables as e\n"
        f"sys.argv[1:] = ['run', 'env1', '--out', {str(tmp_path / 'out')!r}]\n"
        "sys.exit(e.sparse_coord())"
    )
    done = subprocess.run(
        [sys.executable, "-c", program], capture_output=True, text=True
    )
    assert (done.returncode, done.stderr) == (130, "interrupted\n")


@pytest.mark.long
@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM], ids=["INT", "TERM"])
@pytest.mark.parametrize(
    "processes", [[], ["--processes"]], ids=["one process", "processes"]
)
def test_run_ends_well_on_a_signal(start, tmp_path, number, processes):
    out = tmp_path / "out"
    arguments = ["--steps", "1000000", "--out", str(out), *processes]
    process = start("cli.main", "run", "env1", *arguments)
    process.wait_for(" of 1000000 steps, ")
    process.send_signal(number)
    assert process.exit_code() == 130, process.output
    assert "Traceback" not in process.output
    assert "FATAL" not in process.output
    assert_bag_is_whole(out / "bag")
    summary = yaml.safe_load((out / "summary.yaml").read_text())
    assert summary["interrupted"] is True
    assert 0 < summary["transitions"] < 1_000_000
    assert summary["timeouts"] == 0
    tables = tables_in(out)
    assert (tables[0].q_star != 0).any()
    assert load_history(out).length.sum() == summary["transitions"]
    assert {path.name for path in out.iterdir()} == {
        "bag",
        "checkpoint",
        "history.npz",
        "run.yaml",
        "summary.yaml",
        "tables.npz",
    }


@pytest.mark.long
def test_run_stops_the_others_when_a_node_is_killed(start, tmp_path):
    out = tmp_path / "out"
    arguments = [
        "--steps",
        "1000000",
        "--rate",
        "200",
        "--out",
        str(out),
        "--processes",
    ]
    process = start("cli.main", "run", "env1", *arguments)
    process.wait_for(" of 1000000 steps, ")
    victim = process.child("robot")
    victim.send_signal(signal.SIGKILL)
    assert process.exit_code() == 2, process.output
    assert "Traceback" not in process.output
    line = process.output.splitlines()[-1]
    assert line.startswith("error: robot_1 ended with exit code -9")
    assert line.endswith(f"; continue with: sparse_coord run --resume {out}")
    assert_tables(robot_file(out, "robot_2"), 2)
