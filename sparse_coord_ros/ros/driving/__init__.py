# Copyright 2026 The sparse_coord_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The nodes of robots' bodies: drivers by cmd_vel and by Nav2, and simulations of both.

`driver_node` is the base of both drivers' nodes. `driver` steers a base by cmd_vel, `nav2_driver`
by goals of NavigateToPose. `body` simulates bases, `nav2_stand_in` bases with Nav2. The decisions
are made in `lab.driving`, without ROS.
"""
