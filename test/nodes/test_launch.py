# Copyright 2026 The sparse_coord_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The team's launch file, with stand-ins for launch and launch_ros, which the wheels lack."""

import importlib.util
import sys
from pathlib import Path
from types import ModuleType, SimpleNamespace

import pytest
from ament_index_python.packages import PackageNotFoundError

FILE = Path(__file__).parents[2] / "launch" / "team.launch.py"


class Kept:
    """Stands for whatever the file makes: keeps what it was given."""

    def __init__(self, *parts, **options):
        self.parts, self.options = parts, options


@pytest.fixture
def launched(monkeypatch):
    """Return a function that gives the nodes the file would start with some arguments."""
    names = {
        "launch": ["LaunchDescription"],
        "launch.actions": [
            "DeclareLaunchArgument",
            "EmitEvent",
            "OpaqueFunction",
            "RegisterEventHandler",
        ],
        "launch.event_handlers": ["OnProcessExit"],
        "launch.events": ["Shutdown"],
        "launch.substitutions": ["LaunchConfiguration"],
        "launch_ros": [],
        "launch_ros.actions": ["Node"],
    }
    for module, classes in names.items():
        made = ModuleType(module)
        for name in classes:
            setattr(made, name, type(name, (Kept,), {}))
        monkeypatch.setitem(sys.modules, module, made)
    spec = importlib.util.spec_from_file_location("team_launch", FILE)
    file = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(file)

    class Given(Kept):
        def perform(self, context):
            return context.get(self.parts[0], file.ARGUMENTS[self.parts[0]][0])

    file.LaunchConfiguration = Given

    def launch(find=lambda package: "/opt", **given):
        file.get_package_prefix = find
        return [one.options for one in file.team(given) if type(one).__name__ == "Node"]

    return SimpleNamespace(nodes=launch)


def executables(nodes):
    return [options["executable"] for options in nodes]


def test_a_world_robots_and_a_recorder(launched, tmp_path):
    nodes = launched.nodes(scenario="env1", out=str(tmp_path / "run"))
    assert executables(nodes) == ["world_simulator", "robot", "robot", "recorder"]


def test_rviz_is_opened_with_the_file_by_the_run_s_clock(launched, tmp_path):
    [*_, view] = launched.nodes(out=str(tmp_path / "run"), rviz="true")
    assert (view["package"], view["executable"]) == ("rviz2", "rviz2")
    assert view["arguments"][0] == "-d" and view["arguments"][1].endswith("rviz/team.rviz")
    assert view["parameters"] == [{"use_sim_time": True}]


def test_without_rviz_nothing_starts_and_one_line_says_what_to_do(launched, tmp_path):
    def find(package):
        raise PackageNotFoundError(package)

    with pytest.raises(RuntimeError, match="sudo apt install ros-jazzy-rviz2, or leave") as raised:
        launched.nodes(find, out=str(tmp_path / "run"), rviz="true")
    assert "\n" not in str(raised.value)
    assert executables(launched.nodes(find, out=str(tmp_path / "run"), rviz="false"))
