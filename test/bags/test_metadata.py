# Copyright 2026 The sparse_coord_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The texts of metadata.yaml and of the QoS profiles, letter by letter as rosbag2 writes them."""

from textwrap import indent

import yaml

from sparse_coord_ros.log.bags import BagTopic, QoS
from sparse_coord_ros.log.bags.metadata import (
    FileSummary,
    bag_information,
    metadata_yaml,
    offered_qos_profiles,
)

LATCHED = QoS(durability="transient_local", depth=1)

LATCHED_TEXT = """\
- history: keep_last
  depth: 1
  reliability: reliable
  durability: transient_local
  deadline:
    sec: 9223372036
    nsec: 854775807
  lifespan:
    sec: 9223372036
    nsec: 854775807
  liveliness: automatic
  liveliness_lease_duration:
    sec: 9223372036
    nsec: 854775807
  avoid_ros_namespace_conventions: false"""

METADATA_TEXT = f"""\
rosbag2_bagfile_information:
  version: 9
  storage_identifier: mcap
  duration:
    nanoseconds: 250
  starting_time:
    nanoseconds_since_epoch: 1000
  message_count: 3
  topics_with_message_count:
    - topic_metadata:
        name: /map
        type: nav_msgs/msg/OccupancyGrid
        serialization_format: cdr
        offered_qos_profiles:
{indent(LATCHED_TEXT, " " * 10)}
        type_description_hash: RIHS01_ab
      message_count: 3
  compression_format: ""
  compression_mode: ""
  relative_file_paths:
    - run_0.mcap
  files:
    - path: run_0.mcap
      starting_time:
        nanoseconds_since_epoch: 1000
      duration:
        nanoseconds: 250
      message_count: 3
  custom_data: ~
  ros_distro: jazzy"""


def test_metadata_is_version_9_as_jazzy_writes_it():
    """Keys, order, layout and empty values."""
    topic = BagTopic("/map", "nav_msgs/msg/OccupancyGrid", "", (LATCHED,), "RIHS01_ab")
    information = bag_information(
        [FileSummary("run_0.mcap", {"/map": 3}, 1000, 1250)], [topic]
    )
    assert metadata_yaml(information) == METADATA_TEXT


def test_bag_without_messages_starts_at_the_largest_time():
    """rosbag2's convention; a topic nobody published on is still listed."""
    topic = BagTopic("/chatter", "std_msgs/msg/String", "")
    information = bag_information([FileSummary("a_0.mcap", {}, 2**63 - 1, 0)], [topic])
    assert information["starting_time"] == {"nanoseconds_since_epoch": 2**63 - 1}
    assert information["duration"] == {"nanoseconds": 0}
    assert information["files"][0]["message_count"] == information["message_count"] == 0
    assert 'type_description_hash: ""' in metadata_yaml(information)
    none = bag_information([FileSummary("a_0.mcap", {}, 0, 0)], [])
    assert yaml.safe_load(metadata_yaml(none))["rosbag2_bagfile_information"] == none


def test_an_empty_file_has_no_say_in_when_a_bag_begins():
    files = [
        FileSummary("a_0.mcap", {}, 0, 0),
        FileSummary("a_1.mcap", {"/a": 2}, 500, 900),
    ]
    information = bag_information(files, [])
    assert information["starting_time"] == {"nanoseconds_since_epoch": 500}
    assert information["duration"] == {"nanoseconds": 400}


def test_qos_text_is_a_yaml_sequence_of_policies_by_name():
    """The version 9 text, one entry a publisher."""
    assert offered_qos_profiles((LATCHED,)) == LATCHED_TEXT
    assert offered_qos_profiles((LATCHED, LATCHED)) == f"{LATCHED_TEXT}\n{LATCHED_TEXT}"
    assert offered_qos_profiles(()) == "[]"
