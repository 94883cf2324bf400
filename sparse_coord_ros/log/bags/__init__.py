# Copyright 2026 The sparse_coord_ros authors
# SPDX-License-Identifier: Apache-2.0
"""MCAP bags in rosbag2's layout, written and read without rclpy."""

from sparse_coord_ros.log.bags.reader import Bag, Message, open_bag
from sparse_coord_ros.log.bags.schemas import type_hash
from sparse_coord_ros.log.bags.topics import BagTopic, QoS
from sparse_coord_ros.log.bags.writer import BagWriter

__all__ = ["Bag", "BagTopic", "BagWriter", "Message", "QoS", "open_bag", "type_hash"]
