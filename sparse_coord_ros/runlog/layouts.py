# Copyright 2026 The sparse_coord_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Fixed layouts of the team's messages as CDR: many messages are decoded at once, by columns.

A layout is computed from what the wire says (fields, labels, frame, names), without ROS. It reads
the messages of one length whose fixed bytes are the expected ones; all others are left to the slow
decoder, which reads whatever the definitions in the bag describe.
"""

from collections.abc import Iterable, Sequence
from itertools import groupby
from typing import Any, NamedTuple

import numpy as np

from sparse_coord_ros.bags.records import rows_at
from sparse_coord_ros.wire import MAP_FRAME
from sparse_coord_ros.wire.frame import SECOND

LITTLE_ENDIAN_CDR = b"\x00\x01\x00\x00"


class Free(NamedTuple):
    """A field that differs from message to message: its name and NumPy type."""

    name: str
    kind: str


class Fixed(NamedTuple):
    """A field that is always the same."""

    kind: str
    value: float


Item = Free | Fixed | str
"""A field; a text that is always the same."""


class Layout:
    """Where in a message's bytes its fields lie.

    Args:
        items: the fields in the order of the definition.

    Attributes:
        size: bytes of a message.
        kind: structured type of the free fields, with gaps between them.
    """

    def __init__(self, items: Iterable[Item]) -> None:
        expected, checked = bytearray(LITTLE_ENDIAN_CDR), bytearray(b"\1\1\1\1")
        free: dict[str, tuple[str, int]] = {}

        def put(data: bytes, alignment: int, *, check: bool) -> int:
            gap = -(len(expected) - len(LITTLE_ENDIAN_CDR)) % alignment
            begin = len(expected) + gap
            expected.extend(bytes(gap) + data)
            checked.extend(bytes(gap) + bytes([check]) * len(data))  # of gaps anything goes
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
                begin = put(bytes(kind.itemsize), alignment, check=False)
                free[item.name] = (item.kind, begin)
        self.size = len(expected)
        self.kind = np.dtype(
            {
                "names": list(free),
                "formats": [kind for kind, _ in free.values()],
                "offsets": [begin for _, begin in free.values()],
                "itemsize": self.size,
            }
        )
        self._runs: list[tuple[slice, np.ndarray]] = []
        for check, run in groupby(range(self.size), key=checked.__getitem__):
            places = list(run)
            if check:
                where = slice(places[0], places[-1] + 1)
                self._runs.append((where, np.frombuffer(bytes(expected[where]), np.uint8)))

    def read(self, content: bytes, begins: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Read messages of this size.

        Args:
            content: bytes in which they lie.
            begins: where each begins, shape (messages,).

        Returns:
            Which of them have this layout, bool, and the free fields of all; both of shape
            (messages,).
        """
        rows = rows_at(content, begins, self.kind)
        data = rows.view(np.uint8).reshape(len(rows), self.size)
        fits = np.ones(len(rows), dtype=bool)
        for where, expected in self._runs:
            fits &= (data[:, where] == expected).all(axis=1)
        return fits, rows


def nanoseconds(rows: np.ndarray, prefix: str = "") -> np.ndarray:
    """Return the stamps of rows, in nanoseconds."""
    return np.asarray(rows[f"{prefix}sec"].astype(np.int64) * SECOND + rows[f"{prefix}nanosec"])


def stamp(prefix: str = "") -> list[Item]:
    """Return the fields of a time."""
    return [Free(f"{prefix}sec", "<i4"), Free(f"{prefix}nanosec", "<u4")]


def no_stamp() -> list[Item]:
    """Return the fields of a time that is 0."""
    return [Fixed("<i4", 0), Fixed("<u4", 0)]


def header(prefix: str = "") -> list[Item]:
    """Return a header's fields in the frame `map`."""
    return [*stamp(prefix), MAP_FRAME]


