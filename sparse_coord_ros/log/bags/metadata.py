# Copyright 2026 The sparse_coord_ros authors
# SPDX-License-Identifier: Apache-2.0
"""rosbag2's `metadata.yaml`, version 9 as ROS 2 Jazzy writes it.

The same information goes into the MCAP file itself as the metadata record `rosbag2`, so that a
bag file without its directory can still be read.
"""

import functools
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import yaml

from sparse_coord_ros.base.yaml_text import Dumper
from sparse_coord_ros.log.bags.topics import BagTopic, QoS

LATEST_NS = 2**63 - 1
"""rosbag2 stores times as signed 64 bit nanoseconds."""

METADATA_FILE = "metadata.yaml"
METADATA_RECORD = "rosbag2"


@dataclass(frozen=True)
class FileSummary:
    """The entry of one of the bag's files in `metadata.yaml`.

    Attributes:
        name: its name in the bag's directory.
        counts: number of messages by topic.
        start_ns, end_ns: log times of its earliest and latest message; ignored without any.
    """

    name: str
    counts: Mapping[str, int]
    start_ns: int
    end_ns: int

    @property
    def message_count(self) -> int:
        """Number of messages of all topics."""
        return sum(self.counts.values())


class _Rosbag2Dumper(Dumper):
    """PyYAML laid out as yaml-cpp does, so that bags compare equal to rosbag2's as text."""

    def increase_indent(self, flow: bool = False, indentless: bool = False) -> None:
        """Indent sequences below their key."""
        super().increase_indent(flow, False)


def _none(dumper: Any, _: None) -> Any:
    return dumper.represent_scalar("tag:yaml.org,2002:null", "~")


def _text(dumper: Any, text: str) -> Any:
    return dumper.represent_scalar(
        "tag:yaml.org,2002:str", text, style=None if text else '"'
    )


_Rosbag2Dumper.add_representer(type(None), _none)
_Rosbag2Dumper.add_representer(str, _text)


def yaml_text(value: Any) -> str:
    """Return a plain value as YAML in rosbag2's layout, without a final newline."""
    layout: dict[str, Any] = {
        "sort_keys": False,
        "default_flow_style": False,
        "width": 2**31,
    }
    return yaml.dump(value, Dumper=_Rosbag2Dumper, allow_unicode=True, **layout).rstrip(
        "\n"
    )


@functools.lru_cache
def offered_qos_profiles(profiles: tuple[QoS, ...]) -> str:
    """Return the profiles as the YAML text of a channel's `offered_qos_profiles`.

    Args:
        profiles: one profile for each publisher of the topic; none gives `[]`.

    Returns:
        A YAML sequence as rosbag2 (metadata version 9) writes it, without a final newline.
    """
    return yaml_text([profile.as_mapping() for profile in profiles])


def bag_information(
    files: Sequence[FileSummary], topics: Iterable[BagTopic]
) -> dict[str, Any]:
    """Return rosbag2's description of a bag, keys in rosbag2's order.

    MCAP compresses chunks inside the file. rosbag2's compression fields are for whole files or
    single messages, so they stay empty.

    Args:
        files: its files, one after the other.
        topics: its topics, in the order of the list.
    """
    whole = _times(files)
    return {
        "version": 9,
        "storage_identifier": "mcap",
        "duration": whole["duration"],
        "starting_time": whole["starting_time"],
        "message_count": sum(file.message_count for file in files),
        "topics_with_message_count": [
            {
                "topic_metadata": {
                    "name": topic.name,
                    "type": topic.type_name,
                    "serialization_format": "cdr",
                    "offered_qos_profiles": [
                        profile.as_mapping() for profile in topic.qos
                    ],
                    "type_description_hash": topic.type_hash,
                },
                "message_count": sum(file.counts.get(topic.name, 0) for file in files),
            }
            for topic in topics
        ],
        "compression_format": "",
        "compression_mode": "",
        "relative_file_paths": [file.name for file in files],
        "files": [
            {"path": file.name} | _times([file]) | {"message_count": file.message_count}
            for file in files
        ],
        "custom_data": None,
        "ros_distro": "jazzy",
    }


def _times(files: Sequence[FileSummary]) -> dict[str, dict[str, int]]:
    """Return the beginning and the duration of files."""
    filled = [file for file in files if file.message_count]
    start = LATEST_NS
    length = 0  # the start that rosbag2 writes for a bag without messages
    if filled:
        start = min(file.start_ns for file in filled)
        length = max(file.end_ns for file in filled) - start
    begin = {"nanoseconds_since_epoch": start}
    return {"starting_time": begin, "duration": {"nanoseconds": length}}


def metadata_yaml(information: Mapping[str, Any]) -> str:
    """Return the text of `metadata.yaml` for a bag's information, without a final newline."""
    return yaml_text({"rosbag2_bagfile_information": dict(information)})
