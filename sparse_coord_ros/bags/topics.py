# Copyright 2026 The sparse_coord_ros authors
# SPDX-License-Identifier: Apache-2.0
"""What a bag says about a topic."""

from collections.abc import Mapping
from typing import NamedTuple

from mcap.records import Channel, Schema

from sparse_coord_ros.bags.qos import QoS, profiles_from_text
from sparse_coord_ros.bags.records import Damage
from sparse_coord_ros.errors import BagError
from sparse_coord_ros.wire import CLOCK


class BagTopic(NamedTuple):
    """A topic of a bag.

    Attributes:
        name: full name, with a leading slash.
        type_name: message type, e.g. `nav_msgs/msg/Path`.
        schema: the type's definition with all it depends on.
        qos: the profile of each publisher.
        type_hash: the type's RIHS01 hash, empty if unknown.
        schema_encoding: the language of `schema`: `ros2msg`, in bags of others also `ros2idl`.
    """

    name: str
    type_name: str
    schema: str
    qos: tuple[QoS, ...] = (QoS(),)
    type_hash: str = ""
    schema_encoding: str = "ros2msg"


def topic_of(channel: Channel, schemas: dict[int, Schema], offset: int) -> BagTopic:
    """Return what a channel record and its schema say.

    Args:
        channel: the record.
        schemas: the schemas known by then, by id.
        offset: where in the file they are, for the error.

    Raises:
        BagError: the messages are none of ROS 2.
        Damage: the records make no sense.
    """
    if channel.message_encoding != "cdr":
        raise BagError(
            f"this MCAP file is no ROS 2 bag: topic {channel.topic!r} is encoded as "
            f"{channel.message_encoding!r}, not cdr"
        )
    schema = schemas.get(channel.schema_id)
    if schema is None:
        raise Damage(offset, f"topic {channel.topic!r} has no type")
    try:
        qos = profiles_from_text(channel.metadata.get("offered_qos_profiles", ""))
        text = schema.data.decode()
    except (BagError, UnicodeDecodeError) as error:
        raise Damage(offset, f"topic {channel.topic!r}: {error}") from error
    type_hash = channel.metadata.get("topic_type_hash", "")
    return BagTopic(channel.topic, schema.name, text, qos, type_hash, schema.encoding)


def find_clock(topics: Mapping[str, BagTopic], counts: Mapping[str, int]) -> str | None:
    """Return the topic of a bag that holds its clock, however it is called; None: there is none.

    It is known by its type. Of several it is the one of the usual name, else the one that says
    most.
    """
    found = sorted(name for name, topic in topics.items() if topic.type_name == CLOCK.type_name)
    return max(
        found, key=lambda name: (name == f"/{CLOCK.name}", counts.get(name, 0)), default=None
    )
