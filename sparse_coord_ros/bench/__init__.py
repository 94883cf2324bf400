# Copyright 2026 The sparse_coord_ros authors
# SPDX-License-Identifier: Apache-2.0
"""How fast a team learns, and how fast bare rclpy nodes could pass its messages."""
