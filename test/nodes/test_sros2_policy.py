# Copyright 2026 The sparse_coord_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The shipped policy for DDS-Security allows what the nodes of a team do, and nothing else."""

from xml.etree import ElementTree

import pytest

from sparse_coord_ros.base.share import share_folder
from sparse_coord_ros.protocol import wire

POLICY = share_folder("config") / "sros2_policy.xml"
NAMES = ("robot_1", "robot_2")
NODES = (wire.WORLD, *NAMES, wire.RECORDER)
KINDS = (
    ("topics", "publish", "get_publisher_names_and_types_by_node"),
    ("topics", "subscribe", "get_subscriber_names_and_types_by_node"),
    ("services", "reply", "get_service_names_and_types_by_node"),
    ("services", "request", "get_client_names_and_types_by_node"),
)
FOR_SIM_TIME = {"/clock"}
"""A node under use_sim_time subscribes to it too."""
WITH_TF2 = {"/tf"}
"""Published where tf2_msgs is there."""
EVERY_NODE = {"/parameter_events"}
"""Possible subscriptions of rclpy's parameter callbacks."""


def allowed(node: str, tag: str, action: str) -> set[str]:
    """Return the full names that the policy allows a node."""
    (profile,) = ElementTree.parse(POLICY).iterfind(f".//profile[@node='{node}']")
    said = [one.text for one in profile.iterfind(f"{tag}[@{action}='ALLOW']/*")]
    assert len(said) == len(set(said)), "a name stands twice"
    own = [
        name.replace("~", f"/{node}") if name.startswith("~") else name for name in said
    ]
    return {name if name.startswith("/") else f"/{name}" for name in own}


@pytest.fixture(scope="module")
def team(module_bench, tmp_path_factory):
    """Return an observer of a whole team that is under way."""
    observer = module_bench.observer()
    world = module_bench.world(rate=50.0, recorded=True)
    module_bench.recorder(tmp_path_factory.mktemp("policy") / "bag")
    module_bench.robots()
    module_bench.spin_until(
        lambda: world.lockstep.world.transitions > 3, "the run is under way"
    )
    return observer


@pytest.mark.parametrize("node", NODES)
@pytest.mark.parametrize(("tag", "action", "question"), KINDS)
def test_each_node_may_do_what_it_does(team, node, tag, action, question):
    does = {name for name, _ in getattr(team, question)(node, "/")}
    may = allowed(node, tag, action)
    assert does - may == set(), "is not allowed"
    beside = FOR_SIM_TIME | EVERY_NODE if action == "subscribe" else WITH_TF2
    assert may - does - beside == set(), "is allowed, but not done"
