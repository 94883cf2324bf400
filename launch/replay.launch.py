# Copyright 2026 The sparse_coord_ros authors
# SPDX-License-Identifier: Apache-2.0
"""A recorded run, played: `ros2 launch sparse_coord_ros replay.launch.py bag:=RUN/bag`."""

from dataclasses import replace

from launch_ros.actions import Node

from sparse_coord_ros.base.share import PACKAGE
from sparse_coord_ros.ros.launching import described, typed
from sparse_coord_ros.ros.nodes.parameters import PARAMETERS

PLAYER = PARAMETERS["player"]
ARGUMENTS = {
    "bag": replace(PLAYER["bag"], default=None),  # it must be given
    **{name: setting for name, setting in PLAYER.items() if name != "bag"},
}


def start(given, context):
    """Start the player."""
    values = typed(ARGUMENTS, given)
    return [
        Node(package=PACKAGE, executable="player", parameters=[values], output="screen")
    ]


def generate_launch_description():
    """Declare the arguments and start the player."""
    return described(__file__, ARGUMENTS, start)
