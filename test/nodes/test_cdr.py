# Copyright 2026 The sparse_coord_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The fast CDR says what rclpy says, byte for byte, and reads what anybody may send."""

import math
import struct
import subprocess
import sys

import pytest
from builtin_interfaces.msg import Time
from geometry_msgs.msg import PoseStamped
from rclpy.node import Node
from rclpy.serialization import deserialize_message, serialize_message
from sensor_msgs.msg import JointState
from std_msgs.msg import Header

from sparse_coord_ros.nodes.cdr import PROBE_NUMBER, FixedLayout
from sparse_coord_ros.nodes.messages import ACTION_LAYOUT, CLOCK_LAYOUT, POSE_LAYOUT, REWARD_LAYOUT
from sparse_coord_ros.wire import ACCOUNT_LABELS, ACTION_LABELS, REWARD_LABELS

STAMPS = [(0, 0), (1, 1), (12, 300_000_000), (2**31 - 1, 999_999_999)]
NUMBERS = [0.0, -0.0, 1.0, -21.0, 0.1, 5e-324, -1.7e308, math.inf, PROBE_NUMBER]


def assert_same_cdr(data, message):
    """Check bytes against rclpy's, which holds random ones where no field lies and at its end."""
    theirs = serialize_message(message)
    assert len(data) <= len(theirs) <= len(data) + 8
    assert all(mine == other or mine == 0 for mine, other in zip(data, theirs, strict=False))
    assert deserialize_message(data, type(message)) == message


def header(sec, nanosec, frame_id="map"):
    return Header(stamp=Time(sec=sec, nanosec=nanosec), frame_id=frame_id)


def pose(sec, nanosec, x, y, frame_id="map"):
    message = PoseStamped(header=header(sec, nanosec, frame_id))
    message.pose.position.x, message.pose.position.y = x, y
    return message


def labelled(labels, sec, nanosec, numbers, frame_id="map"):
    return JointState(
        header=header(sec, nanosec, frame_id), name=list(labels), position=list(numbers)
    )


@pytest.mark.parametrize("stamp", STAMPS)
def test_packs_a_pose_as_rclpy_does(stamp):
    for x in NUMBERS:
        for y in reversed(NUMBERS):
            assert POSE_LAYOUT.pack(*stamp, x, y) == serialize_message(pose(*stamp, x, y))
            assert POSE_LAYOUT.unpack(POSE_LAYOUT.pack(*stamp, x, y)) == (*stamp, x, y)


@pytest.mark.parametrize("stamp", STAMPS)
@pytest.mark.parametrize(
    ("layout", "labels"),
    [(REWARD_LAYOUT, REWARD_LABELS), (ACTION_LAYOUT, (*ACTION_LABELS, *ACCOUNT_LABELS))],
)
def test_packs_labelled_numbers_as_rclpy_does(layout, labels, stamp):
    for shift in range(len(NUMBERS)):
        numbers = (NUMBERS[shift:] + NUMBERS[:shift])[: len(labels)]
        data = layout.pack(*stamp, *numbers)
        assert_same_cdr(data, labelled(labels, *stamp, numbers))
        assert layout.unpack(data) == (*stamp, *numbers)


@pytest.mark.parametrize("stamp", STAMPS)
def test_packs_a_clock_as_rclpy_does(stamp):
    data = CLOCK_LAYOUT.pack(*stamp)
    message = deserialize_message(data, CLOCK_LAYOUT.message_type)
    assert (message.clock.sec, message.clock.nanosec) == stamp
    assert data == serialize_message(message)
    assert CLOCK_LAYOUT.unpack(data) == stamp


def test_packs_the_same_bytes_in_every_process():
    """Where no field lies rclpy leaves what was in memory: no two processes' bytes agree."""
    program = (
        "from sparse_coord_ros.nodes.messages import ACTION_LAYOUT, REWARD_LAYOUT\n"
        "print(REWARD_LAYOUT.pack(1, 2, 3.0, 4.0, 5.0, 6.0).hex())\n"
        "print(ACTION_LAYOUT.pack(1, 2, 1.0, 0.0, 1.0, 2.0, 1.0, 3.0, 1.0).hex())\n"
    )
    theirs = subprocess.check_output([sys.executable, "-c", program], text=True).split()
    assert theirs == [
        REWARD_LAYOUT.pack(1, 2, 3.0, 4.0, 5.0, 6.0).hex(),
        ACTION_LAYOUT.pack(1, 2, 1.0, 0.0, 1.0, 2.0, 1.0, 3.0, 1.0).hex(),
    ]


def test_packs_what_a_publisher_of_messages_sends(bench):
    message = labelled(REWARD_LABELS, 5, 6, [1.0, 2.0, 3.0, 4.0])
    publisher = bench.observer().create_publisher(JointState, "reward", 10)
    reader = bench.add(Node("reader", context=bench.place()[0]))
    got = []
    reader.create_subscription(JointState, "reward", lambda data: got.append(data), 10, raw=True)
    bench.spin_until(lambda: publisher.get_subscription_count(), "matched")

    def arrived():
        publisher.publish(message)
        return got

    bench.spin_until(arrived, "message")
    mine = REWARD_LAYOUT.pack(5, 6, 1.0, 2.0, 3.0, 4.0)
    assert len(mine) == len(got[0])
    assert all(a == b or a == 0 for a, b in zip(mine, got[0], strict=True))
    assert REWARD_LAYOUT.unpack(got[0]) == (5, 6, 1.0, 2.0, 3.0, 4.0)


