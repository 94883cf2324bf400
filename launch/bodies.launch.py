# Copyright 2026 The sparse_coord_ros authors
# SPDX-License-Identifier: Apache-2.0
"""A team whose robots have bodies: `ros2 launch sparse_coord_ros bodies.launch.py`.

The team of team.launch.py with a driver for each robot, and the simulator of bodies.
"""

from sparse_coord_ros.game.settings import Setting
from sparse_coord_ros.launching import ARGUMENTS, GAME_CLOCK, description
from sparse_coord_ros.nodes.parameters import PARAMETERS

WORLD, BODIES, OTHER = "world", "bodies", "other"
DRIVER = ("radius", "speed", "turn", "step_seconds", "pose_type")
BODY = ("radius", "body_rate", "paths")
OWN = {
    "clock": Setting(
        "clock",
        str,
        WORLD,
        "who publishes /clock: world (time step t is t * step_period s), bodies (their simulated "
        f"time), or other (a simulator of your own); of the last two the world's is {GAME_CLOCK}",
        choices=(WORLD, BODIES, OTHER),
    ),
    "simulate": Setting("simulate", bool, True, "false: robots of your own are there"),
    "slips": PARAMETERS["world_simulator"]["slips"],
    **{name: PARAMETERS["driver"][name] for name in DRIVER},
    **{name: PARAMETERS["body"][name] for name in BODY},
}


def start(team):
    """Add the team, a driver for each robot, and the simulator."""
    if team.get("clock") != WORLD:
        team.others_clock()
    team.add_team(bodies=True, **team.of(["slips"]))
    for robot in team.scenario.robots:
        team.add("driver", {**team.of(DRIVER), "robot": robot.name}, f"{robot.name}_driver")
    if team.get("simulate"):
        more = {"clock": team.get("clock") == BODIES}
        team.add("body", {**team.of(BODY), **more})
    team.add_rviz()


def generate_launch_description():
    """Declare the arguments and start the team."""
    return description(__file__, {**ARGUMENTS, **OWN}, start)
