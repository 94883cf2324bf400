# Copyright 2026 The sparse_coord_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The results of a condition: the measures of its runs, and what they are compared with."""

from collections.abc import Iterable
from dataclasses import dataclass
from functools import cached_property
from typing import Any, TypeAlias

import numpy as np

from sparse_coord_ros.core.engine.trained import Training
from sparse_coord_ros.core.game.actions import PRIMITIVES
from sparse_coord_ros.core.game.scenario import Scenario, dense_nbytes
from sparse_coord_ros.core.learners.learner import Learner
from sparse_coord_ros.core.learners.registry import learner_of
from sparse_coord_ros.core.runs.measures import Measures, by_run
from sparse_coord_ros.core.solve.shipped import known_optimum
from sparse_coord_ros.core.solve.shortest_paths import shortest_paths
from sparse_coord_ros.studies.conditions import Condition

ROW_BYTES = 8 + PRIMITIVES * 8
"""Bytes of a row of Q^C, or of rho: its key, and four float64."""


@dataclass(frozen=True)
class ConditionResult:
    """The results of the learning runs of one condition.

    Attributes:
        condition: the condition.
        seed: seed of run 0; run i has seed + i.
        measures: what each run's team earns: exact where that is quick, else in greedy trials.
        visited: joint states that a robot has updated in Q^C, mean over the robots, of each run.
        optimum: exact joint optimum of the scenario, or an upper bound.
        optimum_exact: whether it is exact.
    """

    condition: Condition
    seed: int
    measures: Measures
    visited: list[float]
    optimum: float
    optimum_exact: bool

    def __repr__(self) -> str:
        """Return a one-line description."""
        returns = self.measures.in_words("returns")
        return f"<ConditionResult {self.id}; {self.measures.how}; return {returns}>"

    @property
    def id(self) -> str:
        """The condition's id."""
        return self.condition.id

    @property
    def scenario(self) -> Scenario:
        """The scenario with the condition's settings."""
        return self.condition.scenario

    @property
    def learner(self) -> Learner:
        """The condition's learner."""
        return learner_of(self.condition.learner)

    @cached_property
    def shortest_paths(self) -> Measures:
        """The measures of fixed shortest paths, with no coordination."""
        return shortest_paths(self.scenario)

    @property
    def runs(self) -> int:
        """Number of learning runs."""
        return len(self.measures)

    @property
    def joint_states(self) -> int:
        """Rows that Q^C of one robot could have: joint states, or pairs of cells in factors."""
        return self.learner.rows_of_a_cell(self.scenario) * len(self.scenario.map.cells)

    @property
    def dense_bytes(self) -> int:
        """Bytes of one robot's Q^C with a row for every joint state."""
        return dense_nbytes(len(self.scenario.map.cells), self.scenario.perceived)

    @property
    def visited_share(self) -> float:
        """Share of the joint states that a robot's Q^C has updated."""
        return float(np.mean(self.visited)) / self.joint_states

    @property
    def visited_bytes(self) -> float:
        """Bytes of the visited rows of one robot's Q^C, with their keys."""
        return float(np.mean(self.visited)) * ROW_BYTES

    def to_dict(self) -> dict[str, Any]:
        """Return plain data, as `reproduce --json` prints it."""
        return {
            "id": self.id,
            **self.measures.to_dict(),
            "robots": self.measures.by_robot(),
            "failed_teams": self.measures.failed,
            "visited_share": self.visited_share,
            "visited_bytes": self.visited_bytes,
            "optimum": self.optimum,
            "optimum_exact": self.optimum_exact,
            "errors_above_optimum": self.measures.errors_above(self.optimum),
            "shortest_paths": self.shortest_paths.to_dict(),
        }


RunResult: TypeAlias = tuple[Measures, float]
"""`measures` and `visited` of one run: their size does not depend on its tables."""


def result_of_run(run: Training) -> RunResult:
    """Return what a condition's result keeps of a run that was evaluated."""
    assert run.measures is not None
    return by_run([run.measures]), float(run.visited.mean())


def collect(
    condition: Condition, seed: int, runs: Iterable[RunResult]
) -> ConditionResult:
    """Join a condition's runs (>= 1), in the order of their seeds from `seed` on."""
    measures, visited = zip(*runs, strict=True)
    optimum = known_optimum(condition.scenario)
    return ConditionResult(
        condition=condition,
        seed=seed,
        measures=by_run(measures),
        visited=list(visited),
        optimum=optimum.value,
        optimum_exact=optimum.exact,
    )
