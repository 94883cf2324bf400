# Copyright 2026 The sparse_coord_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The launch files, with stand-ins for launch and launch_ros, which the wheels lack.

`test_real_launch.py` has the tests with an installed ROS.
"""

import importlib.util
import json
import random
import re
import sys
from pathlib import Path
from types import ModuleType, SimpleNamespace

import pytest
from ament_index_python.packages import PackageNotFoundError

from sparse_coord_ros.base.errors import RunError, SettingError
from sparse_coord_ros.base.yaml_text import parse_yaml
from sparse_coord_ros.core.game.plugins import allowed

FOLDER = Path(__file__).parents[2] / "launch"
NAMES = {
    "launch": [],
    "launch.events": [],
    "launch.actions": [
        *("DeclareLaunchArgument", "OpaqueFunction", "Shutdown"),
    ],
    "launch.events.process": ["ProcessExited"],
    "launch.launch_context": ["LaunchContext"],
    "launch.launch_description": ["LaunchDescription"],
    "launch.logging": [],
    "launch_ros": [],
    "launch_ros.actions": ["Node"],
}


class Kept:
    """Stands for any object of a launch file: keeps its arguments."""

    def __init__(self, *parts, **options):
        self.parts = parts
        self.options = options


@pytest.fixture
def warnings():
    """Return the warnings of launch."""
    return []


@pytest.fixture
def launched(monkeypatch, warnings):
    """Return a function that gives the actions of a launch file with some arguments."""
    for module, classes in NAMES.items():
        made = ModuleType(module)
        for name in classes:
            setattr(made, name, type(name, (Kept,), {}))
        monkeypatch.setitem(sys.modules, module, made)
    logger = SimpleNamespace(warning=warnings.append)
    sys.modules["launch.logging"].get_logger = lambda name: logger
    monkeypatch.delitem(sys.modules, "sparse_coord_ros.ros.launching", raising=False)

    def launch(name="team", **given):
        spec = importlib.util.spec_from_file_location(
            "launched", FOLDER / f"{name}.launch.py"
        )
        file = importlib.util.module_from_spec(spec)
        spec.loader.exec_module(file)
        context = SimpleNamespace(launch_configurations=dict(given))
        [[*declared, last]] = file.generate_launch_description().parts
        for one in declared:  # as DeclareLaunchArgument does
            default = one.options["default_value"]
            context.launch_configurations.setdefault(one.parts[0], default)
        return last.options["function"](context)

    return launch


@pytest.fixture
def nodes(launched):
    """Return a function that gives the options of the nodes that a launch file starts."""
    return lambda *file, **given: [
        one.options for one in launched(*file, **given) if type(one).__name__ == "Node"
    ]


def executables(nodes):
    return [options["executable"] for options in nodes]


def values(node):
    """Return the parameters that a launch gives a node, those of a file apart."""
    return {
        key: v
        for one in node["parameters"]
        if isinstance(one, dict)
        for key, v in one.items()
    }


def test_a_world_robots_and_a_recorder(nodes, tmp_path):
    found = nodes(scenario="env1", out=str(tmp_path / "run"))
    assert executables(found) == ["world_simulator", "robot", "robot", "recorder"]
    world = values(found[0])
    assert (world["scenario"], world["recorded"]) == ("env1", True)
    assert world["out"] == str(tmp_path / "run")
    assert values(found[3])["out"] == str(tmp_path / "run" / "bag")
    assert len(nodes(out=str(tmp_path / "run"), record="false")) == 3


@pytest.fixture
def file(tmp_path):
    """Return a parameter file."""
    path = tmp_path / "p.yaml"
    said = "{scenario: env2-4r, penalty: -55, seed: 7}"
    path.write_text(f"/**/world_simulator:\n  ros__parameters: {said}\n")
    return str(path)


def test_what_is_given_wins_over_the_file_also_where_it_is_the_default(
    nodes, tmp_path, file
):
    out = str(tmp_path / "run")
    given = {
        "set": "penalty=-11, steps=200",
        "seed": "0",
        "out": out,
        "tables": "before",
    }
    found = nodes(params_file=file, **given)
    assert [values(one).get("tables") for one in found] == ["before", *[None] * 5]
    assert found[0]["parameters"][0] == file
    world = values(found[0])
    assert (world["penalty"], world["steps"], world["seed"]) == (-11.0, 200, 0)
    assert world["scenario"] == "env2-4r" and executables(found).count("robot") == 4
    assert (
        executables(nodes(params_file=file, scenario="env1", out=out)).count("robot")
        == 2
    )
    assert not {"penalty", "seed", "greedy", "set"} & set(
        values(nodes(params_file=file, out=out)[0])
    )


@pytest.mark.parametrize(
    ("text", "said"),
    [
        (
            "turtlesim: {ros__parameters: {seed: 1}}",
            r"it has: turtlesim\); name one '/\*\*' for all nodes, or world_simulator, recorder, "
            "robot_1, robot_2",
        ),
        ("world_simulator: {seed: 1}", "section 'seed' has no 'ros__parameters'"),
        ("seed: 1", "section 'seed' has no 'ros__parameters'; write the parameters"),
    ],
)
def test_a_parameter_file_without_a_fitting_section(nodes, file, text, said):
    Path(file).write_text(text)
    with pytest.raises(SettingError, match=said):
        nodes(params_file=file, scenario="env1")


TRUE_OR_FALSE = "allowed: true or false"
REFUSED = [
    ("team", {"greedy": "ture"}, f"argument greedy: value is 'ture', {TRUE_OR_FALSE}"),
    (
        "team",
        {"record": "flase"},
        f"argument record: value is 'flase', {TRUE_OR_FALSE}",
    ),
    (
        "team",
        {"rate": "fast"},
        "argument rate: value is 'fast', allowed: 0, or a number",
    ),
    ("team", {"seed": "1.5"}, "argument seed: value is '1.5', allowed: a whole number"),
    (
        "team",
        {"set": "penaltie=3"},
        "unknown setting 'penaltie' (did you mean 'penalty'",
    ),
    ("team", {"clock": "sun"}, "argument clock: value is 'sun', allowed: own or none"),
    ("lab", {"robots": "tb1"}, "argument robots: 1 names, allowed: 2"),
    ("practice", {"robots": "tb1"}, "argument robots: 1 names, allowed: 2"),
]
"""Launch file, arguments, and the end of the launch."""


@pytest.mark.parametrize(("file", "given", "text"), REFUSED)
def test_a_bad_argument_ends_the_launch(launched, tmp_path, file, given, text):
    out = {} if file == "practice" else {"out": str(tmp_path / "run")}
    with pytest.raises(SettingError, match=re.escape(text)):
        launched(file, **out, **given)


def test_it_allows_what_its_arguments_name(nodes, tmp_path):
    """The nodes inherit it: the environment of the launch is theirs. It imports none itself."""
    changes = "penalty=-5,perception=my_models:fog:0.5"
    given = {"learner": "my_team:Team", "set": changes, "allow": "others, more.own"}
    [world, *_] = nodes(out=str(tmp_path / "out"), **given)
    assert allowed() == ("others", "more.own", "my_team", "my_models")
    assert values(world)["perception"] == "my_models:fog:0.5"


def test_the_clock_follows_the_namespace_or_is_left_to_others(nodes, tmp_path):
    out = str(tmp_path / "run")
    found = nodes(out=out, namespace="/a/", clock="own")
    assert {node["namespace"] for node in found} == {"a"}
    assert all(node["remappings"] == [("/clock", "clock")] for node in found)
    for found in (nodes(out=out, namespace="a"), nodes("lab", out=out)):
        assert values(found[0])["clock"] == "none"
        assert found[0]["remappings"] == found[3]["remappings"] == []


@pytest.mark.parametrize(
    ("given", "clock", "own", "sim_time"),
    [
        ({}, "none", True, True),
        ({"use_sim_time": "false"}, "none", True, False),
        ({"clock": "own"}, "own", True, False),
    ],
)
def test_simulated_bodies_own_the_clock(nodes, tmp_path, given, clock, own, sim_time):
    found = nodes("bodies", out=str(tmp_path / "run"), **given)
    assert values(found[0])["clock"] == clock
    assert all(values(node)["use_sim_time"] == sim_time for node in found)
    assert all(node["remappings"] == [("/clock", "clock")] * own for node in found)


def test_a_misspelt_argument_name_is_warned_of(
    launched, warnings, tmp_path, monkeypatch
):
    """Those of a launch file that includes this one may be meant for others."""
    words = [
        "ros2",
        "launch",
        "sparse_coord_ros",
        "team.launch.py",
        "sceanrio:=env1",
        "x:=3",
    ]
    launched(out=str(tmp_path / "run"))
    assert warnings == []
    monkeypatch.setattr(sys, "argv", [*words, f"out:={tmp_path / 'run'}"])
    launched(out=str(tmp_path / "run"))
    remedy = "--show-args lists the arguments"
    what = "is unknown and changes nothing"
    assert warnings == [
        f"argument 'sceanrio' {what} (did you mean 'scenario'?); {remedy}",
        f"argument 'x' {what}; {remedy}",
    ]


@pytest.fixture
def shown(launched, tmp_path):
    """Return a function that gives the output of --show-args: name, default, text."""

    def show(name):
        launched(out=str(tmp_path / "run"))  # with the stand-ins for launch
        spec = importlib.util.spec_from_file_location(
            "shown", FOLDER / f"{name}.launch.py"
        )
        file = importlib.util.module_from_spec(spec)
        spec.loader.exec_module(file)
        [[*declared, _]] = file.generate_launch_description().parts
        return {
            one.parts[0]: (one.options["default_value"], one.options["description"])
            for one in declared
        }

    return show


def test_the_arguments_show_their_real_defaults(shown):
    team, bodies, lab, replay = map(shown, ("team", "bodies", "lab", "replay"))

    def default(said):
        return said[1].rpartition("; default: ")[2].rstrip(")")

    assert [default(team[name]) for name in ("scenario", "seed", "record")] == [
        *("env1", "0", "true")
    ]
    assert team["out"][0] == "" and "default:" not in team["out"][1]
    assert [default(bodies[name]) for name in ("clock", "use_sim_time")] == [
        *("none", "true")
    ]
    names = ("clock", "slips", "epsilon", "checkpoint", "near")
    assert [default(lab[name]) for name in names] == [
        *("none", "false", "constant:0", "100", "0.1")
    ]
    assert (replay["bag"][0], default(replay["rate"])) == (None, "1.0")
    for said in (team, bodies, lab):
        learner = said["learner"][1].partition("(allowed: ")[2]
        names = learner.partition(", or one of your own")[0].split(", ")
        assert {"coop", "noncoop", "voi"} <= set(names)
        assert "indiv" not in names, "it cannot run live"


def numbers(low, high):
    """Return legal texts of a number, each with its value."""
    drawn = random.Random(f"{low} {high}")
    return [
        (repr(number), number)
        for number in (drawn.uniform(low, high) for _ in range(3))
    ]


def texts(*words):
    return [(word, word) for word in words]


BOTH = [("true", True), ("false", False)]
ARGUMENTS = {
    "scenario": texts("env1", "env2-4r", "aisle"),
    "seed": [("0", 0), ("17", 17), (str(2**63 - 1), 2**63 - 1)],
    "learner": texts("coop", "noncoop", "voi"),
    "tables": texts("before"),
    "rate": numbers(0.01, 1000),
    "clock": texts("own", "none"),
    "epsilon": texts("constant:0.25", "linear:1,0,500"),
    "checkpoint": [("0", 0), ("250", 250)],
    "pose_type": texts("pose", "pose_with_covariance", "odometry", "tf"),
    "base_frame": texts("base_footprint"),
    "map_frame": texts("floor"),
    "bag": texts("runs/a/bag"),
    "position": numbers(0, 100),
    "near": numbers(0.01, 0.4),
    "step_seconds": numbers(0.1, 100),
    "radius": numbers(0, 0.4),
    **dict.fromkeys(("speed", "turn", "body_rate"), numbers(0.01, 100)),
    **dict.fromkeys(("body_timeout", "pose_timeout"), numbers(0, 100)),
    **dict.fromkeys(("greedy", "slips", "use_sim_time", "loop", "wait"), BOTH),
    "start_paused": BOTH,
}
"""Legal values of the arguments that are parameters of nodes, which test_parameter_effects.py
tests."""

OTHERS = {
    "set": "test_what_is_given_wins_over_the_file_also_where_it_is_the_default",
    "params_file": "test_what_is_given_wins_over_the_file_also_where_it_is_the_default",
    "out": "test_a_world_robots_and_a_recorder",
    "record": "test_a_world_robots_and_a_recorder",
    "namespace": "test_the_clock_follows_the_namespace_or_is_left_to_others",
    "allow": "test_it_allows_what_its_arguments_name",
    "rviz": "test_rviz_is_opened_for_the_team_at_hand",
    "foxglove": "test_foxglove_gets_a_layout_of_the_team_at_hand",
    "robots": "test_a_lab_has_drivers_for_the_namespaces_of_its_robots",
}
"""The other arguments, and the test of each one's effect."""


