# Copyright 2026 The sparse_coord_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The settings of Fast DDS."""

import subprocess
import sys
from pathlib import Path
from xml.etree import ElementTree

import pytest
from patience import PATIENCE_SECONDS

from sparse_coord_ros.base.errors import RunError
from sparse_coord_ros.base.share import share_folder
from sparse_coord_ros.ros.nodes.environment import (
    PROFILES,
    RANGE,
    SECURITY_MARK,
    check_security,
    use_udp,
)
from sparse_coord_ros.ros.nodes.robot import GHOST_SECONDS

MAPS = """
from rclpy.node import Node
from sparse_coord_ros.ros.doctor.round_trip import uses_shared_memory
from sparse_coord_ros.ros.nodes.spin import ros_context

with ros_context() as context:
    Node("speaker", context=context)
    print(uses_shared_memory())
"""

LATE_READER = """
import time

from rclpy.node import Node
from std_msgs.msg import Int32
from rclpy.qos import QoSProfile
from sparse_coord_ros.ros.nodes.spin import make_executor, ros_context

with ros_context() as context:
    executor = make_executor(context)
    speaker = Node("speaker", context=context)
    publisher = speaker.create_publisher(Int32, "numbers", QoSProfile(depth=10_000))
    for number in range({before}):
        publisher.publish(Int32(data=number))
    listener = Node("listener", context=context)
    executor.add_node(listener)
    heard = []
    listener.create_subscription(
        Int32, "numbers", lambda message: heard.append(message.data), QoSProfile(depth=10_000)
    )
    time.sleep(0.3)  # what a reader misses in its first 70 ms is sent again
    deadline = time.monotonic() + {seconds}
    publisher.publish(Int32(data=-1))
    while not heard and time.monotonic() < deadline:
        executor.spin_once(timeout_sec=0.05)
    print(heard)
    executor.shutdown()
"""

OWN = {PROFILES: "own.xml", RANGE: "LOCALHOST"}


@pytest.mark.parametrize(
    ("given", "expected"),
    [
        ({}, {PROFILES: "fastdds.xml"}),
        ({RANGE: "SUBNET"}, {PROFILES: "fastdds.xml", RANGE: "SUBNET"}),
        (
            {RANGE: "LOCALHOST"},
            {PROFILES: "fastdds_localhost.xml", RANGE: "SYSTEM_DEFAULT"},
        ),
        (OWN, OWN),
    ],
)
def test_nodes_use_udp_unless_the_user_has_chosen_profiles(given, expected) -> None:
    variables = dict(given)
    use_udp(variables)
    variables[PROFILES] = Path(variables[PROFILES]).name
    assert variables == expected


def elements(name):
    """Return the content of a file of profiles, without comments and spaces."""
    return ElementTree.canonicalize(
        from_file=share_folder("config") / name, strip_text=True
    )


NAMES_IN_3 = {
    "heartbeat_period": "heartbeatPeriod",
    "nack_response_delay": "nackResponseDelay",
    "nack_supression_duration": "nackSupressionDuration",
    "heartbeat_response_delay": "heartbeatResponseDelay",
}
ONLY_HERE = "<interfaceWhiteList><address>127.0.0.1</address></interfaceWhiteList>"


def test_the_four_files_of_profiles_say_the_same_but_for_what_they_are_for():
    for where in ("", "_localhost"):
        of_3 = elements(f"fastdds3{where}.xml")
        for new, old in NAMES_IN_3.items():
            of_3 = of_3.replace(new, old)
        assert of_3 == elements(f"fastdds{where}.xml")
    here = elements("fastdds_localhost.xml")
    assert ONLY_HERE in here
    here = here.replace(ONLY_HERE, "").replace("50000000", "10000000")
    assert here == elements("fastdds.xml")


@pytest.mark.parametrize("discovery_range", ["SUBNET", "LOCALHOST"])
def test_fast_dds_understands_the_profiles(discovery_range, monkeypatch, python):
    """It prints nothing, and its participant has no shared memory."""
    monkeypatch.setenv(PROFILES, "restored after the test")
    monkeypatch.delenv(PROFILES)
    monkeypatch.setenv(RANGE, discovery_range)
    done = python("-c", MAPS)
    assert (done.stdout, done.stderr) == ("False\n", "")


def test_a_reader_that_begins_late_hears_a_writer_of_its_process(
    python,
) -> None:
    """By default Fast DDS rejects a reader's first message after more than 5000 messages."""
    script = LATE_READER.format(before=5001, seconds=PATIENCE_SECONDS / 2)
    done = python("-c", script)
    assert done.stdout == "[-1]\n"


def test_security_is_refused_where_fast_dds_has_none(tmp_path, monkeypatch):
    library = tmp_path / "lib" / "libfastrtps.so"
    monkeypatch.setattr(sys, "prefix", str(tmp_path))
    monkeypatch.delenv("LD_LIBRARY_PATH", raising=False)
    check_security()
    monkeypatch.setenv("ROS_SECURITY_ENABLE", "true")
    check_security()  # no wheel: a build of the user's own
    library.parent.mkdir()
    library.write_bytes(b"without")
    with pytest.raises(RunError, match="DDS-Security"):
        check_security()
    library.write_bytes(b"with " + SECURITY_MARK)
    check_security()


LIVE = """
import sys
import rclpy

rclpy.init()
rclpy.spin(rclpy.create_node(sys.argv[1]))
"""


def test_a_killed_process_is_forgotten_before_a_robot_of_its_name_gives_up(bench):
    observer = bench.observer()
    killed = subprocess.Popen([sys.executable, "-c", LIVE, "killed"])
    there = lambda: "killed" in observer.get_node_names()  # noqa: E731
    bench.spin_until(there, "it is there")
    killed.kill()
    killed.wait()
    bench.spin_until(lambda: not there(), "it is forgotten", seconds=GHOST_SECONDS)
