# Copyright 2026 The sparse_coord_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The ROS 2 nodes: adapters between messages and the state machines of `lockstep`."""
