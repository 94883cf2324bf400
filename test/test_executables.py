# Copyright 2026 The sparse_coord_ros authors
# SPDX-License-Identifier: Apache-2.0
"""What an installation puts where: one command on the PATH, the nodes where `ros2 run` looks."""

import re
import subprocess
import sys
from pathlib import Path

import pytest

from sparse_coord_ros.executables import NODES

ROOT = Path(__file__).parents[1]


def test_every_node_has_a_script_for_ros2_run():
    assert sorted(path.name for path in (ROOT / "scripts").iterdir()) == sorted(NODES)
    assert {path.resolve() for path in (ROOT / "scripts").iterdir()} == {
        ROOT / "resource/node"
    }


def test_only_one_command_is_on_the_path():
    said = (ROOT / "setup.py").read_text()
    assert re.findall(r'"(\w+) = [\w.]+:\w+"', said) == ["sparse_coord"]


def test_setup_runs_from_a_folder_of_links(tmp_path):
    """As `colcon build --symlink-install` makes one."""
    (tmp_path / "setup.py").symlink_to(ROOT / "setup.py")
    command = [sys.executable, "setup.py", "--name"]
    done = subprocess.run(command, cwd=tmp_path, capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
    assert done.stdout.split() == ["sparse_coord_ros"]


@pytest.mark.parametrize(
    "command", [["scripts/robot"], ["-m", "sparse_coord_ros.executables", "robot"]]
)
def test_a_script_runs_the_node_of_its_name(command):
    pytest.importorskip("rclpy")
    wrong = ["--ros-args", "-p", "colour:=red"]
    done = subprocess.run(
        [sys.executable, *command, *wrong], cwd=ROOT, capture_output=True, text=True
    )
    assert done.returncode == 2
    assert done.stderr.startswith(
        "error: node robot: unknown parameter 'colour'; allowed: "
    )


def test_an_unknown_executable_is_one_line():
    command = [sys.executable, "-m", "sparse_coord_ros.executables", "wheel"]
    done = subprocess.run(command, cwd=ROOT, capture_output=True, text=True)
    assert done.returncode == 2 and done.stderr.startswith(
        "error: give the name of an exec"
    )
