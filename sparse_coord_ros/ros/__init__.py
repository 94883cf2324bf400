# Copyright 2026 The sparse_coord_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Everything that imports rclpy: the nodes, their launch files, and the doctor.

`nodes` connects the state machines of `protocol.lockstep` to topics and services, `driving` those
of `lab.driving`. `launching` starts nodes for the launch files, and `doctor` checks an
installation. This part may import every part but `api` and `cli`.
"""
