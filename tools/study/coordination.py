# Copyright 2026 The sparse_coord_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The studies of docs/coordination.md: how many runs of a condition, and the table.

They show the value of the factored learner, and the reasons.
"""

import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import cache
from pathlib import Path

import numpy as np
import pandas as pd

from sparse_coord_ros.base.percents import percent
from sparse_coord_ros.core.engine.batch import run_batch
from sparse_coord_ros.core.game.scenario import Scenario
from sparse_coord_ros.core.learners.registry import learner_of
from sparse_coord_ros.core.runs.evaluation import Measure
from sparse_coord_ros.core.solve.optimum import independent_bound
from sparse_coord_ros.studies.catalogue import LONG, PAYING_PAIRS, unseen_conditions
from sparse_coord_ros.studies.condition_result import ConditionResult
from sparse_coord_ros.studies.conditions import Condition, make_condition
from sparse_coord_ros.studies.report import text
from sparse_coord_ros.studies.report.analysis import gap_closed
from sparse_coord_ros.studies.report.data import best_asking_team
from sparse_coord_ros.studies.standings import Standing, failed_teams, standings
from sparse_coord_ros.studies.store import Plan
from tools.study import fresh

SEED = 950_000
"""Seed of the first run: no search has seen these."""

FRESH = 7_100_000
"""Seed of the first team in fresh buildings."""

RULES = "tools.study.rules:"
LEARNERS = ("factored", "coop", "noncoop")
ONE_PAIR = (*PAYING_PAIRS, "isr", "mit", "cit", "suny", "cmu")
ROUTES: Mapping[str, float] = {
    "env2-4r": 106.63,
    "crowd-4r": 107.88,
    "crowd-6r": 105.48,
    "crowd-8r": 105.05,
}
"""At -100: a prioritised planner that sees everything for nothing, doorways banned by local search
(an earlier study's; known to be reachable with full information)."""

MANY = tuple(ROUTES)

Found = Callable[[Condition], ConditionResult]
"""Returns the result of a condition."""

Rows = Iterator[text.Row]


@dataclass(frozen=True)
class Study:
    """One study.

    Attributes:
        name: its name on the command line and in the marks of the document.
        runs: learning runs of a condition of two robots, and of more.
        trials: trials of a run of more than two robots.
        table: yields the rows; beside results it may take the folder where it keeps others.
        seed: seed of the first run.
        page: the document.
        keeps: whether it keeps others.
    """

    name: str
    runs: tuple[int, int]
    trials: int
    table: Callable[..., Rows]
    seed: int = SEED
    page: str = "coordination.md"
    keeps: bool = False

    def plan(self, condition: Condition) -> Plan:
        """Return seed, runs and trials; of two robots trials are of no interest."""
        two = len(condition.scenario.robots) == 2
        runs, trials = (self.runs[0], 2) if two else (self.runs[1], self.trials)
        return Plan(self.seed, runs, trials)

    def text(
        self, compute: Callable[[Condition, Plan], ConditionResult], out: Path
    ) -> str:
        """Return the table.

        Args:
            compute: returns a condition's result.
            out: the results directory.
        """
        found = cache(lambda condition: compute(condition, self.plan(condition)))
        folder = [out / self.name] * self.keeps
        return text.to_markdown(pd.DataFrame(list(self.table(found, *folder))))


def _factored(name: str, settings: Mapping[str, object]) -> Condition:
    return make_condition(name, "factored", settings)


def _each(
    found: Found, name: str, settings: Mapping[str, object]
) -> list[ConditionResult]:
    """Return the results of `LEARNERS`."""
    return [found(make_condition(name, learner, settings)) for learner in LEARNERS]


def failed_share(result: ConditionResult) -> float:
    """Return the share of the teams that miss in more than one trial of a thousand."""
    return failed_teams(result) / result.runs


def _return(result: ConditionResult) -> str:
    return text.with_error(result.best("returns"))


def return_and_failed(result: ConditionResult) -> str:
    """Return the return of a condition, and where teams fail their share."""
    failed = failed_share(result)
    return _return(result) + (f", {percent(failed, whole=True)} fail" if failed else "")


def _mean(result: ConditionResult, measure: str, digits: int = 2) -> str:
    return f"{result.best(measure).mean:.{digits}f}"


def _pairs(found: Found) -> Rows:
    for name in ONE_PAIR:
        own = found(_factored(name, LONG))
        base = found(make_condition(name, "noncoop", LONG))
        bound = best_asking_team(own)
        share = None
        if bound is not None and name in PAYING_PAIRS:
            share = gap_closed(
                own.run_means("returns"), base.run_means("returns"), bound
            )
        yield {
            "scenario": name,
            "factored": _return(own),
            "worst team": f"{own.run_means('returns').min():.2f}",
            "asks": _mean(own, "asks"),
            "failed teams": percent(failed_share(own)),
            "Non-coop.": _return(base),
            "best asking team found": text.bound_of(own),
            "share of the gap": None if share is None else _share(share),
        }


def _many(found: Found) -> Rows:
    for name in MANY:
        own, coop, base = _each(found, name, LONG)
        yield {
            "scenario": name,
            "factored": _return(own),
            "asks": _mean(own, "asks"),
            "miscoordinations": _mean(own, "miscoordinations", 3),
            "trials in which all arrive": percent(own.arrived),
            "failed teams": percent(failed_share(own)),
            "coop": _return(coop),
            "Non-coop.": _return(base),
            "planner with routes": f"{ROUTES[name]:.2f}",
        }


ABLATED: Mapping[str, tuple[str, Mapping[str, object]]] = {
    "all of it": ("factored", {}),
    "no looking back": (RULES + "NoLookingBack", {}),
    "r^C counts once (`credit: own`)": ("factored", {"credit": "own"}),
    "neither": (RULES + "NoLookingBack", {"credit": "own"}),
    "no percept update of r_bar": (RULES + "NoPerceptUpdate", {}),
    "no replay": (RULES + "NoReplay", {}),
}
"""Learner and changed settings."""
ABLATION = (*PAYING_PAIRS, "cmu", "env2-4r", "crowd-8r")


def _ablation(found: Found) -> Rows:
    for what, (rule, more) in ABLATED.items():
        made = {name: make_condition(name, rule, {**LONG, **more}) for name in ABLATION}
        told = {name: return_and_failed(found(one)) for name, one in made.items()}
        yield {"what": what, **told}


PERCEPTS: Mapping[str, Mapping[str, object]] = {
    "10^4 steps": {**LONG, "steps": 10_000},
    "percepts succeed 3 times of 4": {**LONG, "perception": "probability:0.75"},
    "percepts succeed half of the time": {**LONG, "perception": "probability:0.5"},
    "line of sight": {**LONG, "perception": "line_of_sight"},
    "within 2 cells": {**LONG, "perception": "range:2"},
    "within 1 cell": {**LONG, "perception": "range:1"},
    "r^C 1 : 0.5": {**LONG, "common_reward": "each:1:0.5"},
    "r^C 1 : 0": {**LONG, "common_reward": "each:1:0"},
    "asking costs 0": {**LONG, "ask_cost": 0},
    "asking costs 5": {**LONG, "ask_cost": 5},
}


def _percepts(found: Found) -> Rows:
    for what, settings in PERCEPTS.items():
        told = {
            name: return_and_failed(found(_factored(name, settings)))
            for name in PAYING_PAIRS
        }
        coop = _return(found(make_condition("env1", "coop", settings)))
        yield {"what": what, **told, "env1, coop": coop}


ROBOTS = (4, 8, 16)
BUILDINGS = ("3x2x4-{}r-0", "3x2x4-{}r-1", "3x2x4-{}r-2", "4x2x5-{}r-0")


def _scale(found: Found) -> Rows:
    """Yield how teams of growing size stand in generated buildings."""
    for robots in ROBOTS:
        names = [f"building-{one.format(robots)}" for one in BUILDINGS]
        by_name = [_each(found, name, {"penalty": -100}) for name in names]
        factored, coop, base = (list(own) for own in zip(*by_name, strict=True))
        scenarios = [one.scenario for one in factored]
        bound = np.mean([independent_bound(one) for one in scenarios])
        missed = [one.best("miscoordinations").mean for one in factored]
        spent = [learning_seconds(one) for one in scenarios]
        fixed = [8 * len(one.map.cells) * (2 * 4 + 1) for one in scenarios]
        held = float(np.mean([one.visited_bytes for one in factored]) + np.mean(fixed))
        yield {
            "robots": str(robots),
            "factored": _pooled(factored),
            "robots alone (bound)": f"{bound:.2f}",
            "coop": _pooled(coop),
            "Non-coop.": _pooled(base),
            "asks": f"{np.mean([one.best('asks').mean for one in factored]):.2f}",
            "miscoordinations": f"{np.mean(missed):.3f}",
            "trials in which all arrive": _arrived(factored),
            "of coop's": _arrived(coop),
            "bytes a robot": text.size(held),
            "seconds to learn": f"{np.mean(spent):.2f}",
        }


def _pooled(results: Sequence[ConditionResult]) -> str:
    """Return mean and standard error over the runs of several buildings, each by itself."""
    measures = [result.best("returns") for result in results]
    error = np.sqrt(sum(one.standard_error**2 for one in measures)) / len(measures)
    return f"{np.mean([one.mean for one in measures]):.2f} ({error:.2f})"


def _arrived(results: Sequence[ConditionResult]) -> str:
    return percent(float(np.mean([result.arrived for result in results])))


def learning_seconds(scenario: Scenario, learner: str = "factored") -> float:
    """Return the seconds of processor time of one learning run."""
    scenario = learner_of(learner).with_defaults(scenario)
    for _ in range(2):  # the first one compiles, or loads the compiled loops
        began = time.process_time()
        list(run_batch(scenario, learner, [SEED], trials=0, jobs=1))
    return time.process_time() - began


UNSEEN: Mapping[str, tuple[str, Mapping[str, object]]] = {
    "coop": ("coop", {}),
    "factored": ("factored", {}),
    "factored, 10^4 steps": ("factored", {"steps": 10_000}),
}


def _unseen(found: Found) -> Rows:
    """Yield how teams stand in the buildings for tuning; those for the test stay closed."""
    judged: dict[str, dict[str, Standing]] = {}
    for what, (learner, settings) in UNSEEN.items():
        results = [found(one) for one in unseen_conditions(learner, "tuning", settings)]
        judged[what] = standings(results) | standings(results, by_kind=True)
    for where, own in sorted(judged["factored"].items()):
        if where in ("2r", "4r", "8r") or "corridor" in where:
            yield {
                "teams": where,
                "shortest paths": f"{own.paths:.2f}",
                "best known": f"{own.best_known:.2f}",
                "factored": text.with_error(own.returns),
                **{
                    f"share, {what}": stood[where].share_and_failed()
                    for what, stood in judged.items()
                },
            }


PROTOCOL: Mapping[str, Mapping[str, object]] = {
    "the defaults": {},
    "a = n^-0.5": {"step_size": "floored:0.5:0.1:0.01"},
    "a = n^-0.7": {"step_size": "floored:0.7:0.1:0.01"},
    "floor from 0.2": {"step_size": "floored:0.6:0.2:0.01"},
    "floor from 0.05": {"step_size": "floored:0.6:0.05:0.01"},
    "floor to 0.03": {"step_size": "floored:0.6:0.1:0.03"},
    "epsilon from 0.2": {"epsilon": "linear:0.2:0.02:0.8"},
    "epsilon from 0.5": {"epsilon": "linear:0.5:0.02:0.8"},
    "epsilon to 0": {"epsilon": "linear:0.3:0:0.8"},
    "exploring starts over 30 %": {"starts": "exploring:1:0:0.3"},
    "exploring starts over 80 %": {"starts": "exploring:1:0:0.8"},
    "U begins at 50": {"q_coord_init": 50},
}
"""Settings that were tried against the learner's defaults."""


def _protocol(found: Found) -> Rows:
    for what, settings in PROTOCOL.items():
        row: dict[str, str | None] = {"what": what}
        for robots, steps in ((2, 10_000), (2, 100_000), (4, 100_000)):
            more = {"steps": steps, **settings}
            own = [
                found(one)
                for one in unseen_conditions("factored", "tuning", more, (robots,))
            ]
            (stood,) = standings(own).values()
            row[f"{robots}r, {steps:,} steps"] = stood.share_and_failed()
        yield row


def _share(one: Measure) -> str:
    return f"{percent(one.mean)} ({100 * one.standard_error:.1f})"


CROWDS = Study("many", (200, 100), 300, _many)
STUDIES: tuple[Study, ...] = (
    Study("pairs", (200, 100), 2, _pairs),
    CROWDS,
    Study("ablation", (40, 16), 200, _ablation),
    Study("percepts", (40, 16), 200, _percepts),
    Study("scale", (10, 10), 300, _scale),
    Study("unseen", (20, 10), 500, _unseen),
    Study("fresh", (20, 20), 500, fresh.table, seed=FRESH, keeps=True),
    Study("protocol", (40, 6), 200, _protocol, seed=5_000),
)
