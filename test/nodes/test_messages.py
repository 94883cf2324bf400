# Copyright 2026 The sparse_coord_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Steps, cells and numbers survive their way through ROS messages."""

import math
import re

import numpy as np
import pytest
from builtin_interfaces.msg import Time
from geometry_msgs.msg import PoseStamped
from nav_msgs.msg import OccupancyGrid
from rclpy.serialization import deserialize_message, serialize_message
from sensor_msgs.msg import JointState
from std_msgs.msg import Header
from visualization_msgs.msg import Marker, MarkerArray

from sparse_coord_ros.game.actions import COORDINATE
from sparse_coord_ros.game.scenario import load_scenario, scenario_names
from sparse_coord_ros.game.world import Action, Reward
from sparse_coord_ros.learn.agent import initial_tables
from sparse_coord_ros.learn.run_config import make_run
from sparse_coord_ros.lockstep.rollback import Progress
from sparse_coord_ros.nodes.episode_messages import CoordinationMapLayout, MapLayout, MarkersLayout
from sparse_coord_ros.nodes.messages import (
    Converter,
    progress_message,
    read_claim,
    read_progress,
    read_status,
    read_tables_message,
    status,
    status_values,
    tables_message,
)
from sparse_coord_ros.palette import DOORWAY_COLOUR, rgb
from sparse_coord_ros.wire import ACCOUNT_LABELS, ACTION_LABELS, REWARD_LABELS
from sparse_coord_ros.wire.frame import Account

RESOLUTIONS = [0.001, 0.05, 0.3, 1 / 3, 1.0, 7.77, 1000.0]
PERIODS = [0.001, 0.0123456789, 1 / 3, 0.1, 1.0, 59.94, 60.0]
STEPS = [0, 1, 2, 3, 7, 10, 999, 10_000, 123_456, 500_000]


def labelled(labels, numbers, *, frame="map", sec=0, nanosec=0):
    header = Header(frame_id=frame, stamp=Time(sec=sec, nanosec=nanosec))
    return JointState(header=header, name=list(labels), position=list(numbers))


def converter(name="env1", **settings):
    return Converter(make_run(load_scenario(name), settings))


@pytest.mark.parametrize("name", scenario_names())
def test_every_cell_of_every_map_comes_back(name):
    for resolution in RESOLUTIONS:
        convert = converter(name, resolution=resolution)
        for cell in range(len(convert.grid.cells)):
            assert convert.unpack_state(convert.pack_state(9, cell)) == (9, cell)
            position = convert.pose(9, cell).pose.position
            for dx, dy in ((0.45, 0.45), (-0.45, 0.45), (0.45, -0.45), (-0.45, -0.45)):
                x, y = position.x + dx * resolution, position.y + dy * resolution
                assert convert.cell(x, y) == cell


@pytest.mark.parametrize("name", scenario_names())
def test_walls_and_places_outside_are_no_cells(name):
    convert = converter(name)
    rows, columns = convert.grid.shape
    for row, line in enumerate(convert.grid.rows):
        for column, symbol in enumerate(line):
            cell = convert.cell(column + 0.5, rows - row - 0.5)
            assert (cell is None) == (symbol == "#")
    for x, y in ((-0.5, 0.5), (0.5, -0.5), (columns + 0.5, 0.5), (0.5, rows + 0.5)):
        assert convert.cell(x, y) is None
    for bad in (math.nan, math.inf, -math.inf):
        assert convert.cell(bad, 0.5) is None
        assert convert.cell(0.5, bad) is None


@pytest.mark.parametrize("period", PERIODS)
def test_every_step_comes_back(period):
    convert = converter(step_period=period)
    for step in STEPS:
        sec, nanosec = convert.stamp(step)
        assert 0 <= nanosec < 1_000_000_000
        assert abs(sec + nanosec * 1e-9 - step * period) <= step * 0.6e-9 + 1e-6
        assert convert.step(sec, nanosec) == step
        assert convert.unpack_state(convert.pack_state(step, 3)) == (step, 3)


