# Copyright 2026 The sparse_coord_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The lock step between world and robots, without ROS: waiting, repeating, timeouts."""
