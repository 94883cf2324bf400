# Copyright 2026 The sparse_coord_ros authors
# SPDX-License-Identifier: Apache-2.0
"""`sparse_coord halt`: stop all robots of a team at once, or let them continue."""

import argparse
import time

from sparse_coord_ros.base.errors import EXIT_FAULT, RunError
from sparse_coord_ros.cli import options as shared
from sparse_coord_ros.core.game.settings import Setting

TIMEOUT = Setting(
    "timeout", float, 10.0, "seconds to wait for all confirmations", 2.5, 3600
)

EXAMPLE = "sparse_coord halt\n  sparse_coord halt --go-on"


OPTIONS = (
    shared.Option("--go-on", bool, "let the robots continue"),
    TIMEOUT,
    shared.Option("--namespace", None, "namespace of the team", {"default": ""}),
    shared.JSON,
)


def execute(options: argparse.Namespace) -> int:
    """Run the verb; 1 if a node has not confirmed it."""
    with shared.ros_needed():
        from rclpy.node import Node

        from sparse_coord_ros.ros.nodes.halting import Halting
        from sparse_coord_ros.ros.nodes.spin import (
            Stop,
            exit_code_of,
            make_executor,
            ros_context,
        )
    confirmed = False

    def halt(stop: Stop) -> None:
        nonlocal confirmed
        with ros_context() as context, stop.at_once():
            executor = make_executor("single", context)
            node = Node("halt", context=context)
            executor.add_node(node)
            halting = Halting(node, options.namespace)
            begun = now = time.monotonic()
            halting.ask(not options.go_on, now)
            while halting.asking and now - begun < options.timeout:
                halting.tick(now)
                executor.spin_once(timeout_sec=0.02)
                now = time.monotonic()
            world_told = halting.world_told
            executor.shutdown()
            node.destroy_node()
        if not halting.asked:
            where = f"namespace /{options.namespace.strip('/')}"
            remedy = "give --namespace, check ROS_DOMAIN_ID, or stop the robots by hand"
            raise RunError(
                f"there is no world with bodies and no driver in {where}; {remedy}"
            )
        nodes = {
            name: {"done": one.done, "said": one.said}
            for name, one in sorted(halting.asked.items())
        }
        confirmed = world_told and not halting.left
        said = [halting.in_words(name) for name in nodes]
        if not world_told:
            said.append(
                "no world has confirmed: drivers that start later will not know"
            )
        facts = {"confirmed": confirmed, "world_told": world_told, "nodes": nodes}
        shared.tell(options, facts, *said)

    return exit_code_of(halt) or (0 if confirmed else EXIT_FAULT)
