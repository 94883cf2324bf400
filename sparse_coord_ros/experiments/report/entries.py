# Copyright 2026 The sparse_coord_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Conditions with their results, how to pick some of them, and their CSV."""

import math
from collections.abc import Iterable, Mapping
from dataclasses import asdict, dataclass
from typing import Any

import numpy as np
import pandas as pd

from sparse_coord_ros.experiments.catalogue import Experiment
from sparse_coord_ros.experiments.conditions import Condition
from sparse_coord_ros.experiments.store import BY_ROBOT, SUMS, ConditionResult
from sparse_coord_ros.game.scenario import SETTINGS, Scenario, dense_nbytes
from sparse_coord_ros.game.specs import Spec
from sparse_coord_ros.learn.evaluation import Measure
from sparse_coord_ros.learn.learners import learner_of
from sparse_coord_ros.solve.shipped import shipped_best_team, shipped_class_bound

PAPER_SETTINGS = (("penalty", "-20"),)
"""Settings of the conditions that the paper's Tables 1 to 3 show."""

PAPER_TRIALS = 1000
"""Monte-Carlo trials behind each number of the paper (Section 4)."""

PAPER_MEASURES = ("reward", "time_to_goal", "miscoordinations")


@dataclass(frozen=True)
class Entry:
    """One condition and its result."""

    condition: Condition
    result: ConditionResult

    @property
    def name(self) -> str:
        """Name of the scenario."""
        return self.condition.name

    @property
    def scenario(self) -> Scenario:
        """The scenario with the condition's settings."""
        return self.condition.scenario

    @property
    def learner(self) -> str:
        """The learner's name in files."""
        return self.condition.learner

    @property
    def title(self) -> str:
        """The learner's name in print."""
        return learner_of(self.learner).title

    @property
    def can_ask(self) -> bool:
        """Whether the learner can choose COORDINATE."""
        return learner_of(self.learner).asks

    @property
    def shortest_paths(self) -> float:
        """Exact reward of shortest-path policies."""
        return self.result.reference["reward"]

    @property
    def dense_bytes(self) -> int:
        """Bytes of one robot's Q^C with a row for every joint state."""
        return dense_nbytes(len(self.scenario.map.cells), self.scenario.perceived)

    @property
    def class_bound(self) -> float | None:
        """What the best team of Algorithm 1's form is worth, as far as known; None if unknown."""
        bound = shipped_class_bound(self.scenario)
        return bound.value if bound else None

    @property
    def best_team(self) -> float | None:
        """What the best known team of more than two robots is worth; None if unknown."""
        team = shipped_best_team(self.scenario)
        return team.value if team else None

    def measure(self, name: str) -> Measure:
        """Return mean (exact where it is known), spread and standard error of a measure."""
        return self.result.best(name)

    def paper(self, measure: str) -> Measure | None:
        """Return what the paper prints for this condition; None where it prints nothing.

        The standard error is that of the paper's trials, the robots of one trial being taken
        as wholly dependent.
        """
        row = self.scenario.paper.get(self.learner, {})
        if self.condition.settings != PAPER_SETTINGS or measure not in row:
            return None
        mean, spread = row[measure]
        return Measure(mean, spread, spread / PAPER_TRIALS**0.5)


def entries_of(experiment: Experiment, found: Mapping[str, ConditionResult]) -> list[Entry]:
    """Return the conditions of an experiment with their results."""
    return [Entry(condition, found[condition.id]) for condition in experiment.conditions]


def pick(entries: Iterable[Entry], **wanted: object) -> list[Entry]:
    """Return the entries that have these values: `name`, `learner`, or a scenario's setting."""

    def value(entry: Entry, key: str) -> object:
        return getattr(entry if key in ("name", "learner") else entry.scenario, key)

    return [e for e in entries if all(value(e, key) == wanted[key] for key in wanted)]


def names(entries: Iterable[Entry]) -> list[str]:
    """Return the names of the scenarios, each once."""
    return list(dict.fromkeys(entry.name for entry in entries))


def by_scenario(entries: Iterable[Entry]) -> list[list[Entry]]:
    """Return the entries of each scenario."""
    entries = list(entries)
    return [pick(entries, name=name) for name in names(entries)]


def to_csv(entries: Iterable[Entry]) -> str:
    """Return a CSV file: one row a condition, one value a field, in full precision."""
    return pd.DataFrame([_row(entry) for entry in entries]).to_csv(
        index=False, lineterminator="\n"
    )


def _row(entry: Entry) -> dict[str, Any]:
    result, scenario = entry.result, entry.scenario
    factors = scenario.common_reward.numbers or (1.0,) * result.robots
    settings = {name: getattr(scenario, name) for name in SETTINGS}
    row: dict[str, Any] = {
        "id": result.id,
        "scenario": entry.name,
        "learner": entry.learner,
        "robots": result.robots,
        **{key: str(v) if isinstance(v, Spec) else v for key, v in settings.items()},
        "runs": result.runs,
        "trials": result.trials,
    }
    for name in SUMS:
        row |= {f"{name}_{key}": value for key, value in asdict(result.measure(name)).items()}
    for name in PAPER_MEASURES:
        paper = entry.paper(name)
        row[f"paper_{name}_mean"] = paper.mean if paper else None
        row[f"paper_{name}_spread"] = paper.spread if paper else None
    row |= {f"shortest_path_{name}": result.reference[name] for name in PAPER_MEASURES}
    for name in (
        *("optimum", "optimum_exact", "arrived", "failed_teams", "joint_states"),
        *("visited_share", "visited_bytes"),
    ):
        row[name] = getattr(result, name)
    row["dense_bytes"] = entry.dense_bytes
    by_robot = {name: result.robot_means[name] for name in BY_ROBOT}
    for name, values in {**by_robot, "common_reward_factor": factors}.items():
        row |= {f"{name}_robot_{k}": value for k, value in enumerate(values, start=1)}
    for name in (*SUMS, "arrived"):  # 0.1.0 had the columns above
        means = (result.exact or {}).get(name)
        row[f"exact_{name}_mean"] = float(np.mean(means)) if means else None
        row[f"exact_{name}_standard_error"] = _error(means) if means else None
    row["class_bound"] = entry.class_bound
    row["best_team"] = entry.best_team
    return row


def _error(means: list[float]) -> float:
    """Return the standard error of the mean of runs."""
    return float(np.std(means, ddof=1)) / math.sqrt(len(means)) if len(means) > 1 else math.nan
