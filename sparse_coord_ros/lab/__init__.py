# Copyright 2026 The sparse_coord_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Real buildings and real robots: maps from SLAM, and bodies that drive.

`maps` makes scenarios from maps that SLAM drew. `driving` moves a body from cell to cell, and
simulates bodies. This part imports `protocol`, `core` and `base`; it needs no ROS.
"""
