# Copyright 2026 The sparse_coord_ros authors
# SPDX-License-Identifier: Apache-2.0
"""`sparse_coord conformance`: does a user's robot node keep the contract?"""

import argparse
from typing import TYPE_CHECKING

from sparse_coord_ros.base.errors import EXIT_FAULT
from sparse_coord_ros.cli import options as shared

if TYPE_CHECKING:
    from sparse_coord_ros.ros.nodes.conformance import ObligationResult
    from sparse_coord_ros.ros.nodes.spin import Stop

EXAMPLE = (
    "sparse_coord conformance -- python examples/own_robot.py --ros-args -r __node:=robot_1\n"
    "  sparse_coord conformance --robot robot_2 --checkpoints -- "
    "ros2 run sparse_coord_ros robot --ros-args -r __node:=robot_2 -p out:=checked"
)


OPTIONS = (
    shared.Option(
        "[command COMMAND...]",
        None,
        "command that starts the robot, after -- (default: the robot is already running, "
        "without its peers)",
    ),
    shared.Option(
        "--robot NAME", None, "name of the robot (default: the scenario's first)"
    ),
    shared.Option("--scenario NAME", None, "scenario to play", {"default": "env1"}),
    shared.Option("--namespace NAMESPACE", None, "namespace of the robot"),
    shared.Option(
        "--checkpoints",
        bool,
        "also check that it saves checkpoints and returns to them",
    ),
    shared.JSON,
)


def execute(options: argparse.Namespace) -> int:
    """Run the verb; 1 if the robot breaks an obligation."""
    with shared.ros_needed():
        from sparse_coord_ros.ros.nodes.conformance import BROKEN, judge
        from sparse_coord_ros.ros.nodes.spin import exit_code_of
    found: list[ObligationResult] = []

    def run(stop: "Stop") -> None:
        found.extend(
            judge(
                options.command,
                stop,
                robot=options.robot or "",
                scenario=options.scenario,
                namespace=options.namespace or "",
                checkpoints=options.checkpoints,
            )
        )

    code = exit_code_of(run)
    if code:
        return code
    kept = all(one.verdict != BROKEN for one in found)
    shared.tell(options, {"kept": kept, "obligations": found}, *map(str, found))
    return 0 if kept else EXIT_FAULT
