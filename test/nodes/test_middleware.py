# Copyright 2026 The sparse_coord_ros authors
# SPDX-License-Identifier: Apache-2.0
"""What Fast DDS is told."""

import os
import subprocess
import sys
from pathlib import Path

import pytest

from sparse_coord_ros.nodes.middleware import PROFILES, one_host, repair_promptly

PUBLISH = """
import rclpy
from std_msgs.msg import String
from sparse_coord_ros.nodes.middleware import repair_promptly

repair_promptly()
rclpy.init()
node = rclpy.create_node("speaker")
node.create_publisher(String, "words", 10)
node.destroy_node()
rclpy.shutdown()
"""


def repaired() -> dict[str, str]:
    """Return the environment of a node that is started by hand."""
    repair_promptly()
    return dict(os.environ)


def test_the_profiles_of_the_user_stay(monkeypatch) -> None:
    monkeypatch.setenv(PROFILES, "own.xml")
    repair_promptly()
    assert os.environ[PROFILES] == "own.xml"


def test_a_team_on_one_host_has_profiles_of_its_own(monkeypatch) -> None:
    monkeypatch.setenv(PROFILES, "restored after the test")
    monkeypatch.delenv(PROFILES)
    repair_promptly()  # a run in this process before it changes nothing
    profiles = Path(one_host()[PROFILES])
    assert profiles.name == "fastdds_one_host.xml"
    assert profiles.read_text() != Path(os.environ[PROFILES]).read_text()
    monkeypatch.setenv(PROFILES, "own.xml")
    assert one_host() == os.environ


@pytest.mark.parametrize("environment", [one_host, repaired])
def test_fast_dds_understands_the_profiles(monkeypatch, tmp_path, environment) -> None:
    def printed() -> str:
        done = subprocess.run([sys.executable, "-c", PUBLISH], capture_output=True, text=True)
        assert done.returncode == 0, done.stderr
        return done.stdout + done.stderr

    monkeypatch.setenv(PROFILES, "restored after the test")
    monkeypatch.delenv(PROFILES)
    monkeypatch.setenv(PROFILES, environment()[PROFILES])
    assert printed() == ""
    profiles = Path(os.environ[PROFILES]).read_text()
    bad = tmp_path / "bad.xml"
    bad.write_text(profiles.replace("heartbeatPeriod", "heartbeat"))
    monkeypatch.setenv(PROFILES, str(bad))
    assert "XMLPARSER" in printed()
