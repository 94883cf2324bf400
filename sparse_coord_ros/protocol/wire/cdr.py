# Copyright 2026 The sparse_coord_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Messages as CDR, without ROS: the places of fields in a message's bytes.

Building, converting and decoding message objects costs more than a whole time step of
Algorithm 1. But most messages differ only in a stamp and some numbers. A `Layout` knows the bytes
of such a message: it packs one, reads one, and reads many at once, by columns. A decoder reads
messages whose other bytes are not the expected ones.

Padding bytes align the fields. rclpy leaves random memory in them, and reserves some bytes after
the last field. Here padding is zeros, and the last field ends the message, so that every process
packs the same bytes.
"""

import math
import struct
from collections.abc import Iterable
from itertools import groupby
from typing import Any, NamedTuple

import numpy as np

LITTLE_ENDIAN_CDR = b"\x00\x01\x00\x00"


class Free(NamedTuple):
    """A field that differs from message to message: its name and NumPy type."""

    name: str
    kind: str


class Fixed(NamedTuple):
    """A field with a constant value."""

    kind: str
    value: float | bytes


Item = Free | Fixed | str
"""A field, or a constant text."""


class Layout:
    """The places of fields in a message's bytes.

    Args:
        items: the fields in the order of the type's definition.

    Attributes:
        size: size of a message in bytes.
        kind: structured type of the free fields, with gaps between them.
    """

    def __init__(self, items: Iterable[Item]) -> None:
        expected = bytearray(LITTLE_ENDIAN_CDR)
        checked = bytearray(b"\1\1\1\1")
        free: dict[str, tuple[np.dtype, int]] = {}

        def put(data: bytes, alignment: int, *, check: bool) -> int:
            gap = -(len(expected) - len(LITTLE_ENDIAN_CDR)) % alignment
            begin = len(expected) + gap
            expected.extend(bytes(gap) + data)
            # gaps may have any bytes
            checked.extend(bytes(gap) + bytes([check]) * len(data))
            return begin

        for item in items:
            if isinstance(item, str):
                data = item.encode() + b"\0"
                put(len(data).to_bytes(4, "little"), 4, check=True)
                put(data, 1, check=True)
                continue
            kind = np.dtype(item.kind)
            alignment = kind.base.itemsize if kind.base.kind in "iuf" else 1
            if isinstance(item, Fixed):
                put(np.array(item.value, kind).tobytes(), alignment, check=True)
            else:
                free[item.name] = (
                    kind,
                    put(bytes(kind.itemsize), alignment, check=False),
                )
        self.size = len(expected)
        self.kind = np.dtype(
            {
                "names": list(free),
                "formats": [kind for kind, _ in free.values()],
                "offsets": [begin for _, begin in free.values()],
                "itemsize": self.size,
            }
        )
        self._columns: list[tuple[slice, np.ndarray]] = []
        for check, run in groupby(range(self.size), key=checked.__getitem__):
            places = list(run)
            if check:
                where = slice(places[0], places[-1] + 1)
                self._columns.append(
                    (where, np.frombuffer(bytes(expected[where]), np.uint8))
                )
        # Of single messages: all bytes as one number, and a struct of the free fields.
        mask = bytearray(b"\xff" * self.size)
        codes = "<"
        end = 0
        for kind, begin in free.values():
            codes += f"{begin - end}x{_struct_code(kind)}"
            end = begin + kind.itemsize
            mask[begin:end] = bytes(kind.itemsize)
        self._fixed = int.from_bytes(mask)
        self._expected = int.from_bytes(expected)
        self._struct = struct.Struct(f"{codes}{self.size - end}x")

    def pack(self, *values: Any) -> bytes:
        """Return a message: the values of the free fields, arrays number by number.

        Arrays of bytes are given as one value.
        """
        return (int.from_bytes(self._struct.pack(*values)) | self._expected).to_bytes(
            self.size
        )

    def unpack(self, data: bytes) -> tuple[Any, ...] | None:
        """Return the values of one message, as `pack` takes them; None: it has another layout."""
        if (
            len(data) != self.size
            or int.from_bytes(data) & self._fixed != self._expected
        ):
            return None
        return self._struct.unpack(data)

    def read(self, content: bytes, begins: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Read messages of at least this size; bytes beyond it are padding.

        Args:
            content: bytes that contain them.
            begins: offset of each, shape (messages,).

        Returns:
            Whether each has this layout, bool, and the free fields of all; both of shape
            (messages,).
        """
        rows = rows_at(content, begins, self.kind)
        data = rows.view(np.uint8).reshape(len(rows), self.size)
        fits = np.ones(len(rows), dtype=bool)
        for where, expected in self._columns:
            fits &= (data[:, where] == expected).all(axis=1)
        return fits, rows


def _struct_code(kind: np.dtype) -> str:
    """Return the format of `struct` for a NumPy type."""
    base = kind.base
    count = int(np.prod(kind.shape))
    if base.itemsize == 1 or base.kind == "V":
        return f"{kind.itemsize}s"
    code = {"i4": "i", "u4": "I", "i8": "q", "f4": "f", "f8": "d"}[base.str[1:]]
    return f"{count}{code}"


def rows_at(content: bytes, places: np.ndarray, kind: np.dtype) -> np.ndarray:
    """Return the values at some offsets of bytes, an array of a structured type: (places,)."""
    if not len(places):
        return np.empty(0, dtype=kind)
    count = len(content) - kind.itemsize + 1
    # A view with a row for every byte as its beginning; taking rows copies each with one memcpy.
    every = np.ndarray((count,), np.dtype(("V", kind.itemsize)), content, strides=(1,))
    return np.asarray(every[places].view(kind))


def stamp(prefix: str = "") -> list[Item]:
    """Return the fields of a time."""
    return [Free(f"{prefix}sec", "<i4"), Free(f"{prefix}nanosec", "<u4")]


def nothing(*kinds: str) -> list[Item]:
    """Return fields that are 0; `<u4` also stands for an empty sequence."""
    return [Fixed(kind, 0) for kind in kinds]


UPRIGHT: list[Item] = [Fixed("<f8", value) for value in (0.0, 0.0, 0.0, 1.0)]
"""An orientation along the axes."""


def flat_pose(prefix: str = "") -> list[Item]:
    """Return the fields of a pose that is flat on the map: `xy`."""
    return [Free(f"{prefix}xy", "(2,)<f8"), Fixed("<f8", 0.0), *UPRIGHT]


def flat_pose_at(x: float, y: float, yaw: float = 0.0) -> list[Item]:
    """Return the fields of a constant pose that is flat on the map."""
    turn = (0.0, 0.0, math.sin(yaw / 2), math.cos(yaw / 2))
    return [Fixed("<f8", value) for value in (x, y, 0.0, *turn)]
