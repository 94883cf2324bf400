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
from teams import untrained
from visualization_msgs.msg import Marker, MarkerArray

from sparse_coord_ros.base.palette import DOORWAY_COLOUR, rgb
from sparse_coord_ros.core.game.actions import COORDINATE
from sparse_coord_ros.core.game.scenario import load_scenario, scenario_names
from sparse_coord_ros.core.game.world import Action, Reward
from sparse_coord_ros.core.runs.run_config import make_run
from sparse_coord_ros.protocol.wire import ACTION, REWARD, ClaimRank, SelfReport
from sparse_coord_ros.protocol.wire.messages import markers_form
from sparse_coord_ros.protocol.wire.status import (
    Order,
    Progress,
    RunStatus,
    read_progress,
    read_status,
    values_of,
)
from sparse_coord_ros.ros.nodes.guard import read_claim
from sparse_coord_ros.ros.nodes.messages import (
    Converter,
    read_tables_message,
    status,
    tables_message,
)


def labelled(labels, numbers, *, frame="map", sec=0, nanosec=0):
    header = Header(frame_id=frame, stamp=Time(sec=sec, nanosec=nanosec))
    return JointState(header=header, name=list(labels), position=list(numbers))


def converter(name="env1", **settings):
    return Converter(make_run(load_scenario(name), settings))


@pytest.mark.parametrize("name", scenario_names())
def test_every_cell_of_every_map_comes_back(name):
    convert = converter(name, resolution=1 / 3)
    for cell in range(len(convert.grid.cells)):
        assert convert.unpack_state(convert.pack_state(9, cell)) == (9, cell)


def test_x_points_east_and_y_north():
    convert = converter("env1", resolution=0.5)
    rows, _ = convert.grid.shape
    for cell, (row, column) in enumerate(convert.grid.cells):
        message = deserialize_message(convert.pack_state(4, cell), PoseStamped)
        assert message == convert.pose(4, cell)
        assert message.pose.position.x == (column + 0.5) * 0.5
        assert message.pose.position.y == (rows - 1 - row + 0.5) * 0.5
        assert message.header.frame_id == "map"
        assert message.header.stamp == Time(sec=0, nanosec=400_000_000)


@pytest.mark.parametrize(
    ("frame", "x", "text"),
    [
        ("map", 2.5, "is at (2.5, 4.5), no free cell of map env1"),
        ("odom", 1.5, "is in the frame 'odom'"),
    ],
)
def test_a_state_elsewhere_is_a_value_error(frame, x, text):
    message = PoseStamped(header=Header(frame_id=frame))
    message.pose.position.x = x
    message.pose.position.y = 4.5
    with pytest.raises(ValueError, match=re.escape(text)):
        converter("env1").unpack_state(serialize_message(message))


@pytest.mark.parametrize("referee", [False, True])
def test_rewards_come_back(referee):
    scenario = load_scenario("env1").with_settings({"referee": referee})
    convert = Converter(make_run(scenario, {}))
    partners = (2,) if referee else ()
    for parts in ((10.0, -20.0, -1.0, -11.0), (0.0, 0.0, 0.0, 0.1 + 0.2)):
        reward = Reward(*parts, *partners)
        data = convert.pack_reward(12, reward)
        assert convert.unpack_reward(data) == (12, reward)
        labels = [*REWARD.labels, *(["partners"] if referee else [])]
        assert list(deserialize_message(data, JointState).name) == labels


@pytest.mark.parametrize("strange", [math.nan, math.inf, -math.inf])
def test_a_reward_that_is_not_finite_is_a_value_error(strange):
    convert = converter()
    for place in range(4):
        numbers = [1.0, 0.0, 0.0, 1.0]
        numbers[place] = strange
        with pytest.raises(ValueError, match="not finite"):
            convert.unpack_reward(convert.pack_reward(3, Reward(*numbers)))
        with pytest.raises(ValueError, match="not finite"):
            message = labelled([*REWARD.labels, "x"], [*numbers, 0])
            convert.unpack_reward(serialize_message(message))


