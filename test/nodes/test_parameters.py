# Copyright 2026 The sparse_coord_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Parameters of the nodes: described, checked at once, and fixed except the rate."""

import sys
from contextlib import ExitStack
from pathlib import Path

import pytest
from rcl_interfaces.msg import Parameter, ParameterType, ParameterValue
from rcl_interfaces.srv import (
    GetParameters,
    ListParameters,
    SetParameters,
)
from rclpy.parameter import parameter_value_to_python

from sparse_coord_ros.core.game.scenario import SETTINGS
from sparse_coord_ros.ros.driving import driver
from sparse_coord_ros.ros.nodes import (
    player,
    recorder,
    robot,
    spin,
    team,
    world_simulator,
)
from sparse_coord_ros.ros.nodes.parameters import (
    PARAMETERS,
    TEAM_PARAMETERS,
    ParameterNode,
)
from sparse_coord_ros.ros.nodes.spin import ros_context

MAINS = {
    "world_simulator": world_simulator.main,
    "robot": robot.main,
    "recorder": recorder.main,
    "team": team.main,
    "player": player.main,
    "driver": driver.main,
}
"""The executables whose parameters are refused below."""

TABLES = {
    **{name: PARAMETERS[name] for name in ("world_simulator", "robot", "recorder")},
    "team": TEAM_PARAMETERS,
}
TYPES = {
    bool: ParameterType.PARAMETER_BOOL,
    int: ParameterType.PARAMETER_INTEGER,
    float: ParameterType.PARAMETER_DOUBLE,
    str: ParameterType.PARAMETER_STRING,
    list: ParameterType.PARAMETER_STRING_ARRAY,
}


@pytest.fixture
def made():
    """Return a function that makes a node with a table of parameters."""
    with ros_context() as context, ExitStack() as stack:

        def make(table, **values):
            node = ParameterNode("node", table, context=context, values=values)
            stack.callback(node.destroy_node)
            return node

        yield make


@pytest.mark.parametrize("name", TABLES)
def test_every_parameter_is_described(made, name):
    table = TABLES[name]
    node = made(table)
    for key, setting in table.items():
        descriptor = node.describe_parameter(key)
        assert len(descriptor.description) > 10
        # a family: a text
        kind = setting.kind if isinstance(setting.kind, type) else str
        assert descriptor.type == TYPES[kind]
        assert descriptor.additional_constraints == f"allowed: {setting.allowed}"
        assert descriptor.read_only == (key not in ParameterNode.changeable)
        assert node.get_parameter(key).value == setting.parse(setting.default)
    assert node.values == table.defaults()


def test_ranges_are_in_the_descriptors(made):
    node = made(PARAMETERS["world_simulator"])
    constraints = node.describe_parameter("step_timeout").additional_constraints
    assert constraints == "allowed: a number of at least 0.1"


def test_no_scenario_setting_is_called_like_a_parameter():
    assert not set(SETTINGS) & set(TEAM_PARAMETERS)


@pytest.mark.parametrize("name", TABLES)
def test_a_node_minds_only_its_own_of_a_teams_parameters(made, name):
    """One file, or a launch file's group, may give all of them to every node."""
    # fmt: skip
    values = {
        "out": "x",
        "seed": 7,
        "record": True,
        "penalty": -100.0,
        "perception": "never",
    }
    node = made(TABLES[name], **values)
    own = {key: value for key, value in values.items() if key in TABLES[name]}
    assert {key: node.values[key] for key in own} == own
    settings = {"penalty", "perception"} if "scenario" in TABLES[name] else set()
    assert set(node.values) == {*TABLES[name], *settings}
    assert not node.has_parameter("penalty")


def test_scenario_settings_are_parameters_of_the_world(bench):
    world = bench.world(max_steps=40, penalty=-100.0, use_sim_time=True)
    assert (world.run.scenario.penalty, world.run.scenario.max_steps) == (-100.0, 40)
    shown = {
        name: world.get_parameter(name).value
        for name in ("penalty", "max_steps", "starts")
    }
    assert shown == {
        "penalty": -100.0,
        "max_steps": 40,
        "starts": str(world.run.scenario.starts),
    }
    assert all(world.describe_parameter(name).read_only for name in SETTINGS)


