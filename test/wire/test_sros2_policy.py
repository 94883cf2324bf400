# Copyright 2026 The sparse_coord_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The shipped policy for DDS-Security allows the topics and services of a team, and no others."""

from xml.etree import ElementTree

from sparse_coord_ros.base.share import share_folder
from sparse_coord_ros.protocol import wire
from sparse_coord_ros.protocol.wire import services

TRANSFORMS = "/tf"
"""The only topic that is not in the table of topics."""

OF_PARAMETERS = {
    *("describe_parameters", "get_parameter_types", "get_parameters"),
    *("list_parameters", "set_parameters", "set_parameters_atomically"),
    "get_type_description",
}
"""Services that rclpy gives every node."""


def allowed(tag):
    """Return the names that the policy allows, of "topic" or "service", without doubles."""
    policy = ElementTree.parse(share_folder("config") / "sros2_policy.xml")
    names = [one.text for one in policy.iter(tag)]
    assert len(names) == len(set(names))
    return set(names)


def test_the_policy_has_the_table_of_topics():
    names = {
        topic.of("*") if topic.owner == wire.ROBOT else topic.name
        for topic in wire.TOPICS
    }
    assert allowed("topic") == names | {TRANSFORMS}


def test_the_policy_has_the_table_of_services():
    known = [
        one for one in vars(services).values() if isinstance(one, services.Service)
    ]
    assert len(known) > 3
    names = {one.name for one in known} | OF_PARAMETERS
    assert allowed("service") == {f"*/{name}" for name in names}