@pytest.mark.parametrize("peer", [-1, 0, 3])
@pytest.mark.parametrize(
    ("move", "vector"), [*enumerate([(0.0, 1.0), (0.0, -1.0), (1.0, 0.0), (-1.0, 0.0)])]
)
def test_actions_come_back(move, vector, peer):
    """The moves north, south, east and west are unit vectors, peers count from 1."""
    convert = converter("env2-4r")
    for asked, perceived in ((False, False), (True, False), (True, True)):
        action = Action(move, asked, peer, perceived)
        for report in (SelfReport(3, True), SelfReport(0, False)):
            data = convert.pack_action(77, action, report)
            assert convert.unpack_action(data) == (77, action)
            assert convert.unpack_self_report(data) == (77, action, report)
            said = deserialize_message(data, JointState)
            assert list(said.name) == list(ACTION.labels)
            assert tuple(said.position) == (
                *vector,
                asked,
                peer + 1,
                perceived,
                *report,
            )


def altered(**numbers):
    said = (
        dict(zip(ACTION.labels, [1.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0], strict=True))
        | numbers
    )
    return {"labels": said, "numbers": said.values()}


@pytest.mark.parametrize(
    ("said", "text"),
    [
        ({**altered(), "sec": -1}, "is stamped -1 s 0 ns, outside of the run"),
        ({**altered(), "nanosec": 2**32 - 1}, "0 s 4294967295 ns, outside"),
        (altered(coordinate=math.nan), "coordinate nan"),
        (altered(peer=3.0), "peer 3.0"),
        (altered(peer=math.nan), "peer nan"),
        (altered(perceived=0.5), "perceived 0.5"),
        (altered(percept=math.inf), "says inf, 0.0 of itself"),
        (altered(east=0.0), "no primitive action"),
        (altered(east=math.nan, north=1.0), "no primitive action"),
    ],
)
def test_an_action_that_does_not_fit_the_run_is_a_value_error(said, text):
    data = serialize_message(labelled(**said))
    with pytest.raises(ValueError, match=re.escape(text)):
        converter().unpack_self_report(data)


def test_status_comes_back():
    order = Order("ab", 20, 41)
    for said in (
        RunStatus("id", "learning", 7, 6, 2, "start", order),
        RunStatus("", "paused", 1, 0),
    ):
        assert read_status(status("env1", said.state, said.values())) == said
    good = RunStatus("", "learning", 7, 6).values()
    for bad in ({"step": "x"}, {"step": -1}, {"rollback": "ab 1"}):
        with pytest.raises(ValueError):
            read_status(status("env1", "learning", good | bad))
    with pytest.raises(ValueError, match="has no value 'began'"):
        read_status(
            status("a", "b", {name: good[name] for name in good if name != "began"})
        )


def test_progress_comes_back_and_none_is_beyond_any_run():
    said = Progress("life", 40, 39, (0, 20), "order", True)
    assert read_progress(status("robot_1", "progress", said.values())) == said
    for bad in (
        {"step": -1},
        {"step": 10**12},
        {"transitions": 10**30},
        {"checkpoints": (0, -5)},
    ):
        with pytest.raises(ValueError, match="more than a run can have"):
            read_progress(status("robot_1", "progress", said._replace(**bad).values()))


def test_a_claim_says_who_and_how_far():
    assert read_claim(Header(frame_id="ab12 holding")) == ("ab12", ClaimRank.HOLDING)
    for bad in ("", "ab12", " holding", "ab12 dancing"):
        with pytest.raises(ValueError, match="is no claim"):
            read_claim(Header(frame_id=bad))