@pytest.mark.parametrize("file", ["team", "bodies", "lab", "practice", "replay"])
def test_each_argument_reaches_the_nodes_of_its_parameter(nodes, shown, tmp_path, file):
    assert all(callable(globals()[test]) for test in OTHERS.values())
    given = {"bag": "bag"} if file == "replay" else {"scenario": "env1"}
    if "out" in shown(file):
        given["out"] = str(tmp_path / "run")
    for name in shown(file).keys() - OTHERS:
        for text, value in ARGUMENTS[name]:
            found = nodes(file, **{**given, name: text})
            told = [values(node)[name] for node in found if name in values(node)]
            if (file, name) == ("practice", "scenario"):
                told = [value]  # test_practice_puts_a_base_at_each_start
            assert told and set(told) == {value}, (name, text)


def test_practice_puts_a_base_at_each_start(nodes):
    [stand_in] = nodes("practice", scenario="env1", robots="tb1,tb2")
    assert stand_in["executable"] == "nav2_stand_in"
    assert values(stand_in) == {
        "bases": ["tb1", "tb2"],
        "places": ["0.5,4.5", "4.5,4.5"],
        "speed": 0.3,
    }
    [stand_in] = nodes("practice", scenario="env2-4r")
    assert values(stand_in)["bases"] == ["robot_1", "robot_2", "robot_3", "robot_4"]


