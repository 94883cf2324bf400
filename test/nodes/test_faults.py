# Copyright 2026 The sparse_coord_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Nodes that are killed, restarted or interrupted: the others go on, and nothing is lost."""

import signal
import subprocess
import sys
from types import SimpleNamespace

import pytest
import yaml
from diagnostic_msgs.msg import DiagnosticStatus
from geometry_msgs.msg import PoseStamped
from rcl_interfaces.msg import Parameter, ParameterType, ParameterValue
from rcl_interfaces.srv import SetParameters
from rosbags.highlevel import AnyReader
from sensor_msgs.msg import JointState

from sparse_coord_ros.bags import open_bag
from sparse_coord_ros.bags.recover import recover
from sparse_coord_ros.game.scenario import load_scenario
from sparse_coord_ros.learn.history import load_history
from sparse_coord_ros.learn.tables import load_saved, load_tables, load_team, robot_file

SIGNALS = pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM], ids=["INT", "TERM"])
FAST = {"claim_window": 0.2}


class Team:
    """World, two robots and perhaps a recorder, each a process, and an observer of them."""

    def __init__(self, bench, start_node, out, *, record=False, **values):
        self._start, self._bench, self._out = start_node, bench, out
        self.observer = bench.observer()
        self.states = self.observer.listen(PoseStamped, "robot_1/local_state")
        self.actions = {
            name: self.observer.listen(JointState, f"{name}/action")
            for name in ("robot_1", "robot_2")
        }
        self.status = self.observer.listen(DiagnosticStatus, "status", latched=True)
        self.world = start_node(
            "world_simulator",
            "world_simulator",
            **{"scenario": "env1", "out": out, "recorded": record, **FAST, **values},
        )
        self.recorder = start_node("recorder", "recorder", out=out / "bag") if record else None
        self.robots = {name: self.start_robot(name) for name in ("robot_1", "robot_2")}

    def start_robot(self, name):
        return self._start("robot", name, out=self._out, **FAST)

    def wait_for_steps(self, count=5):
        """Wait for some more local states."""
        before = len(self.states)
        self._bench.spin_until(lambda: len(self.states) >= before + count, "steps go on")

    def unwatched(self):
        """Take the observer away: its readers' acknowledgements would be waited for."""
        self._bench.destroy(self.observer)

    def set_rate(self, rate):
        value = ParameterValue(type=ParameterType.PARAMETER_DOUBLE, double_value=rate)
        request = SetParameters.Request(parameters=[Parameter(name="rate", value=value)])
        response = self.observer.call(SetParameters, "world_simulator/set_parameters", request)
        assert response.results[0].successful


def steps(actions):
    return [round((m.header.stamp.sec + m.header.stamp.nanosec * 1e-9) / 0.1) for m in actions]


def assert_ended_well(process):
    assert process.exit_code() == 0, process.output
    assert "Traceback" not in process.output
    assert "FATAL" not in process.output


def assert_bag_is_whole(bag):
    assert (bag / "metadata.yaml").exists()
    with AnyReader([bag]) as reader:
        count = sum(1 for _ in reader.messages())
        assert count == reader.message_count > 0


def assert_tables(path, number):
    (tables,) = load_tables(path, [number])
    assert tables.q_star.shape[1] == 5
    assert (tables.q_star != 0).any()


@pytest.mark.long
def test_a_killed_robot_is_left_out_and_may_come_back(bench, start_node, tmp_path):
    values = {"set": ["steps=100000", "epsilon=constant:1"], "rate": 80.0}
    times = {"step_timeout": 0.6, "percept_timeout": 0.2}
    team = Team(bench, start_node, tmp_path, **values, **times)
    team.wait_for_steps()
    bench.spin_until(lambda: team.actions["robot_2"], "robot_2 is heard")

    team.robots["robot_2"].send_signal(signal.SIGKILL)
    assert team.robots["robot_2"].exit_code() == -signal.SIGKILL
    team.wait_for_steps(60)  # the barrier opens without it, and asks of it do not hold up
    alone = len(team.actions["robot_2"])
    last = steps(team.actions["robot_2"])[-1]
    team.wait_for_steps(10)
    assert len(team.actions["robot_2"]) == alone
    assert "robot_2 gone or silent for" in team.world.output
    assert not robot_file(tmp_path, "robot_2").exists()

    team.robots["robot_2"] = team.start_robot("robot_2")
    bench.spin_until(lambda: len(team.actions["robot_2"]) > alone + 20, "robot_2 acts again")
    assert steps(team.actions["robot_2"])[alone] > last + 60

    team.unwatched()
    team.world.send_signal(signal.SIGINT)
    for process in (team.world, *team.robots.values()):
        assert_ended_well(process)
    summary = yaml.safe_load((tmp_path / "summary.yaml").read_text())
    assert summary["timeouts"] >= 1
    assert load_saved(robot_file(tmp_path, "robot_1"), [1])[0].counts["late"] >= 1
    assert_tables(robot_file(tmp_path, "robot_1"), 1)
    assert_tables(robot_file(tmp_path, "robot_2"), 2)


