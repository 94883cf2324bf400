# Copyright 2026 The sparse_coord_ros authors
# SPDX-License-Identifier: Apache-2.0
"""One holder a name: of two nodes of the same name, the one that has come further stays.

World and robots say on their latched topics `~/claim` who they are and how far they have come:
starting, holding the name, taking part in a run. Discovery may take seconds, so a claim is never
settled for good: whenever two nodes of one name learn of each other, the one behind gives way; of
two that are equally far, the one with the higher identity. Nobody's clock matters, and a node that
takes part in a run never leaves it for another.
"""

import time
import uuid

from sparse_coord_ros.errors import NameTakenError
from sparse_coord_ros.nodes.intake import Intake
from sparse_coord_ros.nodes.interface import CLAIM, CLAIMS_QOS
from sparse_coord_ros.nodes.messages import read_claim, typed
from sparse_coord_ros.nodes.parameters import ParameterNode
from sparse_coord_ros.wire import CLAIM_RANKS

STARTING, HOLDING, JOINED = range(len(CLAIM_RANKS))


class Claim:
    """A node's claim to its name.

    Args:
        node: the claiming node; its `fail` is called where another node keeps the name.
        intake: the node's subscriptions.

    Attributes:
        id: what nobody else is called.
        rank: how far the node has come: STARTING, HOLDING or JOINED.
    """

    def __init__(self, node: ParameterNode, intake: Intake) -> None:
        self._node = node
        self.id = uuid.uuid4().hex
        self._since = divmod(time.time_ns(), 1_000_000_000)
        self.rank = STARTING
        self._warned = False
        read = typed(CLAIM, read_claim)
        intake.listen(CLAIM, self._on_claim, "~", read=read, qos=CLAIMS_QOS)
        self._publisher = node.create_publisher(CLAIM.type, CLAIM.of("~"), CLAIM.qos)
        self._say()

    def hold(self) -> None:
        """Have the name: nobody who had it has been heard in time."""
        self._rise(HOLDING)

    def join(self) -> None:
        """Take part in a run."""
        self._rise(JOINED)

    def _rise(self, rank: int) -> None:
        if rank > self.rank:
            self.rank = rank
            self._say()

    def _say(self) -> None:
        header = CLAIM.type(frame_id=f"{self.id} {CLAIM_RANKS[self.rank]}")
        header.stamp.sec, header.stamp.nanosec = self._since
        self._publisher.publish(header)

    def _on_claim(self, claim: tuple[str, int]) -> None:
        identity, rank = claim
        name = self._node.get_fully_qualified_name()
        if identity == self.id:
            return
        if self.rank == JOINED:
            if rank == JOINED and not self._warned:
                self._warned = True
                self._node.get_logger().warning(
                    f"another node {name} takes part in a run too; stop one of them"
                )
        elif rank > self.rank or (rank == self.rank and identity < self.id):
            self._node.fail(
                NameTakenError(
                    f"node {name}: the name is taken, a node that was there before has it; stop "
                    "that one, or start this one under another name or namespace"
                )
            )
