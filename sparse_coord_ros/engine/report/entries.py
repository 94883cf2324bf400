# Copyright 2026 The sparse_coord_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Cells with their results, and how to pick some of them."""

from collections.abc import Callable, Iterable, Iterator, Mapping
from dataclasses import dataclass

from sparse_coord_ros.core.evaluation import Measure
from sparse_coord_ros.core.scenario import Scenario
from sparse_coord_ros.engine.conditions import Condition
from sparse_coord_ros.engine.experiments import Experiment
from sparse_coord_ros.engine.results import ConditionResult

LEARNER_NAMES = {"indiv": "Indiv.", "noncoop": "Non-coop.", "coop": "Coop."}
"""The paper's names, in the order of its tables."""

PAPER_SETTINGS = (("penalty", "-20"),)
"""Settings of the cells that the paper's Tables 1 to 3 show."""

PAPER_TRIALS = 1000
"""Monte-Carlo trials behind each number of the paper (Section 4)."""


@dataclass(frozen=True)
class Entry:
    """One cell and its result."""

    cell: Condition
    result: ConditionResult

    @property
    def name(self) -> str:
        """Name of the scenario."""
        return self.cell.name

    @property
    def scenario(self) -> Scenario:
        """The scenario with the cell's settings."""
        return self.cell.scenario

    @property
    def learner(self) -> str:
        """The paper's name of the learner."""
        return LEARNER_NAMES[self.cell.learner]

    @property
    def label(self) -> str:
        """Scenario and learner."""
        return f"{self.name} {self.learner}"

    def measure(self, name: str) -> Measure:
        """Return mean, spread and standard error of a measure."""
        return self.result.measure(name)

    def paper(self, measure: str) -> Measure | None:
        """Return what the paper prints for this cell; None where it prints nothing.

        The standard error is that of the paper's trials, the robots of one trial being taken
        as wholly dependent.
        """
        if self.cell.settings != PAPER_SETTINGS:
            return None
        row = self.scenario.paper.get(self.cell.learner, {})
        if measure not in row:
            return None
        mean, spread = row[measure]
        return Measure(mean, spread, spread / PAPER_TRIALS**0.5)


class Entries:
    """Some cells of one experiment, in its order."""

    def __init__(self, entries: Iterable[Entry]) -> None:
        self._entries = tuple(entries)

    def __iter__(self) -> Iterator[Entry]:
        """Iterate over the entries."""
        return iter(self._entries)

    def __len__(self) -> int:
        """Return the number of entries."""
        return len(self._entries)

    def __getitem__(self, index: int) -> Entry:
        """Return one entry."""
        return self._entries[index]

    @property
    def names(self) -> list[str]:
        """Names of the scenarios, each once."""
        return list(dict.fromkeys(entry.name for entry in self))

    @property
    def learners(self) -> list[str]:
        """The learners, each once."""
        return list(dict.fromkeys(entry.cell.learner for entry in self))

    def pick(
        self,
        name: str | None = None,
        learner: str | None = None,
        test: Callable[[Entry], bool] = lambda entry: True,
    ) -> "Entries":
        """Return the entries of a scenario, of a learner, and that pass a test."""
        return Entries(
            entry
            for entry in self
            if name in (None, entry.name) and learner in (None, entry.cell.learner) and test(entry)
        )


def entries_of(experiment: Experiment, found: Mapping[str, ConditionResult]) -> Entries:
    """Return the cells of an experiment with their results."""
    return Entries(Entry(cell, found[cell.id]) for cell in experiment.conditions)
