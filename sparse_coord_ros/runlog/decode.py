# Copyright 2026 The sparse_coord_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Decodes a bag's messages by the definitions in the bag itself, without ROS."""

import re
from collections.abc import Mapping
from typing import Any

from mcap.records import Schema
from mcap_ros2.decoder import DecoderFactory

from sparse_coord_ros.bags.topics import BagTopic

_SERVICE_TYPE = re.compile(r"(\w+)/srv/(\w+?)_(\w+)", re.ASCII)

PLAIN_CDR = (b"\x00\x00", b"\x00\x01")
"""What a message begins with: its encoding, with the high or the low byte first."""


class Decoder:
    """Turns CDR into objects whose attributes are the message's fields.

    Args:
        topics: the bag's topics with their definitions.
    """

    def __init__(self, topics: Mapping[str, BagTopic]) -> None:
        self._topics = topics
        self._decoders: dict[str, Any] = {}
        self._factory = DecoderFactory()

    def __call__(self, topic: str, data: bytes) -> Any:
        """Return a message of a topic.

        Raises:
            ValueError: the bytes, or the definition in the bag, cannot be read.
        """
        try:
            decode = self._decoders.get(topic)
            if decode is None:
                decode = self._decoders[topic] = self._decoder(self._topics[topic])
            if data[:2] not in PLAIN_CDR:
                raise ValueError(f"its encoding is {data[:2].hex(' ')}, no plain CDR")
            return decode(data)
        except Exception as error:  # of a changed file the library raises what comes up
            raise ValueError(
                f"cannot be decoded as {self._topics[topic].type_name} "
                f"({type(error).__name__}: {' '.join(str(error).split())})"
            ) from error

    def _decoder(self, topic: BagTopic) -> Any:
        """Return the library's decoder of a topic's type.

        The library knows no service types: the parts of an event are told to it as messages.
        """
        name = _SERVICE_TYPE.sub(r"\1/msg/\2\3", topic.type_name)
        text = topic.schema
        if name != topic.type_name:
            text = _SERVICE_TYPE.sub(r"\1/\2\3", text)
        schema = Schema(
            id=1 + len(self._decoders), name=name, encoding="ros2msg", data=text.encode()
        )
        return self._factory.decoder_for("cdr", schema)