def test_a_stamp_beside_a_step_is_the_nearest_one():
    convert = converter(step_period=0.1)
    assert convert.step(1, 40_000_000) == 10
    assert convert.step(1, 60_000_000) == 11


def test_x_points_east_and_y_north():
    convert = converter("env1", resolution=0.5)
    rows, _ = convert.grid.shape
    for cell, (row, column) in enumerate(convert.grid.cells):
        message = deserialize_message(convert.pack_state(4, cell), PoseStamped)
        assert message.pose.position.x == (column + 0.5) * 0.5
        assert message.pose.position.y == (rows - 1 - row + 0.5) * 0.5
        assert message.pose.orientation.w == 1.0
        assert message.header.frame_id == "map"
        assert message.header.stamp == Time(sec=0, nanosec=400_000_000)


def test_a_state_in_a_wall_names_the_map():
    convert = converter("env1")
    message = PoseStamped(header=Header(frame_id="map"))
    message.pose.position.x, message.pose.position.y = 2.5, 4.5
    with pytest.raises(ValueError, match=r"\(2\.5, 4\.5\) is no free cell of map env1"):
        convert.unpack_state(serialize_message(message))


def test_rewards_come_back():
    convert = converter()
    for reward in (Reward(10.0, -20.0, -1.0, -11.0), Reward(0.0, 0.0, 0.0, 0.1 + 0.2)):
        assert convert.unpack_reward(convert.pack_reward(12, reward)) == (12, reward)
        message = deserialize_message(convert.pack_reward(12, reward), JointState)
        assert dict(zip(message.name, message.position, strict=True)) == dict(
            list(reward._asdict().items())[:4]
        )


@pytest.mark.parametrize("peer", [-1, 0, 3])
@pytest.mark.parametrize("move", range(4))
def test_actions_come_back(move, peer):
    convert = converter("env2-4r")
    for asked, perceived in ((False, False), (True, False), (True, True)):
        action = Action(move, asked, peer, perceived)
        for account in (Account(3, True), Account(0, False)):
            data = convert.pack_action(77, action, account)
            assert convert.unpack_action(data) == (77, action)
            said = deserialize_message(data, JointState)
            assert list(said.name) == [*ACTION_LABELS, *ACCOUNT_LABELS]
            assert list(said.position[-2:]) == list(account)


def test_an_action_of_version_0_1_0_is_understood():
    message = labelled(ACTION_LABELS, [1.0, 0.0, 1.0, 2.0, 1.0])
    step, action = converter().unpack_action(serialize_message(message))
    assert (step, action) == (0, Action(2, True, 1, True))


@pytest.mark.parametrize(
    ("move", "vector"),
    [(0, (0.0, 1.0)), (1, (0.0, -1.0)), (2, (1.0, 0.0)), (3, (-1.0, 0.0))],
    ids=["north", "south", "east", "west"],
)
def test_primitive_actions_are_unit_vectors(move, vector):
    message = deserialize_message(
        converter().pack_action(1, Action(move, True, 1, False), Account(3, True)), JointState
    )
    said = dict(zip(message.name, message.position, strict=True))
    assert (said["east"], said["north"]) == vector
    assert (said["coordinate"], said["peer"], said["perceived"]) == (1.0, 2.0, 0.0)


@pytest.mark.parametrize("east_north", [(0.0, 0.0), (1.0, 1.0), (0.5, 0.0), (math.nan, 1.0)])
def test_no_other_vector_is_an_action(east_north):
    message = labelled(ACTION_LABELS, [*east_north, 0.0, 0.0, 0.0])
    with pytest.raises(ValueError, match="no primitive action"):
        converter().unpack_action(serialize_message(message))


