# Copyright 2026 The sparse_coord_ros authors
# SPDX-License-Identifier: Apache-2.0
"""How a log departs from what was computed: one named tuple for whatever may differ."""

from collections.abc import Mapping
from typing import NamedTuple

import numpy as np

from sparse_coord_ros.protocol import wire

MISSING = "missing"
NO_REQUEST = "without its request"
"""What is logged of something that is not in the log, and of an answer to such a request."""
NOTHING_TO_LEARN = "0: there was nothing to learn from"
"""What is due of `learned` where the log holds no reward, or no state, of the action before."""
DIALOGUE = "dialogue"
LOG_TIME = "log_time"
"""Quantities that are no topic's."""
QUANTITIES = (
    wire.LOCAL_STATE.name,
    wire.MAP.name,
    wire.MARKERS.name,
    wire.TABLES.name,
    wire.COORDINATION_MAP.name,
    wire.PERCEPT.name,
    DIALOGUE,
    wire.ACTION.name,
    wire.REWARD.name,
    LOG_TIME,
)
"""What comes within a time step, in its order; everything else comes before."""


class Difference(NamedTuple):
    """One thing in which a log differs from the computation.

    Attributes:
        step: the time step, or None where it belongs to none.
        robot: the robot's name, or None.
        quantity: what differs, e.g. "reward"; after a space what about it, e.g. "tables q_star".
        logged: what the log says.
        computed: what it ought to say.
    """

    step: int | None
    robot: str | None
    quantity: str
    logged: str
    computed: str

    def __str__(self) -> str:
        """Return one line."""
        where = [] if self.step is None else [f"step {self.step}"]
        where += [] if self.robot is None else [self.robot]
        where.append(f"{self.quantity}: logged {self.logged}, computed {self.computed}")
        return ", ".join(where)

    @property
    def missing(self) -> bool:
        """Whether it shows that something is not in the log."""
        gone = self.logged.endswith((MISSING, NO_REQUEST))
        return gone or self.computed == NOTHING_TO_LEARN

    @property
    def rank(self) -> tuple[int, int]:
        """Sorts differences in the order of time: step, then the course of a step."""
        kind = self.quantity.split()[0]
        within = 1 + QUANTITIES.index(kind) if kind in QUANTITIES else 0
        return (-1 if self.step is None else self.step, within)


def first_entry(
    logged: Mapping[str, np.ndarray | None],
    computed: Mapping[str, np.ndarray],
    robot: int,
) -> tuple[str, str, str] | None:
    """Return the first thing in which a robot's arrays differ, bit for bit.

    Args:
        logged: the arrays of an attachment.
        computed: what they ought to be.
        robot: its number from 0, which the names hold from 1.

    Returns:
        The array, with the entry, and what is logged and computed; None: all are equal.
    """
    for name in (*computed, *logged):
        odd = _first_bits(logged.get(name), computed.get(name))
        if odd is not None:
            return f"{name.replace(f'_{robot + 1}', '', 1)}{odd[0]}", odd[1], odd[2]
    return None


def _first_bits(
    logged: np.ndarray | None, computed: np.ndarray | None
) -> tuple[str, str, str] | None:
    """Return the first entry in which two arrays differ, and its values; None: they are equal."""
    if logged is None or computed is None:
        return "", _kind(logged), _kind(computed)
    if (logged.dtype, logged.shape) != (computed.dtype, computed.shape):
        return "", _kind(logged), _kind(computed)
    if logged.tobytes() == computed.tobytes():
        return None
    bits = f"V{computed.itemsize}"
    ours, theirs = (
        np.asarray(array, order="C").view(bits) for array in (logged, computed)
    )
    entry = np.argwhere(ours != theirs)[0].tolist()
    value, due = (repr(array[tuple(entry)].item()) for array in (logged, computed))
    return f"{entry}" if entry else "", value, due


def _kind(array: np.ndarray | None) -> str:
    return MISSING if array is None else f"{array.dtype} of shape {array.shape}"
