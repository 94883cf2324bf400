# Copyright 2026 The sparse_coord_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Learned tables Q* and Q^C of one robot, to be read, whatever form the learner keeps."""

from collections.abc import Sequence
from functools import cached_property
from typing import TYPE_CHECKING, Any

import numpy as np

from sparse_coord_ros.base.errors import NotAllowedError
from sparse_coord_ros.core.game.actions import PRIMITIVES
from sparse_coord_ros.core.game.scenario import Scenario
from sparse_coord_ros.core.learners.mind import Memory, team_mind
from sparse_coord_ros.core.learners.rules import Task

if TYPE_CHECKING:
    from sparse_coord_ros.core.learners.learner import Learner


class Tables:
    """Learned tables of one robot, to be read.

    Args:
        scenario: the problem.
        learner: its learner; None: its code may not be imported, and Q^C is unknown.
        number: the robot, from 0.
        memory: the robot's memory.

    Attributes:
        scenario, learner, number, memory: as of the arguments.
        q_star: Q*_k, shape (cells, 5), float64; column 4 (COORDINATE) is NaN for a baseline.
    """

    def __init__(
        self,
        scenario: Scenario,
        learner: "Learner | None",
        number: int,
        memory: Memory,
    ) -> None:
        self.scenario = scenario
        self.learner = learner
        self.number = number
        self.memory = memory
        self.q_star: np.ndarray = memory["q_star"]

    def __repr__(self) -> str:
        """Return a one-line description."""
        name = "unknown" if self.learner is None else self.learner.label
        return f"<Tables of robot {self.number + 1} of {self.scenario.name}, learner {name}>"

    @cached_property
    def q_coord(self) -> "np.ndarray | JointTable":
        """Q^C_k: the values by which COORDINATE chooses a move after a successful percept.

        An array of shape (cells, cells, 4), float64, where COORDINATE perceives one peer: first
        index the own cell, second the peer's. With more peers, and on large maps, it is read
        entry by entry (`JointTable`).
        """
        table = JointTable(self)
        return table if self.scenario.sparse else table.whole()

    def values_asking(self, cell: int, seen: int, cells: Sequence[int]) -> list[float]:
        """Return the values by which COORDINATE chooses a move.

        Args:
            cell: the own cell.
            seen: the peers that are perceived, the sum of 2^j; 0: the percept failed.
            cells: the cells of all robots; those of peers that are not perceived mean nothing.
        """
        values = [0.0] * PRIMITIVES
        self.rule.asking_values(
            self.mind, self.task, self.number, cell, seen, cells, values
        )
        return values

    @property
    def rule(self) -> "Learner":
        """The learner.

        Raises:
            NotAllowedError: its code may not be imported.
        """
        if self.learner is None:
            raise NotAllowedError(
                "tables: the code of their learner may not be imported"
            )
        return self.learner

    @cached_property
    def task(self) -> Task:
        """The task of the robot's team; it does not learn."""
        return self.rule.task(self.scenario)

    @cached_property
    def mind(self) -> Any:
        """The mind of its team, with the robot's own part; read only."""
        return team_mind(self.rule, self.scenario, [self.number], [self.memory])


class JointTable:
    """Q^C, read entry by entry.

    `table[cell, *peer_cells]` is the row of a joint state, `table[cell, *peer_cells, move]` an
    entry of it; the peers are in ascending order.

    Args:
        tables: of the robot.

    Attributes:
        shape: of the whole table.
    """

    def __init__(self, tables: Tables) -> None:
        scenario = tables.scenario
        self._tables = tables
        self._cells = len(scenario.map.cells)
        self._robots = len(scenario.robots)
        peers = [k for k in range(self._robots) if k != tables.number]
        self._peers = peers[: scenario.perceived - 1]
        self.shape = (self._cells,) * scenario.perceived + (PRIMITIVES,)

    def __getitem__(self, index: tuple[int, ...]) -> Any:
        """Return the row of a joint state, or one entry of it."""
        cell, *others = index
        cells = [cell] * self._robots
        seen = 0
        for peer, peer_cell in zip(self._peers, others, strict=False):
            cells[peer] = peer_cell
            seen |= 1 << peer
        row = np.array(self._tables.values_asking(cell, seen, cells))
        return row[others[-1]] if len(index) == len(self.shape) else row

    def whole(self) -> np.ndarray:
        """Return the table of one perceived peer as an array."""
        if not self._peers:
            return np.repeat(
                self._tables.q_star[:, None, :PRIMITIVES], self._cells, axis=1
            )
        cells = range(self._cells)
        return np.array([[self[x, z] for z in cells] for x in cells])
