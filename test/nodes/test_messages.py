# Copyright 2026 The sparse_coord_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Steps, cells and numbers survive their way through ROS messages."""

import functools
import math
import re
from dataclasses import replace

import numpy as np
import pytest
from builtin_interfaces.msg import Time
from geometry_msgs.msg import PoseStamped, Twist
from hypothesis import assume, given
from hypothesis import strategies as st
from nav_msgs.msg import OccupancyGrid
from rclpy.serialization import deserialize_message, serialize_message
from recordings import cell_pose
from sensor_msgs.msg import JointState
from std_msgs.msg import Header
from teams import untrained
from visualization_msgs.msg import Marker

from sparse_coord_ros.base.palette import DOORWAY_COLOUR, rgb
from sparse_coord_ros.core.game.actions import COORDINATE
from sparse_coord_ros.core.game.scenario import load_scenario, scenario_names
from sparse_coord_ros.core.game.world import Action, Reward
from sparse_coord_ros.core.runs.run_config import make_run
from sparse_coord_ros.protocol.lockstep.bodies import BodyGoal, GoalReport, Goals
from sparse_coord_ros.protocol.wire import ACTION, REWARD, SelfReport
from sparse_coord_ros.protocol.wire.published_tables import read_tables
from sparse_coord_ros.protocol.wire.status import (
    Order,
    Progress,
    RunStatus,
    read_progress,
    read_status,
    values_of,
)
from sparse_coord_ros.ros.driving.body import read_command
from sparse_coord_ros.ros.nodes.body_messages import (
    goals_message,
    reached_message,
    read_goals,
    read_reached,
)
from sparse_coord_ros.ros.nodes.ros_messages import (
    map_header,
    messages_of,
    status,
    tables_message,
)
from sparse_coord_ros.ros.nodes.scene import Scene


@functools.cache
def messages_in(name="env1", resolution=1.0):
    scenario = load_scenario(name)
    metric = replace(scenario.map, resolution=resolution)
    return messages_of(make_run(replace(scenario, map=metric), {}))


@pytest.mark.parametrize("name", scenario_names())
def test_every_cell_of_every_map_comes_back(name):
    messages = messages_in(name, resolution=1 / 3)
    for cell in range(len(messages.grid.cells)):
        assert messages.unpack_state(messages.pack_state(9, cell)) == (9, cell)


def test_x_points_east_and_y_north():
    messages = messages_in("env1", resolution=0.5)
    rows, _ = messages.grid.shape
    for cell, (row, column) in enumerate(messages.grid.cells):
        message = deserialize_message(messages.pack_state(4, cell), PoseStamped)
        assert message == cell_pose(messages, 4, cell)
        assert message.pose.position.x == (column + 0.5) * 0.5
        assert message.pose.position.y == (rows - 1 - row + 0.5) * 0.5
        assert message.header.frame_id == "map"
        assert message.header.stamp == Time(sec=0, nanosec=400_000_000)


PARTS = st.lists(
    st.floats(allow_nan=False, allow_infinity=False), min_size=4, max_size=4
)


@given(parts=PARTS)
def test_rewards_come_back(parts):
    messages = messages_of(make_run(load_scenario("env1"), {}))
    reward = Reward(*parts, 2)
    data = messages.pack_reward(12, reward)
    assert messages.unpack_reward(data) == (12, reward)
    assert list(deserialize_message(data, JointState).name) == list(REWARD.labels)


NORTH_AND_EAST = [(1.0, 0.0), (-1.0, 0.0), (0.0, 1.0), (0.0, -1.0)]
"""Of the moves north, south, east and west: unit vectors."""

ACTIONS = st.builds(
    Action, st.integers(0, 3), st.booleans(), st.integers(-1, 3), st.booleans()
)
ACCOUNTS = st.builds(SelfReport, st.integers(0, 3), st.booleans())


@given(st.integers(0, 10**7), ACTIONS, ACCOUNTS)
def test_actions_come_back(step, action, account):
    """Peers count from 1; only robots that have asked perceive."""
    assume(action.asked or not action.perceived)
    messages = messages_in("env2-4r")
    data = messages.pack_action(step, action, account)
    assert messages.unpack_action(data) == (step, action, account)
    said = deserialize_message(data, JointState)
    numbers = dict(zip(said.name, said.position, strict=True))
    assert list(said.name) == list(ACTION.labels)
    assert (numbers["north"], numbers["east"]) == NORTH_AND_EAST[action.move]
    assert numbers["peer"] == action.peer + 1


def test_status_comes_back():
    order = Order("ab", 20)
    for said in (
        RunStatus("id", "learning", 7, 6, 2, "start", order, 10),
        RunStatus("", "paused", 1, 0),
    ):
        assert read_status(status("env1", said.state, said.values())) == said


def test_progress_comes_back():
    said = Progress((20, 0), "ab")
    assert read_progress(status("robot_1", "progress", said.values())) == said


