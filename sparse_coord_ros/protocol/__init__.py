# Copyright 2026 The sparse_coord_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The messages between robots and world, and their order.

`wire` declares each topic and message once, and packs them into bytes. `lockstep` has the state
machines of world, robots and bodies; they send and receive through ports, so they need no ROS.
This part imports `core` and `base`.
"""
