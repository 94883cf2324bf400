# Copyright 2026 The sparse_coord_ros authors
# SPDX-License-Identifier: Apache-2.0
"""A test's ROS domain is its own, also where a team runs on this machine."""

import socket

import pytest
from domains import FIRST_PORT, PORTS_OF_A_DOMAIN, is_free, ros_domain

A = 99
B = 100


@pytest.mark.parametrize("port", [0, 10, 14])
def test_a_domain_in_which_a_participant_listens_is_not_taken(port):
    """On the port that all share, or on one of its own; it may let others share it."""
    with socket.socket(type=socket.SOCK_DGRAM) as participant:
        participant.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        participant.bind(("", FIRST_PORT + PORTS_OF_A_DOMAIN * A + port))
        assert not is_free(A)
        for _ in range(5):
            with ros_domain([A, B]) as domain:
                assert domain == B
    assert is_free(A)


def test_two_tests_have_two_domains():
    with ros_domain([A, B]) as one, ros_domain([A, B]) as other:
        assert {one, other} == {A, B}


def test_a_domain_with_a_node_is_found_out():
    spin = pytest.importorskip("sparse_coord_ros.ros.nodes.spin")
    with ros_domain([A, B]) as domain, pytest.MonkeyPatch.context() as patch:
        patch.setenv("ROS_DOMAIN_ID", str(domain))
        with spin.ros_context() as context:
            import rclpy.node

            node = rclpy.node.Node("a_node", context=context)
            assert not is_free(domain)
            node.destroy_node()
