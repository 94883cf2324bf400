# Copyright 2026 The sparse_coord_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The treatment of messages that do not fit."""

from types import SimpleNamespace

from sparse_coord_ros.ros.nodes.subscriber import Subscriber


def test_a_message_that_does_not_fit_is_said_once_a_topic_and_counted():
    lines = []
    logger = SimpleNamespace(warning=lines.append)
    subscriber = Subscriber(SimpleNamespace(get_logger=lambda: logger), print)
    for _ in range(3):
        subscriber.drop("/a", "has two\nlines")
    subscriber.drop("/b", ValueError("is none"), "the answer is not used")
    assert lines == [
        "/a: has two lines; message dropped; further ones are only counted (diagnostics)",
        "/b: is none; the answer is not used; further ones are only counted (diagnostics)",
    ]
    assert subscriber.dropped == {"/a": 3, "/b": 1}
    assert subscriber.total == 4