def grid_of(messages, data):
    """Return an occupancy grid's values as the map's rows are written, the northmost first."""
    message = deserialize_message(data, OccupancyGrid)
    info = message.info
    assert (info.height, info.width) == messages.grid.shape
    assert info.resolution == messages.resolution and info.origin.orientation.w == 1.0
    assert message.header == map_header(messages.stamp(3))
    return np.flipud(np.array(message.data).reshape(messages.grid.shape))


def test_the_map_is_drawn_from_the_south():
    messages = messages_in("env1", resolution=0.25)
    values = grid_of(messages, messages.pack_map(3))
    walls = np.array([[sign == "#" for sign in row] for row in messages.grid.rows])
    np.testing.assert_array_equal(values, 100 * walls)


def test_the_coordination_map_shows_where_coordinate_is_best():
    messages = messages_in("env1")
    tables = untrained(load_scenario("env1"))
    tables.q_star[:] = 0.0
    tables.q_star[:, 0] = 1.0
    tables.q_star[7, COORDINATE] = 2.0
    asking = messages.asking_cells(tables.q_star)
    values = grid_of(messages, messages.pack_coordination_map(3, asking))
    assert np.argwhere(values == 100).tolist() == [list(messages.grid.cells[7])]
    assert np.count_nonzero(values == -1) == sum(
        r.count("#") for r in messages.grid.rows
    )
    tables = untrained(load_scenario("env1"), "noncoop")
    asking = messages.asking_cells(tables.q_star)
    assert 100 not in grid_of(messages, messages.pack_coordination_map(3, asking))


def test_markers_show_doorways_goals_and_robots():
    scenario = load_scenario("env2-4r")
    messages = messages_in("env2-4r", resolution=2.0)
    for step, cells in ((8, [3, 4, 5, 6]), (70_000, [7, 4, 0, 9])):
        header = map_header(messages.stamp(step))
        shown = Scene(messages, step, cells, header)
        array = shown.markers([robot.goal for robot in scenario.robots])
        robots = [m for m in shown.scene({}).markers if m.ns == "robots"]
        array.markers = [*array.markers, *robots]
        by_kind = {}
        for marker in array.markers:
            assert (marker.action, marker.header) == (Marker.ADD, header)
            position = marker.pose.position
            by_kind.setdefault(marker.ns, {})[marker.id] = messages.cell(
                position.x, position.y
            )
        assert set(by_kind["doorways"].values()) == scenario.map.doorways
        assert list(by_kind["goals"].values()) == [
            robot.goal for robot in scenario.robots
        ]
        assert list(by_kind["robots"].values()) == cells
        assert len(array.markers) == sum(len(ids) for ids in by_kind.values())
    [look] = {
        (m.color.r, m.color.g, m.color.b) for m in array.markers if m.ns == "doorways"
    }
    assert look == pytest.approx(rgb(DOORWAY_COLOUR), abs=1e-6), (
        "as in every picture, no wall"
    )
    shapes = {m.ns: m.type for m in array.markers}
    wanted = {
        "doorways": Marker.CUBE,
        "goals": Marker.CYLINDER,
        "robots": Marker.SPHERE,
    }
    assert shapes == wanted


def test_tables_travel_as_bytes():
    message = tables_message(b"some bytes", 7, "final", "ab")
    assert read_tables(message) == (b"some bytes", 7, "final", "ab")


def test_values_of_a_status_come_back():
    message = status("env1", "learning", {"step": 12, "rate": 0.5}, warn=True)
    assert values_of(message) == {"step": "12", "rate": "0.5"}
    assert (message.name, message.message, message.level) == (
        "env1",
        "learning",
        message.WARN,
    )
    assert status("env1", "learning", {}).level == message.OK


# Messages that are not of a run.

STATE = {"x": 1.5, "y": 4.5, "z": 0.0}
PAID = dict(zip(REWARD.labels, (1.0, 0.0, 0.0, 1.0, 0.0), strict=True))
ACTED = dict(zip(ACTION.labels, (1.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0), strict=True))
SAID = RunStatus("", "learning", 7, 6).values()
BEGUN = Progress((20, 0), "ab")
"""Messages that fit a run; in the table below one of their fields is another, or is left out."""

LEFT_OUT = None
NAN = math.nan
INF = math.inf


def changed(values, changes):
    """Return values with some changed or left out."""
    found = {**values, **changes}
    return {name: value for name, value in found.items() if value is not LEFT_OUT}


def header_of(frame="map", sec=0, nanosec=0):
    return Header(frame_id=frame, stamp=Time(sec=sec, nanosec=nanosec))


def state(changes, **header):
    message = PoseStamped(header=header_of(**header))
    for name, value in changed(STATE, changes).items():
        setattr(message.pose.position, name, value)
    return messages_in().unpack_state(serialize_message(message))


