# Copyright 2026 The sparse_coord_ros authors
# SPDX-License-Identifier: Apache-2.0
"""A team whose robots have bodies: `ros2 launch sparse_coord_ros bodies.launch.py`.

The team of team.launch.py with a driver for each robot, and the simulator of bodies.
"""

from sparse_coord_ros.game.settings import Setting
from sparse_coord_ros.launching import ARGUMENTS, description
from sparse_coord_ros.learn.run_config import NO_CLOCK
from sparse_coord_ros.nodes.parameters import PARAMETERS

DRIVER = ("radius", "speed", "turn", "step_seconds", "pose_type")
BODY = ("radius", "body_rate", "body_clock", "paths")
OWN = {
    "simulate": Setting("simulate", bool, True, "false: robots of your own are there"),
    "slips": PARAMETERS["world_simulator"]["slips"],
    **{name: PARAMETERS["driver"][name] for name in DRIVER},
    **{name: PARAMETERS["body"][name] for name in BODY},
}


def start(team):
    """Add the team, a driver for each robot, and the simulator."""
    more = {"clock": NO_CLOCK} if team.get("body_clock") else {}
    team.add_team(bodies=True, **more, **team.of(["slips"]))
    for robot in team.scenario.robots:
        team.add("driver", {**team.of(DRIVER), "robot": robot.name}, f"{robot.name}_driver")
    if team.get("simulate"):
        team.add("body", team.of(BODY))
    team.add_views()


def generate_launch_description():
    """Declare the arguments and start the team."""
    return description(__file__, {**ARGUMENTS, **OWN}, start)
