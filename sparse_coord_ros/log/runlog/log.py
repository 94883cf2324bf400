# Copyright 2026 The sparse_coord_ros authors
# SPDX-License-Identifier: Apache-2.0
"""A recorded run as NumPy arrays over time step and robot."""

from collections.abc import Mapping, Sequence
from copy import copy
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from sparse_coord_ros.base.dataframes import data_frame
from sparse_coord_ros.core.game.actions import ACTIONS, COORDINATE
from sparse_coord_ros.core.game.interactions import (
    interactions_of,
    miscoordinations,
)
from sparse_coord_ros.core.game.rules import EPISODE_GAP
from sparse_coord_ros.core.learners.agent import NOBODY
from sparse_coord_ros.core.learners.tables import Tables
from sparse_coord_ros.core.runs.history import History
from sparse_coord_ros.log.runlog.difference import Difference
from sparse_coord_ros.log.runlog.run_messages import (
    RunMessages,
    Series,
    read_messages,
)
from sparse_coord_ros.protocol.wire import ACTION, PERCEPT, REWARD
from sparse_coord_ros.protocol.wire.messages import MOVE_OF, Messages, action_from

if TYPE_CHECKING:
    import pandas as pd

NONE = -1


class RunLog:
    """A recorded run: T recorded time steps, K robots; a missing value is -1, False or NaN.

    Args:
        messages: the messages of the bag, or of a part of it.

    Attributes:
        bag: the bag: topics, counts, damage.
        run: the run.
        names: the robots, in the scenario's order.
        step: shape (T,), int64, ascending.
        episode: number of the episode, from 0, shape (T,).
        cells: local states X_k(t), shape (T, K), int32.
        position: the same in metres (x east, y north), shape (T, K, 2).
        action: A_k(t), 0 to 3 a move, 4 COORDINATE, shape (T, K), int8.
        move: the primitive action after it, shape (T, K), int8.
        peer: the asked robot, from 0; NOBODY (-1) for no robot or several, shape (T, K).
        asked, perceived: shape (T, K), bool.
        percept: cells that robot k perceived, by the robot seen: shape (T, K, K), int32.
        rewards: individual, common, ask_cost, total, and the partners of an interaction, as
            of `core.game.world.Reward`; NaN if the log does not contain them, shape (T, K, 5),
            float64.
        numbers: the actions' numbers as logged, by the labels of `wire.ACTION`: shape (T, K, 7),
            float64.
        tables: by (robot's number, time step); of several of a time step the last.
        all_tables: all recorded tables, in the order of the log.
        messages: the given messages, with their problems.
        frame: converts the run's time steps and metres.
    """

    def __init__(self, messages: RunMessages) -> None:
        self.messages = messages
        self.bag = messages.bag
        self.run = messages.run
        self.names = messages.names
        self.frame = Messages(self.run)
        self.all_tables = tuple(messages.tables)
        self.step = self._recorded_steps()
        self.episode = np.cumsum(np.diff(self.step, prepend=self.step[:1]) > 1)
        self.position = self._filled(messages.states, "xy", 2)
        self.cells = cell_numbers(self.frame, self.position)
        self.rewards = self._filled(messages.rewards, "numbers", len(REWARD.labels))
        self.numbers = self._filled(messages.actions, "numbers", len(ACTION.labels))
        self.move = self._moves()
        self.peer = self._asked_peers()
        moved = self.move != NONE
        self.asked = moved & (self._number("coordinate") != 0)
        self.perceived = moved & (self._number("perceived") != 0)
        self.action = np.where(self.asked, np.int8(COORDINATE), self.move)
        self.percept = self._perceived_cells()
        self._note_malformed_actions()

    def _recorded_steps(self) -> np.ndarray:
        """Return the time steps with a message of any robot, ascending."""
        of_robots = [self.messages.of_robot(k) for k in range(len(self.names))]
        return np.unique(
            np.concatenate([one.step for series in of_robots for one in series])
        )

    def _filled(self, series: Sequence[Series], field: str, width: int) -> np.ndarray:
        """Return a field of each robot's messages, NaN without a message, shape (T, K, width)."""
        found = np.full((len(self.step), len(self.names), width), np.nan)
        for k, one in enumerate(series):
            values = one.rows[field]
            rows = np.searchsorted(self.step, one.step)
            found[rows, k, : values.shape[1]] = values
        return found

    def _number(self, label: str) -> np.ndarray:
        """Return one of the actions' numbers, shape (T, K)."""
        return self.numbers[..., ACTION.column(label)]

    def _moves(self) -> np.ndarray:
        """Return the primitive actions; NONE for a malformed or missing action."""
        directions = self.numbers[..., :2].reshape(-1, 2).tolist()
        moves = [MOVE_OF.get((east, north), NONE) for east, north in directions]
        found = np.array(moves, dtype=np.int8).reshape(self.cells.shape)
        found[~np.isfinite(self._number("peer"))] = NONE
        return found

    def _asked_peers(self) -> np.ndarray:
        """Return the asked robots; NOBODY for no robot or several."""
        logged = self._number("peer")
        found = np.full(self.cells.shape, NOBODY, dtype=np.int16)
        known = (self.move != NONE) & (logged >= 0) & (logged <= len(self.names))
        found[known] = logged[known].astype(np.int16) - 1
        return found

    def _perceived_cells(self) -> np.ndarray:
        """Return the cells that robots perceived, by the perceived robot, shape (T, K, K)."""
        robots = range(len(self.names))
        found = np.full((*self.cells.shape, len(robots)), NONE, dtype=np.int32)
        for k, percepts in enumerate(self.messages.percepts):
            others = [other for other in robots if other != k]
            if not others:
                continue
            rows = np.searchsorted(self.step, percepts.step)
            seen = cell_numbers(self.frame, percepts.rows["places"])[:, 1:]
            peer = self.peer[rows, k]
            one = peer != NOBODY
            found[rows[one], k, peer[one]] = seen[one, 0]
            found[np.ix_(rows[~one], [k], others)] = seen[~one][:, None, :]
        return found

    def _note_malformed_actions(self) -> None:
        """Note the messages whose numbers are not a valid action."""
        logged = ~np.isnan(self.numbers[..., 0])
        for row, k in np.argwhere(logged & (self.move == NONE)).tolist():
            try:
                action_from(self.numbers[row, k].tolist())
            except ValueError as error:
                words = ACTION.name, f"a message that {error}", "an action"
                found = self.messages.difference(int(self.step[row]), k, *words)
                self.messages.problems.append(found)

    def __repr__(self) -> str:
        """Return scenario, learner, seed and length on one line."""
        run = f"{self.run.scenario.label}; {self.run.learner}, seed {self.run.seed}"
        return f"<RunLog {run}; {len(self.step):,} steps in {self.bag.path}>"

    @property
    def reward(self) -> np.ndarray:
        """Individual, common, ask_cost, total: shape (T, K, 4)."""
        return self.rewards[..., : REWARD.column("partners")]

    @cached_property
    def row_of(self) -> Mapping[int, int]:
        """The rows by time step."""
        return {step: row for row, step in enumerate(self.step.tolist())}

    @property
    def damage(self) -> str | None:
        """One line if the bag is damaged or has no end: how far it was read; else None."""
        return self.bag.ends_early(f"time step {self.step.max(initial=0)}")

    @property
    def problems(self) -> tuple[Difference, ...]:
        """Unreadable messages and tables, and messages that contradict each other."""
        return tuple(self.messages.problems)

    @property
    def whole(self) -> bool:
        """True if it has all robots' states of each of its time steps, and no step is missing."""
        no_jump = bool((np.diff(self.step) <= EPISODE_GAP).all())
        return no_jump and not (self.cells == NONE).any()

    @property
    def ended(self) -> np.ndarray:
        """The ends of percepts, by `wire.PerceptEnd`; NaN without a percept; shape (T, K)."""
        return self._number(PERCEPT.name)

    @property
    def has_learned(self) -> np.ndarray:
        """1 if an action reports that its robot learned from the one before, shape (T, K)."""
        return self._number("learned")

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
        """Return the time steps from `first` to `last`, both included."""
        rows = slice(*np.searchsorted(self.step, [first, last + 1]))
        arrays = {
            name: value[rows]
            for name, value in vars(self).items()
            if isinstance(value, np.ndarray)
        }
        return self.with_changes(**arrays)

    def with_changes(self, **changes: object) -> "RunLog":
        """Return the same log with some attributes changed."""
        log = copy(self)
        vars(log).pop("row_of", None)
        vars(log).update(changes)
        return log

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
        labels = ("individual", "common", "ask_cost", "reward")
        columns |= {
            label: self.reward[..., place] for place, label in enumerate(labels)
        }
        return data_frame({name: values.ravel() for name, values in columns.items()})

    def history(self) -> History:
        """Return the learning history: each episode as far as the log goes.

        An episode beside lost time steps is left out, as its length is unknown.
        """
        scenario = self.run.scenario
        goals = np.array([robot.goal for robot in scenario.robots])
        rewarded = ~np.isnan(self.reward[..., -1])
        made = rewarded.any(axis=1)
        # A transition counts if the log also contains the state after it.
        made[:-1] &= np.diff(self.step) == 1
        made[-1:] = False
        made &= ~np.isin(self.episode, self._episodes_beside_lost_steps())
        after = np.roll(self.cells, -1, axis=0)
        found, episode = np.unique(self.episode[made], return_inverse=True)
        first = np.searchsorted(self.episode, found)

        inter = interactions_of(scenario)
        conflicts = miscoordinations(inter, self.cells.T, after.T)

        def total(values: np.ndarray) -> np.ndarray:
            sums = np.zeros((len(found), *values.shape[1:]), dtype=values.dtype)
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
            present=np.ones((len(found), len(self.names)), dtype=bool),
        )

    def _episodes_beside_lost_steps(self) -> np.ndarray:
        """Return the numbers of the episodes between which time steps are missing."""
        lost = np.flatnonzero(np.diff(self.step) > EPISODE_GAP)
        return np.unique(self.episode[np.concatenate([lost, lost + 1])])


def cell_numbers(frame: Messages, places: np.ndarray) -> np.ndarray:
    """Return the cells of positions.

    Args:
        frame: the run's frame.
        places: in metres, shape (..., 2).

    Returns:
        The cells, `NONE` for a position in no free cell, int32, shape (...).
    """
    pairs = np.ascontiguousarray(places).view(np.complex128)[..., 0]
    different, which = np.unique(pairs, return_inverse=True)
    found = [frame.cell(pair.real, pair.imag) for pair in different.tolist()]
    table = np.array([NONE if cell is None else cell for cell in found], dtype=np.int32)
    return table[which.reshape(pairs.shape)]


def read_run(path: Path) -> RunLog:
    """Read a run's log: a bag's directory, an `.mcap` or an `.mcap.partial`.

    An unfinished or damaged file is read up to there.

    Raises:
        BagError: the bag cannot be read, contains no run, or has another format.
        RunError, ScenarioError, SettingError: the run in the bag is not one of this version.
    """
    return RunLog(read_messages(Path(path)))
