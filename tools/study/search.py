# Copyright 2026 The sparse_coord_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The study of the learning protocol: what Algorithm 1 leaves open, for all nine scenarios.

A protocol is one choice from each list of `SPACE`. Its loss adds up, in units of reward, by how
much Coop. misses what one protocol for all nine scenarios should reach. The search tries a
textbook protocol and the best of earlier searches, then changes of the best so far and a few
protocols drawn at random; the best are judged again with more runs, and every choice of the winner
is varied alone.
"""

import math
import random
from collections.abc import Callable, Iterable, Iterator, Mapping
from dataclasses import dataclass

from sparse_coord_ros.experiments.catalogue import CLOSE, CLOSED, LARGE, LONG, SMALL, SPARSE
from sparse_coord_ros.experiments.conditions import Condition, make_condition
from sparse_coord_ros.experiments.store import ConditionResult

Choices = Mapping[str, float]
"""One value for each name of `SPACE`."""

SPACE: Mapping[str, tuple[float, ...]] = {
    "exponent": (0.4, 0.5, 0.6, 0.8, 1),
    "floor_first": (0, 0.05, 0.1, 0.15, 0.2, 0.3),
    "floor_last": (0, 0.005, 0.01, 0.02),
    "epsilon_first": (0.1, 0.15, 0.2, 0.3, 0.5, 1),
    "epsilon_last": (0.01, 0.02, 0.05, 0.1),
    "epsilon_fraction": (0.5, 0.8, 1),
    "starts_last": (0, 0.1, 0.2, 0.3, 0.5, 1),
    "starts_fraction": (0.5, 0.8, 1),
    "q_star_init": (0, 10, 15, 20, 30),
    "q_coord_init": (0, 100, 200),
    "goal_value": (0, 200),
    "max_steps": (50, 100, 200, 1000),
}
"""What Algorithm 1 leaves open, and the values tried."""

TEXTBOOK: Choices = {
    "exponent": 0.6,
    "floor_first": 0,
    "floor_last": 0,
    "epsilon_first": 1,
    "epsilon_last": 0.05,
    "epsilon_fraction": 1,
    "starts_last": 1,
    "starts_fraction": 1,
    "q_star_init": 0,
    "q_coord_init": 200,
    "goal_value": 200,
    "max_steps": 1000,
}
"""Step sizes that decay with the visits, epsilon from 1, exploring starts throughout."""

EARLIER: Choices = {
    "exponent": 0.5,
    "floor_first": 0.1,
    "floor_last": 0.01,
    "epsilon_first": 0.15,
    "epsilon_last": 0.02,
    "epsilon_fraction": 0.8,
    "starts_last": 0.2,
    "starts_fraction": 0.5,
    "q_star_init": 20,
    "q_coord_init": 200,
    "goal_value": 200,
    "max_steps": 100,
}
"""The best that earlier searches of this kind, with fewer runs and other seeds, came to."""

STARTS: Mapping[str, Choices] = {"textbook": TEXTBOOK, "earlier search": EARLIER}
"""Protocols that the search tries first."""

SETTINGS = (
    "step_size",
    "epsilon",
    "starts",
    "q_star_init",
    "q_coord_init",
    "goal_value",
    "max_steps",
)
"""The scenario settings that make up a protocol."""

MARGIN = 0.02
"""How much more of the gap the search asks for, as its estimates are noisy."""

HOPELESS = 20.0
"""A change of one choice is not judged to the end once it loses this much more."""

FINALISTS = 6
"""Protocols that are judged again, with more runs."""

FINAL_RUNS = 3
"""How many times as many runs."""

KEPT = 4
"""Protocols whose choices the search goes on from."""

FRESH = 0.1
"""Share of protocols drawn at random."""

CHANGED = 0.25
"""Probability that a choice of a good protocol is drawn again."""


def settings_of(choices: Choices) -> dict[str, str]:
    """Return the scenario settings of a protocol."""
    c = {name: f"{value:g}" for name, value in choices.items()}
    schedules = {
        "step_size": f"floored:{c['exponent']}:{c['floor_first']}:{c['floor_last']}",
        "epsilon": f"linear:{c['epsilon_first']}:{c['epsilon_last']}:{c['epsilon_fraction']}",
        "starts": f"exploring:1:{c['starts_last']}:{c['starts_fraction']}",
    }
    return schedules | {name: c[name] for name in SETTINGS if name in c}


@dataclass(frozen=True)
class Judgement:
    """What a protocol brought.

    Attributes:
        choices: the protocol.
        loss: summed shortfalls, in units of reward; 0: nothing is missed.
        whole: False where the search stopped early, as the loss was too large already.
        closed: share of the gap closed at penalty -100 and 10^5 steps, by scenario.
        difference: reward of Coop. less that of the better baseline at penalty -20: the exact
            value of shortest paths or, in the small scenarios, Non-coop.
        asks: COORDINATE per robot and trial where none is needed, by scenario.
        failed_teams: teams that do not all arrive in 99.9 % of their trials.
        teams: teams that learned.
    """

    choices: Choices
    loss: float
    whole: bool
    closed: dict[str, float]
    difference: dict[str, float]
    asks: dict[str, float]
    failed_teams: int
    teams: int


Compute = Callable[[Condition], ConditionResult]
"""Returns the result of a condition."""


@dataclass(frozen=True)
class Task:
    """What a search is about.

    Attributes:
        learner: whose protocol it is.
        space: the values of each choice.
        starts: protocols that are tried first.
        judge: returns what a protocol brings, and stops early beyond a limit of the loss.
    """

    learner: str
    space: Mapping[str, tuple[float, ...]]
    starts: Mapping[str, Choices]
    judge: Callable[[Choices, Compute, float], Judgement]


def judge(choices: Choices, compute: Compute, limit: float) -> Judgement:
    """Return what a protocol brings; stop early once its loss exceeds a limit.

    Args:
        choices: the protocol.
        compute: returns the result of a condition.
        limit: loss beyond which the protocol is of no interest.
    """
    protocol = settings_of(choices)
    loss, failed, teams = 0.0, 0, 0
    closed: dict[str, float] = {}
    difference: dict[str, float] = {}
    asks: dict[str, float] = {}

    def coop(name: str, settings: Mapping[str, object]) -> ConditionResult:
        nonlocal loss, failed, teams
        result = compute(make_condition(name, "coop", {**protocol, **settings}))
        failed += result.failed_teams
        teams += result.runs
        loss += 100.0 * result.failed_teams / result.runs
        return result

    for name in CLOSE:
        result = coop(name, LONG)
        low = compute(make_condition(name, "noncoop", {**protocol, **LONG})).measure("reward").mean
        closed[name] = (result.measure("reward").mean - low) / (result.optimum - low)
        loss += 40.0 * max(0.0, CLOSED[name] + MARGIN - closed[name])
        if loss > limit:
            return Judgement(choices, loss, False, closed, difference, asks, failed, teams)
    for name in SMALL + LARGE:
        result = coop(name, {"penalty": -20})
        baseline = result.reference["reward"]
        if name in SMALL:  # in the large ones Non-coop. is worth the shortest paths
            other = compute(make_condition(name, "noncoop", {**protocol, "penalty": -20}))
            baseline = max(baseline, other.measure("reward").mean)
        difference[name] = result.measure("reward").mean - baseline
        loss += 2.0 * max(0.0, -0.3 - difference[name])
        if name in SPARSE:
            asks[name] = result.measure("asks").mean
            loss += 20.0 * max(0.0, asks[name] - 0.03)
        if loss > limit:
            return Judgement(choices, loss, False, closed, difference, asks, failed, teams)
    return Judgement(choices, loss, True, closed, difference, asks, failed, teams)


COOP = Task("coop", SPACE, STARTS, judge)


def search(
    compute: Compute, candidates: int, seed: int = 0, task: Task = COOP
) -> Iterator[Judgement]:
    """Yield the outcome of each protocol tried, the task's `starts` first.

    Then protocols are drawn at random until `KEPT` of them were judged whole; from then on most
    are changes of the best ones.

    Args:
        compute: returns the result of a condition.
        candidates: how many protocols to try.
        seed: of the choice of candidates.
        task: what the search is about.
    """
    draw = random.Random(seed)
    best: list[Judgement] = []
    first = list(task.starts.values())
    seen: set[tuple[float, ...]] = set()
    for number in range(min(candidates, math.prod(map(len, task.space.values())))):
        choices = dict(first[min(number, len(first) - 1)])
        while tuple(choices.values()) in seen:
            fresh = len(best) < KEPT or draw.random() < FRESH
            kept = {} if fresh else draw.choice(best).choices
            choices = {
                name: draw.choice(values) if fresh or draw.random() < CHANGED else kept[name]
                for name, values in task.space.items()
            }
        seen.add(tuple(choices.values()))
        limit = 1.3 * best[KEPT - 1].loss + 1.0 if len(best) >= KEPT else float("inf")
        outcome = task.judge(choices, compute, limit)
        yield outcome
        if outcome.whole:
            best = sorted([*best, outcome], key=lambda one: one.loss)[:KEPT]


def final(
    outcomes: Iterable[Judgement], compute: Compute, task: Task = COOP
) -> Iterator[Judgement]:
    """Judge the best protocols of a search again and yield their new outcomes.

    Args:
        outcomes: of the search.
        compute: returns the result of a condition, from more runs and other seeds than the
            search's: the best of many noisy estimates is often a lucky one.
        task: what the search is about.
    """
    whole = sorted((one for one in outcomes if one.whole), key=lambda one: one.loss)
    for outcome in whole[:FINALISTS]:
        yield task.judge(outcome.choices, compute, float("inf"))


def vary(
    best: Judgement, compute: Compute, task: Task = COOP
) -> Iterator[tuple[str, float, Judgement]]:
    """Yield name, new value and outcome of every change of one choice of a protocol."""
    for name, values in task.space.items():
        for value in values:
            if value != best.choices[name]:
                changed = {**best.choices, name: value}
                yield name, value, task.judge(changed, compute, best.loss + HOPELESS)
