# Copyright 2026 The sparse_coord_ros authors
# SPDX-License-Identifier: Apache-2.0
"""A team, every node in its own process: `ros2 launch sparse_coord_ros team.launch.py`."""

from sparse_coord_ros.ros.launching import ARGUMENTS, description


def start(team):
    """Add world, robots and recorder."""
    team.add_team()
    team.add_views()


def generate_launch_description():
    """Declare the arguments and start the team."""
    return description(__file__, ARGUMENTS, start)
