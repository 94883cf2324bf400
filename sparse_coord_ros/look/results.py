# Copyright 2026 The sparse_coord_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Pictures of results: those of the report, and one of whatever conditions there are."""

from pathlib import Path

from matplotlib.figure import Figure

from sparse_coord_ros.errors import ResultsError, SettingError, did_you_mean
from sparse_coord_ros.experiments.catalogue import NAMES, experiment
from sparse_coord_ros.experiments.report.drawings import figures_of
from sparse_coord_ros.experiments.report.map_pictures import asked_maps
from sparse_coord_ros.experiments.store import ConditionResult, read_results

ASKS, VARIANCE = "asks", "_variance"


class ResultsShown:
    """A results directory to look at.

    Args:
        directory: where it is.

    Attributes:
        plan: seed, runs and trials of every condition.
        results: the result of every condition.
        experiments: the results of each experiment that is complete, by its name.

    Raises:
        ResultsError: it is no results directory, or holds no result yet, or a broken one.
    """

    def __init__(self, directory: Path) -> None:
        self.directory = directory
        self.plan, self.results = read_results(directory)
        if not self.results:
            raise ResultsError(
                f"{directory}: holds no result yet; 'sparse_coord reproduce' puts some there"
            )
        by_id = {one.id: one for one in self.results}
        self.experiments: dict[str, list[ConditionResult]] = {}
        for name in NAMES:
            ids = [condition.id for condition in experiment(name).conditions]
            if all(one in by_id for one in ids):
                self.experiments[name] = [by_id[one] for one in ids]

    @property
    def whats(self) -> list[str]:
        """What can be drawn."""
        found = ["conditions", ASKS] if self._asking else ["conditions"]
        extra = [f"figure4{VARIANCE}"] if "figure4" in self.experiments else []
        return [*found, *self.experiments, *extra]

    @property
    def _asking(self) -> list[ConditionResult]:
        """One condition a scenario in which somebody asks, for its map."""
        able = [one for one in self.results if one.learner.asks]
        asking = {one.scenario.name: one for one in able if one.best("asks").mean > 0}
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
        name = what.removesuffix(VARIANCE)
        return figures_of(name, self.experiments.get(name, self.results))[what]
