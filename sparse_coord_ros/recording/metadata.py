# Copyright 2026 The sparse_coord_ros authors
# SPDX-License-Identifier: Apache-2.0
"""rosbag2's `metadata.yaml`, version 9 as ROS 2 Jazzy writes it.

The same information goes into the MCAP file itself as the metadata record `rosbag2`, so that a
bag file without its directory is still understood.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from sparse_coord_ros.recording.qos import QoS, yaml_text

METADATA_FILE = "metadata.yaml"
METADATA_RECORD = "rosbag2"
RECOVERED_RECORD = "recovered"
"""Name of the metadata record that `recover` leaves in what it made of a broken bag."""
METADATA_VERSION = 9
ROS_DISTRO = "jazzy"

# rosbag2 leaves the largest time point as starting time of a bag without messages.
_NO_START_NS = 2**63 - 1


@dataclass(frozen=True)
class TopicSummary:
    """What `metadata.yaml` says about one topic.

    Attributes:
        name: the topic's full name, with a leading slash.
        type_name: its message type, e.g. `nav_msgs/msg/Path`.
        message_count: number of messages in the bag.
        qos: the profile of each publisher.
        type_hash: the type's RIHS01 hash, empty if unknown.
    """

    name: str
    type_name: str
    message_count: int
    qos: tuple[QoS, ...] = (QoS(),)
    type_hash: str = ""

    def as_mapping(self) -> dict[str, Any]:
        """Return the topic's entry in `topics_with_message_count`."""
        return {
            "topic_metadata": {
                "name": self.name,
                "type": self.type_name,
                "serialization_format": "cdr",
                "offered_qos_profiles": [profile.as_mapping() for profile in self.qos],
                "type_description_hash": self.type_hash,
            },
            "message_count": self.message_count,
        }


def bag_information(
    file_name: str,
    topics: Sequence[TopicSummary],
    *,
    start_time_ns: int,
    end_time_ns: int,
    custom_data: Mapping[str, str] | None = None,
    ros_distro: str = ROS_DISTRO,
) -> dict[str, Any]:
    """Return what rosbag2 stores about a bag of one MCAP file, keys in rosbag2's order.

    Chunks are compressed inside the MCAP file, of which rosbag2 knows nothing: its compression
    fields, meant for whole files or single messages, stay empty.

    Args:
        file_name: name of the MCAP file in the bag's directory.
        topics: one summary a topic, in the order they are to be listed.
        start_time_ns: log time of the earliest message; ignored if there is no message.
        end_time_ns: log time of the latest message; ignored if there is no message.
        custom_data: texts for `ros2 bag info` to show, none by default.
        ros_distro: name of the ROS distribution that recorded the bag.
    """
    message_count = sum(topic.message_count for topic in topics)
    duration = {"nanoseconds": end_time_ns - start_time_ns if message_count else 0}
    starting_time = {"nanoseconds_since_epoch": start_time_ns if message_count else _NO_START_NS}
    return {
        "version": METADATA_VERSION,
        "storage_identifier": "mcap",
        "duration": duration,
        "starting_time": starting_time,
        "message_count": message_count,
        "topics_with_message_count": [topic.as_mapping() for topic in topics],
        "compression_format": "",
        "compression_mode": "",
        "relative_file_paths": [file_name],
        "files": [
            {
                "path": file_name,
                "starting_time": starting_time,
                "duration": duration,
                "message_count": message_count,
            }
        ],
        "custom_data": dict(custom_data) if custom_data else None,
        "ros_distro": ros_distro,
    }


def metadata_yaml(information: Mapping[str, Any]) -> str:
    """Return the text of `metadata.yaml` for a bag's information, without a final newline."""
    return yaml_text({"rosbag2_bagfile_information": dict(information)})
