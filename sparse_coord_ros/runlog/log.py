# Copyright 2026 The sparse_coord_ros authors
# SPDX-License-Identifier: Apache-2.0
"""A recorded run as NumPy arrays over time step and robot."""

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path

import numpy as np

from sparse_coord_ros.core.agent import NOBODY, Tables
from sparse_coord_ros.core.frame import Frame, action_from
from sparse_coord_ros.core.run_config import RunConfig
from sparse_coord_ros.core.wire import REWARD_LABELS
from sparse_coord_ros.errors import RunError
from sparse_coord_ros.recording.reader import Bag
from sparse_coord_ros.runlog.attached import RecordedTables
from sparse_coord_ros.runlog.dialogue import Request
from sparse_coord_ros.runlog.difference import Difference
from sparse_coord_ros.runlog.tracks import Tracks, read_tracks

NONE = -1
MARGIN = 5
"""Time steps at the end of an unfinished log in which single messages may be missing."""


@dataclass(frozen=True)
class RunLog:
    """What a bag tells of a run. T recorded time steps, K robots; -1, False or NaN where none.

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
        reward: individual, common, ask_cost, total: shape (T, K, 4), float64.
        tables: by (robot's number, time step); of two of a step the later.
        all_tables: all of them, in the order of the log.
        requests: the dialogue, in the order of time steps.
        tracks: the messages topic by topic, with whatever was odd about them.
    """

    bag: Bag
    run: RunConfig
    names: tuple[str, ...]
    step: np.ndarray
    episode: np.ndarray
    cells: np.ndarray
    position: np.ndarray
    action: np.ndarray
    move: np.ndarray
    peer: np.ndarray
    asked: np.ndarray
    perceived: np.ndarray
    percept: np.ndarray
    reward: np.ndarray
    all_tables: tuple[RecordedTables, ...]
    requests: tuple[Request, ...]
    tracks: Tracks

    @property
    def damage(self) -> str | None:
        """What is wrong with the file, or None; the log is what could be read before it."""
        return self.bag.damage

    @property
    def broken_off(self) -> bool:
        """Whether the recording ended before the run, or a part of it is lost."""
        return self.tracks.broken_off

    @property
    def last_step(self) -> int | None:
        """Up to which time step nothing is missing; None: to its end."""
        if not self.broken_off:
            return None
        tracks = self.tracks
        ends = [max(track.first, default=0) for track in (*tracks.states, tracks.clock)]
        return min(ends) - MARGIN

    @property
    def problems(self) -> tuple[Difference, ...]:
        """Messages and attachments that could not be read, or are out of order."""
        return tuple(self.tracks.problems)

    @cached_property
    def tables(self) -> Mapping[tuple[int, int], Tables]:
        """The recorded tables by (robot's number, time step)."""
        return {(entry.robot, entry.step): entry.tables for entry in self.all_tables}

    def frame(self):
        """Return a pandas DataFrame: one row for each time step and robot.

        Raises:
            RunError: pandas is not installed.
        """
        try:
            import pandas
        except ImportError as error:
            raise RunError(
                f"a data frame needs the Python package pandas ({error}): pip install pandas, or "
                "use the arrays"
            ) from None
        count, robots = self.cells.shape
        columns = {
            "step": np.repeat(self.step, robots),
            "episode": np.repeat(self.episode, robots),
            "robot": np.tile(np.array(self.names, dtype=object), count),
            "cell": self.cells.ravel(),
            "x": self.position[..., 0].ravel(),
            "y": self.position[..., 1].ravel(),
        }
        for name in ("action", "move", "peer", "asked", "perceived"):
            columns[name] = getattr(self, name).ravel()
        for place, name in enumerate(self.names):
            columns[f"percept_{name}"] = self.percept[..., place].ravel()
        for place, label in enumerate(REWARD_LABELS):
            columns["reward" if label == "total" else label] = self.reward[..., place].ravel()
        return pandas.DataFrame(columns)


def read_run(path: Path) -> RunLog:
    """Read a run's log: a bag's directory, an `.mcap` or an `.mcap.partial`.

    Of an unfinished or damaged file, what can be read before the damage.

    Raises:
        BagError: nothing can be read, or the bag holds no run.
        RunError, ScenarioError, SettingError: the run in the bag is not one of this version.
    """
    tracks = read_tracks(Path(path))
    run, names = tracks.run, tracks.names
    frame = Frame(run)
    robots = range(len(names))
    steps = sorted({t for k in robots for kind in tracks.of(k) for t in kind.first})
    row = {t: place for place, t in enumerate(steps)}
    shape = (len(steps), len(names))
    step = np.array(steps, dtype=np.int64)
    cells = np.full(shape, NONE, dtype=np.int32)
    position = np.full((*shape, 2), np.nan)
    action = np.full(shape, NONE, dtype=np.int8)
    move = np.full(shape, NONE, dtype=np.int8)
    peer = np.full(shape, NOBODY, dtype=np.int16)
    asked = np.zeros(shape, dtype=bool)
    perceived = np.zeros(shape, dtype=bool)
    percept = np.full((*shape, len(names)), NONE, dtype=np.int32)
    reward = np.full((*shape, len(REWARD_LABELS)), np.nan)
    for k in robots:
        for t, (x, y) in tracks.states[k].first.items():
            position[row[t], k] = x, y
            cell = frame.cell(x, y)
            cells[row[t], k] = NONE if cell is None else cell
        for t, parts in tracks.rewards[k].first.items():
            reward[row[t], k] = parts
        for t, numbers in tracks.actions[k].first.items():
            try:
                said = action_from(numbers)
            except ValueError as error:
                tracks.problem(t, k, "action", str(error), "an action")
                continue
            at = row[t], k
            action[at] = 4 if said.asked else said.move
            move[at], asked[at], perceived[at] = said.move, said.asked, said.perceived
            if NOBODY <= said.peer < len(names):
                peer[at] = said.peer
        for t, places in tracks.percepts[k].first.items():
            for seen, (x, y) in zip(_seen(k, peer[row[t], k], names), places[1:], strict=False):
                cell = frame.cell(x, y)
                percept[row[t], k, seen] = NONE if cell is None else cell
    return RunLog(
        bag=tracks.bag,
        run=run,
        names=names,
        step=step,
        episode=np.cumsum(np.diff(step, prepend=step[:1]) > 1),
        cells=cells,
        position=position,
        action=action,
        move=move,
        peer=peer,
        asked=asked,
        perceived=perceived,
        percept=percept,
        reward=reward,
        all_tables=tuple(tracks.tables),
        requests=tuple(tracks.requests),
        tracks=tracks,
    )


def _seen(k: int, peer: int, names: tuple[str, ...]) -> list[int]:
    """Return whom robot k perceives, in the order of its percept."""
    return [peer] if peer != NOBODY else [other for other in range(len(names)) if other != k]
