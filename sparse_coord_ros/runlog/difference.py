# Copyright 2026 The sparse_coord_ros authors
# SPDX-License-Identifier: Apache-2.0
"""How a log departs from what was computed: one named tuple for whatever may differ."""

from collections.abc import Iterable, Iterator
from typing import Any, NamedTuple

import numpy as np

from sparse_coord_ros import wire
from sparse_coord_ros.game.actions import PRIMITIVES
from sparse_coord_ros.learn.agent import Tables
from sparse_coord_ros.learn.factors import Factors
from sparse_coord_ros.learn.sparse import SparseTable

MISSING = "missing"
DIALOGUE, LOG_TIME = "dialogue", "log_time"
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
    def rank(self) -> tuple[int, int]:
        """Sorts differences in the order of time: step, then the course of a step."""
        kind = self.quantity.split()[0]
        within = 1 + QUANTITIES.index(kind) if kind in QUANTITIES else 0
        return (-1 if self.step is None else self.step, within)


def _pairs(logged: Tables, computed: Tables) -> Iterator[tuple[str, Any, Any]]:
    """Yield the parts of both tables by name."""
    yield "q_star", logged.q_star, computed.q_star
    if logged.factors is not None and computed.factors is not None:
        names = Factors._fields
        yield from zip(names, logged.factors, computed.factors, strict=True)
    yield "q_coord", logged.q_coord, computed.q_coord


def first_entry(logged: Tables, computed: Tables) -> tuple[str, str, str]:
    """Return the first entry in which tables differ, its logged and its computed value."""
    for part, ours, theirs in _pairs(logged, computed):
        name = f"{wire.TABLES.name} {part}"
        entries: Iterable[Any]
        if isinstance(ours, SparseTable) and isinstance(theirs, SparseTable):
            if ours.unseen != theirs.unseen:
                return f"{name} unseen", repr(ours.unseen), repr(theirs.unseen)
            keys = sorted({tuple(key) for table in (ours, theirs) for key in table.keys.tolist()})
            entries = ((*key, action) for key in keys for action in range(PRIMITIVES))
        elif isinstance(ours, np.ndarray) and isinstance(theirs, np.ndarray):
            if ours.shape != theirs.shape:
                return name, f"shape {ours.shape}", f"shape {theirs.shape}"
            bits = f"u{ours.itemsize}"
            entries = map(tuple, np.argwhere(ours.view(bits) != theirs.view(bits)).tolist())
        else:
            continue
        for entry in entries:
            values = repr(float(ours[entry])), repr(float(theirs[entry]))
            if values[0] != values[1]:
                return f"{name}{list(entry)}", *values
        if isinstance(ours, SparseTable) and not ours.same_bits(theirs):
            return name, f"{len(ours)} rows", f"{len(theirs)} rows"
    return wire.TABLES.name, "another kind", "that of the scenario"
