# Copyright 2026 The sparse_coord_ros authors
# SPDX-License-Identifier: Apache-2.0
"""A team whose robots have bodies: `ros2 launch sparse_coord_ros bodies.launch.py`.

The team of team.launch.py with a driver for each robot, and the simulator of bodies. That one
owns the clock, as simulators do: poses and transforms have its time, not that of the time steps.
"""

from dataclasses import replace

from sparse_coord_ros.core.runs.run_config import NO_CLOCK
from sparse_coord_ros.ros.launching import ARGUMENTS, description
from sparse_coord_ros.ros.nodes.parameters import PARAMETERS

WORLD, DRIVER, BODY = (
    PARAMETERS[node] for node in ("world_simulator", "driver", "body")
)
OF_DRIVER = ("radius", "speed", "turn", "step_seconds", "pose_type")
OF_BODY = ("radius", "body_rate")
OWN = {
    "use_sim_time": replace(
        ARGUMENTS["use_sim_time"],
        default=True,
        help="the nodes' ROS clocks follow the topic clock; false with clock:=own",
    ),
    "slips": WORLD["slips"],
    **{name: DRIVER[name] for name in OF_DRIVER},
    **{name: BODY[name] for name in OF_BODY},
}


def start(team):
    """Add the team, a driver for each robot, and the simulator."""
    team.own_clock = True
    of_bodies = team.of_world("clock") == NO_CLOCK
    team.sim_time = team.given.get("use_sim_time", of_bodies)
    team.add_team(bodies=True, **team.of(["slips"]))
    for robot in team.scenario.robots:
        team.add(
            "driver",
            {**team.of(OF_DRIVER), "robot": robot.name},
            f"{robot.name}_driver",
        )
    team.add("body", team.of(OF_BODY))
    team.add_views()


def generate_launch_description():
    """Declare the arguments and start the team."""
    return description(__file__, {**ARGUMENTS, **OWN}, start)
