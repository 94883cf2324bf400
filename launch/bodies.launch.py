# Copyright 2026 The sparse_coord_ros authors
# SPDX-License-Identifier: Apache-2.0
"""A team whose robots have bodies: `ros2 launch sparse_coord_ros bodies.launch.py`.

The team of team.launch.py with a driver for each robot, and the simulator of bodies.
"""

import importlib.util
from pathlib import Path

from launch.actions import DeclareLaunchArgument, OpaqueFunction
from launch.substitutions import LaunchConfiguration
from launch_ros.actions import Node

from launch import LaunchDescription
from sparse_coord_ros.game.scenario import load_scenario

WORLD, BODIES, OTHER = "world", "bodies", "other"
GAME_CLOCK = "game_clock"

OWN = {
    "clock": (
        WORLD,
        "who publishes /clock: world (time step t is t * step_period s), bodies (their simulated "
        f"time), or other (a simulator of your own); of the last two the world's is {GAME_CLOCK}",
    ),
    "simulate": ("true", "false: no simulator of bodies; robots of your own are there"),
    "slips": ("true", "true: moves also fail at random, as in the grid; false: as bodies do"),
    "radius": ("0.0", "of a body, in metres; 0: 0.15 of a cell"),
    "speed": ("0.5", "of a body, in metres a second"),
    "turn": ("1.5", "of a body, in radians a second"),
    "step_seconds": ("0.0", "seconds that a move may take, by the poses; 0: by the cell's side"),
    "pose_type": ("pose", "pose, pose_with_covariance, odometry or tf: where poses come from"),
    "body_rate": ("0.0", "simulated seconds a second; 0: in step with the drivers"),
    "paths": ("", "file .npz for where the bodies drove; empty: none"),
}


def _team():
    """Return team.launch.py as a module."""
    path = Path(__file__).with_name("team.launch.py")
    spec = importlib.util.spec_from_file_location("sparse_coord_team_launch", path)
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


def nodes(context, team):
    """Return the nodes; the launch ends with the world, and fails where a node failed."""
    given = {name: LaunchConfiguration(name).perform(context) for name in OWN}
    if given["clock"] not in (WORLD, BODIES, OTHER):
        raise RuntimeError(f"clock: value is {given['clock']!r}, allowed: world, bodies or other")
    bodies = {"bodies": True, "slips": team.is_true(given["slips"])}
    remapped = [] if given["clock"] == WORLD else [("/clock", GAME_CLOCK)]
    found, common, place = team.members(context, more=bodies, remappings=remapped)
    shared = {"radius": float(given["radius"])}
    driver = {name: float(given[name]) for name in ("speed", "turn", "step_seconds")}
    driver["pose_type"] = given["pose_type"]
    scenario = load_scenario(LaunchConfiguration("scenario").perform(context))
    for robot in scenario.robots:
        own = {**shared, **driver, "robot": robot.name}
        name = f"{robot.name}_driver"
        found.append(Node(executable="driver", name=name, parameters=[*common, own], **place))
    if team.is_true(given["simulate"]):
        own = {
            **shared,
            "body_rate": float(given["body_rate"]),
            "clock": given["clock"] == BODIES,
            "paths": given["paths"],
        }
        found.append(
            Node(executable="body", parameters=[*common, own], **{**place, "remappings": []})
        )
    return [*found, *team.endings(found)]


def generate_launch_description():
    """Declare the arguments and start the team."""
    team = _team()
    arguments = {**team.ARGUMENTS, **OWN}
    declared = [
        DeclareLaunchArgument(name, default_value=default, description=text)
        for name, (default, text) in arguments.items()
    ]
    start = OpaqueFunction(function=lambda context: nodes(context, team))
    return LaunchDescription([*declared, start])
