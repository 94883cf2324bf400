# Copyright 2026 The sparse_coord_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Decodes a bag's messages by the definitions in the bag itself, without ROS."""

from collections.abc import Mapping
from typing import Any

from mcap.records import Schema
from mcap_ros2.decoder import DecoderFactory

from sparse_coord_ros.base.errors import message_of
from sparse_coord_ros.log.bags.topics import BagTopic

PLAIN_CDR = (b"\x00\x00", b"\x00\x01")
"""The beginning of a message: its encoding, with the high or the low byte first."""


class Decoder:
    """Turns CDR into objects whose attributes are the message's fields.

    Args:
        topics: the bag's topics with their definitions.
    """

    def __init__(self, topics: Mapping[str, BagTopic]) -> None:
        self._factory = DecoderFactory()
        self._schemas = {
            name: Schema(number, topic.schema.encode(), "ros2msg", topic.type_name)
            for number, (name, topic) in enumerate(topics.items(), start=1)
        }

    def __contains__(self, topic: str) -> bool:
        """Return whether it has the definition of a topic."""
        return topic in self._schemas

    def __call__(self, topic: str, data: bytes) -> Any:
        """Return a message of a topic.

        Raises:
            ValueError: the bytes, or the definition in the bag, cannot be read.
        """
        schema = self._schemas[topic]
        try:
            if data[:2] not in PLAIN_CDR:
                raise ValueError(f"its encoding is {data[:2].hex(' ')}, no plain CDR")
            decode: Any = self._factory.decoder_for("cdr", schema)
            return decode(data)
        except Exception as error:  # the library may raise any exception
            why = f"{type(error).__name__}: {message_of(error)}"
            raise ValueError(f"cannot be decoded as {schema.name} ({why})") from error
