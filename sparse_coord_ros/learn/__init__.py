# Copyright 2026 The sparse_coord_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The algorithm, the game and the evaluation; needs no ROS."""
