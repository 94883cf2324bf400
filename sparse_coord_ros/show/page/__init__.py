# Copyright 2026 The sparse_coord_ros authors
# SPDX-License-Identifier: Apache-2.0
"""A page in the browser that shows a team that learns: frames, where they come from, the server.

Nothing here needs ROS; the live source is `ros.nodes.watch`.
"""
