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
from collections.abc import Callable, Sequence

from builtin_interfaces.msg import Time
from rclpy.serialization import deserialize_message, serialize_message

PROBE_SECONDS, PROBE_NANOSECONDS = 0x5A17C3E1, 0x2B94D0F7
PROBE_NUMBER = 7.313131e77
_STAMP = struct.Struct("=iI")
LITTLE_ENDIAN_CDR = b"\x00\x01"
ENCAPSULATION = 4
SIZES = {"boolean": 1, "int8": 1, "uint8": 1, "int32": 4, "uint32": 4, "float": 4, "double": 8}


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
        message = build(PROBE_SECONDS, PROBE_NANOSECONDS, *_probes(numbers))
        data = serialize_message(message)
        self._whole: struct.Struct | None = None
        if data[:2] != LITTLE_ENDIAN_CDR:  # a big-endian machine: leave it all to rclpy
            return
        data = _without_garbage(data, message)
        stamp = _STAMP.pack(PROBE_SECONDS, PROBE_NANOSECONDS)
        block = struct.pack(f"<{numbers}d", *_probes(numbers))
        if data.count(stamp) != 1 or (block and data.count(block) != 1):
            raise RuntimeError(f"{message_type.__name__}: probe not found in its CDR")
        self._before, rest = data.split(stamp)
        self._between, self._after = rest.split(block) if block else (rest, b"")
        before, between, after = map(len, (self._before, self._between, self._after))
        self._whole = struct.Struct(f"<{before}siI{between}s{numbers}d{after}s")
        self._said = struct.Struct(f"<{before}xiI{between}x{numbers}d")
        self._second = before + len(stamp)

    def pack(self, sec: int, nanosec: int, *numbers: float) -> bytes:
        """Return the CDR bytes of a message."""
        if self._whole is None:
            return serialize_message(self._build(sec, nanosec, *numbers))
        return self._whole.pack(self._before, sec, nanosec, self._between, *numbers, self._after)

    def unpack(self, data: bytes) -> tuple:
        """Return (sec, nanosec, *numbers) of a message's CDR bytes.

        Raises:
            ValueError: a message of the type that does not say these numbers.
        """
        if (
            self._whole is not None
            and len(data) == self._whole.size
            and data.startswith(self._before)
            and data.startswith(self._between, self._second)
            and data.endswith(self._after)
        ):
            return self._said.unpack_from(data)
        return self._read(deserialize_message(data, self.message_type))


def _probes(count: int) -> list[float]:
    return [PROBE_NUMBER * (1 + index) for index in range(count)]


class Template:
    """The CDR of one message, of which stamps and some bytes are changed.

    Args:
        message: the message; each stamp that is to change is that of `probe_stamp`.
        probes: bytes, each in one place of the CDR, that are to be changed.

    Raises:
        RuntimeError: a probe or the stamp was not found, or a probe in several places.
    """

    def __init__(self, message, probes: Sequence[bytes] = ()) -> None:
        kind = type(message)
        message = deserialize_message(serialize_message(message), kind)  # float32 as they are sent
        data = _without_garbage(serialize_message(message), message)
        mark = _STAMP.pack(PROBE_SECONDS, PROBE_NANOSECONDS)
        places = range(ENCAPSULATION, len(data), 4)
        self._stamps = [at for at in places if data.startswith(mark, at)]
        if not self._stamps or any(data.count(probe) != 1 for probe in probes):
            raise RuntimeError(f"{kind.__name__}: probe not found in its CDR")
        self._places = [slice(data.index(p), data.index(p) + len(p)) for p in probes]
        self._data = bytearray(data)

    def pack(self, sec: int, nanosec: int, *parts: bytes) -> bytes:
        """Return the CDR with other stamps, and other bytes of the same lengths for the probes."""
        for at in self._stamps:
            _STAMP.pack_into(self._data, at, sec, nanosec)
        for place, part in zip(self._places, parts, strict=True):
            self._data[place] = part
        return bytes(self._data)


def probe_stamp() -> Time:
    """Return the stamp by which a `Template` knows the places of stamps."""
    return Time(sec=PROBE_SECONDS, nanosec=PROBE_NANOSECONDS)


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
