# Copyright 2026 The sparse_coord_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Recorded runs: written, read, verified and explained.

`bags` writes and reads MCAP files in the layout of rosbag2. `runlog` turns the messages of a bag
into arrays, and computes a run again to verify it. This part imports `protocol`, `core` and
`base`; it needs no ROS.
"""
