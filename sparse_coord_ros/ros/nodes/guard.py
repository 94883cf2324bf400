# Copyright 2026 The sparse_coord_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Guards against second owners of a node's name, services and topics.

Of two nodes of one name one ends. Each publishes on its latched topic `~/_claim` its identity and
its stage: starting, holding the name, taking part in a run. Discovery may take seconds, so this is
never settled for good. Whenever two nodes discover each other, the node at the earlier stage ends;
at equal stages, the one with the higher identity. Clocks play no part, and a node that takes part
in a run never leaves it for another.

A topic or service may have a second owner of another name, without a claim. rclpy does not give
the sender of a message, but the graph contains the second publisher: a warning names it. The
server of a service is the publisher of its answers.

`cli.live.sole_team` refuses earlier to start two whole teams at once on one machine: claims would
give each of them some of the names.
"""

import time
import uuid
from collections import Counter
from collections.abc import Iterable, Sequence
from typing import Any, NamedTuple

from rclpy.node import Node

from sparse_coord_ros.base.errors import NameTakenError
from sparse_coord_ros.protocol.wire import ClaimRank
from sparse_coord_ros.ros.nodes.parameters import ParameterNode
from sparse_coord_ros.ros.nodes.ros_topics import CLAIM, CLAIMS_QOS

ANSWERS = "rr{}Reply"
"""Name of the topic of a service's answers in the DDS middlewares of ROS 2."""

UNKNOWN_NODE = "NODE_NAME_UNKNOWN"
"""Part of the name that rcl gives a node that it has only half discovered."""


def in_words(names: Sequence[str], who: str) -> str:
    """Return advice for a topic or service with several publishers or servers (`who`)."""
    said = f"{len(names)} {who}, {', '.join(names)}; it should have one"
    return f"{said}: stop the others (a node that was killed is forgotten after 20 s)"


class NameClaim(NamedTuple):
    """A node's claim to its name: its identity, and its stage."""

    id: str
    rank: ClaimRank

    def yields_to(self, other: "NameClaim") -> bool:
        """Return whether this node ends because of another one of its name."""
        if self.rank == ClaimRank.JOINED:
            return False
        return (other.rank, self.id) > (self.rank, other.id)


def read_claim(header: Any) -> NameClaim:
    """Return the claim in a message.

    Raises:
        ValueError: the message is no claim.
    """
    identity, _, rank = header.frame_id.partition(" ")
    if not identity or rank.upper() not in ClaimRank.__members__:
        raise ValueError(f"has the frame_id {header.frame_id!r}, which is not a claim")
    return NameClaim(identity, ClaimRank[rank.upper()])


def owners(node: Node, name: str, *, service: bool) -> list[str]:
    """Return the full names of the nodes that publish a topic, or serve a service, sorted.

    A node that was killed is among them for 20 s. As long as one of them is only half discovered,
    the list is empty.

    Args:
        node: its graph is searched.
        name: the full name of the topic or service.
        service: whether it is a service.
    """
    topic = ANSWERS.format(name) if service else name
    infos = node.get_publishers_info_by_topic(topic, no_mangle=service)
    if any(UNKNOWN_NODE in info.node_name for info in infos):
        return []
    return sorted(
        f"{info.node_namespace.rstrip('/')}/{info.node_name}" for info in infos
    )


class Guard:
    """Guards a node's name, topics and services.

    Args:
        node: the node; its `fail` is called if another node keeps the name.

    Attributes:
        claim: the node's claim.
        doubled: topics and services that also have a second owner.
    """

    def __init__(self, node: ParameterNode) -> None:
        self._node = node
        self.claim = NameClaim(uuid.uuid4().hex, ClaimRank.STARTING)
        self.doubled: set[str] = set()
        self._since = divmod(time.time_ns(), 1_000_000_000)
        self._warned = False
        self._topics: list[str] = []
        self._services: list[str] = []
        node.subscriber.listen(
            CLAIM, self._on_claim, "~", read=read_claim, qos=CLAIMS_QOS
        )
        self._publisher = node.create_publisher(CLAIM.type, CLAIM.of("~"), CLAIM.qos)
        self._say()

    def holds(self, now: float) -> bool:
        """Return whether the node has its name: no earlier owner has announced itself in time."""
        if now - self._node.born < self._node.values["claim_window"]:
            return False
        self._rise(ClaimRank.HOLDING)
        return True

    def join(self) -> None:
        """Take part in a run."""
        self._rise(ClaimRank.JOINED)

    def watch(self, topics: Iterable[str], services: Iterable[str] = ()) -> None:
        """Guard topics and services, by their full names."""
        self._topics = list(topics)
        self._services = list(services)

    def counts(self) -> Counter[str]:
        """Return the number of topics and services that had a second owner."""
        services = len(self.doubled.intersection(self._services))
        topics = len(self.doubled) - services
        return Counter(
            topics_of_two_publishers=topics, services_of_two_servers=services
        )

    def look(self) -> None:
        """Check topics and services, and warn once of each that has a second owner."""
        node = self._node
        more = [name for name in self._topics if node.count_publishers(name) > 1]
        more += [name for name in self._services if node.count_services(name) > 1]
        for name in (name for name in more if name not in self.doubled):
            service = name in self._services
            names = owners(node, name, service=service)
            if len(names) > 1:
                self.doubled.add(name)
                who = "servers" if service else "publishers"
                node.get_logger().warning(f"{name} has {in_words(names, who)}")

    def _rise(self, rank: ClaimRank) -> None:
        if rank > self.claim.rank:
            self.claim = self.claim._replace(rank=rank)
            self._say()

    def _say(self) -> None:
        header = CLAIM.type(frame_id=f"{self.claim.id} {self.claim.rank.name.lower()}")
        header.stamp.sec, header.stamp.nanosec = self._since
        self._publisher.publish(header)

    def _on_claim(self, other: NameClaim) -> None:
        name = self._node.get_fully_qualified_name()
        if other.id == self.claim.id:
            return
        if self.claim.yields_to(other):
            self._node.fail(
                NameTakenError(
                    f"node {name}: the name is taken by an earlier node; stop that one, or "
                    "start this one under another name or namespace"
                )
            )
        elif self.claim.rank == other.rank == ClaimRank.JOINED and not self._warned:
            self._warned = True
            text = f"another node {name} takes part in a run too; stop one of them"
            self._node.get_logger().warning(text)
