# Copyright 2026 The sparse_coord_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The settings of Fast DDS."""

import os
import subprocess
import sys
from pathlib import Path

import pytest
from patience import PATIENCE_SECONDS

from sparse_coord_ros.base.errors import RunError
from sparse_coord_ros.base.share import share_folder
from sparse_coord_ros.ros.nodes.environment import (
    PROFILES,
    SECURITY_MARK,
    check_participants,
    check_security,
    one_host,
    repair_promptly,
)
from sparse_coord_ros.ros.nodes.robot import GHOST_SECONDS

PUBLISH = """
import rclpy
from std_msgs.msg import String
from sparse_coord_ros.ros.nodes.environment import repair_promptly

repair_promptly()
rclpy.init()
node = rclpy.create_node("speaker")
node.create_publisher(String, "words", 10)
node.destroy_node()
rclpy.shutdown()
"""

LATE_READER = """
import time

from rclpy.node import Node
from std_msgs.msg import Int32
from sparse_coord_ros.ros.nodes.ros_topics import STEP_QOS
from sparse_coord_ros.ros.nodes.spin import make_executor, ros_context

with ros_context() as context:
    executor = make_executor(context)
    speaker = Node("speaker", context=context)
    publisher = speaker.create_publisher(Int32, "numbers", STEP_QOS)
    for number in range({before}):
        publisher.publish(Int32(data=number))
    listener = Node("listener", context=context)
    executor.add_node(listener)
    heard = []
    listener.create_subscription(
        Int32, "numbers", lambda message: heard.append(message.data), STEP_QOS
    )
    time.sleep(0.3)  # what a reader misses in its first 70 ms is sent again
    deadline = time.monotonic() + {seconds}
    publisher.publish(Int32(data=-1))
    while not heard and time.monotonic() < deadline:
        executor.spin_once(timeout_sec=0.05)
    print(heard)
    executor.shutdown()
"""

EMPTIES = """<?xml version="1.0" encoding="UTF-8" ?>
<dds xmlns="http://www.eprosima.com/XMLSchemas/fastRTPS_Profiles">
  <log>
    <use_default>FALSE</use_default>
    <consumer>
      <class>FileConsumer</class>
      <property><name>filename</name><value>{file}</value></property>
    </consumer>
  </log>
</dds>
"""


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


def test_fast_dds_understands_the_profiles(monkeypatch, tmp_path) -> None:
    monkeypatch.setenv(PROFILES, "restored after the test")
    monkeypatch.delenv(PROFILES)
    on_one_host = Path(one_host()[PROFILES])
    repair_promptly()
    by_hand = Path(os.environ[PROFILES])
    bad = tmp_path / "bad.xml"
    bad.write_text(by_hand.read_text().replace("heartbeatPeriod", "heartbeat"))
    for profiles in (on_one_host, by_hand, bad):
        monkeypatch.setenv(PROFILES, str(profiles))
        done = subprocess.run(
            [sys.executable, "-c", PUBLISH], capture_output=True, text=True
        )
        assert done.returncode == 0, done.stderr
        printed = done.stdout + done.stderr
        assert ("XMLPARSER" in printed) if profiles == bad else printed == ""


@pytest.mark.parametrize("profiles", ["fastdds.xml", "fastdds_one_host.xml"])
def test_a_reader_that_begins_late_hears_a_writer_of_its_process(
    profiles, monkeypatch, python
) -> None:
    """By default Fast DDS rejects a reader's first message after more than 5000 messages."""
    monkeypatch.setenv(PROFILES, str(share_folder("config") / profiles))
    script = LATE_READER.format(before=5001, seconds=PATIENCE_SECONDS / 2)
    done = python("-c", script)
    assert done.stdout == "[-1]\n"


def test_profiles_of_the_current_directory_are_not_taken(monkeypatch, tmp_path) -> None:
    """They may name any file of the user's, which Fast DDS then empties for its log."""
    monkeypatch.setenv("SKIP_DEFAULT_XML_FILE", "restored after the test")
    monkeypatch.delenv("SKIP_DEFAULT_XML_FILE")
    (victim := tmp_path / "victim").write_text("kept")
    for name in ("FASTRTPS", "FASTDDS"):
        (tmp_path / f"DEFAULT_{name}_PROFILES.xml").write_text(
            EMPTIES.format(file=victim)
        )
    command = [sys.executable, "-c", PUBLISH]
    subprocess.run(command, cwd=tmp_path, check=True, capture_output=True)
    assert victim.read_text() == "kept"


def test_security_is_refused_where_fast_dds_has_none(tmp_path, monkeypatch):
    library = tmp_path / "lib" / "libfastrtps.so"
    monkeypatch.setattr(sys, "prefix", str(tmp_path))
    check_security()
    monkeypatch.setenv("ROS_SECURITY_ENABLE", "true")
    check_security()  # no wheel: a build of the user's own
    library.parent.mkdir()
    library.write_bytes(b"without")
    with pytest.raises(RunError, match="DDS-Security"):
        check_security()
    library.write_bytes(b"with " + SECURITY_MARK)
    check_security()


def test_more_processes_than_find_each_other_are_refused(monkeypatch):
    monkeypatch.setenv("ROS_AUTOMATIC_DISCOVERY_RANGE", "LOCALHOST")
    check_participants(32)
    with pytest.raises(RunError, match="^34 nodes in processes"):
        check_participants(34)
    monkeypatch.setenv("ROS_AUTOMATIC_DISCOVERY_RANGE", "SUBNET")
    check_participants(34)


LIVE = """
import sys
import rclpy

rclpy.init()
rclpy.spin(rclpy.create_node(sys.argv[1]))
"""


def test_a_killed_process_is_forgotten_before_a_robot_of_its_name_gives_up(bench):
    observer = bench.observer()
    names = ("fastdds", "fastdds_one_host")
    killed = []
    for name in names:
        profiles = {PROFILES: str(share_folder("config") / f"{name}.xml")}
        command = [sys.executable, "-c", LIVE, name]
        killed.append(subprocess.Popen(command, env={**os.environ, **profiles}))
    bench.spin_until(lambda: {*names} <= {*observer.get_node_names()}, "all are there")
    for process in killed:
        process.kill()
        process.wait()
    gone = lambda: not {*names} & {*observer.get_node_names()}  # noqa: E731
    bench.spin_until(gone, "all are forgotten", seconds=GHOST_SECONDS)
