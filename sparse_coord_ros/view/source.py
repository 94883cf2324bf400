# Copyright 2026 The sparse_coord_ros authors
# SPDX-License-Identifier: Apache-2.0
"""What is to be shown: a run's directory or a bag, opened into one object."""

from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path

from sparse_coord_ros.core.agent import Tables
from sparse_coord_ros.core.evaluation import Trials, check_tables, play
from sparse_coord_ros.core.history import HISTORY_FILE, History, load_history
from sparse_coord_ros.core.run_config import RUN_FILE, RunConfig, load_run
from sparse_coord_ros.core.tables import load_team
from sparse_coord_ros.engine.results import MANIFEST
from sparse_coord_ros.errors import RunError, SparseCoordError, TablesError
from sparse_coord_ros.recording.reader import BAG_DIRECTORY
from sparse_coord_ros.runlog.attached import RecordedTables
from sparse_coord_ros.runlog.log import RunLog, read_run

TRIALS = 200
"""Greedy episodes from which pictures show where robots go and ask."""

Say = Callable[[str], None]
"""Hears in a few words what takes a while."""


def silent(_: str) -> None:
    """Say nothing."""


@dataclass(frozen=True)
class Shown:
    """A run to look at; what is not there is read when it is first asked for, and says so then.

    Attributes:
        path: what was given.
        directory: the run's directory; None: a bag alone was given.
        bag: its bag; None: it has none.
        say: hears what takes a while.
    """

    path: Path
    directory: Path | None
    bag: Path | None
    say: Say = silent

    @property
    def name(self) -> str:
        """What to call it in a legend."""
        place = self.path.resolve()
        return place.parent.name if self.directory is None and place.name == "bag" else place.name

    @cached_property
    def config(self) -> RunConfig:
        """What the run is; errors as of `load_run` and `read_run`."""
        return self.log.run if self.directory is None else load_run(self.directory)

    @cached_property
    def log(self) -> RunLog:
        """The run's log.

        Raises:
            RunError: it was not recorded.
            BagError: the bag cannot be read, or is of another run than the directory.
        """
        if self.bag is None:
            raise RunError(
                f"{self.path}: has no bag; 'sparse_coord run' records one, 'train' does not"
            )
        self.say(f"reading {self.bag} ({_size(self.bag)})")
        return read_run(self.bag)

    @cached_property
    def tables(self) -> list[Tables]:
        """The newest tables of every robot.

        Raises:
            TablesError: some are missing, malformed or do not fit the scenario.
        """
        scenario = self.config.scenario
        if self.directory is not None:
            tables = load_team(self.directory, scenario)
        else:
            newest = {entry.robot: entry.tables for entry in _ascending(self.log)}
            missing = [n for k, n in enumerate(self.log.names) if k not in newest]
            if missing:
                raise TablesError(
                    f"{self.path}: holds no readable tables of {', '.join(missing)}; see "
                    "'sparse_coord info'"
                )
            tables = [newest[k] for k in range(len(self.log.names))]
        check_tables(scenario, tables, self.config.learner)
        return tables

    @cached_property
    def history(self) -> History:
        """What happened in each episode: from history.npz, else from the bag.

        Raises:
            RunError: there is neither.
        """
        if self.directory is not None:
            if (self.directory / HISTORY_FILE).exists() or self.bag is None:
                return load_history(self.directory)
        return self.log.history()

    @cached_property
    def trials(self) -> Trials:
        """Greedy episodes of what it has learned, always the same ones; errors as of `tables`."""
        scenario, tables = self.config.scenario, self.tables
        self.say(f"playing {TRIALS} greedy episodes")
        return play(scenario, tables, trials=TRIALS, seed=0, learner=self.config.rule)

    def has(self, what: str) -> bool:
        """Return whether `log`, `tables` or `history` can be read."""
        try:
            getattr(self, what)
        except SparseCoordError:
            return False
        return True


def _ascending(log: RunLog) -> list[RecordedTables]:
    return sorted(log.all_tables, key=lambda entry: entry.step)


def _size(bag: Path) -> str:
    files = [bag] if bag.is_file() else [path for path in bag.rglob("*") if path.is_file()]
    return f"{sum(path.stat().st_size for path in files) / 1e6:.1f} MB"


def is_results(path: Path) -> bool:
    """Return whether a directory holds results of `sparse_coord reproduce`."""
    return (path / MANIFEST).is_file()


def open_shown(path: Path, say: Say = silent) -> Shown:
    """Open a run's directory or a bag.

    Args:
        path: a run's directory; a bag's, or its file.
        say: hears what takes a while.

    Raises:
        RunError, BagError: it is neither; `info` says more of a bag.
    """
    if (path / RUN_FILE).is_file():
        bag = path / BAG_DIRECTORY
        return Shown(path, path, bag if bag.is_dir() else None, say)
    return Shown(path, None, path, say)
