# Copyright 2026 The sparse_coord_ros authors
# SPDX-License-Identifier: Apache-2.0
"""A recorded run as NumPy arrays over time step and robot."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, fields, replace
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from sparse_coord_ros.base.dataframes import data_frame
from sparse_coord_ros.core.game.actions import ACTIONS, COORDINATE
from sparse_coord_ros.core.game.interactions import (
    interactions_of,
    miscoordinations,
)
from sparse_coord_ros.core.game.rules import EPISODE_GAP
from sparse_coord_ros.core.game.world import FIRST_STEP
from sparse_coord_ros.core.learners.tables import Tables
from sparse_coord_ros.core.runs.history import History
from sparse_coord_ros.core.runs.run_config import RunConfig
from sparse_coord_ros.log.runlog.difference import Finding
from sparse_coord_ros.protocol.wire import ACTION, REWARD, Topic
from sparse_coord_ros.protocol.wire.messages import Messages
from sparse_coord_ros.protocol.wire.status import RunStatus

if TYPE_CHECKING:
    import pandas as pd

NONE = -1


def learning_steps(step: int, episode: int) -> int:
    """Return the learning steps that were made before a time step of an episode, from 0.

    A run has more time steps: those between two episodes.
    """
    return step - FIRST_STEP - EPISODE_GAP * episode


class Series(NamedTuple):
    """The messages of a robot on a topic; n of them.

    Attributes:
        step: their time steps, ascending, shape (n,).
        rows: their contents, shape (n,), by the form of the topic (`protocol.wire.messages`).
    """

    step: np.ndarray
    rows: np.ndarray


class RecordedTables(NamedTuple):
    """One robot's tables in the log.

    Attributes:
        robot: its number from 0.
        step: the robot had learned from everything before this time step.
        tables: the tables.
        counts: the numbers stored beside them.
        arrays: all recorded arrays, by name; empty for computed tables.
    """

    robot: int
    step: int
    tables: Tables
    counts: Mapping[str, int]
    arrays: Mapping[str, np.ndarray]


@dataclass(frozen=True, repr=False, eq=False)
class RunLog:
    """A recorded run: T recorded time steps, K robots; a missing value is -1, False or NaN.

    `reading.arrange` makes it.

    Attributes:
        path: the bag.
        files: the names of its files.
        segments: for each file the checkpoint at which it begins; 0: the run's beginning, or none.
        run: the run.
        frame: converts the run's time steps and metres.
        names: the robots, in the scenario's order.
        damage: one line if the bag is damaged or has no end: how far it was read; else None.
        series: the messages by topic and robot's number.
        statuses: the world's statuses, in the order of the log.
        all_tables: all recorded tables.
        problems: unreadable messages and tables, and messages that contradict each other.
        step: shape (T,), int64, ascending.
        episode: number of the episode, from 0, shape (T,).
        position: (x east, y north) in metres, shape (T, K, 2).
        cells: local states X_k(t), shape (T, K), int32.
        rewards: R_k(t) and its parts, by the labels of `wire.REWARD`: shape (T, K, 5), float64.
        numbers: the actions' numbers as logged, by the labels of `wire.ACTION`: shape (T, K, 7),
            float64.
        move: the primitive action, shape (T, K), int8.
        peer: the asked robot, from 0; NOBODY (-1) for no robot or several, shape (T, K).
        asked, perceived: shape (T, K), bool.
        percept: cells that robot k perceived, by the robot seen: shape (T, K, K), int32.
    """

    path: Path
    files: Sequence[str]
    segments: Sequence[int]
    run: RunConfig
    frame: Messages
    names: Sequence[str]
    damage: str | None
    series: Mapping[tuple[Topic, int], Series]
    statuses: Sequence[RunStatus]
    all_tables: Sequence[RecordedTables]
    problems: Sequence[Finding]
    step: np.ndarray
    episode: np.ndarray
    position: np.ndarray
    cells: np.ndarray
    rewards: np.ndarray
    numbers: np.ndarray
    move: np.ndarray
    peer: np.ndarray
    asked: np.ndarray
    perceived: np.ndarray
    percept: np.ndarray

    def __repr__(self) -> str:
        """Return scenario, learner, seed and length on one line."""
        run = f"{self.run.scenario.label}; {self.run.learner}, seed {self.run.seed}"
        return f"<RunLog {run}; {len(self.step):,} steps in {self.path}>"

    def column(self, label: str) -> np.ndarray:
        """Return one number of the rewards or actions, shape (T, K).

        Args:
            label: one of the labels of `wire.REWARD` or `wire.ACTION`, such as "total".
        """
        if label in REWARD.labels:
            return self.rewards[..., REWARD.column(label)]
        return self.numbers[..., ACTION.column(label)]

    @cached_property
    def action(self) -> np.ndarray:
        """A_k(t), 0 to 3 a move, 4 COORDINATE, shape (T, K), int8."""
        return np.where(self.asked, np.int8(COORDINATE), self.move)

    @cached_property
    def row_of(self) -> Mapping[int, int]:
        """The rows by time step."""
        return {step: row for row, step in enumerate(self.step.tolist())}

    def made_before(self, step: int) -> int:
        """Return the learning steps that were made before a time step."""
        row = int(np.searchsorted(self.step, step, side="right")) - 1
        if row < 0:
            return max(0, learning_steps(step, 0))
        return learning_steps(int(self.step[row]), int(self.episode[row]))

    def time_step(self, made: int) -> int:
        """Return the first time step before which so many learning steps were made.

        It is the last time step if fewer were made.
        """
        steps = self.step - FIRST_STEP - EPISODE_GAP * self.episode
        row = int(np.searchsorted(steps, made))
        return int(self.step[min(row, len(steps) - 1)])

    @property
    def whole(self) -> bool:
        """True if it has all robots' states of each of its time steps, and no step is missing."""
        no_jump = bool((np.diff(self.step) <= EPISODE_GAP).all())
        return no_jump and not (self.cells == NONE).any()

    def tables_before(
        self, robot: int, step: int | None = None
    ) -> RecordedTables | None:
        """Return a robot's newest tables of a time step or earlier; None: there are none.

        Args:
            robot: its number from 0.
            step: the time step; None: the newest of all.
        """
        known = [
            tables
            for tables in self.all_tables
            if tables.robot == robot and (step is None or tables.step <= step)
        ]
        return max(known, key=lambda tables: tables.step, default=None)

    def table_steps(self) -> list[list[int]]:
        """Return for each robot the time steps of its tables, ascending."""
        steps: list[set[int]] = [set() for _ in self.names]
        for tables in self.all_tables:
            steps[tables.robot].add(tables.step)
        return list(map(sorted, steps))

    @cached_property
    def tables(self) -> Mapping[tuple[int, int], Tables]:
        """The recorded tables by (robot's number, time step)."""
        return {(entry.robot, entry.step): entry.tables for entry in self.all_tables}

    def why_not_computed(self, k: int) -> str | None:
        """Return the reason if a robot's actions cannot be computed: it publishes no tables.

        Args:
            k: the robot's number.

        Returns:
            The reason as a sentence; None: it publishes tables.
        """
        if any(entry.robot == k for entry in self.all_tables):
            return None
        name = self.names[k]
        return (
            f"{name} publishes no tables: its actions cannot be explained (is it a custom "
            "learner?)"
        )

    def between(self, first: int, last: int) -> "RunLog":
        """Return the time steps from `first` to `last`, both included.

        The messages, statuses and tables stay.
        """
        rows = slice(*np.searchsorted(self.step, [first, last + 1]))
        arrays = {
            field.name: getattr(self, field.name)[rows]
            for field in fields(self)
            if isinstance(getattr(self, field.name), np.ndarray)
        }
        return replace(self, **arrays)

    def to_pandas(self) -> "pd.DataFrame":
        """Return a pandas DataFrame: one row for each time step and robot.

        Raises:
            RunError: pandas is not installed.
        """
        count, robots = self.cells.shape
        # A missing cell or action has index -1, which selects the padding at the end.
        grid = np.array([*self.run.scenario.map.cells, (NONE, NONE)])[self.cells]
        called = np.array([*ACTIONS, None], dtype=object)
        columns = {
            "step": np.repeat(self.step, robots),
            "episode": np.repeat(self.episode, robots),
            "robot": np.tile(np.array(self.names, dtype=object), count),
            "cell": self.cells,
            "row": grid[..., 0],
            "column": grid[..., 1],
            "x": self.position[..., 0],
            "y": self.position[..., 1],
            "action": self.action,
            "action_name": called[self.action],
            "move": self.move,
            "move_name": called[self.move],
            "peer": self.peer,
            "asked": self.asked,
            "perceived": self.perceived,
        }
        columns |= {
            f"percept_{name}": self.percept[..., k] for k, name in enumerate(self.names)
        }
        for label in ("individual", "common", "ask_cost"):
            columns[label] = self.column(label)
        columns["reward"] = self.column("total")
        return data_frame({name: values.ravel() for name, values in columns.items()})

    def history(self) -> History:
        """Return the learning history: each episode as far as the log goes.

        An episode beside lost time steps is left out, as its length is unknown.
        """
        scenario = self.run.scenario
        goals = np.array([robot.goal for robot in scenario.robots])
        rewarded = ~np.isnan(self.column("total"))
        made = rewarded.any(axis=1)
        # A transition counts if the log also contains the state after it.
        made[:-1] &= np.diff(self.step) == 1
        made[-1:] = False
        made &= ~np.isin(self.episode, self._episodes_beside_lost_steps())
        after = np.roll(self.cells, -1, axis=0)
        episodes, episode = np.unique(self.episode[made], return_inverse=True)
        first = np.searchsorted(self.episode, episodes)

        inter = interactions_of(scenario)
        conflicts = miscoordinations(inter, self.cells.T, after.T)

        def total(values: np.ndarray) -> np.ndarray:
            sums = np.zeros((len(episodes), *values.shape[1:]), dtype=values.dtype)
            np.add.at(sums, episode, values[made])
            return sums

        asked = self.asked & rewarded
        arrives = rewarded & (after == goals)
        paid = np.where(arrives, scenario.arrival_value, 0.0)
        paid += np.where(conflicts[:, None], scenario.penalties, 0.0)
        paid += np.where(asked, -scenario.ask_cost, 0.0)
        elapsed = np.zeros(len(self.step), dtype=np.int64)
        elapsed[made] = self.step[made] - self.step[first][episode]
        powers = np.full(elapsed.max(initial=0) + 1, scenario.discount)
        powers[0] = 1.0
        factors = np.cumprod(powers)  # one by one, as everywhere: the same bits

        return History(
            first_step=self.step[first],
            length=total(made.astype(np.int64)),
            returns=total(factors[elapsed][:, None] * paid),
            miscoordinations=total(conflicts.astype(np.int64)),
            asks=total(asked.astype(np.int64)),
            arrived=total((after == goals).astype(np.int64)) > 0,
            present=np.ones((len(episodes), len(self.names)), dtype=bool),
        )

    def _episodes_beside_lost_steps(self) -> np.ndarray:
        """Return the numbers of the episodes between which time steps are missing."""
        lost = np.flatnonzero(np.diff(self.step) > EPISODE_GAP)
        return np.unique(self.episode[np.concatenate([lost, lost + 1])])
