# Copyright 2026 The sparse_coord_ros authors
# SPDX-License-Identifier: Apache-2.0
"""MCAP bags in rosbag2's layout, written and read without rclpy."""

from sparse_coord_ros.bags.contents import Attachment
from sparse_coord_ros.bags.metadata import bag_information, metadata_yaml
from sparse_coord_ros.bags.qos import QoS, offered_qos_profiles
from sparse_coord_ros.bags.reader import Bag, Message, open_bag
from sparse_coord_ros.bags.schemas import schema_text, type_hash
from sparse_coord_ros.bags.topics import BagTopic
from sparse_coord_ros.bags.writer import BagWriter
from sparse_coord_ros.errors import BagError

__all__ = [
    "Attachment",
    "Bag",
    "BagError",
    "BagWriter",
    "Message",
    "QoS",
    "BagTopic",
    "bag_information",
    "metadata_yaml",
    "offered_qos_profiles",
    "open_bag",
    "schema_text",
    "type_hash",
]
