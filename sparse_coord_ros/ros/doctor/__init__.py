# Copyright 2026 The sparse_coord_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Checks of `sparse_coord doctor`: installation, places to write, network, and ROS 2."""
