# Copyright 2026 The sparse_coord_ros authors
# SPDX-License-Identifier: Apache-2.0
"""What all other parts need: errors, files, streams, progress, YAML, compiler, colours.

Nothing in this part knows about robots, learning or ROS. It imports no other part of the package.
A module belongs here if parts that do not know each other use it.
"""
