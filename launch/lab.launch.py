# Copyright 2026 The sparse_coord_ros authors
# SPDX-License-Identifier: Apache-2.0
"""A team that Nav2 drives: `ros2 launch sparse_coord_ros lab.launch.py scenario:=lab.yaml`.

The team of team.launch.py with a nav2_driver for each robot, whose Nav2 is in a namespace of the
robot's name, as Nav2's own launch files have it.
"""

from dataclasses import replace

from sparse_coord_ros.core.game.scenario import SETTINGS
from sparse_coord_ros.core.game.settings import Setting
from sparse_coord_ros.ros.launching import ARGUMENTS, description, one_for_each
from sparse_coord_ros.ros.nodes.parameters import PARAMETERS
from sparse_coord_ros.ros.nodes.transforms import TF, TF_STATIC

WORLD = PARAMETERS["world_simulator"]
TABLE = PARAMETERS["nav2_driver"]
DRIVER = ("near", "step_seconds", "map_frame", "pose_timeout")
OWN = {
    "robots": Setting(
        *("robots", str, ""),
        "namespaces of the robots' Nav2, in the scenario's order, separated by commas; empty: the "
        "robots' names",
    ),
    "base_frame": Setting(
        "base_frame", str, "base_link", "of each body in its own /NAMESPACE/tf"
    ),
    "slips": replace(WORLD["slips"], default=False),
    "epsilon": replace(
        SETTINGS["epsilon"],
        default="constant:0",
        help="the probability of a random action while it learns; 0: it moves safely",
    ),
    "checkpoint": replace(WORLD["checkpoint"], default=100),
    "body_timeout": WORLD["body_timeout"],
    **{name: TABLE[name] for name in DRIVER},
}


def start(team):
    """Add the team, and what takes its moves to Nav2."""
    of_world = {
        name: team.of_world(name) for name in ("slips", "epsilon", "checkpoint")
    }
    team.add_team(bodies=True, **of_world, **team.of(["body_timeout"]))
    names = team.scenario.names
    spaces = one_for_each("robots", team.get("robots"), names)
    for name, space in zip(names, spaces, strict=True):
        driver = {
            **team.of(DRIVER),
            "robot": name,
            "pose_type": "tf",
            "base_frame": team.get("base_frame"),
            "action": f"/{space}/navigate_to_pose",
        }
        tf = [(topic, f"/{space}/{topic}") for topic in (TF, TF_STATIC)]
        team.add("nav2_driver", driver, f"{name}_driver", remapped=tf)
    team.add_views()


def generate_launch_description():
    """Declare the arguments and start the team."""
    return description(__file__, {**ARGUMENTS, **OWN}, start)
