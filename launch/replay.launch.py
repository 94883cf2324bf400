# Copyright 2026 The sparse_coord_ros authors
# SPDX-License-Identifier: Apache-2.0
"""A recorded run, played: `ros2 launch sparse_coord_ros replay.launch.py bag:=RUN/bag`."""

from launch.actions import DeclareLaunchArgument
from launch.substitutions import LaunchConfiguration
from launch_ros.actions import Node
from launch_ros.parameter_descriptions import ParameterValue

from launch import LaunchDescription

ARGUMENTS = {
    "bag": (None, str, "the bag to play: its directory, or its MCAP file"),
    "rate": ("1.0", float, "seconds of the bag played a second"),
    "position": ("0.0", float, "seconds after the bag's first message: where to begin"),
    "loop": ("false", bool, "true: begin again at the end"),
    "start_paused": ("false", bool, "true: show the first time step, and wait"),
}


def generate_launch_description():
    """Declare the arguments and start the player."""
    declared = [
        DeclareLaunchArgument(name, default_value=default, description=text)
        for name, (default, _, text) in ARGUMENTS.items()
    ]
    values = {
        name: ParameterValue(LaunchConfiguration(name), value_type=kind)
        for name, (_, kind, _) in ARGUMENTS.items()
    }
    player = Node(
        package="sparse_coord_ros", executable="player", parameters=[values], output="screen"
    )
    return LaunchDescription([*declared, player])
