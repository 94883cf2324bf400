# Copyright 2026 The sparse_coord_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The topics of a bag: type and offered quality of service.

A player offers the recorded quality of service: without `transient_local` in the bag a replayed
`map` is not latched.
"""

import functools
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple

from mcap.records import Channel, Schema

from sparse_coord_ros.base.errors import BagError
from sparse_coord_ros.base.yaml_text import yaml_value

# rmw's RMW_DURATION_INFINITE, 2**63 - 1 ns: rosbag2 records it for a publisher without a deadline,
# lifespan or lease.
_INFINITE = {"sec": 9223372036, "nsec": 854775807}

_POLICIES = {
    "reliability": ("reliable", "best_effort"),
    "durability": ("transient_local", "volatile"),
    "history": ("keep_last", "keep_all"),
}
"""In the order of rmw's numbers from 1, which rosbag2 wrote before version 9."""


@dataclass(frozen=True)
class QoS:
    """The quality of service that a topic's publisher offers.

    Attributes:
        history: `keep_last` or `keep_all`.
        depth: messages kept with `keep_last`, 0 or more; ignored with `keep_all`.
        reliability: `reliable` or `best_effort`.
        durability: `volatile`, or `transient_local` for a latched topic.
    """

    history: str = "keep_last"
    depth: int = 10
    reliability: str = "reliable"
    durability: str = "volatile"

    def as_mapping(self) -> dict[str, Any]:
        """Return the profile with the keys, order and policy names of rosbag2 version 9."""
        return vars(self) | {
            "deadline": dict(_INFINITE),
            "lifespan": dict(_INFINITE),
            "liveliness": "automatic",
            "liveliness_lease_duration": dict(_INFINITE),
            "avoid_ros_namespace_conventions": False,
        }


@functools.lru_cache
def profiles_from_text(text: str) -> tuple[QoS, ...]:
    """Return the profiles of a channel's `offered_qos_profiles`, in any version's spelling.

    None are returned if the text is not YAML, or not a list of profiles.
    """
    try:
        entries = yaml_value(text, where="QoS", error=BagError) or []
        return tuple(_profile(entry) for entry in entries)
    except (BagError, ValueError, OverflowError, TypeError, AttributeError):
        return ()


def _profile(entry: dict[str, Any]) -> QoS:
    values: dict[str, Any] = {"depth": int(entry.get("depth", QoS.depth))}
    if values["depth"] < 0:
        raise ValueError
    for name, allowed in _POLICIES.items():
        value = entry.get(name)
        if isinstance(value, int) and 1 <= value <= len(allowed):
            value = allowed[value - 1]
        # Other values are rosbag2's unknown, system_default and best_available.
        values[name] = value if value in allowed else getattr(QoS, name)
    return QoS(**values)


def latched(profiles: Sequence[QoS]) -> bool:
    """True if a late subscriber gets the last message."""
    return any(qos.durability == "transient_local" for qos in profiles)


class BagTopic(NamedTuple):
    """A topic of a bag.

    Attributes:
        name: full name, with a leading slash.
        type_name: message type, e.g. `nav_msgs/msg/Path`.
        schema: the type's definition with its dependencies.
        qos: the profile of each publisher.
        type_hash: the type's RIHS01 hash, empty if unknown.
        encoding: the encoding of its messages: `cdr` in bags of ROS 2.
    """

    name: str
    type_name: str
    schema: str
    qos: tuple[QoS, ...] = (QoS(),)
    type_hash: str = ""
    encoding: str = "cdr"


def topic_of(channel: Channel, schemas: Mapping[int, Schema]) -> BagTopic:
    """Return the topic of a channel record and its schema, if it has one."""
    schema = schemas.get(channel.schema_id)
    name = ""
    text = ""
    if schema is not None:
        name = schema.name
        text = schema.data.decode(errors="replace")
    qos = profiles_from_text(channel.metadata.get("offered_qos_profiles", ""))
    type_hash = channel.metadata.get("topic_type_hash", "")
    encoding = channel.message_encoding
    return BagTopic(channel.topic, name, text, qos, type_hash, encoding)