def test_whole_numbers_do_for_numbers(made):
    """`-p rate:=5` is an integer to ROS, though the parameter is a double."""
    node = made(PARAMETERS["world_simulator"], rate=5)
    assert node.values["rate"] == 5.0
    assert node.get_parameter("rate").type_ == node.get_parameter("step_timeout").type_


WORLD = "world_simulator"
NONE_GIVEN = "none is given; start the node with --ros-args -p "
NO_DIRECTORY = f"{__file__}: cannot be written, as {__file__} is no directory; choose"
REFUSED = [
    (WORLD, ["seed:=[1, 2]"], "node world_simulator: parameter seed: value is [1, 2]"),
    (WORLD, [], f"parameter scenario: {NONE_GIVEN}scenario:=NAME"),
    (WORLD, ["rate:=0.0001"], "value is 0.0001, allowed: 0, or a number from 0.001 to"),
    (WORLD, ["scenario:=env9"], "scenario 'env9': no such scenario"),
    (WORLD, ["scenario:=env1", "steps:=0"], "parameter steps: value is 0"),
    (WORLD, ["scenario:=env1", "learner:=indiv"], "with one robot at a time; allowed"),
    (
        WORLD,
        ["scenario:=env1", "learner:=joint", "peers_seen:=when_asked"],
        "allowed with learner joint: while_learning, as it learns from joint states;",
    ),
    (WORLD, ["scenario:=env1", "penalti:=-3"], "(did you mean 'penalty'?)"),
    ("robot", [f"out:={__file__}"], NO_DIRECTORY),
    ("recorder", [f"out:={__file__}/a"], f"as {__file__} is no directory; choose"),
    ("team", ["record:=2"], "parameter record: value is 2, allowed: true or false"),
    ("player", [], f"parameter bag: {NONE_GIVEN}bag:=DIRECTORY"),
    ("player", [f"bag:={Path(__file__).parent}"], "is not a bag"),
    ("player", ["bag:=x", "rate:=0.0"], "value is 0.0, allowed: a number from 0.01"),
    ("player", ["bag:=x", "start:=1.0"], "unknown parameter 'start'"),
    ("driver", [], f"parameter robot: {NONE_GIVEN}robot:=NAME"),
    ("driver", ["robot:=r", "pose_type:=gps"], "parameter pose_type: value is 'gps'"),
]
"""Executable, parameters, and its one-line error."""


@pytest.mark.parametrize(("name", "parameters", "text"), REFUSED)
def test_a_bad_parameter_ends_an_executable_with_one_line(
    capfd, monkeypatch, name, parameters, text
):
    words = [word for one in parameters for word in ("-p", one)]
    monkeypatch.setattr(sys, "argv", [name, "--ros-args", *words])
    assert MAINS[name]() == 2
    out, err = capfd.readouterr()
    assert out == ""
    (line,) = err.splitlines()
    assert line.startswith("error: ")
    assert text in line


ARGUMENTS = [
    (["--help"], "argument '--help': is no ROS argument"),
    (["-p", "out:=runs"], "argument '-p': is no ROS argument"),
    (
        ["--ros-args", "-p", "out=runs"],
        "ROS: Couldn't parse parameter override rule: '-p out=runs'",
    ),
    (
        ["--ros-args", "-r", "__ns:=team_a"],
        "ROS: Couldn't parse remap rule: '-r __ns:=team_a'",
    ),
    (
        ["--ros-args", "--params-file", "absent.yaml"],
        "ROS: Couldn't parse params file: '--params-file absent.yaml'. Error: Error opening YAML "
        "file",
    ),
    (["--ros-args", "--colour"], "ROS: ['--colour']"),
]
"""Arguments, and what is said of them."""


@pytest.mark.parametrize(("words", "text"), ARGUMENTS)
def test_arguments_that_ros_cannot_read_are_refused(capfd, monkeypatch, words, text):
    monkeypatch.setattr(sys, "argv", ["robot", *words])
    assert robot.main() == 2
    said = capfd.readouterr().err.splitlines()
    lines = [line for line in said if "[rcl]" not in line]
    assert lines == [f"error: {text}; {spin.ARGUMENTS}"]


def set_one(observer, name, value):
    request = SetParameters.Request(parameters=[Parameter(name=name, value=value)])
    return observer.call(
        SetParameters, "world_simulator/set_parameters", request
    ).results[0]


def double(value):
    return ParameterValue(type=ParameterType.PARAMETER_DOUBLE, double_value=value)


