# Copyright 2026 The sparse_coord_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Fast CDR for the three messages that every time step exchanges.

Building and converting message objects costs more than a whole time step of Algorithm 1. These
messages differ only in their stamp and a few numbers, so their bytes are rclpy's own serialisation
of one message with the numbers put in place. Where those bytes lie is found by serialising
probes, not assumed; a message with another layout (another frame, other labels, another
byte order) is read by rclpy.

Between the fields lie bytes that only align them. rclpy leaves there what was in memory; here they
are zeros, so that every process packs and expects the same bytes. What rclpy reserves after the
last field (eight bytes of a JointState) is left out: rosbags reads no message with more than it
expects.
"""

import struct
from collections.abc import Callable

from rclpy.serialization import deserialize_message, serialize_message

PROBE_SECONDS, PROBE_NANOSECONDS = 0x5A17C3E1, 0x2B94D0F7
PROBE_NUMBER = 7.313131e77
LITTLE_ENDIAN_CDR = b"\x00\x01"
ENCAPSULATION = 4
SIZES = {"int32": 4, "uint32": 4, "double": 8}


class FixedLayout:
    """Packs and reads messages of one type that differ in a stamp and some numbers.

    Args:
        message_type: the message class.
        build: makes a message from (sec, nanosec, *numbers).
        read: gives (sec, nanosec, *numbers) of any message of the type; raises ValueError where
            the message does not say them.
        numbers: how many float64 numbers there are.
    """

    def __init__(self, message_type: type, build: Callable, read: Callable, numbers: int) -> None:
        self.message_type = message_type
        self._build, self._read = build, read
        probes = [PROBE_NUMBER * (1 + index) for index in range(numbers)]
        message = build(PROBE_SECONDS, PROBE_NANOSECONDS, *probes)
        data = serialize_message(message)
        if data[:2] != LITTLE_ENDIAN_CDR:  # a big-endian machine: leave it all to rclpy
            self._layout = None
            return
        data = _without_garbage(data, message)
        marks = [struct.pack("<II", PROBE_SECONDS, PROBE_NANOSECONDS)]
        marks += [struct.pack("<d", probe) for probe in probes]
        self._fixed, parts, end = [], ["<"], 0
        for mark, code in zip(marks, ["iI"] + ["d"] * numbers, strict=True):
            if data.count(mark) != 1:
                raise RuntimeError(f"{message_type.__name__}: probe not found in its CDR")
            start = data.index(mark)
            self._fixed.append(data[end:start])
            parts += [f"{start - end}s", code]
            end = start + len(mark)
        self._fixed.append(data[end:])
        parts.append(f"{len(data) - end}s")
        self._layout = struct.Struct("".join(parts))

    def pack(self, sec: int, nanosec: int, *numbers: float) -> bytes:
        """Return the CDR bytes of a message."""
        if self._layout is None:
            return serialize_message(self._build(sec, nanosec, *numbers))
        fixed = self._fixed
        values = [fixed[0], sec, nanosec, fixed[1]]
        for number, between in zip(numbers, fixed[2:], strict=True):
            values += (number, between)
        return self._layout.pack(*values)

    def unpack(self, data: bytes) -> tuple:
        """Return (sec, nanosec, *numbers) of a message's CDR bytes.

        Raises:
            ValueError: a message of the type that does not say these numbers.
        """
        if self._layout is not None and len(data) == self._layout.size:
            values = self._layout.unpack(data)
            if [values[0], *values[3::2]] == self._fixed:
                return (*values[1:3], *values[4::2])
        return self._read(deserialize_message(data, self.message_type))


def _without_garbage(data: bytes, message) -> bytes:
    """Return a message's CDR with zeros between its fields and nothing after the last one."""
    clean = bytearray(len(data))

    def keep(at: int, size: int, alignment: int = 1) -> int:
        start = at + (ENCAPSULATION - at) % alignment
        clean[start : start + size] = data[start : start + size]
        return start + size

    def walk(value, kind: str, at: int) -> int:
        if kind in SIZES:
            return keep(at, SIZES[kind], SIZES[kind])
        if kind == "string":
            return keep(keep(at, 4, 4), len(value.encode()) + 1)
        if kind.startswith("sequence<"):
            at = keep(at, 4, 4)
            for item in value:
                at = walk(item, kind.removeprefix("sequence<").removesuffix(">"), at)
            return at
        for name, field in value.get_fields_and_field_types().items():
            at = walk(getattr(value, name), field, at)
        return at

    keep(0, ENCAPSULATION)
    end = walk(message, "message", ENCAPSULATION)
    if deserialize_message(bytes(clean[:end]), type(message)) != message:
        raise RuntimeError(f"{type(message).__name__}: its CDR is not as expected")
    return bytes(clean[:end])