def grid_of(convert, data):
    """Return an occupancy grid's values as the map's rows are written, the northmost first."""
    message = deserialize_message(data, OccupancyGrid)
    info = message.info
    assert (info.height, info.width) == convert.grid.shape
    assert info.resolution == convert.resolution and info.origin.orientation.w == 1.0
    assert message.header == convert.header(3)
    return np.flipud(np.array(message.data).reshape(convert.grid.shape))


def test_the_map_is_drawn_from_the_south():
    convert = converter("env1", resolution=0.25)
    values = grid_of(convert, convert.pack_map(3))
    walls = np.array([[sign == "#" for sign in row] for row in convert.grid.rows])
    np.testing.assert_array_equal(values, 100 * walls)


def test_the_coordination_map_shows_where_coordinate_is_best():
    convert = converter("env1")
    tables = untrained(load_scenario("env1"))
    tables.q_star[:] = 0.0
    tables.q_star[:, 0] = 1.0
    tables.q_star[7, COORDINATE] = 2.0
    values = grid_of(convert, convert.pack_coordination_map(3, tables.q_star))
    assert np.argwhere(values == 100).tolist() == [list(convert.grid.cells[7])]
    assert np.count_nonzero(values == -1) == sum(
        r.count("#") for r in convert.grid.rows
    )
    tables = untrained(load_scenario("env1"), "noncoop")
    assert 100 not in grid_of(convert, convert.pack_coordination_map(3, tables.q_star))


def marker_rows(convert, scenario, array):
    """Return what a log makes of a message of markers, and whether it is of the run's form."""
    data = serialize_message(array)
    form = markers_form(convert, scenario)
    return form.rows(data, np.array([0]), np.array([len(data)]))


def test_markers_show_doorways_goals_and_robots():
    """Packed twice at different steps: what one left must not show in the other."""
    scenario = load_scenario("env2-4r")
    convert = converter("env2-4r", resolution=2.0)
    for step, cells in ((8, [3, 4, 5, 6]), (70_000, [7, 4, 0, 9])):
        array = deserialize_message(
            convert.pack_markers(convert.stamp(step), cells), MarkerArray
        )
        by_kind = {}
        for marker in array.markers:
            assert (marker.action, marker.header) == (Marker.ADD, convert.header(step))
            position = marker.pose.position
            by_kind.setdefault(marker.ns, {})[marker.id] = convert.cell(
                position.x, position.y
            )
        assert set(by_kind["doorways"].values()) == scenario.map.doorways
        assert list(by_kind["goals"].values()) == [
            robot.goal for robot in scenario.robots
        ]
        assert list(by_kind["robots"].values()) == cells
        assert len(array.markers) == sum(len(ids) for ids in by_kind.values())
        rows, fits = marker_rows(convert, scenario, array)
        assert fits.all() and convert.step(0, int(rows["ns"][0])) == step
        assert rows["places"][0].tolist() == [list(convert.centres[c]) for c in cells]
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


def other_look(markers):
    markers[0].color.r = 0.5


def other_stamp(markers):
    markers[-1].header.stamp.sec += 1


def other_frame(markers):
    markers[0].header.frame_id = "odom"


def other_place(markers):
    markers[0].pose.position.x += 1.0


@pytest.mark.parametrize(
    ("change", "fits"),
    [
        (len, True),
        (other_look, False),
        (other_stamp, False),
        (other_frame, False),
        (other_place, False),
    ],
)
def test_other_markers_are_not_of_the_runs_form(change, fits):
    convert = converter()
    array = deserialize_message(
        convert.pack_markers(convert.stamp(8), [3, 4]), MarkerArray
    )
    change(array.markers)
    assert marker_rows(convert, load_scenario("env1"), array)[1].tolist() == [fits]


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


def test_values_of_a_status_come_back():
    message = status("env1", "learning", {"step": 12, "rate": 0.5}, warn=True)
    assert values_of(message) == {"step": "12", "rate": "0.5"}
    assert (message.name, message.message, message.level) == (
        "env1",
        "learning",
        message.WARN,
    )
    assert status("env1", "learning", {}).level == message.OK
