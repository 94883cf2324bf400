# Copyright 2026 The sparse_coord_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The launch files with the real `ros2 launch`: where ROS and this package are installed."""

import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest
import yaml
from patience import PATIENCE_SECONDS

pytest.importorskip("launch_ros")
pytest.importorskip("ros2launch")

from sparse_coord_ros.log.runlog.verify import verify  # noqa: E402

pytestmark = [pytest.mark.long, pytest.mark.timeout(300)]
LAUNCH = Path(__file__).parents[2] / "launch"

OUTER = """\
import sys

from launch import LaunchDescription
from launch.actions import ExecuteProcess, GroupAction, IncludeLaunchDescription
from launch.launch_description_sources import PythonLaunchDescriptionSource
from launch_ros.actions import PushRosNamespace

CLOCK = '''
import time, rclpy
from rosgraph_msgs.msg import Clock
rclpy.init()
node = rclpy.create_node("third")
clock = node.create_publisher(Clock, "/clock", 10)
end, said = time.monotonic() + {seconds}, Clock()
while time.monotonic() < end:
    said.clock.sec += 1000
    clock.publish(said)
    time.sleep(0.02)
rclpy.shutdown()
print("the third one ended well", flush=True)
'''


def fleet(name):
    given = {{"set": "steps={steps}", "rate": "{rate}", "out": "{out}/" + name}}
    source = PythonLaunchDescriptionSource("{launch}/team.launch.py")
    included = IncludeLaunchDescription(source, launch_arguments=given.items())
    return GroupAction([PushRosNamespace(name), included])


def generate_launch_description():
    third = ExecuteProcess(cmd=[sys.executable, "-c", CLOCK], output="screen")
    return LaunchDescription([third, fleet("a"), fleet("b")])
"""


class Launched:
    """The real command, in a session of its own: it signals its whole group."""

    def __init__(self, log, *arguments):
        self._log = log
        code = "import sys; from ros2cli.cli import main; sys.exit(main())"
        command = [sys.executable, "-c", code, "launch", *map(str, arguments)]
        with log.open("w") as file:
            self._popen = subprocess.Popen(
                command, stdout=file, stderr=subprocess.STDOUT, start_new_session=True
            )

    @property
    def output(self):
        return self._log.read_text(errors="replace")

    def ends(self, seconds=PATIENCE_SECONDS):
        try:
            return self._popen.wait(seconds)
        except subprocess.TimeoutExpired:
            os.killpg(self._popen.pid, signal.SIGKILL)
            raise


@pytest.fixture
def ros2_launch(tmp_path):
    return lambda *arguments: Launched(tmp_path / "launch.log", *arguments)


def test_an_argument_wins_over_the_file_also_where_it_is_the_default(
    ros2_launch, tmp_path
):
    file = tmp_path / "p.yaml"
    out = tmp_path / "run"
    file.write_text(
        "world_simulator:\n  ros__parameters: {penalty: -55.0, seed: 7, steps: 200}\n"
    )
    given = (
        "set:=penalty=-11",
        "seed:=0",
        f"params_file:={file}",
        f"out:={out}",
    )
    assert ros2_launch(LAUNCH / "team.launch.py", *given).ends() == 0
    run = yaml.safe_load((out / "run.yaml").read_text())
    said = run["scenario"]
    assert (said["penalty"], said["steps"], run["seed"]) == (-11.0, 200, 0)
    launched = ros2_launch(LAUNCH / "team.launch.py", f"out:={out}")
    launched.ends()
    assert "holds another run" in launched.output


def test_a_misspelt_value_ends_the_launch_in_one_line(ros2_launch, tmp_path):
    given = ("greedy:=ture", "record:=flase", f"out:={tmp_path / 'run'}")
    launched = ros2_launch(LAUNCH / "team.launch.py", *given)
    assert launched.ends() == 1
    assert "argument greedy: value is 'ture', allowed: true or false" in launched.output
    assert not (tmp_path / "run").exists()


@pytest.fixture
def outer(ros2_launch, tmp_path):
    """Return a function that launches two fleets beside a third process."""

    def launch(**values):
        file = tmp_path / "outer.launch.py"
        file.write_text(OUTER.format(out=tmp_path, launch=LAUNCH, **values))
        return ros2_launch(file)

    return launch


def test_two_fleets_beside_an_outside_clock_do_not_disturb_each_other(outer, tmp_path):
    launched = outer(steps=300, rate=0.0, seconds=20)
    assert launched.ends() == 0 and "the third one ended well" in launched.output
    for name in ("a", "b"):
        assert verify(tmp_path / name / "bag").same


def test_a_fleet_that_fails_ends_alone(outer, tmp_path):
    launched = outer(steps=3000, rate=150.0, seconds=30)
    deadline = time.monotonic() + PATIENCE_SECONDS
    while not all((tmp_path / name / "bag").exists() for name in ("a", "b")):
        assert time.monotonic() < deadline, launched.output
        time.sleep(0.1)
    mark = "[world_simulator-2]: process started with pid ["
    os.kill(int(launched.output.partition(mark)[2].partition("]")[0]), signal.SIGKILL)
    assert launched.ends() == 0
    assert "the third one ended well" in launched.output
    assert verify(tmp_path / "b" / "bag").same


def test_in_a_namespace_drivers_find_their_bodies_by_tf(ros2_launch, tmp_path):
    pytest.importorskip("tf2_msgs")
    out = tmp_path / "run"
    given = (
        "namespace:=a",
        "pose_type:=tf",
        "set:=steps=40,starts=fixed",
        f"out:={out}",
    )
    launched = ros2_launch(LAUNCH / "bodies.launch.py", *given)
    assert launched.ends() == 0, launched.output
    assert verify(out / "bag").same
    assert yaml.safe_load((out / "summary.yaml").read_text())["moves_failed"] == 0
