# Copyright 2026 The sparse_coord_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The results of a condition: what is kept of each run, and the figures that follow from it."""

import math
from collections.abc import Iterable
from dataclasses import asdict, dataclass, fields
from typing import Any, NamedTuple

import numpy as np

from sparse_coord_ros.core.engine.trained import Training
from sparse_coord_ros.core.game.actions import PRIMITIVES
from sparse_coord_ros.core.game.interactions import interactions_of, only_together
from sparse_coord_ros.core.game.scenario import Scenario, dense_nbytes
from sparse_coord_ros.core.learners.factored import Factored
from sparse_coord_ros.core.learners.learner import Learner
from sparse_coord_ros.core.learners.registry import learner_of
from sparse_coord_ros.core.runs.evaluation import Measure, fails
from sparse_coord_ros.core.solve.reference import Reference, shortest_path_reference
from sparse_coord_ros.core.solve.shipped import known_optimum
from sparse_coord_ros.studies.conditions import Condition

CONFIDENCE = 0.95
"""The level of confidence intervals."""

SUMS = ("returns", "time_to_goal", "asks", "miscoordinations")
BY_ROBOT = ("returns", "asks")

KEY_BYTES = 8
"""Bytes of the key of a row."""

CORRECTION_BYTES = KEY_BYTES + PRIMITIVES * 8
"""Bytes of a row of rho: its key, and four float64."""


@dataclass(frozen=True)
class ConditionResult:
    """The results of the runs of one condition; lists have one entry for each run.

    Attributes:
        condition: the condition.
        trials: trials of each run.
        optimum: exact joint optimum of the scenario, or an upper bound.
        optimum_exact: whether it is exact.
        reference: value of fixed shortest-path policies: returns, time_to_goal and
            miscoordinations. Where robots swap or block also the other attributes
            of `Reference`.
        means: mean of each measure of `SUMS` over trials (and robots).
        variances: variance of each measure over trials (and robots).
        robot_means: mean of each measure of `BY_ROBOT` over runs and trials, one a robot.
        not_arrived: trials in which some robot did not arrive.
        visited: joint states that a robot has updated in Q^C, mean over the robots.
        asked: how often COORDINATE was chosen in each cell, mean of a trial, shape
            (robots, cells).
        stays: steps in which the robot acted in each cell, likewise.
        exact: exact mean of each measure of `SUMS` over trials (and robots), and the probability
            `arrived` that all robots arrive; None where a team has no exact evaluation.
    """

    condition: Condition
    trials: int
    optimum: float
    optimum_exact: bool
    reference: dict[str, float]
    means: dict[str, list[float]]
    variances: dict[str, list[float]]
    robot_means: dict[str, list[float]]
    not_arrived: list[int]
    visited: list[float]
    asked: list[list[float]]
    stays: list[list[float]]
    exact: dict[str, list[float]] | None = None

    def __repr__(self) -> str:
        """Return a one-line description."""
        returns = self.measure("returns")
        worth = f"return {returns.mean:.2f} ({returns.standard_error:.2f})"
        return f"<ConditionResult {self.id}; {self.runs} runs, {self.trials} trials each; {worth}>"

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

    @property
    def runs(self) -> int:
        """Number of learning runs."""
        return len(self.not_arrived)

    def measure(self, name: str) -> Measure:
        """Return mean, spread over single robots, trials and runs, and standard error.

        The runs are the independent samples: the standard error is that of their means.
        """
        means = np.array(self.means[name])
        variances = np.array(self.variances[name])
        spread = math.sqrt(variances.mean() + means.var())
        return Measure(float(means.mean()), spread, standard_error(means))

    def best(self, name: str) -> Measure:
        """Return a measure with its exact mean where there is one, else that of the trials.

        The spread is that of the trials; the standard error says how much the runs differ.
        """
        means = self.run_means(name)
        spread = self.measure(name).spread
        return Measure(float(means.mean()), spread, standard_error(means))

    def run_means(self, name: str) -> np.ndarray:
        """Return a measure's mean in each run, shape (runs,); exact where it is known.

        Run i has the same seed in every condition: quantities from several conditions are computed
        run by run, and their error is that of the results.
        """
        return np.array((self.means if self.exact is None else self.exact)[name])

    @property
    def arrived(self) -> float:
        """Share of trials in which every robot arrived."""
        return 1.0 - sum(self.not_arrived) / (self.runs * self.trials)

    @property
    def arrived_in_trials(self) -> list[float]:
        """Share of its trials in which every robot of a run's team arrived, for each run."""
        return [(self.trials - missed) / self.trials for missed in self.not_arrived]

    @property
    def failed_teams(self) -> int:
        """Runs whose team fails in its trials."""
        return sum(fails(share) for share in self.arrived_in_trials)

    @property
    def joint_states(self) -> int:
        """Rows that Q^C of one robot could have: joint states, or pairs of cells in factors."""
        return self.learner.rows_of_a_cell(self.scenario) * len(self.scenario.map.cells)

    @property
    def row_bytes(self) -> int:
        """Bytes of one such row: four float64, and its key where it has one."""
        if isinstance(self.learner, Factored):
            return CORRECTION_BYTES
        perceived = self.scenario.perceived
        return dense_nbytes(1, perceived) + self.scenario.sparse * KEY_BYTES

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
        """Bytes of the visited rows of one robot's Q^C, with their keys where it is sparse."""
        return float(np.mean(self.visited)) * self.row_bytes

    def to_dict(self) -> dict[str, Any]:
        """Return plain data, as `reproduce --json` prints it."""
        measures = {name: asdict(self.measure(name)) for name in SUMS}
        if self.exact is not None:
            measures["exact"] = {
                name: float(np.mean(self.exact[name])) for name in self.exact
            }
        return {
            "id": self.id,
            "runs": self.runs,
            "trials": self.trials,
            **measures,
            "robot_means": self.robot_means,
            "arrived": self.arrived,
            "failed_teams": self.failed_teams,
            "visited_share": self.visited_share,
            "visited_bytes": self.visited_bytes,
            "optimum": self.optimum,
            "optimum_exact": self.optimum_exact,
            "reference": self.reference,
        }