UPRIGHT: list[Item] = [Fixed("<f8", value) for value in (0.0, 0.0, 0.0, 1.0)]
NO_POSE: list[Item] = [*([Fixed("<f8", 0.0)] * 3), *UPRIGHT]


def place(prefix: str = "") -> list[Item]:
    """Return the fields of a pose that is flat on the map: (x, y)."""
    return [Free(f"{prefix}xy", "(2,)<f8"), Fixed("<f8", 0.0), *UPRIGHT]


def pose_stamped(prefix: str = "") -> list[Item]:
    """Return the fields of geometry_msgs/PoseStamped."""
    return [*header(prefix), *place(prefix)]


def labelled(labels: Sequence[str]) -> Layout:
    """Return the layout of a sensor_msgs/JointState whose positions, `numbers`, have names."""
    names: list[Item] = [Fixed("<u4", len(labels)), *labels]
    numbers: list[Item] = [Fixed("<u4", len(labels)), Free("numbers", f"({len(labels)},)<f8")]
    return Layout([*header(), *names, *numbers, Fixed("<u4", 0), Fixed("<u4", 0)])


def path(count: int) -> list[Item]:
    """Return the fields of a nav_msgs/Path of some poses, whose own stamps may be any."""
    items = [*header(), Fixed("<u4", count)]
    for number in range(count):
        items += pose_stamped(f"{number}_")
    return items


def event(rest: Sequence[Item]) -> Layout:
    """Return the layout of a service event with its request and response."""
    info = [Free("kind", "u1"), *stamp("wall_"), Free("client", "V16"), Free("number", "<i8")]
    return Layout([*info, *rest])


def request(asker: str) -> Layout:
    """Return the layout of an event with a request of nav_msgs/GetPlan."""
    goal = [*no_stamp(), asker, *NO_POSE]
    return event([Fixed("<u4", 1), *pose_stamped(), *goal, Fixed("<f4", 0.0), Fixed("<u4", 0)])


def response(count: int) -> Layout:
    """Return the layout of an event with a response of nav_msgs/GetPlan."""
    return event([Fixed("<u4", 0), Fixed("<u4", 1), *path(count)])


def occupancy(
    resolution: float, rows: int, columns: int, origin: tuple[float, float]
) -> list[Item]:
    """Return the fields of a nav_msgs/OccupancyGrid up to its data."""
    info = [*no_stamp(), Fixed("<f4", resolution), Fixed("<u4", columns), Fixed("<u4", rows)]
    corner = [Fixed("<f8", n) for n in (*origin, 0.0)]
    return [*header(), *info, *corner, *UPRIGHT, Fixed("<u4", rows * columns)]


def markers(looks: Sequence[Any], shown: Sequence[tuple[str, int, Any]]) -> Layout:
    """Return the layout of a visualization_msgs/MarkerArray.

    Args:
        looks: type, action, scale and colour of each marker, ten numbers.
        shown: namespace, number and place of each; None in place of one that moves.
    """
    items: list[Item] = [Fixed("<u4", len(shown))]
    for i, ((space, number, where), look) in enumerate(zip(shown, looks, strict=True)):
        items += [*header(f"{i}_"), space, Fixed("<i4", number)]
        items += [Fixed("<i4", look[0]), Fixed("<i4", look[1])]
        if where is None:
            items += place(f"{i}_")
        else:
            items += [Fixed("<f8", n) for n in (*where, 0.0)] + UPRIGHT
        items += [Fixed("<f8", n) for n in look[2:5]] + [Fixed("<f4", n) for n in look[5:]]
        items += [*no_stamp(), Fixed("u1", 0), Fixed("<u4", 0), Fixed("<u4", 0), ""]
        items += [*no_stamp(), "", "", Fixed("<u4", 0), Fixed("<u4", 0)]
        items += ["", "", "", Fixed("<u4", 0), Fixed("u1", 0)]
    return Layout(items)
