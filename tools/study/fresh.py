# Copyright 2026 The sparse_coord_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The study of fresh buildings: results of a learner's teams in buildings without a search.

The buildings are those with a real conflict from seed `FIRST` on, as many of each kind. What is
known of them (the best asking team found, or the route planner's) is kept in the study's folder.
"""

import json
from collections.abc import Callable, Iterator, Mapping
from functools import partial
from itertools import count, islice
from pathlib import Path

from sparse_coord_ros.base.files import write_whole
from sparse_coord_ros.base.percents import percent
from sparse_coord_ros.core.game.scenario import Scenario, load_scenario
from sparse_coord_ros.core.game.unseen import KINDS, VERSIONS
from sparse_coord_ros.core.solve.asking_search import find_asking_team
from sparse_coord_ros.core.solve.optimum import joint_optimum
from sparse_coord_ros.core.solve.reference import shortest_path_reference
from sparse_coord_ros.core.solve.routes import route_plan
from sparse_coord_ros.studies.catalogue import LONG
from sparse_coord_ros.studies.condition_result import ConditionResult
from sparse_coord_ros.studies.conditions import Condition, make_condition
from sparse_coord_ros.studies.report.text import Row
from sparse_coord_ros.studies.standings import standing

FIRST = 800_000
"""Seed of the first building that is looked at."""

EACH = {2: 6, 4: 4, 8: 2}
"""Buildings of each kind, by robots."""

BUDGETS = {2: (10_000, 100_000), 4: (100_000,), 8: (100_000,)}
"""Step budgets, by robots."""

RESTARTS = 20
"""Of the search for an asking team."""

CONFLICT = 1.0
"""By how much the best known team of a chosen building earns more than shortest paths."""


def table(found: Callable[[Condition], ConditionResult], kept: Path) -> Iterator[Row]:
    """Yield how teams of `factored` stand.

    Args:
        found: returns the result of a condition.
        kept: folder in which the known best teams are kept.
    """
    for robots, budgets in BUDGETS.items():
        best = _chosen(robots, kept)
        for steps in budgets:
            settings = {**LONG, "steps": steps}
            results = [
                found(make_condition(name, "factored", settings)) for name in best
            ]
            stood = standing(results, partial(_value_in, best))
            yield {
                "robots": f"{robots}",
                "steps": f"{steps:,}",
                "buildings": f"{stood.buildings}",
                "shortest paths": f"{stood.paths:.2f}",
                "best known": f"{stood.best_known:.2f}",
                "share of the gap": stood.share_and_failed(),
                "worst building": percent(stood.worst),
            }


def _value_in(best: Mapping[str, float], scenario: Scenario) -> float:
    return best[scenario.name]


def _chosen(robots: int, kept: Path) -> dict[str, float]:
    """Return the value of the best known team of each chosen building."""
    file = kept / f"{robots}.json"
    if file.exists():
        known: dict[str, float] = json.loads(file.read_text("utf-8"))
        return known
    known = {}
    for kind in KINDS:
        for name, value in islice(_with_conflict(kind, robots), EACH[robots]):
            print(f"{name}: {value:.2f}", flush=True)
            known[name] = value
    kept.mkdir(parents=True, exist_ok=True)
    write_whole(file, json.dumps(known, indent=1) + "\n")
    return known


def _with_conflict(kind: str, robots: int) -> Iterator[tuple[str, float]]:
    """Yield the buildings of a kind that have a conflict, with the best known team's value."""
    for seed in count(FIRST):
        scenario = load_scenario(
            f"{VERSIONS[0]}-{kind}-{robots}r-{seed}"
        ).with_settings(LONG)
        low = shortest_path_reference(scenario).returns + CONFLICT
        if robots == 2 and joint_optimum(scenario).value <= low:
            continue
        value = _best(scenario)
        if value > low:
            yield scenario.name, value


def _best(scenario: Scenario) -> float:
    if len(scenario.robots) == 2:
        return find_asking_team(scenario, restarts=RESTARTS).value
    return route_plan(scenario).value
