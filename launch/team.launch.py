# Copyright 2026 The sparse_coord_ros authors
# SPDX-License-Identifier: Apache-2.0
"""A team, every node in its own process: `ros2 launch sparse_coord_ros team.launch.py`."""

from launch.actions import DeclareLaunchArgument, OpaqueFunction
from launch.substitutions import LaunchConfiguration
from launch_ros.actions import Node

from launch import LaunchDescription
from sparse_coord_ros.core.scenario import load_scenario

PACKAGE = "sparse_coord_ros"


def team(context):
    scenario, seed, out = (
        LaunchConfiguration(name).perform(context) for name in ("scenario", "seed", "out")
    )
    world = {"scenario": scenario, "seed": int(seed), "recorded": bool(out), "out": out}
    nodes = [Node(package=PACKAGE, executable="world_simulator", parameters=[world])]
    for robot in load_scenario(scenario).robots:
        nodes.append(
            Node(package=PACKAGE, executable="robot", name=robot.name, parameters=[{"out": out}])
        )
    if out:
        nodes.append(
            Node(package=PACKAGE, executable="recorder", parameters=[{"out": f"{out}/bag"}])
        )
    return nodes


def generate_launch_description():
    return LaunchDescription(
        [
            DeclareLaunchArgument("scenario", default_value="env1", description="name or file"),
            DeclareLaunchArgument("seed", default_value="0", description="seed of the run"),
            DeclareLaunchArgument("out", default_value="", description="output directory"),
            OpaqueFunction(function=team),
        ]
    )
