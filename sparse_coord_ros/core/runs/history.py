# Copyright 2026 The sparse_coord_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The learning history of a run: one row an episode, the same bits from every way of running.

`history.npz` in a run's directory holds the arrays of a `History` by their names.
"""

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from sparse_coord_ros.base import npz
from sparse_coord_ros.base.compiling import viewed
from sparse_coord_ros.base.dataframes import data_frame
from sparse_coord_ros.base.errors import RunError, retold
from sparse_coord_ros.base.files import read_file, write_whole
from sparse_coord_ros.core.game.rules import paid_for_ever, problem_of, rewards_of
from sparse_coord_ros.core.game.scenario import Scenario
from sparse_coord_ros.core.game.world import Action, StepOutcome

if TYPE_CHECKING:
    import pandas as pd

HISTORY_FILE = "history.npz"
CURVES = ("length", "returns", "miscoordinations", "asks", "arrived")
"""The measures of an episode that make a learning curve."""

FIRST_EPISODES = 64
"""Rows of a recorder at first; they double when they are used up."""


class History(NamedTuple):
    """The history of learning episodes; E episodes of K robots.

    An episode begins with its first transition: one that never had any is left out. The last one
    may have been cut off by the end of the budget. Robots that learn all at once share their
    episodes; of a learner that learns `alone` each robot has its own: first all episodes of robot
    1, then those of robot 2 and so on, as `present` says.

    Attributes:
        first_step: the time step at which the episode begins, shape (E,), int64.
        length: its transitions, shape (E,), int64.
        returns: total discounted reward of robot k, as in `evaluate`: with all that the goal pays
            from its arrival on, and with later miscoordinations; of a cut-off episode as far as it
            goes. Shape (E, K), float64; 0 where it was not present.
        miscoordinations: transitions that ended in a miscoordination, shape (E,), int64.
        asks: how often robot k chose COORDINATE, shape (E, K), int64.
        arrived: whether robot k reached its goal, shape (E, K), bool.
        present: whether robot k was in the world, shape (E, K), bool.
    """

    first_step: np.ndarray
    length: np.ndarray
    returns: np.ndarray
    miscoordinations: np.ndarray
    asks: np.ndarray
    arrived: np.ndarray
    present: np.ndarray

    def __repr__(self) -> str:
        """Return a one-line description."""
        return f"<History of {self.episodes} episodes of {self.robots} robots>"

    @property
    def episodes(self) -> int:
        """Number of episodes, E."""
        return len(self.length)

    @property
    def robots(self) -> int:
        """Number of robots, K."""
        return int(self.present.shape[1])

    @property
    def steps_before(self) -> np.ndarray:
        """The learning steps that were made before each episode, shape (E,), int64.

        A run has more time steps: those between two episodes.
        """
        made = np.cumsum(self.length) - self.length
        begins = np.flatnonzero(np.diff(self.first_step) < 0) + 1  # another robot's
        before = np.zeros(self.episodes, dtype=np.int64)
        before[begins] = np.diff(made[begins], prepend=0)
        steps: np.ndarray = made - np.cumsum(before)
        return steps

    def curve(
        self, name: str, window: int = 1, *, robot: int | None = None
    ) -> tuple[np.ndarray, np.ndarray]:
        """Return a learning curve, ready to be plotted: `plt.plot(*history.curve("length", 50))`.

        Args:
            name: length, returns, miscoordinations, asks or arrived (their share).
            window: episodes over which to average (all there are, where these are fewer).
            robot: only this robot (from 1) and the episodes it was present in; None: the mean of
                the robots present.

        Returns:
            The learning steps that were made before the last episode of each window, and the
            average over the window; both have shape (E - window + 1,).

        Raises:
            RunError: no such measure, robot or window.
        """
        if name not in CURVES:
            raise RunError(
                f"history: there is no measure {name!r}; allowed: {', '.join(CURVES)}"
            )
        if robot is not None and not 1 <= robot <= self.robots:
            raise RunError(
                f"history: there is no robot {robot}; allowed: 1 to {self.robots}"
            )
        if window < 1:
            raise RunError(f"history: window is {window}, allowed: at least 1")
        values = np.asarray(getattr(self, name), dtype=np.float64)
        if robot is None:
            if values.ndim == 2:
                values = (values * self.present).sum(axis=1) / self.present.sum(axis=1)
            # Robots that learned alone: side by side in time, not one after the other.
            order = np.argsort(self.first_step, kind="stable")
        else:
            order = np.flatnonzero(self.present[:, robot - 1])
            values = values[:, robot - 1] if values.ndim == 2 else values
        steps = self.steps_before[order]
        values = values[order]
        window = min(window, max(1, len(values)))
        sums = np.cumsum(np.concatenate([np.zeros(1), values]))
        return steps[window - 1 :], (sums[window:] - sums[:-window]) / window

    def to_pandas(self, names: Sequence[str] | None = None) -> "pd.DataFrame":
        """Return a pandas DataFrame: one row for each episode and each robot present.

        Columns: episode (from 0), steps_before (learning steps made before it), length, robot,
        returns, asks, arrived, miscoordinations.

        Args:
            names: the robots' names; None: their numbers from 1.

        Raises:
            RunError: pandas is not installed.
        """
        episode, robot = np.nonzero(self.present)
        labels = np.arange(1, self.robots + 1) if names is None else np.array(names)
        return data_frame(
            {
                "episode": episode,
                "steps_before": self.steps_before[episode],
                "length": self.length[episode],
                "robot": labels[robot],
                "returns": self.returns[episode, robot],
                "asks": self.asks[episode, robot],
                "arrived": self.arrived[episode, robot],
                "miscoordinations": self.miscoordinations[episode],
            }
        )

    def first(self, episodes: int) -> "History":
        """Return the first episodes: no copy."""
        return History(*(array[:episodes] for array in self))

    def copy(self) -> "History":
        """Return a copy."""
        return History(*(array.copy() for array in self))

    def save(self, directory: Path) -> None:
        """Write `history.npz`, whole or not at all."""
        write_whole(directory / HISTORY_FILE, npz.pack(self._asdict()))


def blank_history(episodes: int, robots: int) -> History:
    """Return a history of zeros, in which no robot is present."""
    whole = np.zeros((3, episodes), dtype=np.int64)
    flags = np.zeros((2, episodes, robots), dtype=np.bool_)
    sums = np.zeros((episodes, robots))
    return History(
        whole[0], whole[1], sums, whole[2], np.zeros_like(sums, np.int64), *flags
    )


def concatenated(histories: Sequence[History]) -> History:
    """Join histories of the same robots, one after the other."""
    return History(*map(np.concatenate, zip(*histories, strict=True)))


def load_history(directory: Path) -> History:
    """Read `history.npz` of a run's directory.

    Raises:
        RunError: the file is missing or cannot be read.
    """
    path = directory / HISTORY_FILE
    how: Any = {"error": RunError, "remedy": "use a file that run or train wrote"}
    data = read_file(path, **how)
    arrays = npz.unpack(data, where=str(path), what="a learning history", **how)
    with retold(RunError, ValueError, f"{path}", f"; {how['remedy']}"):
        return history_from(arrays)


def history_from(arrays: Mapping[str, np.ndarray], prefix: str = "") -> History:
    """Return the history whose arrays stand in a mapping under their names behind a prefix.

    Raises:
        ValueError: one is missing, or has another type or shape than it must have.
    """
    present = npz.member(arrays, f"{prefix}present", np.bool_, None, None)
    blank = blank_history(0, 0)._asdict().items()
    return History(
        *(
            npz.member(arrays, prefix + name, array.dtype, *present.shape[: array.ndim])
            for name, array in blank
        )
    )


PARTS = 50
"""Points of the mean learning curve of several runs."""


def mean_curves(histories: Sequence[History], steps: int) -> dict[str, np.ndarray]:
    """Return learning curves, averaged over runs, with their standard errors.

    Args:
        histories: of each run.
        steps: the learning steps of a run.

    Returns:
        `steps`, the learning steps at the end of each part, and for each of `CURVES` the mean
        of the episodes that end in the part, and `<name>_error`; NaN where none does.
    """
    ends = np.linspace(0, steps, PARTS + 1)[1:]
    curves: dict[str, np.ndarray] = {"steps": ends}
    for name in CURVES:
        by_run = np.array([_by_part(history, name, ends) for history in histories])
        known = ~np.isnan(by_run)
        count = known.sum(axis=0)
        with np.errstate(invalid="ignore", divide="ignore"):
            mean = np.where(known, by_run, 0.0).sum(axis=0) / count
            squares = np.where(known, (by_run - mean) ** 2, 0.0).sum(axis=0)
            error = np.sqrt(squares / (count - 1) / count)
        curves[name] = mean
        curves[f"{name}_error"] = error
    return curves


def _by_part(history: History, name: str, ends: np.ndarray) -> np.ndarray:
    """Return the mean of a measure over the episodes that end in each part of a run."""
    values = np.asarray(getattr(history, name), dtype=np.float64)
    if values.ndim == 2:
        values = (values * history.present).sum(axis=1) / history.present.sum(axis=1)
    done = history.steps_before + history.length
    whole = done < ends[-1]  # the budget's end cuts an episode off
    values = values[whole]
    part = np.searchsorted(ends, done[whole])
    sums = np.bincount(part, values, minlength=len(ends))
    counts = np.bincount(part, minlength=len(ends))
    with np.errstate(invalid="ignore"):
        return np.asarray(sums / counts)


class HistoryRecorder:
    """Gathers the history of a run that is fed to it transition by transition.

    Args:
        scenario: the problem, with K robots.
        history: rows to go on from; the first transition added goes into a new episode unless
            `under_way`.
        under_way: whether the last episode of `history` goes on.
    """

    def __init__(
        self,
        scenario: Scenario,
        *,
        history: History | None = None,
        under_way: bool = False,
    ) -> None:
        robots = len(scenario.robots)
        self._problem = viewed(problem_of(scenario, percepts=False))
        begun = blank_history(0, robots) if history is None else history
        self._rows = concatenated([begun, blank_history(FIRST_EPISODES, robots)])
        self._used = begun.episodes
        self._episode: int | None = None
        self._goes_on = under_way
        self._factor = 1.0  # gamma^n after n steps of the episode
        if under_way:
            for _ in range(int(begun.length[-1])):
                self._factor *= self._problem.discount

    def add(
        self,
        episode: int,
        step: int,
        actions: Sequence[Action | None],
        outcome: StepOutcome,
    ) -> None:
        """Take in one transition.

        Args:
            episode: number of the episode; another one than before begins a new row.
            step: the time step t at which the robots acted.
            actions: each robot's action; None if it did not act.
            outcome: the world's outcome.
        """
        if episode != self._episode:
            self._episode = episode
            if not self._goes_on:
                self._begin(step)
            self._goes_on = False
        rows = self._rows
        last = self._used - 1
        rows.length[last] += 1
        rows.miscoordinations[last] += outcome.miscoordination
        for k, action in enumerate(actions):
            asked = action is not None and action.asked
            rows.asks[last, k] += asked
            rows.returns[last, k] += self._factor * self._paid(k, asked, outcome)
        self._factor *= self._problem.discount
        for k in outcome.arrived:
            rows.arrived[last, k] = True

    def _paid(self, k: int, asked: bool, outcome: StepOutcome) -> float:
        """Return R_k(t) with all that the goal pays from the arrival on."""
        arrives = k in outcome.arrived
        _, common, asking = rewards_of(
            self._problem, k, outcome.miscoordination, arrives, asked
        )
        return paid_for_ever(self._problem, arrives, common, asking)

    def _begin(self, step: int) -> None:
        """Begin the next row."""
        self._factor = 1.0
        if self._used == self._rows.episodes:
            # Twice as many; they take memory as they are written to.
            more = blank_history(self._used, self._rows.robots)
            self._rows = concatenated([self._rows, more])
        self._rows.first_step[self._used] = step
        self._rows.present[self._used] = True
        self._used += 1

    @property
    def so_far(self) -> History:
        """The episodes so far, the one under way included: no copy, valid until the next `add`."""
        return self._rows.first(self._used)
