# Copyright 2026 The sparse_coord_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Sample messages, serialised by rosbags: code that is independent of rclpy and of mcap_ros2."""

import numpy as np
import pytest
from rosbags.interfaces import Nodetype
from rosbags.typesys import Stores, get_typestore

from sparse_coord_ros.log.bags import QoS

STRING = "std_msgs/msg/String"


class Samples:
    """Messages of any type with a different value in every field."""

    def __init__(self, typestore):
        """Read the types' definitions from a rosbags typestore."""
        self.typestore = typestore

    def message(self, type_name, seed=1):
        """Return a message; other seeds give other values and lengths."""
        fields = self.typestore.fielddefs[type_name][1]
        values = [
            self._value(desc, seed * 31 + place)
            for place, (_, desc) in enumerate(fields)
        ]
        return self.typestore.types[type_name](*values)

    def cdr(self, type_name, seed=1):
        """Return the serialised message."""
        return bytes(
            self.typestore.serialize_cdr(self.message(type_name, seed), type_name)
        )

    def fill(self, bag, count, *, chunks=False):
        """Write texts of the times 0, 1, 2, ... ns on `/a`, in a chunk each or as it comes."""
        channel = bag.add_topic("/a", STRING, QoS())
        for i in range(count):
            bag.write(channel, self.cdr(STRING), i, i)
            if chunks:
                bag.flush()

    def same(self, message, decoded):
        """Return whether a message and its decoded form have equal fields."""
        if isinstance(message, np.ndarray | list):
            return len(message) == len(decoded) and all(
                map(self.same, message, decoded)
            )
        if not hasattr(message, "__msgtype__"):
            return message == decoded
        fields = self.typestore.fielddefs[message.__msgtype__][1]
        return all(
            self.same(getattr(message, n), getattr(decoded, n)) for n, _ in fields
        )

    def _value(self, desc, seed):
        kind, detail = desc
        if kind == Nodetype.NAME:
            return self.message(detail, seed % 1000)
        if kind == Nodetype.BASE:
            return self._number_or_text(detail[0], seed)
        element, bound = detail
        length = bound if kind == Nodetype.ARRAY else min(2 + seed % 2, bound or 3)
        values = [self._value(element, seed + i) for i in range(length)]
        if element[0] == Nodetype.BASE and element[1][0] != "string":
            dtype = {"octet": "uint8", "byte": "uint8", "char": "uint8"}.get(
                element[1][0]
            )
            return np.array(values, dtype or element[1][0])
        return values

    @staticmethod
    def _number_or_text(name, seed):
        if name == "string":
            return f"text {seed} é"
        if name == "bool":
            return bool(seed % 2)
        if name.startswith("float"):
            return seed / 4
        return seed % 100 if not name.startswith("int") else seed % 100 - 50


@pytest.fixture(scope="session")
def samples():
    """Return a maker of sample messages of ROS 2 Jazzy's types."""
    return Samples(get_typestore(Stores.ROS2_JAZZY))
