# Copyright 2026 The sparse_coord_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The display of RViz and Foxglove beside the markers: the scene and the transforms."""

import math
import sys
from dataclasses import replace
from types import ModuleType
from types import SimpleNamespace as Anything

import pytest
from visualization_msgs.msg import Marker

from sparse_coord_ros.base.palette import OUTCOME_COLOURS, rgb
from sparse_coord_ros.core.game.scenario import load_scenario
from sparse_coord_ros.core.game.world import Action
from sparse_coord_ros.core.runs.run_config import make_run
from sparse_coord_ros.protocol import wire
from sparse_coord_ros.protocol.wire import SelfReport
from sparse_coord_ros.ros.nodes.ros_messages import map_header, messages_of
from sparse_coord_ros.ros.nodes.scene import Scene, ScenePublisher
from sparse_coord_ros.ros.nodes.transforms import robot_frame

NAMES = ("robot_1", "robot_2")


@pytest.fixture
def scene():
    run = make_run(load_scenario("env1"), {})
    messages = messages_of(run)
    return Anything(run=run, messages=messages)


def markers(scene, cells, actions=None, step=10):
    shown = Scene(scene.messages, step, cells, map_header(scene.messages.stamp(step)))
    return {(one.ns, one.id): one for one in shown.scene(actions or {}).markers}


def asking(scene, percept, *, perceived=False, step=9, peer=1):
    report = SelfReport(percept, False)
    return step, Action(0, True, peer, perceived), report


def test_names_hang_over_the_robots(scene):
    found = markers(scene, [0, 11])
    for k, cell in enumerate((0, 11)):
        one = found["names", k]
        assert (one.type, one.text) == (Marker.TEXT_VIEW_FACING, NAMES[k])
        x, y = scene.messages.centres[cell]
        assert one.pose.position.x == x and y < one.pose.position.y < y + 0.5
    stamps = {(m.header.frame_id, m.header.stamp.sec) for m in found.values()}
    assert stamps == {("map", 1)}


def test_marks_grow_with_the_cells():
    sizes = []
    for side in (1.0, 3.0):
        scenario = load_scenario("env1")
        grid = replace(scenario.map, resolution=side)
        messages = messages_of(make_run(replace(scenario, map=grid), {}))
        found = markers(Anything(messages=messages), [0, 11])
        sizes.append([(one.ns, one.scale.z / side) for one in found.values()])
    assert sizes[0] == [(name, pytest.approx(size)) for name, size in sizes[1]]


@pytest.mark.parametrize(
    ("percept", "perceived", "outcome"),
    [
        (wire.PerceptEnd.ANSWERED, True, "answered"),
        (wire.PerceptEnd.REFUSED, False, "refused"),
        (wire.PerceptEnd.LATE, False, "failed"),
        (wire.PerceptEnd.NOBODY_TO_ASK, False, "failed"),
    ],
)
def test_a_question_is_a_line_to_the_peer_and_words(scene, percept, perceived, outcome):
    found = markers(scene, [9, 11], {0: asking(scene, percept, perceived=perceived)})
    line = found["questions", 0]
    words = found["words", 0]
    assert line.type == Marker.LINE_LIST and line.action == Marker.ADD
    ends = [(point.x, point.y) for point in line.points]
    assert ends == [scene.messages.centres[9], scene.messages.centres[11]]
    colour = (line.color.r, line.color.g, line.color.b)
    assert colour == pytest.approx(rgb(OUTCOME_COLOURS[outcome]), abs=1e-6)
    assert words.text == f"asks robot_2: {outcome}"
    assert found["questions", 1].action == found["words", 1].action == Marker.DELETE


def test_a_percept_that_ended_as_nothing_known(scene):
    """The world takes actions whatever they say of themselves; showing them must not end it."""
    found = markers(scene, [9, 11], {0: asking(scene, 99)})
    assert found["words", 0].text == "asks robot_2: failed"


def test_old_questions_go_and_one_to_all_has_a_line_to_each(scene):
    old = markers(scene, [9, 11], {0: asking(scene, wire.PerceptEnd.ANSWERED, step=3)})
    assert old["questions", 0].action == Marker.DELETE
    run = make_run(load_scenario("crowd-4r"), {})
    messages = messages_of(run)
    report = SelfReport(wire.PerceptEnd.ANSWERED, False)
    said = (4, Action(0, True, -1, True), report)
    found = (
        Scene(messages, 5, [0, 1, 2, 3], map_header(messages.stamp(5)))
        .scene({1: said})
        .markers
    )
    [line] = [m for m in found if m.ns == "questions" and m.action == Marker.ADD]
    assert len(line.points) == 6


def test_doorways_rise_with_the_robots_in_them(scene):
    [door] = scene.run.scenario.map.doorways
    boxes = [
        markers(scene, cells)["occupancy", 0]
        for cells in ([0, 1], [door, 1], [door] * 2)
    ]
    assert boxes[0].scale.z < boxes[1].scale.z < boxes[2].scale.z
    assert boxes[0].color.a < boxes[1].color.a < boxes[2].color.a
    assert boxes[0].pose.position.x == scene.messages.centres[door][0]
    for box in boxes:
        assert math.isclose(box.pose.orientation.w, 1.0)


def test_transforms_are_published_where_tf2_is(scene, monkeypatch):
    published = []

    class Node:
        values = {"frame_prefix": ""}

        def get_namespace(self):
            return "/team_a"

        def announce(self, topic):
            return Anything(publish=seen.append)

        def create_publisher(self, kind, topic, qos):
            return Anything(publish=lambda message: published.append((topic, message)))

    package = ModuleType("tf2_msgs")
    module = ModuleType("tf2_msgs.msg")
    module.TFMessage = lambda transforms: transforms
    monkeypatch.setitem(sys.modules, "tf2_msgs", package)
    monkeypatch.setitem(sys.modules, "tf2_msgs.msg", module)
    seen = []
    made = ScenePublisher(Node(), scene.run.scenario, scene.messages)
    for _ in range(50):
        made.publish(5, [0, 11], (1, 0))
    assert len(seen) < 5, "at most 30 a second"
    made.publish(5, [0, 11], (1, 7), always=True)
    topic, [one, other] = published[-1]
    assert topic == "tf", "in the namespace: each has a clock of its own"
    assert (one.header.frame_id, one.child_frame_id) == (
        "map",
        "team_a/robot_1/base_link",
    )
    assert (one.header.stamp.sec, one.header.stamp.nanosec) == (1, 7)
    where = other.transform.translation
    assert (where.x, where.y) == scene.messages.centres[
        11
    ] and other.transform.rotation.w == 1
    monkeypatch.setitem(sys.modules, "tf2_msgs.msg", None)
    published.clear()
    ScenePublisher(Node(), scene.run.scenario, scene.messages).publish(
        5, [0, 11], (1, 0)
    )
    assert not published


@pytest.mark.parametrize(
    ("namespace", "given", "frame"),
    [
        ("/", "", "robot_1/odom"),
        ("/team_a", "", "team_a/robot_1/odom"),
        ("/team_a", "/", "robot_1/odom"),
        ("/team_a", "b_", "b_robot_1/odom"),
    ],
)
def test_one_rule_says_how_frames_are_called(namespace, given, frame):
    node = Anything(values={"frame_prefix": given}, get_namespace=lambda: namespace)
    assert robot_frame(node, "robot_1", "odom") == frame
