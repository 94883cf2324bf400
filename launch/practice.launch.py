# Copyright 2026 The sparse_coord_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Simulated bases with Nav2's action: `ros2 launch sparse_coord_ros practice.launch.py ...`.

It takes the place of robots and Nav2 under lab.launch.py, to practise the procedure of
docs/real_robots.md. Give both the same `scenario` and `robots`.
"""

from launch_ros.actions import Node

from sparse_coord_ros.base.share import PACKAGE
from sparse_coord_ros.core.game.scenario import load_scenario
from sparse_coord_ros.core.game.settings import Setting
from sparse_coord_ros.core.runs.run_config import make_run
from sparse_coord_ros.protocol.wire.messages import Messages
from sparse_coord_ros.ros.launching import ARGUMENTS, described, one_for_each, typed
from sparse_coord_ros.ros.nodes.parameters import PARAMETERS

STAND_IN = PARAMETERS["nav2_stand_in"]
OWN = {
    "scenario": ARGUMENTS["scenario"],
    "robots": Setting(
        *("robots", str, ""),
        "namespaces of the bases, in the scenario's order, separated by commas; empty: the "
        "robots' names",
    ),
    "speed": STAND_IN["speed"],
}


def start(given, context):
    """Put a base at the start of each robot."""
    values = typed(OWN, given)
    scenario = load_scenario(values.get("scenario", OWN["scenario"].default))
    centres = Messages(make_run(scenario, {})).centres
    places = [centres[robot.start] for robot in scenario.robots]
    parameters = {
        "bases": one_for_each("robots", values.get("robots", ""), scenario.names),
        "places": [f"{x},{y}" for x, y in places],
        "speed": values.get("speed", OWN["speed"].default),
    }
    executable = "nav2_stand_in"
    return [
        Node(
            package=PACKAGE,
            executable=executable,
            parameters=[parameters],
            output="screen",
        )
    ]


def generate_launch_description():
    """Declare the arguments and start the bases."""
    return described(__file__, OWN, start)
