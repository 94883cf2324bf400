# Copyright 2026 The sparse_coord_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Bodies that make the moves: who steers them, and a simulator of them, without ROS."""
