# Copyright 2026 The sparse_coord_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The fast CDR packs the same bytes as rclpy, and reads any message."""

import re
import struct

import pytest
from builtin_interfaces.msg import Time
from geometry_msgs.msg import PoseStamped
from hypothesis import given
from hypothesis import strategies as st
from rclpy.node import Node
from rclpy.serialization import deserialize_message, serialize_message
from rosgraph_msgs.msg import Clock
from sensor_msgs.msg import JointState
from std_msgs.msg import Header

from sparse_coord_ros.protocol.wire import ACTION, ACTION_LABELS, REWARD, SelfReport
from sparse_coord_ros.protocol.wire.messages import (
    ACTION_FORM,
    CLOCK_FORM,
    POSE_FORM,
    REWARD_FORM,
)

STAMPS = st.tuples(st.integers(0, 2**31 - 1), st.integers(0, 999_999_999))
FORMS = st.sampled_from([(REWARD_FORM, REWARD), (ACTION_FORM, ACTION)])


def assert_same_cdr(data, message):
    """Check bytes against rclpy's, which has random bytes between fields and at its end."""
    theirs = serialize_message(message)
    assert len(data) <= len(theirs) <= len(data) + 8
    assert all(
        mine == other or mine == 0 for mine, other in zip(data, theirs, strict=False)
    )
    assert deserialize_message(data, type(message)) == message


def header(sec, nanosec, frame_id="map"):
    return Header(stamp=Time(sec=sec, nanosec=nanosec), frame_id=frame_id)


def pose(sec, nanosec, x, y, frame_id="map"):
    message = PoseStamped(header=header(sec, nanosec, frame_id))
    message.pose.position.x = x
    message.pose.position.y = y
    return message


def labelled(labels, numbers, sec=5, nanosec=6):
    return JointState(
        header=header(sec, nanosec), name=list(labels), position=list(numbers)
    )


def said(form, message):
    """Return the content of a message in rclpy's bytes, by layout or decoded."""
    data = serialize_message(message)
    values = form.layout.unpack(data)
    if values is not None:
        return values[0] * 10**9 + values[1], list(values[2:])
    ns, numbers = form.read(deserialize_message(data, type(message)))
    return ns, list(numbers)


@given(STAMPS, st.floats(), st.floats())
def test_packs_a_pose_as_rclpy_does(stamp, x, y):
    """To the bits of each NaN."""
    data = POSE_FORM.layout.pack(*stamp, x, y)
    assert data == serialize_message(pose(*stamp, x, y))
    assert POSE_FORM.layout.pack(*POSE_FORM.layout.unpack(data)) == data


@given(st.data(), FORMS, STAMPS)
def test_packs_labelled_numbers_as_rclpy_does(data, form_of, stamp):
    form, topic = form_of
    count = len(topic.labels)
    number = st.floats(allow_nan=False)
    numbers = data.draw(st.lists(number, min_size=count, max_size=count))
    packed = form.layout.pack(*stamp, *numbers)
    assert_same_cdr(packed, labelled(topic.labels, numbers, *stamp))
    assert form.layout.unpack(packed) == (*stamp, *numbers)


@given(STAMPS)
def test_packs_a_clock_as_rclpy_does(stamp):
    data = CLOCK_FORM.layout.pack(*stamp)
    assert data == serialize_message(Clock(clock=Time(sec=stamp[0], nanosec=stamp[1])))
    assert CLOCK_FORM.layout.unpack(data) == stamp


@given(st.permutations([*REWARD.labels, "battery", "mood"]))
def test_reads_labels_in_any_order_and_among_others(labels):
    numbers = {label: float(place) for place, label in enumerate(labels)}
    message = labelled(labels, numbers.values())
    wanted = [numbers[label] for label in REWARD.labels]
    assert said(REWARD_FORM, message)[1] == wanted


def test_reads_what_a_publisher_of_messages_sends(bench):
    message = labelled(REWARD.labels, [1.0, 2.0, 3.0, 4.0, 5.0])
    publisher = bench.observer().create_publisher(JointState, "reward", 10)
    reader = bench.add(Node("reader", context=bench.place()[0]))
    got = []
    reader.create_subscription(
        JointState, "reward", lambda data: got.append(data), 10, raw=True
    )
    bench.spin_until(lambda: publisher.get_subscription_count(), "matched")

    def arrived():
        publisher.publish(message)
        return got

    bench.spin_until(arrived, "message")
    mine = REWARD_FORM.layout.pack(5, 6, 1.0, 2.0, 3.0, 4.0, 5.0)
    assert len(mine) == len(got[0])
    assert all(a == b or a == 0 for a, b in zip(mine, got[0], strict=True))
    assert said(REWARD_FORM, message) == (5_000_000_006, [1.0, 2.0, 3.0, 4.0, 5.0])


def test_another_message_has_another_layout():
    data = bytearray(REWARD_FORM.layout.pack(1, 2, 3.0, 4.0, 5.0, 6.0, 7.0))
    data[data.index(b"common\0") + 7] = 0xEE  # between the fields
    assert REWARD_FORM.layout.unpack(bytes(data)) is None
    assert REWARD_FORM.layout.unpack(bytes(data[:-1])) is None
    assert said(REWARD_FORM, deserialize_message(bytes(data), JointState))[1][1] == 4.0


def test_reads_an_action_among_other_numbers():
    labels = ["battery", *ACTION_LABELS, "mood", *SelfReport._fields]
    message = labelled(labels, [9.0, 1.0, 0.0, 1.0, 2.0, 1.0, 7.0, 3.0, 1.0])
    assert said(ACTION_FORM, message)[1] == [1.0, 0.0, 1.0, 2.0, 1.0, 3.0, 1.0]


def test_reads_a_message_that_says_velocities_too():
    message = labelled(REWARD.labels, [1.0, 2.0, 3.0, 4.0, 5.0])
    message.velocity = [0.5]
    assert said(REWARD_FORM, message)[1] == [1.0, 2.0, 3.0, 4.0, 5.0]


@pytest.mark.parametrize(
    ("labels", "count", "text"),
    [
        (REWARD.labels[1:], 4, "has no number labelled individual"),
        (REWARD.labels, 3, "has 5 labels and 3 numbers"),
        (
            (*REWARD.labels[:3], "common"),
            4,
            "labels a number twice: individual, common, ask_c",
        ),
        ((), 0, "has no number labelled individual, common, ask_cost, total, partners"),
    ],
)
def test_says_which_labels_do_not_fit(labels, count, text):
    with pytest.raises(ValueError, match=f"^{re.escape(text)}"):
        said(REWARD_FORM, labelled(labels, [1.0] * count))


def test_packs_no_number_that_is_none():
    with pytest.raises(struct.error):
        POSE_FORM.layout.pack(1, 2, 3.0, None)
