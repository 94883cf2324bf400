# Copyright 2026 The sparse_coord_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Nodes that came back and continued without the team: unknown parts are named."""

import numpy as np
import pytest
from rclpy.serialization import serialize_message

from sparse_coord_ros.cli.main import main
from sparse_coord_ros.core.runs.tables import pack_tables, unpack_saved
from sparse_coord_ros.log.bags import BagWriter, QoS
from sparse_coord_ros.log.bags.reader import open_bag
from sparse_coord_ros.log.runlog import verify
from sparse_coord_ros.protocol.wire import RunState
from sparse_coord_ros.protocol.wire.status import (
    NO_ROLLBACK,
    Order,
    Progress,
    RunStatus,
)
from sparse_coord_ros.ros.nodes.messages import status

AT = 120
"""The time step at which robot_2 comes back."""
FIRST = Progress("one", 0, 0)
ALONE = Progress("another", 40, 39, (40, 0), resumed=True)
OBEYED = ALONE._replace(obeyed="order")
CALL = RunStatus("", RunState.RESUMING, 1, 0, order=Order("order", NO_ROLLBACK, 40))


@pytest.fixture
def returned(good, tmp_path):
    """Return a function that writes a bag: robot_2 sends a message, tables are changed.

    The tables `which` of a robot are changed; the attachment `again` occurs twice.
    """
    bag = open_bag(good.bag)
    directory = tmp_path / "bag"
    period = round(good.run.step_period * 1e9)

    def written(*said, other, which=-1, again=None, call=False, without=None):
        with BagWriter(directory) as new:
            for name, texts in bag.metadata.items():
                if name != "rosbag2":
                    new.add_metadata(name, texts)
            places = {one.name: new.add_known_topic(one) for one in bag.topics.values()}
            latched = QoS(durability="transient_local", depth=1)
            own = new.add_topic(
                "/robot_2/_progress", "diagnostic_msgs/msg/DiagnosticStatus", latched
            )
            if call:
                message = status("env1", CALL.state, CALL.values())
                new.write(places["/status"], serialize_message(message), 0, 0)
            due = [(0, FIRST), *((AT + 60 * i, one) for i, one in enumerate(said))]
            for one in bag.messages():
                while due and one.log_time_ns > due[0][0] * period:
                    step, progress = due.pop(0)
                    data = serialize_message(
                        status("robot_2", "progress", progress.values())
                    )
                    new.write(own, data, step * period, step * period)
                if (one.topic, one.log_time_ns) != without:
                    new.write(
                        places[one.topic],
                        one.data,
                        one.log_time_ns,
                        one.publish_time_ns,
                    )
            last = [
                one.name
                for one in bag.attachments
                if one.name.startswith(f"tables/{other}")
            ]
            for one in bag.attachments:
                data = one.data
                if one.name == last[which]:
                    number = int(other[-1])
                    [saved] = unpack_saved(data, [number], where="")
                    q_star = saved.memory["q_star"]
                    q_star[0, 0] = np.nextafter(q_star[0, 0], 1)
                    data = pack_tables({number: saved.memory}, counts=saved.counts)
                for _ in range(1 + (one.name == again)):
                    new.attach(one.name, data, one.media_type, one.log_time_ns)
        return verify(directory)

    return written


def test_a_robot_that_went_on_alone_is_an_open_question(returned, tmp_path, capsys):
    [unknown] = returned(ALONE, other="robot_2").unknown
    assert unknown[:2] == (AT, None) and unknown.why.startswith("robot_2 returned")
    assert main(["verify", str(tmp_path / "bag")]) == 3
    told = f"undecided from time step {AT} on: robot_2 returned "
    assert told in capsys.readouterr().out


def test_a_robot_that_comes_back_twice(returned):
    """The run is undecided from the first time on; its checkpoint's tables come again."""
    first, second = (
        ALONE._replace(life=life, step=0) for life in ("another", "a third")
    )
    found = returned(
        first, second, other="robot_2", which=1, again="tables/robot_2_0.npz"
    )
    assert found.undecided
    assert [one[:2] for one in found.unknown] == [(AT, None)]


def test_an_order_without_rollback_moves_no_robot_back(returned):
    assert returned(ALONE, OBEYED, other="robot_2", call=True).undecided


def test_what_follows_from_a_world_that_came_back_alone_is_open(returned, good):
    gone = "/robot_1/local_state", round(AT * good.run.step_period * 1e9)
    found = returned(other="robot_2", call=True, without=gone)
    [unknown] = found.unknown
    assert unknown[:2] == (0, None) and unknown.why.startswith("the world returned")


def test_what_differs_before_a_robot_came_back_differs(returned, good):
    gone = "/robot_1/local_state", round((AT - 1) * good.run.step_period * 1e9)
    found = returned(ALONE, other="robot_2", without=gone)
    assert [one[:3] for one in found.differences] == [
        (AT - 1, "robot_1", "local_state")
    ]
    assert [one.first for one in found.unknown] == [AT]


def test_what_differs_as_a_robot_comes_back_is_unknown(returned, good):
    gone = "/robot_1/local_state", round(AT * good.run.step_period * 1e9)
    assert returned(ALONE, other="robot_2", without=gone).undecided


def test_what_follows_from_a_robot_that_came_back_is_not_told_apart(returned):
    """Another robot's tables may follow from it, too: `verify` does not find out."""
    assert returned(ALONE, other="robot_1").undecided


@pytest.mark.parametrize(
    ("said", "other"),
    [
        ((ALONE, OBEYED), "robot_2"),
        ((FIRST,), "robot_2"),
        ((ALONE._replace(resumed=False),), "robot_2"),
        ((), "robot_2"),
    ],
    ids=[
        "it went back with the team",
        "the same process",
        "another process that began anew",
        "nobody came back",
    ],
)
def test_other_differences_are_none_of_its(returned, said, other):
    found = returned(*said, other=other)
    assert [one.robot for one in found.differences] == [other]
    assert not found.unknown
