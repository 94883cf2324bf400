# Copyright 2026 The sparse_coord_ros authors
# SPDX-License-Identifier: Apache-2.0
"""rosbag2's `metadata.yaml`, version 9 as ROS 2 Jazzy writes it.

The same information goes into the MCAP file itself as the metadata record `rosbag2`, so that a
bag file without its directory is still understood.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from sparse_coord_ros.bags.qos import QoS, yaml_text
from sparse_coord_ros.bags.topics import BagTopic

METADATA_FILE = "metadata.yaml"
METADATA_RECORD = "rosbag2"
RECOVERED_RECORD = "recovered"
"""Name of the metadata record that `recover` leaves in what it made of a broken bag."""
CONTINUED_RECORD = "continued"
"""Name of the metadata record of every file of a bag but the first: `why` it begins (see
`SPLIT`, `RESTARTED`, `ROLLED_BACK`); of one that takes the run back `step`, the checkpoint, and
`first`, the time step of the first local state after it."""
SPLIT, RESTARTED, ROLLED_BACK = "split", "restarted", "rolled_back"
"""Why a file begins: the one before was big or long enough; its recorder had ended; the run went
back to a checkpoint, and what the files before say from there on is superseded."""
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


def topic_summary(topic: BagTopic, count: int) -> TopicSummary:
    """Return what `metadata.yaml` says about a topic of so many messages."""
    return TopicSummary(topic.name, topic.type_name, count, topic.qos, topic.type_hash)


@dataclass(frozen=True)
class FileSummary:
    """What `metadata.yaml` says about one of the bag's files.

    Attributes:
        name: its name in the bag's directory.
        message_count: number of messages in it.
        start_ns, end_ns: log times of its earliest and latest message; ignored without any.
    """

    name: str
    message_count: int
    start_ns: int
    end_ns: int

    def as_mapping(self) -> dict[str, Any]:
        """Return the file's entry in `files`."""
        return {"path": self.name} | self.times() | {"message_count": self.message_count}

    def times(self) -> dict[str, Any]:
        """Return when it begins and how long it lasts."""
        start, length = _NO_START_NS, 0
        if self.message_count:
            start, length = self.start_ns, self.end_ns - self.start_ns
        return {
            "starting_time": {"nanoseconds_since_epoch": start},
            "duration": {"nanoseconds": length},
        }


def bag_information(
    files: Sequence[FileSummary],
    topics: Sequence[TopicSummary],
    *,
    custom_data: Mapping[str, str] | None = None,
    ros_distro: str = ROS_DISTRO,
) -> dict[str, Any]:
    """Return what rosbag2 stores about a bag, keys in rosbag2's order.

    Chunks are compressed inside the MCAP file, of which rosbag2 knows nothing: its compression
    fields, meant for whole files or single messages, stay empty.

    Args:
        files: its files, one after the other.
        topics: one summary a topic, in the order they are to be listed.
        custom_data: texts for `ros2 bag info` to show, none by default.
        ros_distro: name of the ROS distribution that recorded the bag.
    """
    filled = [file for file in files if file.message_count]
    whole = FileSummary(
        "",
        sum(file.message_count for file in files),
        min((file.start_ns for file in filled), default=0),
        max((file.end_ns for file in filled), default=0),
    )
    times = whole.times()
    return {
        "version": METADATA_VERSION,
        "storage_identifier": "mcap",
        "duration": times["duration"],
        "starting_time": times["starting_time"],
        "message_count": whole.message_count,
        "topics_with_message_count": [topic.as_mapping() for topic in topics],
        "compression_format": "",
        "compression_mode": "",
        "relative_file_paths": [file.name for file in files],
        "files": [file.as_mapping() for file in files],
        "custom_data": dict(custom_data) if custom_data else None,
        "ros_distro": ros_distro,
    }


def metadata_yaml(information: Mapping[str, Any]) -> str:
    """Return the text of `metadata.yaml` for a bag's information, without a final newline."""
    return yaml_text({"rosbag2_bagfile_information": dict(information)})
