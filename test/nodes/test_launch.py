# Copyright 2026 The sparse_coord_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The team's launch file, with stand-ins for launch and launch_ros, which the wheels lack."""

import importlib.util
import sys
from pathlib import Path
from types import ModuleType, SimpleNamespace

import pytest
from ament_index_python.packages import PackageNotFoundError

from sparse_coord_ros.game.plugins import allowed

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


@pytest.fixture
def bodies(launched, monkeypatch):
    """Return a function that gives the nodes of bodies.launch.py."""
    path = FILE.with_name("bodies.launch.py")
    spec = importlib.util.spec_from_file_location("bodies_launch", path)
    file = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(file)
    team = file._team()
    defaults = {**team.ARGUMENTS, **file.OWN}

    class Given(Kept):
        def perform(self, context):
            return context.get(self.parts[0], defaults[self.parts[0]][0])

    team.LaunchConfiguration = file.LaunchConfiguration = Given
    return lambda **given: [
        one.options for one in file.nodes(given, team) if type(one).__name__ == "Node"
    ]


def test_bodies_have_drivers_and_a_simulator(bodies, tmp_path):
    nodes = bodies(scenario="env1", out=str(tmp_path / "run"), radius="0.1", slips="false")
    assert executables(nodes)[-3:] == ["driver", "driver", "body"]
    assert nodes[0]["parameters"][-1]["bodies"] and not nodes[0]["parameters"][-1]["slips"]
    assert [node["parameters"][-1]["robot"] for node in nodes[-3:-1]] == ["robot_1", "robot_2"]
    assert all(node["parameters"][-1]["radius"] == 0.1 for node in nodes[-3:])
    assert "remappings" not in nodes[0]


@pytest.mark.parametrize(("clock", "says"), [("bodies", True), ("other", False)])
def test_others_may_own_the_clock(bodies, tmp_path, clock, says):
    nodes = bodies(scenario="env1", out=str(tmp_path / "run"), clock=clock)
    assert nodes[0]["remappings"] == [("/clock", "game_clock")]
    assert nodes[-1]["parameters"][-1]["clock"] is says and nodes[-1]["remappings"] == []


def test_bodies_of_your_own_and_a_bad_clock(bodies, tmp_path):
    nodes = bodies(scenario="env1", out=str(tmp_path / "run"), simulate="false")
    assert "body" not in executables(nodes)
    with pytest.raises(RuntimeError, match="clock: value is 'sun', allowed: world"):
        bodies(scenario="env1", out=str(tmp_path / "run"), clock="sun")


def executables(nodes):
    return [options["executable"] for options in nodes]


def test_a_world_robots_and_a_recorder(launched, tmp_path):
    nodes = launched.nodes(scenario="env1", out=str(tmp_path / "run"))
    assert executables(nodes) == ["world_simulator", "robot", "robot", "recorder"]


def test_it_allows_what_its_arguments_name(launched, tmp_path):
    """The nodes inherit it: the environment of the launch is theirs."""
    changes = "penalty=-5,perception=my_models:fog:0.5"
    launched.nodes(
        out=str(tmp_path / "out"), learner="my_team:Team", set=changes, allow="others, more.own"
    )
    assert allowed() == ("others", "more.own", "my_team", "my_models")


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
