# Copyright 2026 The sparse_coord_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The lock step between world and robots, without ROS: waiting, repeating, timeouts.

`world_side` and `robot_side` are the two ends of a time step; `bodies` moves bodies in between.
`world_states` says what the world does at all (it waits, runs, is paused). `timeouts` has the
deadlines, `attempts` what happens when a process is lost and comes again.
"""