def test_replay_plays_the_bag(nodes):
    [player] = nodes("replay", bag="runs/a/bag", rate="2")
    assert values(player) == {"bag": "runs/a/bag", "rate": 2.0}


def test_bodies_have_drivers_and_a_simulator(nodes, tmp_path):
    given = {
        "scenario": "env1",
        "out": str(tmp_path / "run"),
        "radius": "0.1",
        "slips": "false",
    }
    found = nodes("bodies", **given)
    assert executables(found)[-3:] == ["driver", "driver", "body"]
    assert values(found[0])["bodies"] and not values(found[0])["slips"]
    assert [values(node)["robot"] for node in found[-3:-1]] == ["robot_1", "robot_2"]
    assert all(values(node)["radius"] == 0.1 for node in found[-3:])


def test_a_lab_has_drivers_for_the_namespaces_of_its_robots(nodes, tmp_path):
    found = nodes("lab", out=str(tmp_path / "run"), robots="/tb1, tb2", near="0.2")
    assert executables(found)[-2:] == ["nav2_driver"] * 2
    said = values(found[-1])
    assert (said["robot"], said["action"]) == ("robot_2", "/tb2/navigate_to_pose")
    assert (said["pose_type"], said["base_frame"], said["near"]) == (
        "tf",
        "base_link",
        0.2,
    )
    assert ("tf", "/tb2/tf") in found[-1]["remappings"]
    own = {"slips": False, "epsilon": "constant:0", "checkpoint": 100, "clock": "none"}
    assert own.items() <= values(found[0]).items()
    said = {"set": "epsilon=constant:0.1,steps=9", "slips": "true", "checkpoint": "7"}
    world = values(nodes("lab", out=str(tmp_path / "run"), **said)[0])
    assert (str(world["epsilon"]), world["slips"], world["checkpoint"]) == (
        "constant:0.1",
        True,
        7,
    )


