# Copyright 2026 The sparse_coord_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Findings of `verify`: a difference between log and computation, or where it cannot go on."""

from collections.abc import Mapping
from typing import NamedTuple

import numpy as np

MISSING = "missing"
"""The value of an array that is not there."""


class Difference(NamedTuple):
    """A quantity that differs between the log and the computation.

    Attributes:
        step: the time step.
        robot: the robot's name; None: the quantity belongs to the world.
        quantity: a topic, e.g. "reward"; after a space a part of it, e.g. "tables q_star".
        logged: the value in the log.
        computed: the correct value.
    """

    step: int
    robot: str | None
    quantity: str
    logged: str
    computed: str

    def __str__(self) -> str:
        """Return one line."""
        where = [f"time step {self.step}"]
        where += [] if self.robot is None else [self.robot]
        where.append(f"{self.quantity}: logged {self.logged}, computed {self.computed}")
        return ", ".join(where)


class Undecided(NamedTuple):
    """From a time step on, a run cannot be verified.

    Attributes:
        step: the time step; 0: the run's beginning.
        why: the reason, as a sentence.
    """

    step: int
    why: str

    def __str__(self) -> str:
        """Return one line."""
        return f"from time step {self.step} on: {self.why}"


Finding = Difference | Undecided


def first_entry(
    logged: Mapping[str, np.ndarray | None],
    computed: Mapping[str, np.ndarray],
    robot: int,
) -> tuple[str, str, str] | None:
    """Return the first entry in which a robot's arrays differ, bit for bit.

    Args:
        logged: the recorded arrays.
        computed: the correct arrays.
        robot: its number from 0; the names have it from 1.

    Returns:
        The array with the entry, the logged value, the computed value; None: all are equal.
    """
    for name in (*computed, *logged):
        difference = _first_bits(logged.get(name), computed.get(name))
        if difference is not None:
            entry, value, due = difference
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
