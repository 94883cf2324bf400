# Copyright 2026 The sparse_coord_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Sources to show: a run's directory or a bag, opened into one object."""

from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path

import numpy as np

from sparse_coord_ros.base.errors import (
    RunError,
    SettingError,
    SparseCoordError,
    TablesError,
)
from sparse_coord_ros.core.game.actions import COORDINATE
from sparse_coord_ros.core.learners.tables import Tables
from sparse_coord_ros.core.runs.evaluation import check_tables
from sparse_coord_ros.core.runs.history import HISTORY_FILE, History, load_history
from sparse_coord_ros.core.runs.run_config import (
    RUN_FILE,
    RunConfig,
    load_run,
    refuse_scenario,
)
from sparse_coord_ros.core.runs.saved_tables import load_team
from sparse_coord_ros.log.bags.reader import BAG_DIRECTORY, Bag, bag_files
from sparse_coord_ros.log.runlog.log import RunLog
from sparse_coord_ros.log.runlog.reading import find_run, read_run

RESULTS_FILE = "results.json"
"""What a directory of `sparse_coord reproduce` has."""

Say = Callable[[str], None]
"""Receives a short text on each slow step."""


@dataclass(frozen=True)
class OpenedRun:
    """A run to show. Its parts are read at their first use; missing parts raise errors then.

    Attributes:
        path: the given path.
        directory: the run's directory; None: only a bag was given.
        bag: its bag; None: it has none.
        say: receives notes on slow steps.
        read: reads its log.
    """

    path: Path
    directory: Path | None
    bag: Path | None
    say: Say = lambda _: None
    read: Callable[[Path], RunLog] = read_run

    @property
    def name(self) -> str:
        """Its name in a legend."""
        path = self.path.resolve()
        if self.directory is None and path.name == BAG_DIRECTORY:
            return path.parent.name
        return path.name

    @cached_property
    def config(self) -> RunConfig:
        """The run's configuration; errors as in `load_run` and `read_run`."""
        if self.directory is not None:
            return load_run(self.directory)
        return find_run(Bag(bag_files(self.path))).run

    @cached_property
    def log(self) -> RunLog:
        """The run's log.

        Raises:
            RunError: the run was not recorded.
            BagError: the bag cannot be read.
        """
        if self.bag is None:
            remedy = "'sparse_coord run' records one, 'train' does not"
            raise RunError(f"{self.path}: has no bag; {remedy}")
        self.say(f"reading {self.bag}")
        log = self.read(self.bag)
        if log.damage is not None:
            self.say(log.damage)
        return log

    @cached_property
    def tables(self) -> list[Tables]:
        """The newest tables of every robot.

        Raises:
            TablesError: some are missing, malformed or do not fit the scenario.
        """
        scenario = self.config.scenario
        if self.directory is not None:
            return load_team(self.directory, scenario, self.config.known_rule)
        entries = []
        for k, robot in enumerate(scenario.robots):
            entry = self.log.tables_before(k)
            if entry is None:
                problem = f"holds no tables of {robot.name}; see 'sparse_coord info'"
                raise TablesError(f"{self.path}: {problem}")
            entries.append(entry)
        tables = [entry.tables for entry in entries]
        self._say_how_old(min(entry.step for entry in entries))
        if self.config.known_rule is not None:
            check_tables(scenario, tables, self.config.rule)
        return tables

    def _say_how_old(self, step: int) -> None:
        """Say it if a bag's newest tables are from before its end: of this time step."""
        log = self.log
        made = log.made_before(step)
        ends = log.made_before(int(log.step.max(initial=0)))
        if made < ends:
            self.say(
                f"its newest tables are of step {made} of {ends}: the policy is the one of then; "
                "tables are recorded at checkpoints and at the end"
            )

    @cached_property
    def history(self) -> History:
        """The history of episodes: from history.npz, else from the bag.

        Raises:
            RunError: both are missing.
        """
        directory = self.directory
        if directory is None or (
            self.bag is not None and not (directory / HISTORY_FILE).exists()
        ):
            return self.log.history()
        return load_history(directory)

    @property
    def asks(self) -> bool:
        """True if its robots can ask; errors as in `tables`."""
        return not np.isnan(self.tables[0].q_star[:, COORDINATE]).any()

    def has(self, what: str) -> bool:
        """Return whether `log`, `tables` or `history` can be read; if not, report the reason."""
        try:
            getattr(self, what)
        except SparseCoordError as error:
            self.say(f"left out {what}: {error}")
            return False
        return True


def in_memory(config: RunConfig, tables: list[Tables], history: History) -> OpenedRun:
    """Return a run that is not on disk."""
    shown = OpenedRun(Path(config.scenario.name), None, None)
    vars(shown).update(config=config, tables=tables, history=history)
    return shown


def is_results(path: Path) -> bool:
    """Return whether a directory contains results of `sparse_coord reproduce`."""
    return (path / RESULTS_FILE).is_file()


def open_run(
    path: Path,
    say: Say = lambda _: None,
    read: Callable[[Path], RunLog] = read_run,
) -> OpenedRun:
    """Open a run's directory or a bag.

    Args:
        path: a run's directory; a bag's, or its file.
        say: receives notes on slow steps.
        read: reads its log.

    Raises:
        RunError, BagError: the path is neither; `info` reports more on a bag.
        SettingError: the path is a directory of results.
    """
    if is_results(path):
        raise SettingError(
            f"{path} holds results, not a run: 'plot' draws them alone; give a run's directory or "
            "a bag"
        )
    if (path / RUN_FILE).is_file():
        bag = path / BAG_DIRECTORY
        return OpenedRun(path, path, bag if bag.is_dir() else None, say, read)
    refuse_scenario(path)
    return OpenedRun(path, None, path, say, read)
