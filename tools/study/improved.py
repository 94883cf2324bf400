# Copyright 2026 The sparse_coord_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The study of teams that plan on their learned models: `core.engine.improve`."""

import json
import sys
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from sparse_coord_ros.base.files import write_whole
from sparse_coord_ros.base.percents import percent
from sparse_coord_ros.core.engine.batch import prepare
from sparse_coord_ros.core.engine.improve import improve
from sparse_coord_ros.core.learners.registry import learner_of
from sparse_coord_ros.core.runs.run import LearningRun
from sparse_coord_ros.core.runs.team import Team
from sparse_coord_ros.core.solve.exact import exact_means
from sparse_coord_ros.core.solve.reference import shortest_path_reference
from sparse_coord_ros.core.solve.shipped import known_best
from sparse_coord_ros.studies.catalogue import PAYING_PAIRS, unseen_conditions
from sparse_coord_ros.studies.condition_result import ConditionResult
from sparse_coord_ros.studies.conditions import Condition, make_condition
from sparse_coord_ros.studies.report.text import Row

SEED = 1_400_000
"""Seed of the first team: no search has seen these."""

TRIALS = 2000
"""Fresh trials of a team of more than two robots."""

LONG = 100_000
SHORT = 10_000
PAIRS = ((*PAYING_PAIRS, SHORT, 200), ("env2-2r", "cmu", LONG, 200))
BUILDINGS = ((2, SHORT, 10), (2, LONG, 10), (4, LONG, 9))
MANY = ("env2-4r", "crowd-6r", "crowd-8r", LONG, 100)


class ImprovedTeam(NamedTuple):
    """One team: its value as learned and as improved, and seconds."""

    learned: float
    improved: float
    seconds: float


def table(
    planners: Mapping[str, float],
    found: Callable[[Condition], ConditionResult],
    kept: Path,
) -> Iterator[Row]:
    """Yield the rows.

    Args:
        planners: values of the planner with routes in the scenarios of more robots.
        found: returns the result of a condition.
        kept: folder of the teams.
    """
    for *names, steps, count in (*PAIRS, MANY):
        given = {"penalty": -100, "steps": steps}
        for name in names:
            own, base = (
                make_condition(name, one, given) for one in ("factored", "noncoop")
            )
            low = found(base).best("returns").mean
            bound = known_best(own.scenario)
            yield _row(name, [(own, low, bound or planners[name])], count, kept)
    for robots, steps, count in BUILDINGS:
        made = unseen_conditions("factored", "tuning", {"steps": steps}, [robots])
        judged = [
            (
                one,
                shortest_path_reference(one.scenario).returns,
                known_best(one.scenario),
            )
            for one in made
        ]
        yield _row(f"{len(made)} unseen buildings, {robots}r", judged, count, kept)


def _row(
    what: str,
    judged: Sequence[tuple[Condition, float, float | None]],
    count: int,
    kept: Path,
) -> Row:
    """Return a row: mean and standard error over the teams, each building alike."""
    teams = [teams_of(one, count, kept) for one, _, _ in judged]
    steps = judged[0][0].scenario.steps
    low, bound = (float(np.mean([one[place] for one in judged])) for place in (1, 2))
    values = np.array([[(one.learned, one.improved) for one in own] for own in teams])
    means = values.mean(axis=(0, 1))
    errors = np.sqrt((values.var(axis=1, ddof=1) / count).sum(axis=0)) / len(teams)
    shares = [percent((mean - low) / (bound - low)) for mean in means]
    every = [one for own in teams for one in own]
    return {
        "teams": f"{what}, 10^{len(str(steps)) - 1} steps",
        "n": str(len(every)),
        "learned": f"{means[0]:.2f} ({errors[0]:.2f})",
        "**then improved**": f"{means[1]:.2f} ({errors[1]:.2f})",
        "worst team": f"{values[..., 1].min():.2f}" if len(teams) == 1 else "-",
        "best known": f"{bound:.2f}",
        "of the gap, learned": shares[0],
        "improved": shares[1],
        "seconds": f"{np.mean([one.seconds for one in every]):.2f}",
    }


def teams_of(condition: Condition, count: int, kept: Path) -> list[ImprovedTeam]:
    """Let teams learn and improve, and judge them in the true game; keep each."""
    scenario = condition.scenario
    learner = learner_of(condition.learner)
    file = kept / f"{condition.id.replace('/', '-')}.json"
    found = (
        [ImprovedTeam(*one) for one in json.loads(file.read_text())]
        if file.exists()
        else []
    )
    kept.mkdir(parents=True, exist_ok=True)
    prepare(learner)
    compiled = Team(scenario, learner, compiled=True)
    for seed in range(SEED + len(found), SEED + count):
        print(
            f"\r{condition.id} {seed - SEED}", end="\x1b[K", file=sys.stderr, flush=True
        )
        learning = LearningRun(compiled, seed, gathering=False)
        learning.advance(scenario.steps)
        since = time.process_time()
        plan = improve(scenario, learner, learning.memories)
        seconds = time.process_time() - since
        worth = []
        for tables in (learning.tables, plan.tables):
            means: Any = exact_means(scenario, tables)
            if means is None:
                minds = compiled.initial([table.memory for table in tables])
                means = compiled.play(minds, seed, TRIALS)
            worth.append(float(means.returns.mean()))
        found.append(ImprovedTeam(worth[0], worth[1], seconds))
        write_whole(file, json.dumps(found))
    return found[:count]
