# Copyright 2026 The sparse_coord_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Pictures of results: those of the report, and one of whatever conditions there are."""

from collections.abc import Sequence
from pathlib import Path

from matplotlib.figure import Figure

from sparse_coord_ros.errors import ResultsError, SettingError, did_you_mean
from sparse_coord_ros.experiments.catalogue import NAMES, experiment
from sparse_coord_ros.experiments.report import sweeps
from sparse_coord_ros.experiments.report.document import SECTIONS
from sparse_coord_ros.experiments.report.entries import Entry
from sparse_coord_ros.experiments.report.map_pictures import asked_maps
from sparse_coord_ros.experiments.store import Plan, read_results

CONDITIONS, ASKS = "conditions", "asks"
VARIANCE = "_variance"


class ResultsShown:
    """A results directory to look at.

    Args:
        directory: where it is.

    Attributes:
        plan: seed, runs and trials of every condition.
        entries: every condition with its result.
        experiments: the entries of each experiment that is complete, by its name.

    Raises:
        ResultsError: it is no results directory, or holds no result yet, or a broken one.
    """

    def __init__(self, directory: Path) -> None:
        self.directory = directory
        self.plan: Plan
        self.plan, found = read_results(directory)
        if not found:
            raise ResultsError(
                f"{directory}: holds no result yet; 'sparse_coord reproduce' puts some there"
            )
        self.entries = [Entry(condition, result) for condition, result in found]
        by_id = {entry.condition.id: entry for entry in self.entries}
        self.experiments: dict[str, list[Entry]] = {}
        for name in NAMES:
            ids = [condition.id for condition in experiment(name).conditions]
            if all(one in by_id for one in ids):
                self.experiments[name] = [by_id[one] for one in ids]

    @property
    def whats(self) -> list[str]:
        """What can be drawn."""
        found = [CONDITIONS]
        found += [ASKS] if self._asking else []
        for name in self.experiments:
            found += [name, f"{name}{VARIANCE}"] if name == "figure4" else [name]
        return found

    @property
    def _asking(self) -> list[Entry]:
        """One condition a scenario in which somebody asks, for its map."""
        asking = {e.name: e for e in self.entries if e.can_ask and e.measure("asks").mean > 0}
        return list(asking.values())

    def figure(self, what: str) -> Figure:
        """Draw something of `whats`.

        Raises:
            SettingError: it is not there.
        """
        if what not in self.whats:
            raise SettingError(
                f"--what {what!r}: these results have {', '.join(self.whats)}"
                f"{did_you_mean(what, self.whats)}"
            )
        if what == ASKS:
            return asked_maps(self._asking)
        name, figure = what.removesuffix(VARIANCE), int(what.endswith(VARIANCE))
        entries: Sequence[Entry] = self.experiments.get(name, self.entries)
        return SECTIONS.get(name, sweeps.default_section)(entries).figures[figure]