@pytest.mark.parametrize("name", ["team", "bodies", "lab"])
def test_rviz_is_opened_for_the_team_at_hand(
    nodes, launched, tmp_path, monkeypatch, name
):
    launched(out=str(tmp_path / "run"))
    monkeypatch.setattr(
        "sparse_coord_ros.ros.launching.get_package_prefix", lambda package: "/opt"
    )
    given = {"out": str(tmp_path / "run"), "scenario": "env2-4r", "namespace": "a"}
    [*_, view] = nodes(name, rviz="true", **given)
    assert (view["package"], view["executable"]) == ("rviz2", "rviz2")
    assert view["parameters"] == [{"use_sim_time": name == "bodies"}], (
        "where a team owns the clock"
    )
    assert {("/tf", "tf"), ("/tf_static", "tf_static")} <= set(view["remappings"])
    [option, config] = view["arguments"]
    shown = Path(config).read_text()
    Path(config).unlink()
    assert option == "-d" and parse_yaml(shown, where=config)
    assert (
        shown.count("asks here") == 4 and "Value: /a/robot_4/coordination_map" in shown
    )


def test_foxglove_gets_a_layout_of_the_team_at_hand(launched, tmp_path):
    file = tmp_path / "team.json"
    launched(
        out=str(tmp_path / "run"), scenario="env2-4r", namespace="a", foxglove=str(file)
    )
    shown = json.loads(file.read_text())["configById"]
    assert [one["value"] for one in shown["Plot!reward"]["paths"]] == [
        f"/a/robot_{k}/reward.position[3]" for k in (1, 2, 3, 4)
    ]
    assert {"/a/world_simulator/map", "/a/robot_4/coordination_map"} < set(
        shown["3D!team"]["topics"]
    )
    assert shown["DiagnosticSummary!world"]["topicToRender"] == "/diagnostics"


