# Copyright 2026 The sparse_coord_ros authors
# SPDX-License-Identifier: Apache-2.0
"""MCAP bags in rosbag2's layout, written and read without rclpy."""

from sparse_coord_ros.errors import BagError
from sparse_coord_ros.recording.metadata import TopicSummary, bag_information, metadata_yaml
from sparse_coord_ros.recording.qos import QoS, offered_qos_profiles
from sparse_coord_ros.recording.reader import Attachment, Attachments, Bag, Message, open_bag
from sparse_coord_ros.recording.schemas import schema_text, type_hash
from sparse_coord_ros.recording.topics import BagTopic
from sparse_coord_ros.recording.writer import BagWriter

__all__ = [
    "Attachment",
    "Attachments",
    "Bag",
    "BagError",
    "BagWriter",
    "Message",
    "QoS",
    "BagTopic",
    "TopicSummary",
    "bag_information",
    "metadata_yaml",
    "offered_qos_profiles",
    "open_bag",
    "schema_text",
    "type_hash",
]
