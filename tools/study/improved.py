# Copyright 2026 The sparse_coord_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The study of what teams make of what they have learned: `engine.improve`."""

import sys
import time
from collections.abc import Callable, Mapping, Sequence
from typing import NamedTuple

import numpy as np

from sparse_coord_ros.engine.batch import CompiledTeam, prepare
from sparse_coord_ros.engine.improve import improve
from sparse_coord_ros.experiments.catalogue import CLOSE, unseen_conditions
from sparse_coord_ros.experiments.conditions import Condition, make_condition
from sparse_coord_ros.experiments.report.text import Row, percent, to_markdown
from sparse_coord_ros.experiments.store import ConditionResult
from sparse_coord_ros.learn.agent import Memory, Tables
from sparse_coord_ros.learn.learners import learner_of
from sparse_coord_ros.solve.exact import exact_means
from sparse_coord_ros.solve.reference import shortest_path_reference
from sparse_coord_ros.solve.shipped import known_best

SEED = 1_400_000
"""Seed of the first team: no search has seen these."""

TRIALS = 2000
"""Fresh trials of a team of more than two robots."""

LONG, SHORT = 100_000, 10_000
PAIRS = ((*CLOSE, SHORT, 200), (*CLOSE, LONG, 200), ("cmu", "isr", "cit", LONG, 200))
BUILDINGS = ((2, SHORT, 10), (2, LONG, 10), (4, LONG, 2))
MANY = (("env2-4r", 20), ("crowd-6r", 20), ("crowd-8r", 20))


class Team(NamedTuple):
    """One team: what it is worth learned and improved; doorways that nobody felt; seconds."""

    learned: float
    improved: float
    unfelt: int
    seconds: float


def table(found: Callable[[Condition], ConditionResult], planners: Mapping[str, float]) -> str:
    """Return the table.

    Args:
        found: returns the result of a condition.
        planners: what the planner with routes reaches in the scenarios of more robots.
    """
    rows: list[Row] = []
    for *names, steps, count in PAIRS:
        for name in names:
            own, base = (
                make_condition(name, learner, {"penalty": -100, "steps": steps})
                for learner in ("factored", "noncoop")
            )
            low = found(base).best("reward").mean
            rows.append(_row(name, steps, [(own, low, known_best(own.scenario))], count))
    rows += [_buildings(*which) for which in BUILDINGS]
    for name, count in MANY:
        settings = {"penalty": -100, "steps": LONG}
        own, base = (make_condition(name, one, settings) for one in ("factored", "noncoop"))
        low = found(base).best("reward").mean
        rows.append(_row(name, LONG, [(own, low, planners[name])], count))
    return to_markdown(rows)


def _buildings(robots: int, steps: int, count: int) -> Row:
    """Return the row of a size of teams in the buildings for tuning."""
    made = unseen_conditions("factored", "tuning", {"steps": steps}, [robots])
    judged = [
        (one, shortest_path_reference(one.scenario).reward, known_best(one.scenario))
        for one in made
    ]
    return _row(f"{len(made)} unseen buildings, {robots}r", steps, judged, count)


def _row(
    what: str, steps: int, judged: Sequence[tuple[Condition, float, float | None]], count: int
) -> Row:
    """Return a row: mean and standard error over the teams, each building alike."""
    teams = []
    for condition, _, _ in judged:
        print(f"\r{condition.id}", end="\x1b[K", file=sys.stderr, flush=True)
        teams.append(_teams(condition, count))
    low, bound = (float(np.mean([one[place] for one in judged])) for place in (1, 2))
    values = np.array([[(one.learned, one.improved) for one in own] for own in teams])
    means = values.mean(axis=(0, 1))
    errors = np.sqrt((values.var(axis=1, ddof=1) / count).sum(axis=0)) / len(teams)
    shares = [percent((mean - low) / (bound - low)) if bound - low > 1 else "-" for mean in means]
    every = [one for own in teams for one in own]
    return {
        "teams": f"{what}, 10^{len(str(steps)) - 1} steps",
        "n": str(len(every)),
        "learned": f"{means[0]:.2f} ({errors[0]:.2f})",
        "**then improved**": f"{means[1]:.2f} ({errors[1]:.2f})",
        "worst team": f"{values[..., 1].min():.2f}" if len(teams) == 1 else "-",
        "bound": f"{bound:.2f}",
        "of the gap, learned": shares[0],
        "improved": shares[1],
        "doorways unfelt": f"{np.mean([one.unfelt for one in every]):.2f}",
        "seconds": f"{np.mean([one.seconds for one in every]):.2f}",
    }


def _teams(condition: Condition, count: int) -> list[Team]:
    """Let teams learn and improve, and judge them in the true game."""
    scenario, learner = condition.scenario, learner_of(condition.learner)
    prepare(learner)
    compiled, found = CompiledTeam(scenario, learner), []
    for seed in range(SEED, SEED + count):
        minds = compiled.learn(seed)
        memories = [minds.memory(k, scenario) for k in range(len(scenario.robots))]
        since = time.perf_counter()
        plan = improve(scenario, learner, memories)
        seconds = time.perf_counter() - since
        worth = []
        for tables in (compiled.tables(minds), plan.tables):
            exact = exact_means(scenario, tables, learner)
            if exact is None:
                known = compiled.remembered(list(map(_remembering, memories, tables)))
                worth.append(float(compiled.play(known, seed, TRIALS).reward.mean()))
            else:
                worth.append(float(exact.reward.mean()))
        unfelt = len(scenario.map.doorways - set(plan.doorways))
        found.append(Team(worth[0], worth[1], unfelt, seconds))
    return found


def _remembering(memory: Memory, table: Tables) -> Memory:
    """Return what a robot remembers, but other tables."""
    assert table.factors is not None
    u, r_bar, w, states, rho = table.factors
    more = {**memory.more, "u": u, "r_bar": r_bar, "w": w}
    counts = np.zeros(rho.shape, dtype=np.int64)
    return memory._replace(
        q_star=table.q_star, states=states, values=rho, updates=counts, more=more
    )