@pytest.mark.parametrize(
    ("change", "text"),
    [
        ({"labels": [*ACTION_LABELS[:4], "peer"]}, "labels are given twice"),
        ({"labels": ACTION_LABELS[:4]}, "no number is labelled perceived"),
        ({"frame": "odom"}, "frame_id is 'odom', not 'map'"),
        ({"sec": -1}, "stamp -1 s 0 ns is no time of the run"),
        ({"nanosec": 2**32 - 1}, "stamp 0 s 4294967295 ns is no time of the run"),
        ({"numbers": [1.0, 0.0, math.nan, 0.0, 0.0]}, "coordinate nan"),
        ({"numbers": [1.0, 0.0, 1.0, 3.0, 1.0]}, "peer 3.0"),
        ({"numbers": [1.0, 0.0, 1.0, 1.0, 0.5]}, "perceived 0.5"),
    ],
)
def test_an_action_that_does_not_fit_the_run_is_a_value_error(change, text):
    said = {"labels": ACTION_LABELS, "numbers": [1.0, 0.0, 0.0, 0.0, 0.0], **change}
    with pytest.raises(ValueError, match=re.escape(text)):
        converter().unpack_action(serialize_message(labelled(**said)))


@pytest.mark.parametrize("strange", [math.nan, math.inf, -math.inf])
def test_a_reward_that_is_not_finite_is_a_value_error(strange):
    convert = converter()
    for place in range(4):
        numbers = [1.0, 0.0, 0.0, 1.0]
        numbers[place] = strange
        with pytest.raises(ValueError, match="not finite"):
            convert.unpack_reward(convert.pack_reward(3, Reward(*numbers)))
        with pytest.raises(ValueError, match="not finite"):
            convert.unpack_reward(
                serialize_message(labelled([*REWARD_LABELS, "x"], [*numbers, 0]))
            )


def test_a_state_of_another_frame_is_a_value_error():
    message = converter().pose(4, 3)
    message.header.frame_id = "odom"
    with pytest.raises(ValueError, match="frame_id is 'odom'"):
        converter().unpack_state(serialize_message(message))


def test_status_says_of_which_run_it_is():
    values = {"step": 7, "transitions": 6}
    said = read_status(status("env1", "learning", values))
    assert said[:4] == ("", "learning", 7, 6)
    assert read_status(status("env1", "paused", {**values, "run": "ab"})).run == "ab"
    for bad in ({"step": 7}, {"step": "x", "transitions": 1}, {"step": -1, "transitions": 0}):
        with pytest.raises(ValueError):
            read_status(status("env1", "learning", bad))


def test_progress_comes_back_and_none_is_beyond_any_run():
    said = Progress("life", 40, 39, (0, 20), "order", True)
    assert read_progress(progress_message("robot_1", said)) == said
    for bad in ({"step": -1}, {"step": 10**12}, {"transitions": 10**30}, {"checkpoints": (0, -5)}):
        with pytest.raises(ValueError, match="no run comes there"):
            read_progress(progress_message("robot_1", said._replace(**bad)))


def test_a_claim_says_who_and_how_far():
    assert read_claim(Header(frame_id="ab12 holding")) == ("ab12", 1)
    for bad in ("", "ab12", " holding", "ab12 dancing"):
        with pytest.raises(ValueError, match="is no claim"):
            read_claim(Header(frame_id=bad))


@pytest.mark.parametrize("peer", [math.nan, math.inf, -math.inf])
def test_an_action_with_a_strange_peer_is_a_value_error(peer):
    message = labelled(ACTION_LABELS, [1.0, 0.0, 1.0, peer, 0.0])
    with pytest.raises(ValueError):
        converter().unpack_action(serialize_message(message))