def standard_error(values: np.ndarray) -> float:
    """Return the standard error of the mean of independent values; NaN of a single one."""
    if len(values) < 2:
        return math.nan
    return float(values.std(ddof=1) / math.sqrt(len(values)))


class Sample(NamedTuple):
    """The part of one run that a condition's result keeps; its size does not depend on the tables.

    Attributes:
        means, variances: of each measure of `SUMS`.
        by_robot: mean of each measure of `BY_ROBOT`, shape (robots,).
        not_arrived: trials in which some robot did not arrive.
        visited: as of `ConditionResult`.
        exact: mean of each exact measure; empty without an exact evaluation.
        asked, stays: how often, over all trials, shape (robots, cells).
    """

    means: dict[str, float]
    variances: dict[str, float]
    by_robot: dict[str, np.ndarray]
    not_arrived: int
    visited: float
    exact: dict[str, float]
    asked: np.ndarray
    stays: np.ndarray


def sample(run: Training) -> Sample:
    """Return the sample of a run with trials."""
    trials = run.trials
    assert trials is not None  # conditions are computed with trials
    exact = {} if run.exact is None else run.exact._asdict()
    return Sample(
        means={name: float(getattr(trials, name).mean()) for name in SUMS},
        variances={name: float(getattr(trials, name).var()) for name in SUMS},
        by_robot={name: getattr(trials, name).mean(axis=0) for name in BY_ROBOT},
        not_arrived=int((~trials.arrived.all(axis=1)).sum()),
        visited=float(run.visited.mean()),
        exact={name: float(np.mean(value)) for name, value in exact.items()},
        asked=trials.asked,
        stays=trials.stays,
    )


def collect(
    condition: Condition, trials: int, samples: Iterable[Sample]
) -> ConditionResult:
    """Summarise a condition's runs (>= 1), in the order of their seeds."""
    found = list(samples)
    optimum = known_optimum(condition.scenario)
    episodes = len(found) * trials

    def of_runs(field: str) -> dict[str, list[float]]:
        each = [getattr(one, field) for one in found]
        return {name: [own[name] for own in each] for name in each[0]}

    return ConditionResult(
        condition=condition,
        trials=trials,
        optimum=optimum.value,
        optimum_exact=optimum.exact,
        reference=reference_of(condition.scenario),
        means=of_runs("means"),
        variances=of_runs("variances"),
        robot_means={
            name: np.mean([one.by_robot[name] for one in found], axis=0).tolist()
            for name in BY_ROBOT
        },
        not_arrived=[one.not_arrived for one in found],
        visited=[one.visited for one in found],
        asked=(np.sum([one.asked for one in found], axis=0) / episodes).tolist(),
        stays=(np.sum([one.stays for one in found], axis=0) / episodes).tolist(),
        exact=of_runs("exact") or None,
    )


def reference_names(scenario: Scenario) -> tuple[str, ...]:
    """Return the attributes of `Reference` that a result has; where it is always exact, three."""
    if only_together(interactions_of(scenario)):
        return "returns", "time_to_goal", "miscoordinations"
    return tuple(field.name for field in fields(Reference))


def reference_of(scenario: Scenario) -> dict[str, float]:
    """Return the fields of a result for the value of fixed shortest paths."""
    found = asdict(shortest_path_reference(scenario))
    return {name: float(found[name]) for name in reference_names(scenario)}