def labelled(numbers, header):
    """Return the bytes of a message of labelled numbers."""
    names = list(numbers)
    message = JointState(header=header, name=names, position=list(numbers.values()))
    return serialize_message(message)


def reward(changes, **header):
    numbers = changed(PAID, changes)
    return messages_in().unpack_reward(labelled(numbers, header_of(**header)))


def account(changes, **header):
    numbers = changed(ACTED, changes)
    return messages_in().unpack_action(labelled(numbers, header_of(**header)))


def goals(changes, *, since=0.0):
    messages = messages_in()
    message = goals_message(messages, Goals(1, 2, True, since, (BodyGoal(0, 1, 1),)))
    numbers = changed(dict(zip(message.name, message.position, strict=True)), changes)
    return read_goals(
        messages,
        JointState(
            header=message.header,
            name=list(numbers),
            position=list(numbers.values()),
        ),
    )


def reached(changes):
    messages = messages_in()
    message = reached_message(messages, 1, GoalReport(0, 3, 5, True, 1.25, 0.0))
    for label, value in changes.items():
        message.position[list(message.name).index(label)] = value
    return read_reached(messages, 0, message)


def command(changes):
    message = Twist()
    for name, value in changes.items():
        setattr(message.angular, name, value)
    return read_command(message)


def tables(changes):
    message = tables_message(b"some bytes", 7, "final", "ab")
    message.layout.dim[0].label = changes.get("label", message.layout.dim[0].label)
    message.layout.dim = message.layout.dim[: changes.get("count", 3)]
    return read_tables(message)


def world_status(changes):
    return read_status(status("env1", "learning", changed(SAID, changes)))


def progress(changes):
    values = BEGUN._replace(**changes).values()
    return read_progress(status("robot_1", "progress", values))


MISFITS = [
    (state, {"x": 2.5}, {}, "is at (2.5, 4.5), no free cell of map env1"),
    (state, {"z": 9.0}, {}, "not flat"),
    (state, {}, {"frame": "odom"}, "is in the frame 'odom', not 'map'"),
    (state, {}, {"frame": ""}, "is in the frame '', not 'map'"),
    (reward, {"common": LEFT_OUT}, {}, "has no number labelled common"),
    (reward, {"common": math.nan}, {}, "no reward"),
    (reward, dict.fromkeys(PAID), {}, "has no number labelled individual, common"),
    (account, {"coordinate": NAN}, {}, "coordinate nan"),
    (account, {"peer": 3.0}, {}, "peer 3.0"),
    (account, {"peer": NAN}, {}, "peer nan"),
    (account, {"perceived": 0.5}, {}, "perceived 0.5"),
    (account, {"east": 0.0}, {}, "no primitive action"),
    (account, {"east": NAN, "north": 1.0}, {}, "no primitive action"),
    (world_status, {"step": "x"}, {}, "'x'"),
    (world_status, {"step": -1}, {}, "has a negative number"),
    (world_status, {"checkpoint": "ab"}, {}, "'ab'"),
    (world_status, {"oldest": -1}, {}, "has a negative number"),
    (world_status, {"attempt": LEFT_OUT}, {}, "has no value 'attempt'"),
    (world_status, {"began": LEFT_OUT}, {}, "has no value 'began'"),
    (progress, {"checkpoints": (0, -5)}, {}, "says checkpoints '0 -5'"),
    (progress, {"checkpoints": ("x",)}, {}, "'x'"),
    (tables, {"label": "csv"}, {}, "npz"),
    (tables, {"count": 1}, {}, "npz"),
    (goals, {"robot_1/to": 999.0}, {}, "robot_1/to"),
    (goals, {"robot_1/to": LEFT_OUT}, {}, "robot_1/to nan"),
    (goals, {}, {"since": 1e300}, "since 1e+300"),
    (reached, {"number": 0.0}, {}, "number"),
    (reached, {"number": 1.5}, {}, "number"),
    (reached, {"cell": 1e6}, {}, "cell"),
    (reached, {"cell": NAN}, {}, "cell"),
    (reached, {"seconds": -1.0}, {}, "seconds"),
    (reached, {"stamp": INF}, {}, "stamp"),
    (reached, {"stamp": 1e300}, {}, "stamp"),
    *((command, {"z": odd}, {}, "angular.z") for odd in (NAN, INF, 1.7e308, -1e4)),
]
"""The reader; the fields that are others, in the message and in its header; what is said."""


@pytest.mark.parametrize(("read", "changes", "header", "text"), MISFITS)
def test_a_message_that_does_not_fit_the_run_is_refused(read, changes, header, text):
    with pytest.raises(ValueError, match=re.escape(text)):
        read(changes, **header)


@pytest.mark.parametrize("read", dict.fromkeys(row[0] for row in MISFITS))
def test_such_a_message_fits_where_nothing_is_changed(read):
    read({})