def test_the_map_is_drawn_from_the_south():
    convert = converter("env1", resolution=0.25)
    message = convert.map()
    rows, columns = convert.grid.shape
    assert (message.info.height, message.info.width) == (rows, columns)
    assert message.info.resolution == 0.25
    assert message.header.frame_id == "map"
    for row, line in enumerate(convert.grid.rows):
        for column, symbol in enumerate(line):
            value = message.data[(rows - 1 - row) * columns + column]
            assert value == (100 if symbol == "#" else 0)


def read_map(data):
    return deserialize_message(data, OccupancyGrid)


def test_episode_messages_are_those_that_rclpy_makes():
    """Packed twice at different steps: what one left must not show in the other."""
    convert = converter()
    scenario = load_scenario("env1")
    markers, grid = MarkersLayout(convert, scenario), MapLayout(convert)
    for step, cells in ((3, (4, 9)), (70_000, (20, 0))):
        wanted = serialize_message(convert.markers(step, scenario, cells))
        got = deserialize_message(markers.pack(step, cells), MarkerArray)
        assert got == deserialize_message(wanted, MarkerArray)
        wanted = convert.map()
        wanted.header = convert.header(step)
        wanted = deserialize_message(serialize_message(wanted), OccupancyGrid)
        assert read_map(grid.pack(step)) == wanted


@pytest.mark.parametrize("change", ["label", "count"])
def test_tables_travel_as_bytes(change):
    message = tables_message(b"some bytes", 7, "final")
    assert read_tables_message(message) == (b"some bytes", 7, "final")
    if change == "label":
        message.layout.dim[0].label = "csv"
    else:
        message.layout.dim = message.layout.dim[:1]
    with pytest.raises(ValueError, match="npz"):
        read_tables_message(message)


def test_the_coordination_map_shows_where_coordinate_is_best():
    scenario = load_scenario("env1")
    convert = converter("env1")
    tables = initial_tables(scenario)
    tables.q_star[:] = 0.0
    tables.q_star[:, 0] = 1.0
    tables.q_star[7, COORDINATE] = 2.0
    message = read_map(CoordinationMapLayout(convert).pack(3, tables))
    rows, columns = convert.grid.shape
    row, column = convert.grid.cells[7]
    values = np.flipud(np.array(message.data).reshape(rows, columns))
    assert values[row, column] == 100
    assert np.count_nonzero(values == 100) == 1
    assert np.count_nonzero(values == -1) == sum(r.count("#") for r in convert.grid.rows)


def test_the_coordination_map_of_a_baseline_is_empty():
    tables = initial_tables(load_scenario("env1"), asks=False)
    message = read_map(CoordinationMapLayout(converter()).pack(3, tables))
    assert 100 not in message.data


def test_markers_show_doorways_goals_and_robots():
    scenario = load_scenario("env2-4r")
    convert = converter("env2-4r", resolution=2.0)
    cells = [3, 4, 5, 6]
    array = convert.markers(8, scenario, cells)
    by_kind = {}
    for marker in array.markers:
        assert marker.action == Marker.ADD
        assert marker.header.frame_id == "map"
        position = marker.pose.position
        by_kind.setdefault(marker.ns, {})[marker.id] = convert.cell(position.x, position.y)
    assert set(by_kind["doorways"].values()) == scenario.map.doorways
    assert list(by_kind["goals"].values()) == [robot.goal for robot in scenario.robots]
    assert list(by_kind["robots"].values()) == cells
    [look] = {(m.color.r, m.color.g, m.color.b) for m in array.markers if m.ns == "doorways"}
    assert look == pytest.approx(rgb(DOORWAY_COLOUR), abs=1e-6), "as in every picture, no wall"
    assert len(array.markers) == sum(len(ids) for ids in by_kind.values())


def test_status_values_come_back():
    message = status("env1", "learning", {"step": 12, "rate": 0.5}, warn=True)
    assert status_values(message) == {"step": "12", "rate": "0.5"}
    assert (message.name, message.message, message.level) == ("env1", "learning", message.WARN)
    assert status("env1", "learning", {}).level == message.OK
