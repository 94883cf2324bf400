# Copyright 2026 The sparse_coord_ros authors
# SPDX-License-Identifier: Apache-2.0
"""One holder a name: of two nodes of the same name, the later one stops.

World and robots say on their latched topics `~/claim` since when they have been there. Discovery
may take seconds, so a claim is never settled for good: whenever two nodes of one name learn of
each other, the later one gives way.
"""

import time
import uuid
from typing import Any

from sparse_coord_ros.errors import NameTakenError
from sparse_coord_ros.nodes.interface import CLAIM, CLAIMS_QOS
from sparse_coord_ros.nodes.parameters import ParameterNode


class Claim:
    """A node's claim to its name.

    Args:
        node: the claiming node; its `fail` is called where an earlier node has the name.
    """

    def __init__(self, node: ParameterNode) -> None:
        self._node = node
        self._id = uuid.uuid4().hex
        self._since = divmod(time.time_ns(), 1_000_000_000)
        node.create_subscription(CLAIM.type, CLAIM.of("~"), self._on_claim, CLAIMS_QOS)
        self._publisher = node.create_publisher(CLAIM.type, CLAIM.of("~"), CLAIM.qos)
        header = CLAIM.type(frame_id=self._id)
        header.stamp.sec, header.stamp.nanosec = self._since
        self._publisher.publish(header)

    def _on_claim(self, header: Any) -> None:
        theirs = (header.stamp.sec, header.stamp.nanosec, header.frame_id)
        if theirs < (*self._since, self._id):
            name = self._node.get_fully_qualified_name()
            self._node.fail(
                NameTakenError(
                    f"node {name}: the name is taken, a node that was there before has it; stop "
                    "that one, or start this one under another name or namespace"
                )
            )