def test_reads_what_rclpy_leaves_between_the_fields():
    data = bytearray(REWARD_LAYOUT.pack(1, 2, 3.0, 4.0, 5.0, 6.0))
    data[data.index(b"common\0") + 7] = 0xEE
    assert REWARD_LAYOUT.unpack(bytes(data)) == (1, 2, 3.0, 4.0, 5.0, 6.0)


def test_keeps_the_bits_of_nan():
    data = POSE_LAYOUT.pack(3, 4, math.nan, 1.0)
    assert data == serialize_message(pose(3, 4, math.nan, 1.0))
    assert math.isnan(POSE_LAYOUT.unpack(data)[2])


@pytest.mark.parametrize("frame_id", ["", "odom", "nap", "map/robot_1"])
def test_refuses_poses_of_other_frames(frame_id):
    data = serialize_message(pose(12, 34, 1.5, -2.5, frame_id))
    with pytest.raises(ValueError, match=f"frame_id is '{frame_id}', not 'map'"):
        POSE_LAYOUT.unpack(data)


def test_reads_a_pose_with_an_orientation_of_its_own():
    message = pose(1, 2, 3.5, 4.5)
    message.pose.orientation.z, message.pose.position.z = 1.0, 9.0
    assert POSE_LAYOUT.unpack(serialize_message(message)) == (1, 2, 3.5, 4.5)


def test_reads_labels_in_another_order():
    numbers = [10.0, -20.0, -1.0, -11.0]
    data = serialize_message(labelled(reversed(REWARD_LABELS), 5, 6, reversed(numbers)))
    assert REWARD_LAYOUT.unpack(data) == (5, 6, *numbers)


def test_reads_labels_of_equal_length_in_another_order():
    labels = ["common", "individual", "ask_cost", "total"]
    swapped = serialize_message(labelled(labels, 5, 6, [1.0, 2.0, 3.0, 4.0]))
    assert REWARD_LAYOUT.unpack(swapped) == (5, 6, 2.0, 1.0, 3.0, 4.0)


def test_reads_labels_among_others():
    labels = ["battery", *ACTION_LABELS, "mood", *ACCOUNT_LABELS]
    numbers = [9.0, 1.0, 0.0, 1.0, 2.0, 1.0, 7.0, 3.0, 1.0]
    data = serialize_message(labelled(labels, 5, 6, numbers))
    assert ACTION_LAYOUT.unpack(data) == (5, 6, 1.0, 0.0, 1.0, 2.0, 1.0, 3.0, 1.0)


def test_optional_labels_that_are_missing_read_as_zero():
    data = serialize_message(labelled(ACTION_LABELS, 5, 6, [1.0, 0.0, 1.0, 2.0, 1.0]))
    assert ACTION_LAYOUT.unpack(data) == (5, 6, 1.0, 0.0, 1.0, 2.0, 1.0, 0.0, 0.0)


def test_reads_a_message_that_says_velocities_too():
    message = labelled(REWARD_LABELS, 5, 6, [1.0, 2.0, 3.0, 4.0])
    message.velocity = [0.5]
    assert REWARD_LAYOUT.unpack(serialize_message(message)) == (5, 6, 1.0, 2.0, 3.0, 4.0)


@pytest.mark.parametrize("missing", REWARD_LABELS)
def test_names_the_label_that_is_missing(missing):
    labels = [label for label in REWARD_LABELS if label != missing]
    data = serialize_message(labelled(labels, 5, 6, [1.0, 2.0, 3.0]))
    with pytest.raises(ValueError, match=f"^no number is labelled {missing}$"):
        REWARD_LAYOUT.unpack(data)


def test_misses_a_label_without_a_number():
    data = serialize_message(labelled(REWARD_LABELS, 5, 6, [1.0, 2.0, 3.0]))
    with pytest.raises(ValueError, match="^no number is labelled total$"):
        REWARD_LAYOUT.unpack(data)


def test_misses_all_labels_of_an_empty_message():
    with pytest.raises(ValueError, match="east, north, coordinate, peer, perceived"):
        ACTION_LAYOUT.unpack(serialize_message(JointState(header=Header(frame_id="map"))))


def test_refuses_a_layout_whose_probes_are_not_found():
    with pytest.raises(RuntimeError, match="PoseStamped: probe not found"):
        FixedLayout(PoseStamped, lambda sec, nanosec, x: PoseStamped(), lambda message: (), 1)


def test_packs_no_other_count_of_numbers():
    with pytest.raises(struct.error, match="items"):
        POSE_LAYOUT.pack(1, 2, 3.0)