def test_without_rviz_nothing_starts_and_one_line_says_what_to_do(
    launched, tmp_path, monkeypatch
):
    def find(package):
        raise PackageNotFoundError(package)

    launched(out=str(tmp_path / "run"))
    monkeypatch.setattr("sparse_coord_ros.ros.launching.get_package_prefix", find)
    with pytest.raises(RunError, match="rviz2") as raised:
        launched(out=str(tmp_path / "run"), rviz="true")
    assert "\n" not in str(raised.value)


def test_a_launch_of_its_own_ends_with_the_world_and_starts_the_others_again(
    nodes, tmp_path, monkeypatch
):
    out = str(tmp_path / "run")
    assert not any("respawn" in one or "on_exit" in one for one in nodes(out=out))
    monkeypatch.setattr(
        sys, "argv", ["ros2", "launch", "sparse_coord_ros", "team.launch.py"]
    )
    [world, *others] = nodes(out=out)
    assert "respawn" not in world and all(one["respawn"] for one in others)
    running = SimpleNamespace(is_shutdown=False)

    def ends(node, code):
        ended = SimpleNamespace(process_name="node-1", returncode=code)
        return type(node["on_exit"](ended, running)).__name__

    assert ends(world, 0) == "Shutdown"
    for robot in others:
        assert ends(robot, 0) == ends(robot, 1) == ends(robot, -9) == "NoneType"
    # `ros2 launch` ends with exit code 1 after an exception
    for node, code in ((world, 1), (world, 2), *((robot, 2) for robot in others)):
        with pytest.raises(RunError, match=f"node-1 has ended with exit code {code}"):
            ends(node, code)
    running.is_shutdown = True
    assert ends(world, 2) == "Shutdown" and ends(others[0], 2) == "NoneType"
