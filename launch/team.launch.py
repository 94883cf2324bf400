# Copyright 2026 The sparse_coord_ros authors
# SPDX-License-Identifier: Apache-2.0
"""A team, every node in its own process: `ros2 launch sparse_coord_ros team.launch.py`."""

from datetime import datetime
from pathlib import Path

from ament_index_python.packages import PackageNotFoundError, get_package_prefix
from launch.actions import DeclareLaunchArgument, EmitEvent, OpaqueFunction, RegisterEventHandler
from launch.event_handlers import OnProcessExit
from launch.events import Shutdown
from launch.substitutions import LaunchConfiguration
from launch_ros.actions import Node

from launch import LaunchDescription
from sparse_coord_ros.game.plugins import allow_modules, allow_named
from sparse_coord_ros.game.scenario import load_scenario
from sparse_coord_ros.share import share_file

PACKAGE = "sparse_coord_ros"

ARGUMENTS = {
    "scenario": ("env1", "a shipped scenario's name, or a scenario file"),
    "set": ("", "changed scenario settings, separated by commas: penalty=-100,steps=2000"),
    "seed": ("0", "seed of the run"),
    "learner": ("coop", "who learns: a learner's name, or module:Class"),
    "greedy": ("false", "true: act on `tables` without learning"),
    "tables": ("", "output directory of a run whose tables to begin with"),
    "rate": ("0.0", "time steps a second; 0: as fast as the team acts"),
    "out": ("", "output directory; empty: <scenario>_<date>_<time>"),
    "record": ("true", "true: record the run to the bag OUT/bag"),
    "namespace": ("", "the team's namespace; its /clock is then NAMESPACE/clock"),
    "use_sim_time": ("false", "true: the nodes' ROS clocks follow the team's /clock"),
    "rviz": ("false", "true: open RViz, where it is installed, with rviz/team.rviz"),
    "allow": (
        "",
        "modules that a scenario may name, with models of your own, separated by commas",
    ),
    "params_file": ("", "a parameter file for all nodes, such as config/params.yaml"),
}


def is_true(text):
    return text.lower() in ("true", "yes", "on", "1")


def members(context, more=None, remappings=()):
    """Return the team's nodes, the world's first, and what they share.

    `more` are further parameters of the world. What is shared is a list of parameters, and the
    arguments of `Node`.
    """
    given = {name: LaunchConfiguration(name).perform(context) for name in ARGUMENTS}
    record, simulated = is_true(given["record"]), is_true(given["use_sim_time"])
    changes = [one.strip() for one in given["set"].split(",")]
    allow_modules(given["allow"].replace(",", " "))  # the nodes inherit it
    for named in (given["learner"], *(one.partition("=")[2].strip() for one in changes)):
        allow_named(named)
    scenario = load_scenario(given["scenario"])
    out = given["out"] or f"{scenario.name}_{datetime.now():%Y%m%d_%H%M%S}"
    if Path(out).exists():
        raise RuntimeError(f"out: {out} exists already, nothing is overwritten; choose another")
    namespace = given["namespace"].strip("/")
    place = {"package": PACKAGE, "namespace": namespace, "output": "screen"}
    if namespace or remappings:
        place["remappings"] = [*remappings] or [("/clock", f"/{namespace}/clock")]
    common = [given["params_file"]] if given["params_file"] else []
    common.append({"use_sim_time": simulated})
    world = {
        "scenario": given["scenario"],
        "set": changes,
        "seed": int(given["seed"]),
        "learner": given["learner"],
        "greedy": is_true(given["greedy"]),
        "tables": given["tables"],
        "rate": float(given["rate"]),
        "recorded": record,
        "out": out,
    }
    if given["params_file"]:  # which says what the command line leaves at its default
        world = {
            name: value
            for name, value in world.items()
            if name in ("scenario", "out", "recorded") or given[name] != ARGUMENTS[name][0]
        }
    world |= more or {}
    nodes = [Node(executable="world_simulator", parameters=[*common, world], **place)]
    nodes += [
        Node(executable="robot", name=robot.name, parameters=[*common, {"out": out}], **place)
        for robot in scenario.robots
    ]
    if record:
        bag = {"out": str(Path(out) / "bag")}
        nodes.append(Node(executable="recorder", parameters=[*common, bag], **place))
    return nodes, common, place


def team(context):
    """Return the nodes; the launch ends with the world, and fails where a node failed."""
    nodes, _, _ = members(context)
    view = []
    if is_true(LaunchConfiguration("rviz").perform(context)):
        try:
            get_package_prefix("rviz2")
        except PackageNotFoundError:
            raise RuntimeError(
                "rviz:=true: RViz is not installed: sudo apt install ros-jazzy-rviz2, or leave "
                "rviz:=true out; 'sparse_coord watch' shows the team in a browser"
            ) from None
        shown = ["-d", str(share_file("rviz", "team.rviz"))]
        stamps = [{"use_sim_time": True}]
        view = [Node(package="rviz2", executable="rviz2", arguments=shown, parameters=stamps)]
    return [*nodes, *view, *endings(nodes)]


def endings(nodes):
    """Return what ends the launch.

    When the world is gone before its time, the others are stopped; after a run they end by
    themselves. The launch fails where a node failed.
    """
    world, running, failed = nodes[0], {id(node) for node in nodes}, []

    def on_exit(node, event):
        running.discard(id(node))
        if event.returncode:
            failed.append(f"{event.process_name} ended with exit code {event.returncode}")
        if not running and failed:
            raise RuntimeError("; ".join(failed))
        return [EmitEvent(event=Shutdown(reason="no world"))] if node is world and failed else []

    def handler(node):
        then = OnProcessExit(target_action=node, on_exit=lambda event, _: on_exit(node, event))
        return RegisterEventHandler(then)

    return [handler(node) for node in nodes]


def generate_launch_description():
    """Declare the arguments and start the team."""
    declared = [
        DeclareLaunchArgument(name, default_value=default, description=text)
        for name, (default, text) in ARGUMENTS.items()
    ]
    return LaunchDescription([*declared, OpaqueFunction(function=team)])
