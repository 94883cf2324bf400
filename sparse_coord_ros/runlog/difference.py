# Copyright 2026 The sparse_coord_ros authors
# SPDX-License-Identifier: Apache-2.0
"""How a log departs from what was computed: one named tuple for whatever may differ."""

from typing import NamedTuple

import numpy as np

from sparse_coord_ros import wire
from sparse_coord_ros.learn.agent import Tables

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


def first_entry(logged: Tables, computed: Tables) -> tuple[str, str, str]:
    """Return the first entry in which tables differ, its logged and its computed value."""
    ours, theirs = logged.arrays(), computed.arrays()
    for name, due in theirs.items() if ours.keys() == theirs.keys() else ():
        quantity, said = f"{wire.TABLES.name} {name}", ours[name]
        if said.shape != due.shape:
            return quantity, f"shape {said.shape}", f"shape {due.shape}"
        bits = f"u{due.itemsize}"
        for entry in np.argwhere(said.view(bits) != due.view(bits)).tolist()[:1]:
            logged_value, value = (repr(float(array[tuple(entry)])) for array in (said, due))
            return f"{quantity}{entry}", logged_value, value
    return wire.TABLES.name, "another kind", "that of the scenario"
