# Copyright 2026 The sparse_coord_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The ROS 2 nodes: adapters between messages and the state machines of `protocol.lockstep`.

- `world_simulator`, with its parts `world_topics`, `world_bodies`, `world_speed`, `scene` (for
  RViz) and `restart`; `robot`, with `peers` (its questions); `recorder`; `player`; `watch` (the
  page); `team`: world, robots and recorder in one process.
- Their bases: `parameters` (a node whose parameters come from a table), `follower` (one that
  begins and ends with a run).
- What they share: `ros_topics` and `messages` bind the table of topics to rclpy; `subscriber`
  reads, `direct_recording` writes; `outputs` has their files; `spin` contexts and signals.
"""