def test_a_killed_team_leaves_a_readable_bag(bench, start_node, tmp_path):
    """It looks unfinished, for it is."""
    team = Team(bench, start_node, tmp_path, record=True, rate=100.0)
    team.wait_for_steps(20)
    for process in (team.recorder, team.world, *team.robots.values()):
        process.send_signal(signal.SIGKILL)
        assert process.exit_code() == -signal.SIGKILL
    assert [path.name for path in (tmp_path / "bag").iterdir()] == ["bag_0.mcap.partial"]
    assert not open_bag(tmp_path / "bag").finished
    recover(tmp_path / "bag")
    assert_bag_is_whole(tmp_path / "bag")


def test_nodes_end_well_on_a_signal(bench, start_node, tmp_path):
    number = signal.SIGTERM
    team = Team(bench, start_node, tmp_path, record=True, rate=100.0)
    team.wait_for_steps(20)

    team.recorder.send_signal(number)
    assert_ended_well(team.recorder)
    assert_bag_is_whole(tmp_path / "bag")
    team.wait_for_steps()

    team.robots["robot_2"].send_signal(number)
    assert_ended_well(team.robots["robot_2"])
    assert_tables(robot_file(tmp_path, "robot_2"), 2)
    team.wait_for_steps()

    team.unwatched()
    team.world.send_signal(number)
    assert_ended_well(team.world)
    assert yaml.safe_load((tmp_path / "summary.yaml").read_text())["transitions"] >= 25
    assert_ended_well(team.robots["robot_1"])
    assert_tables(robot_file(tmp_path, "robot_1"), 1)
    scenario = SimpleNamespace(robots=load_scenario("env1").robots)
    assert len(load_team(tmp_path, scenario)) == 2


def test_the_team_ends_when_the_world_fails(start_node, tmp_path):
    """One robot never comes: the world gives up, and who waited for it ends too."""
    robot = start_node("robot", "robot_1", out=tmp_path)
    recorder = start_node("recorder", "recorder", out=tmp_path / "bag")
    world = start_node("world_simulator", "world_simulator", scenario="env1", startup_timeout=3.0)
    assert world.exit_code() == 2
    assert "startup_timeout: after 3 s still no node for" in world.output
    for process in (robot, recorder):
        assert_ended_well(process)
    assert_bag_is_whole(tmp_path / "bag")


@pytest.mark.parametrize(
    ("name", "number"),
    [
        ("world_simulator", signal.SIGINT),
        ("robot", signal.SIGTERM),
        ("recorder", signal.SIGINT),
    ],
)
def test_a_waiting_node_ends_well_on_a_signal(start_node, bench, tmp_path, name, number):
    observer = bench.observer()
    more = {"world_simulator": {"scenario": "env1"}, "recorder": {"out": tmp_path / "bag"}}
    process = start_node(name, name, **more.get(name, {}))
    topic = {"world_simulator": "run", "robot": "robot/claim", "recorder": "diagnostics"}[name]
    bench.spin_until(lambda: observer.count(topic), "node is there")
    process.send_signal(number)
    assert_ended_well(process)
    assert not (tmp_path / "bag").exists()  # no world, no run, no bag


@pytest.mark.parametrize(
    ("name", "code", "number"),
    [
        ("robot", 0, signal.SIGTERM),
        ("robot", 0, signal.SIGHUP),
        ("sparse_coord", 130, signal.SIGINT),
    ],
)
def test_a_signal_while_modules_are_imported(name, code, number):
    """It comes before ROS and NumPy are there; the import is replaced by the signal."""
    program = (
        "import os, sys, time; import sparse_coord_ros.executables as e\n"
        "e.importlib.import_module = lambda module: "
        f"(os.kill(os.getpid(), {int(number)}), time.sleep(9))\n"
        f"sys.exit(e.main({name!r}))"
    )
    done = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True)
    assert (done.returncode, done.stdout, done.stderr) == (code, "", "")


@pytest.mark.long
@SIGNALS
@pytest.mark.parametrize("processes", [[], ["--processes"]], ids=["one process", "processes"])
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
    tables = load_team(out, load_scenario("env1"))
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
    arguments = ["--steps", "1000000", "--rate", "200", "--out", str(out), "--processes"]
    process = start("cli.main", "run", "env1", *arguments)
    process.wait_for(" of 1000000 steps, ")
    victim = process.child("robot")
    victim.send_signal(signal.SIGKILL)
    assert process.exit_code() == 2, process.output
    assert "Traceback" not in process.output
    line = process.output.splitlines()[-1]
    assert line.startswith("error: robot_1 ended with exit code -9")
    assert_tables(robot_file(out, "robot_2"), 2)
