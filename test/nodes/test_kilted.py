# Copyright 2026 The sparse_coord_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The same team on ROS 2 Kilted, with its wheels from PyPI."""

import os
import subprocess
import sys
from importlib.metadata import requires
from pathlib import Path

import pytest

from sparse_coord_ros.ros.nodes.environment import PROFILES, PROFILES_3

pytestmark = [pytest.mark.long, pytest.mark.timeout(600)]
CHECKOUT = Path(__file__).parents[2]
OF_JAZZY = (
    PROFILES,
    PROFILES_3,
    "PYTHONPATH",
    "LD_LIBRARY_PATH",
    "_ROS_WHEELS_BOOTSTRAP_COMPLETE",
)
"""Variables by which the tests' own ROS 2 finds its libraries. With the last one the wheels of
Kilted would not set theirs."""

WHEELS = ("ros-kilted-rclpy[fastrtps]", "ros-kilted-common-interfaces")


@pytest.fixture(scope="module")
def kilted(tmp_path_factory):
    """Return a function that runs the command line with ROS 2 Kilted, and gives what it prints."""
    folder = tmp_path_factory.mktemp("kilted")
    needed = [one for one in requires("sparse_coord_ros") if "extra ==" not in one]
    subprocess.run([sys.executable, "-m", "venv", folder], check=True)
    python = folder / "bin" / "python"
    pip = [python, "-m", "pip", "install", "-q", "--disable-pip-version-check"]
    subprocess.run([*pip, *WHEELS, *needed], check=True)
    environment = {
        name: os.environ[name] for name in os.environ if name not in OF_JAZZY
    }
    environment["PYTHONPATH"] = str(CHECKOUT)
    environment["ROS_AUTOMATIC_DISCOVERY_RANGE"] = "LOCALHOST"

    def run(*words):
        command = [python, "-m", "sparse_coord_ros.executables", "sparse_coord", *words]
        done = subprocess.run(
            list(map(str, command)), env=environment, capture_output=True, text=True
        )
        assert done.returncode == 0, done.stdout + done.stderr
        assert "XMLPARSER" not in done.stdout + done.stderr
        return done.stdout

    return run


@pytest.mark.parametrize("ways", [(), ("--processes",)])
def test_a_team_runs_and_its_log_is_identical(kilted, tmp_path, ways):
    kilted("run", "env1", "--steps", "500", *ways, "--out", tmp_path / "run")
    assert "identical" in kilted("verify", tmp_path / "run")


def test_its_processes_talk_by_udp(kilted):
    assert "exchanged messages by UDP" in kilted("doctor")
