# Copyright 2026 The sparse_coord_ros authors
# SPDX-License-Identifier: Apache-2.0
"""A recorded run as NumPy arrays over time step and robot."""

from collections.abc import Mapping
from copy import copy
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from sparse_coord_ros.base.dataframes import data_frame
from sparse_coord_ros.core.game.actions import ACTIONS, COORDINATE
from sparse_coord_ros.core.game.miscoordination import miscoordinations
from sparse_coord_ros.core.learners.agent import NOBODY
from sparse_coord_ros.core.learners.tables import Tables
from sparse_coord_ros.core.runs.history import History
from sparse_coord_ros.log.runlog.difference import Difference
from sparse_coord_ros.log.runlog.timeline import LostSteps, gap_in_words
from sparse_coord_ros.log.runlog.tracks import Tracks, read_tracks
from sparse_coord_ros.protocol.wire import ACTION, PERCEPT, REWARD
from sparse_coord_ros.protocol.wire.frame import MOVE_OF, Frame
from sparse_coord_ros.protocol.wire.messages import action_from

if TYPE_CHECKING:
    import pandas as pd

NONE = -1


class RunLog:
    """What a bag tells of a run. T recorded time steps, K robots; -1, False or NaN where none.

    Args:
        tracks: the messages of the bag, or of a part of it.

    Attributes:
        bag: the file's own account: topics, counts, damage.
        run: the run.
        names: the robots, in the scenario's order.
        step: shape (T,), int64, ascending.
        episode: number of the episode, from 0, shape (T,).
        cells: local states X_k(t), shape (T, K), int32.
        position: the same in metres (x east, y north), shape (T, K, 2).
        action: A_k(t), 0 to 3 a move, 4 COORDINATE, shape (T, K), int8.
        move: the primitive action that it became, shape (T, K), int8.
        peer: the robot that was asked, from 0; NOBODY (-1) for none or several, shape (T, K).
        asked, perceived: shape (T, K), bool.
        percept: cells that robot k perceived, by the robot seen: shape (T, K, K), int32.
        rewards: individual, common, ask_cost, total, and with whom a robot was in a
            miscoordination, as of `core.game.world.Reward`; NaN where nobody says, shape (T, K,
            5), float64.
        numbers: the actions' numbers as they were logged, by the labels of `wire.ACTION`:
            shape (T, K, 7), float64.
        tables: by (robot's number, time step); of two of a step the later.
        all_tables: all of them, in the order of the log.
        requests: the dialogue, in the order of time steps.
        tracks: as given, with whatever was odd about them.
        frame: the run's time steps and metres.
    """

    def __init__(self, tracks: Tracks) -> None:
        self.tracks = tracks
        self.bag = tracks.bag
        self.run = tracks.run
        self.names = tracks.names
        self.frame = frame = Frame(self.run)
        self.all_tables = tuple(tracks.tables)
        self.requests = tuple(tracks.requests)
        robots = range(len(self.names))
        steps = [track.step for k in robots for track in tracks.of(k)]
        self.step = step = np.unique(np.concatenate(steps))
        self.episode = np.cumsum(np.diff(step, prepend=step[:1]) > 1)
        shape = (len(step), len(robots))
        self.position = np.full((*shape, 2), np.nan)
        self.numbers = numbers = np.full((*shape, len(ACTION.labels)), np.nan)
        self.rewards = np.full((*shape, len(REWARD.labels) + 1), np.nan)
        for k in robots:
            states, rewards, actions, _ = tracks.of(k)
            self.position[np.searchsorted(step, states.step), k] = states.rows["xy"]
            said = rewards.rows["numbers"]
            self.rewards[np.searchsorted(step, rewards.step), k, : said.shape[1]] = said
            numbers[np.searchsorted(step, actions.step), k] = actions.rows["numbers"]
        self.cells = cell_numbers(frame, self.position)
        pairs = map(tuple, numbers[..., :2].reshape(-1, 2).tolist())
        move = np.array(
            [MOVE_OF.get(pair, NONE) for pair in pairs], dtype=np.int8
        ).reshape(shape)
        self.move = move
        self.peer = np.full(shape, NOBODY, dtype=np.int16)
        said = numbers[..., ACTION.column("peer")]
        move[~np.isfinite(said)] = NONE
        known = (move != NONE) & (said >= 0) & (said <= len(robots))
        self.peer[known] = said[known].astype(np.int16) - 1
        self.asked = (move != NONE) & (numbers[..., ACTION.column("coordinate")] != 0)
        self.perceived = (move != NONE) & (
            numbers[..., ACTION.column("perceived")] != 0
        )
        self.action = np.where(self.asked, np.int8(COORDINATE), move)
        for place, k in np.argwhere(
            (move == NONE) & ~np.isnan(numbers[..., 0])
        ).tolist():
            try:
                action_from(numbers[place, k].tolist())
            except ValueError as error:
                words = ACTION.name, str(error), "an action"
                tracks.problems.append(tracks.odd(int(step[place]), k, *words))
        self.percept = np.full((*shape, len(robots)), NONE, dtype=np.int32)
        for k in robots:
            rows = np.searchsorted(step, tracks.percepts[k].step)
            seen = cell_numbers(frame, tracks.percepts[k].rows["places"])[:, 1:]
            others = [other for other in robots if other != k]
            one = self.peer[rows, k] != NOBODY
            if others:
                self.percept[rows[one], k, self.peer[rows[one], k]] = seen[one, 0]
            self.percept[np.ix_(rows[~one], [k], others)] = seen[~one][:, None, :]

    def __repr__(self) -> str:
        """Return what it is, on one line."""
        who = f"{self.run.scenario.label}; {self.run.learner}, seed {self.run.seed}"
        return f"<RunLog {who}; {len(self.step):,} steps in {self.bag.path}>"

    @property
    def reward(self) -> np.ndarray:
        """Individual, common, ask_cost, total: shape (T, K, 4)."""
        return self.rewards[..., : len(REWARD.labels)]

    @cached_property
    def row_of(self) -> Mapping[int, int]:
        """The rows by time step."""
        return {step: row for row, step in enumerate(self.step.tolist())}

    @property
    def gaps(self) -> list[LostSteps]:
        """What is not in the log, in order; the last one without an end where it broke off."""
        tracks = self.tracks
        found = sorted(tracks.gaps)
        if not tracks.broken_off:
            return found
        ends = [t.step.max() for t in (*tracks.states, tracks.clock) if len(t.step)]
        end = int(min(ends, default=0)) + 1
        return [*(gap for gap in found if gap.first < end), LostSteps(end, None)]

    @property
    def losses(self) -> list[str]:
        """What of the bag cannot be read, and which time steps are not in the log, one line each.

        What cannot be read may hold no message of any time step.
        """
        found = [gap_in_words(gap, self.frame.period) for gap in self.bag.gaps]
        why = "the log breaks off"
        if self.tracks.untold:
            why += ", the world does not say how the run ended"
        for first, last in self.gaps:
            end = f"on: {why}" if last is None else f"to {last}"
            found.append(f"time steps {first} {end}")
        return found

    @property
    def problems(self) -> tuple[Difference, ...]:
        """Messages and attachments that could not be read, or are out of order."""
        return tuple(self.tracks.problems)

    @property
    def ended(self) -> np.ndarray:
        """How percepts ended: numbers of `wire.PerceptEnd`, NaN where none, shape (T, K)."""
        return self.numbers[..., ACTION.column(PERCEPT.name)]

    @property
    def has_learned(self) -> np.ndarray:
        """1 where a robot says that it has learned from its action before, shape (T, K)."""
        return self.numbers[..., ACTION.column("learned")]

    @cached_property
    def tables(self) -> Mapping[tuple[int, int], Tables]:
        """The recorded tables by (robot's number, time step)."""
        return {(entry.robot, entry.step): entry.tables for entry in self.all_tables}

    def hides(self, k: int) -> str | None:
        """Return that a robot says nothing of what it learns, as one's own may; None: it does."""
        recorded = any(entry.robot == k for entry in self.all_tables)
        if recorded or len(self.tracks.coordination_maps[k][0]):
            return None
        what = f"{self.names[k]} shows no tables and no coordination maps"
        return f"{what}: why it acts as it does is not computed (a robot of one's own?)"

    def between(self, first: int, last: int) -> "RunLog":
        """Return the time steps from `first` to `last`, both included."""
        rows = slice(*np.searchsorted(self.step, [first, last + 1]))
        columns = {
            n: one[rows] for n, one in vars(self).items() if isinstance(one, np.ndarray)
        }
        requests = tuple(one for one in self.requests if first <= one.step <= last)
        return self.but(**columns, requests=requests)

    def but(self, **changes: object) -> "RunLog":
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
        # Where there is no cell or action, index -1 finds what was put at the end.
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
        labels = [label.replace("total", "reward") for label in REWARD.labels]
        columns |= {
            label: self.reward[..., place] for place, label in enumerate(labels)
        }
        return data_frame({name: values.ravel() for name, values in columns.items()})

    def history(self) -> History:
        """Return what happened in each learning episode, as far as the log goes.

        Of an episode that a gap cuts nobody knows how long it was: it is left out.
        """
        scenario = self.run.scenario
        goals = np.array([robot.goal for robot in scenario.robots])
        rewarded = ~np.isnan(self.reward[..., -1])
        made = rewarded.any(axis=1)
        made[:-1] &= (
            np.diff(self.step) == 1
        )  # else the state after it is not in the log
        made[-1:] = False
        for gap in self.tracks.gaps:
            end = gap.first if gap.last is None else gap.last
            cut = self.episode[(self.step >= gap.first - 1) & (self.step <= end + 1)]
            made &= ~np.isin(self.episode, cut)
        after = np.roll(self.cells, -1, axis=0)
        found, episode = np.unique(self.episode[made], return_inverse=True)
        first = np.searchsorted(self.episode, found)

        def total(values: np.ndarray) -> np.ndarray:
            sums = np.zeros((len(found), *values.shape[1:]), dtype=values.dtype)
            np.add.at(sums, episode, values[made])
            return sums

        return History(
            first_step=self.step[first],
            length=total(made.astype(np.int64)),
            reward=total(np.where(rewarded, self.reward[..., -1], 0.0)),
            miscoordinations=total(miscoordinations(scenario, after).astype(np.int64)),
            asks=total((self.asked & rewarded).astype(np.int64)),
            arrived=total((after == goals).astype(np.int64)) > 0,
            present=np.ones((len(found), len(self.names)), dtype=bool),
        )


def cell_numbers(frame: Frame, places: np.ndarray) -> np.ndarray:
    """Return in which cells positions lie.

    Args:
        frame: the run's frame.
        places: in metres, shape (..., 2).

    Returns:
        The cells, `NONE` where there is no free one, int32, shape (...).
    """
    pairs = np.ascontiguousarray(places).view(np.complex128)[..., 0]
    different, which = np.unique(pairs, return_inverse=True)
    found = [frame.cell(pair.real, pair.imag) for pair in different.tolist()]
    table = np.array([NONE if cell is None else cell for cell in found], dtype=np.int32)
    return table[which.reshape(pairs.shape)]


def read_run(path: Path) -> RunLog:
    """Read a run's log: a bag's directory, an `.mcap` or an `.mcap.partial`.

    Of an unfinished or damaged file, what can be read before the damage.

    Raises:
        BagError: nothing can be read, or the bag holds no run, or is of another format.
        RunError, ScenarioError, SettingError: the run in the bag is not one of this version.
    """
    return RunLog(read_tracks(Path(path)))
