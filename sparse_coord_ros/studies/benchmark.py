# Copyright 2026 The sparse_coord_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The benchmark: how learners stand in fixed lists of scenarios (`studies.lists`).

A scenario's gap lies between robots on fixed shortest paths, which ignore each other, and its top:
of two robots the best asking team found, which is no upper bound, of more a shipped upper bound.
Of a scenario file that is none of these an upper bound is computed.
Where percepts fail the top is that of sure percepts.
"""

from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from sparse_coord_ros.base.errors import SettingError, check_argument
from sparse_coord_ros.base.progress import Show
from sparse_coord_ros.core.engine.cluster import SchedulerLike
from sparse_coord_ros.core.game.scenario import PROTOCOL, SETTINGS
from sparse_coord_ros.core.game.settings import Setting
from sparse_coord_ros.core.learners.registry import LearnerLike, chosen_learner
from sparse_coord_ros.core.runs.measures import standard_error
from sparse_coord_ros.core.solve.shipped import known_optimum, known_top
from sparse_coord_ros.studies.condition_result import ConditionResult
from sparse_coord_ros.studies.conditions import Condition, make_condition
from sparse_coord_ros.studies.lists import (
    LISTS,
    SAMPLED,
    TUNING,
    Item,
    items_of,
)
from sparse_coord_ros.studies.runner import run_experiment

TEAM_RUNS = Setting(
    "runs", int, 10, "teams that learn in each scenario", low=2, high=1_000_000
)
TEAM_TRIALS = Setting(
    "trials",
    int,
    500,
    "trials of a team of more than two robots",
    low=2,
    high=1_000_000,
)

CHANGEABLE = (*PROTOCOL, "peers")
"""Settings that may be changed: those of learning, and whom a robot asks."""

RESAMPLES = 2000
"""Of a bootstrap."""


def benchmark(
    learners: "LearnerLike | Iterable[LearnerLike]" = "voi",
    *,
    lists: Sequence[str] = TUNING,
    steps: int = 100_000,
    out: str | Path | None = None,
    runs: int = TEAM_RUNS.default,
    trials: int = TEAM_TRIALS.default,
    seed: int = 0,
    engine: str = "auto",
    jobs: int | None = None,
    scheduler: SchedulerLike = None,
    progress: Show = True,
    **settings: object,
) -> list[dict[str, Any]]:
    """Judge learners on fixed lists of scenarios, each with its own penalty (-100 in all lists).

    Args:
        learners: a learner, or several.
        lists: names of lists (`studies.lists.LISTS`): paper, percepts, and generated buildings:
            "tuning-pairs", "-four" and "-eight", by which rules and numbers are chosen, the same
            with "validation", and with "unseen2" for closing figures; or scenario files.
        steps: learning steps of each robot.
        out: results directory, as for `run_experiment`; None: nothing is saved.
        runs: teams that learn in each scenario.
        trials: greedy trials of a team; those of two robots are evaluated exactly.
        seed: seed of team 0; team i has seed + i.
        engine: "numba", "python", or "auto": numba where it is installed. The bits are the same.
        jobs: threads (or processes) at once; all cores that this process may use where None.
        scheduler: as for `run_experiment`.
        progress: True: a bar at a terminal and in notebooks; False: nothing; or a function,
            called with a condition's id, the agent-steps done and those of its list.
        **settings: settings of learning to change for all.

    Returns:
        Of each list and learner, in the order in which they were asked for:

        - `list`, `learner`: their names;
        - `peers_seen`: which cells of peers the robots learned from, as the setting says; None
          where `share` is None;
        - `share`: closed share of the pooled gap; None: the learner cannot learn every scenario of
          the list;
        - `error`: the standard error of the share: of generated buildings a bootstrap over
          buildings, and teams in each, else that of the teams;
        - `failed`: teams in which some robot fails to arrive in more than one trial of a thousand;
        - `teams`: all teams;
        - `arrived`: the least share of its trials in which a team arrives.

    Raises:
        SettingError: no learner; an unknown learner, list or setting; a setting that changes the
            game.
        ResultsError, OSError, RunError, PluginError: as `run_experiment`.
    """
    is_list = isinstance(lists, Sequence) and not isinstance(lists, str)
    check_argument("lists", lists, is_list, f"a list of some of: {', '.join(LISTS)}")
    items_by_list = items_of(list(lists))
    several = isinstance(learners, Iterable) and not isinstance(learners, str)
    learners_given: list[Any] = list(learners) if several else [learners]  # type: ignore[arg-type]
    if not learners_given:
        raise SettingError("benchmark: no learner is given; name one, e.g. 'voi'")
    names = list(
        dict.fromkeys(chosen_learner(learner).label for learner in learners_given)
    )
    SETTINGS.parse(settings)
    fixed = [name for name in settings if name not in CHANGEABLE]
    if fixed:
        raise SettingError(
            f"benchmark: with {', '.join(fixed)} another game would be played, and its "
            "bounds are unknown; change settings of learning only"
        )
    steps = SETTINGS["steps"].parse(steps)
    options: dict[str, Any] = {
        "out": out,
        "runs": TEAM_RUNS.parse(runs),
        "trials": TEAM_TRIALS.parse(trials),
        "seed": seed,
        "engine": engine,
        "jobs": jobs,
        "scheduler": scheduler,
        "progress": progress,
    }
    standings = []
    for name, items in items_by_list.items():
        for learner in names:
            conditions = _conditions(learner, items, {**settings, "steps": steps})
            results: list[ConditionResult] = []
            if conditions:
                results = list(run_experiment(conditions, **options).values())
            standings.append(standing(name, learner, results))
    return standings


def _conditions(
    learner: str, items: Sequence[Item], settings: dict[str, object]
) -> list[Condition]:
    """Return a condition for each scenario; none: the learner cannot learn all of them.

    Raises:
        SettingError: a setting to change is bad, or does not fit.
    """
    games = [(item.scenario, dict(item.settings)) for item in items]
    try:
        for scenario, game in games:
            make_condition(scenario, learner, game)
    except SettingError:
        return []
    return [
        make_condition(scenario, learner, {**settings, **game})
        for scenario, game in games
    ]


def standing(
    name: str, learner: str, results: Sequence[ConditionResult]
) -> dict[str, Any]:
    """Return how the teams of a learner stand in the scenarios of a list: a row of `benchmark`.

    Args:
        name: the list's name.
        learner: the learner's name.
        results: of each scenario of the list; none: the learner cannot learn all of them.
    """
    row = {"list": name, "learner": learner}
    if not results:
        none = dict.fromkeys(("peers_seen", "share", "error", "arrived"))
        return {**row, **none, "failed": 0, "teams": 0}
    learned = [result.measures.each("returns") for result in results]
    low = np.array([result.shortest_paths.mean("returns") for result in results])
    high = np.array([_top(result) for result in results])
    share, error = pooled_share(learned, low, high)
    if name not in SAMPLED:
        errors = [standard_error(returns) for returns in learned]
        error = float(np.linalg.norm(errors) / (high - low).sum())
    return {
        **row,
        "peers_seen": results[0].scenario.peers_seen,
        "share": share,
        "error": error,
        "failed": sum(result.measures.failed for result in results),
        "teams": sum(result.runs for result in results),
        "arrived": min(float(result.measures.arrived.min()) for result in results),
    }


def _top(result: ConditionResult) -> float:
    """Return where the gap of a scenario ends; of a scenario file an upper bound is computed."""
    sure = result.scenario.with_settings({"perception": "always"})
    top = known_top(sure)
    return known_optimum(sure).value if top is None else top


def pooled_share(
    learned: Sequence[np.ndarray], low: np.ndarray, high: np.ndarray
) -> tuple[float, float]:
    """Return the share of the pooled gap that teams close, with a bootstrap standard error.

    A resample draws as many buildings with replacement, and in each as many teams. Its draws are
    the same in every call.

    Args:
        learned: the teams' returns in each building, shape (teams,) each.
        low: where the gap begins in each building, shape (buildings,).
        high: where it ends, shape (buildings,).
    """
    rng = np.random.default_rng(0)
    count = len(learned)
    chosen = rng.integers(count, size=(RESAMPLES, count))
    gained = np.zeros((RESAMPLES, count))
    for building, returns in enumerate(learned):
        drawn = chosen == building
        teams = rng.integers(len(returns), size=(int(drawn.sum()), len(returns)))
        gained[drawn] = returns[teams].mean(axis=1) - low[building]
    shares = gained.sum(axis=1) / (high - low)[chosen].sum(axis=1)
    means = np.array([returns.mean() for returns in learned])
    share = float((means - low).sum() / (high - low).sum())
    return share, float(shares.std(ddof=1))
