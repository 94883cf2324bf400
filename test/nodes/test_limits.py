# Copyright 2026 The sparse_coord_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Limits of messages: the largest team's stay below them, larger ones are not read."""

import io
import time
import zipfile
from types import SimpleNamespace

import numpy as np
import pytest
from diagnostic_msgs.msg import DiagnosticStatus, KeyValue
from rclpy.serialization import deserialize_message, serialize_message
from sensor_msgs.msg import JointState
from teams import drawn

from sparse_coord_ros.base.errors import TablesError
from sparse_coord_ros.base.limits import TABLES
from sparse_coord_ros.core.game.scenario import LARGEST_TEAM, load_scenario
from sparse_coord_ros.core.runs.run_config import RunConfig, make_run
from sparse_coord_ros.core.runs.tables import unpack_saved
from sparse_coord_ros.protocol import wire
from sparse_coord_ros.protocol.lockstep.bodies import BodyGoal, Goals
from sparse_coord_ros.protocol.wire.status import read_status
from sparse_coord_ros.ros.nodes import ros_topics
from sparse_coord_ros.ros.nodes.messages import Converter
from sparse_coord_ros.ros.nodes.subscriber import Subscriber

STALL_SECONDS = 0.05
"""Longest time to read one message for a node in the lock step; measured: 8 ms."""


@pytest.mark.parametrize("topic", wire.TOPICS, ids=lambda topic: topic.name)
def test_a_large_message_is_dropped_unread(topic):
    heard = {}
    said = []

    def create_subscription(kind, name, take, qos, raw):
        heard[name] = take

    logger = SimpleNamespace(warning=said.append)
    node = SimpleNamespace(
        create_subscription=create_subscription, get_logger=lambda: logger
    )
    subscriber = Subscriber(node)
    bound = ros_topics.bind(topic)
    subscriber.listen(bound, None, name="x", unpack=None, read=None)
    heard["x"](bytes(topic.limit.bytes + 1))
    assert subscriber.dropped == {"x": 1}
    assert (
        f"allowed for {topic.limit.what}: {topic.limit.bytes:,}; message dropped"
        in said[0]
    )


def test_messages_of_a_large_team_are_below_the_limits():
    rows = ["1" + "." * 99, *["." * 100] * 98, "." * 99 + "2"]
    robots = {f"robot_{k + 1}": (1, 2) for k in range(LARGEST_TEAM)}
    scenario = drawn("\n".join(rows), robots)
    run = RunConfig(scenario=scenario, learner="indiv", versions={})
    convert = Converter(run)
    goals = Goals(
        1, 0, False, 0.0, tuple(BodyGoal(k, 1, 2) for k in range(LARGEST_TEAM))
    )
    for topic, data in (
        (wire.RUN, run.to_yaml().encode()),
        (wire.MAP, convert.pack_map(0)),
        (
            wire.MARKERS,
            convert.pack_markers((0, 0), [robot.start for robot in scenario.robots]),
        ),
        (wire.BODY_GOALS, serialize_message(convert.goals_message(goals))),
        (wire.LOCAL_STATE, convert.pack_state(7, 3)),
    ):
        assert len(data) < topic.limit.bytes / 2, topic.name


def test_the_largest_message_does_not_stall_the_lock_step():
    convert = Converter(make_run(load_scenario("env1"), {}))
    values = DiagnosticStatus(values=[KeyValue()] * 4000)
    names = JointState(name=["x"] * 8000)
    names.header.frame_id = "map"
    for message, read in (
        (values, lambda data: read_status(deserialize_message(data, DiagnosticStatus))),
        (names, convert.unpack_reward),
        (names, convert.unpack_self_report),
    ):
        data = serialize_message(message)
        assert (
            0.9 * ros_topics.STATUS.limit.bytes
            < len(data)
            <= ros_topics.STATUS.limit.bytes
        )
        taken = []
        for _ in range(3):
            before = time.process_time()
            with pytest.raises(ValueError):
                read(data)
            taken.append(time.process_time() - before)
        assert min(taken) < STALL_SECONDS


def test_tables_are_unpacked_only_as_far_as_those_of_a_robot_can_be():
    file = io.BytesIO()
    with zipfile.ZipFile(file, "w", zipfile.ZIP_DEFLATED, compresslevel=1) as archived:
        with archived.open("q_star_1.npy", "w") as array:
            np.lib.format.write_array(array, np.zeros((10_000_000, 1)))
    assert len(file.getvalue()) < 600_000
    before = time.process_time()
    with pytest.raises(TablesError, match="80,000,128 bytes"):
        unpack_saved(file.getvalue(), [1], where="tables", limit=TABLES)
    assert time.process_time() - before < STALL_SECONDS


def test_the_identity_of_a_run_is_read_from_its_first_line():
    run = RunConfig(scenario=load_scenario("env1"), versions={}, id="12e45")
    assert run.to_yaml().startswith("id: '12e45'\n")
    assert RunConfig.identity(run.to_yaml().encode()) == "12e45"
    assert RunConfig.identity(b"x: 1\nid: abc\n") == ""
