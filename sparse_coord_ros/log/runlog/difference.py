# Copyright 2026 The sparse_coord_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Findings of `verify`: differences between log and computation, and undecided parts."""

from collections.abc import Mapping
from typing import NamedTuple

import numpy as np

from sparse_coord_ros.protocol import wire

MISSING = "missing"
"""Logged value of a message or an attachment that is not in the log."""
NO_REQUEST = "without its request"
"""Logged value of an answer whose request is not in the log."""
NOTHING_TO_LEARN = "0: there was nothing to learn from"
"""Computed value of `learned` if the log lacks the reward or the state of the action before."""
TWICE = "twice"
"""Logged value of a message or an attachment that must occur only once."""
DIALOGUE = "dialogue"
"""Quantity: question and answer of a percept."""
LOG_TIME = "log_time"
"""Quantity: the time at which a message was logged."""
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
"""The quantities of a time step in their order; all other quantities come before."""


class Difference(NamedTuple):
    """A quantity that differs between the log and the computation.

    Attributes:
        step: the time step; None: the quantity belongs to the whole run.
        robot: the robot's name; None: the quantity belongs to the world or the run.
        quantity: a topic, e.g. "reward"; after a space a part of it, e.g. "tables q_star".
        logged: the value in the log.
        computed: the correct value.
    """

    step: int | None
    robot: str | None
    quantity: str
    logged: str
    computed: str

    def __str__(self) -> str:
        """Return one line."""
        where = [] if self.step is None else [f"time step {self.step}"]
        where += [] if self.robot is None else [self.robot]
        where.append(f"{self.quantity}: logged {self.logged}, computed {self.computed}")
        return ", ".join(where)

    @property
    def missing(self) -> bool:
        """True if a message that is not in the log explains the difference."""
        not_there = self.logged.endswith((MISSING, NO_REQUEST))
        return not_there or self.computed == NOTHING_TO_LEARN

    @property
    def rank(self) -> tuple[int, int]:
        """A key that sorts differences by time step, then by the course of a step."""
        step = -1 if self.step is None else self.step
        topic = self.quantity.split()[0]
        if topic not in QUANTITIES:
            return step, 0
        return step, 1 + QUANTITIES.index(topic)


class Unknown(NamedTuple):
    """A part of a run that cannot be verified.

    Attributes:
        first: its first time step; 0: from the run's beginning.
        last: its last time step; None: up to the run's end.
        why: the reason, as a sentence.
    """

    first: int
    last: int | None
    why: str

    def __str__(self) -> str:
        """Return one line."""
        if self.last is None:
            return f"from time step {self.first} on: {self.why}"
        if self.last == self.first:
            return f"at time step {self.first}: {self.why}"
        return f"from time step {self.first} to time step {self.last}: {self.why}"


def first_entry(
    logged: Mapping[str, np.ndarray | None],
    computed: Mapping[str, np.ndarray],
    robot: int,
) -> tuple[str, str, str] | None:
    """Return the first entry in which a robot's arrays differ, bit for bit.

    Args:
        logged: the arrays of an attachment.
        computed: the correct arrays.
        robot: its number from 0; the names have it from 1.

    Returns:
        The array with the entry, the logged value, the computed value; None: all are equal.
    """
    for name in (*computed, *logged):
        found = _first_bits(logged.get(name), computed.get(name))
        if found is not None:
            entry, value, due = found
            return f"{name.replace(f'_{robot + 1}', '', 1)}{entry}", value, due
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
    entry = tuple(np.argwhere(_bits(logged) != _bits(computed))[0].tolist())
    value = repr(logged[entry].item())
    due = repr(computed[entry].item())
    return f"{list(entry)}" if entry else "", value, due


def _bits(array: np.ndarray) -> np.ndarray:
    return np.asarray(array, order="C").view(f"V{array.itemsize}")


def _kind(array: np.ndarray | None) -> str:
    return MISSING if array is None else f"{array.dtype} of shape {array.shape}"