def test_the_rate_can_be_set_while_the_node_runs(bench):
    observer = bench.observer()
    world = bench.world(rate=0.001, steps=50)
    robots = bench.robots()
    bench.spin_until(lambda: world.lockstep.complete, "first barrier")
    assert world.lockstep.world.transitions == 0
    result = set_one(observer, "rate", double(-1.0))
    assert not result.successful
    assert "out of range Min: 0" in result.reason
    result = set_one(observer, "rate", double(0.0001))
    assert "allowed: 0, or a number from 0.001" in result.reason
    numbers = ParameterValue(
        type=ParameterType.PARAMETER_DOUBLE_ARRAY, double_array_value=[1.0]
    )
    assert "value is [1.0], allowed" in set_one(observer, "rate", numbers).reason
    assert world.values["rate"] == 0.001
    assert set_one(observer, "rate", double(100.0)).successful
    bench.spin_until(lambda: world.lockstep.world.transitions >= 10, "ten steps")
    assert set_one(observer, "rate", double(0.0)).successful
    bench.spin_until_done(world, *robots)
    request = GetParameters.Request(names=["rate", "seed"])
    values = observer.call(GetParameters, "robot_1/get_parameters", request).values
    assert [value.type for value in values] == [], "robots have neither"
    values = observer.call(
        GetParameters, "world_simulator/get_parameters", request
    ).values
    assert [parameter_value_to_python(value) for value in values] == [0.0, 0]


def test_a_world_keeps_a_rate_whose_period_is_no_whole_number_of_nanoseconds(bench):
    world = bench.world(rate=7.0, steps=3)
    robots = bench.robots()
    bench.spin_until_done(world, *robots)
    assert world.lockstep.world.transitions == 3


def test_a_request_that_rclpy_cannot_read_ends_no_node(bench, capfd):
    """An unknown type of a parameter: rclpy raises in its own service."""
    world = bench.world()
    observer = bench.observer()
    odd = Parameter(name="rate", value=ParameterValue(type=255))
    request = SetParameters.Request(parameters=[odd])
    assert (
        observer.call(SetParameters, "world_simulator/set_parameters", request).results
        == []
    )
    assert world.failure is None
    assert world.subscriber.dropped == {"world_simulator/set_parameters": 1}
    assert "255 is not a valid" in capfd.readouterr().err


@pytest.mark.parametrize(
    ("words", "name", "value", "line"),
    [
        (
            ("robot",),
            "ROS_DOMAIN_ID",
            "233",
            "is '233', allowed: a whole number from 0",
        ),
        (
            ("sparse_coord", "run", "env1", "--out", "out"),
            "RMW_IMPLEMENTATION",
            "rmw_x",
            "is 'rmw_x', which is not installed",
        ),
    ],
)
def test_a_ros_that_cannot_start_is_one_line(
    python, tmp_path, words, name, value, line
):
    """The middleware would end the process by itself, with a code of its own."""
    command = ("-m", "sparse_coord_ros.executables", *words)
    done = python(*command, cwd=tmp_path, env={name: value}, code=2)
    assert done.stderr.startswith(f"error: {name} {line}")
    assert done.stderr.count("\n") == 1


def test_all_others_are_fixed(bench):
    observer = bench.observer()
    world = bench.world()
    seed = ParameterValue(type=ParameterType.PARAMETER_INTEGER, integer_value=8)
    result = set_one(observer, "seed", seed)
    assert not result.successful
    assert "read-only" in result.reason
    assert world.values["seed"] == 0
    assert world.get_parameter("seed").value == 0
    assert not set_one(observer, "sed", seed).successful
    response = observer.call(ListParameters, "world_simulator/list_parameters")
    assert set(PARAMETERS["world_simulator"]) <= set(response.result.names)


def test_a_whole_number_is_a_number(bench):
    """`ros2 param set world_simulator rate 20` sends an integer."""
    observer = bench.observer()
    world = bench.world()
    rate = ParameterValue(type=ParameterType.PARAMETER_INTEGER, integer_value=20)
    assert set_one(observer, "rate", rate).successful
    assert world.values["rate"] == 20.0 and type(world.values["rate"]) is float
    text = ParameterValue(type=ParameterType.PARAMETER_STRING, string_value="fast")
    assert "rate" in set_one(observer, "rate", text).reason
