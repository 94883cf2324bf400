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
from dataclasses import dataclass, field

from sparse_coord_ros.experiments.catalogue import CLOSE, CLOSED, LARGE, LONG, SMALL, SPARSE
from sparse_coord_ros.experiments.conditions import Condition, make_condition
from sparse_coord_ros.experiments.report.text import Row, of
from sparse_coord_ros.experiments.store import ConditionResult

Choices = Mapping[str, float]
"""One value for each name of `SPACE`."""

PROTOCOLS: Mapping[str, tuple[tuple[float, ...], float, float]] = {
    "exponent": ((0.4, 0.5, 0.6, 0.8, 1), 0.6, 0.5),
    "floor_first": ((0, 0.05, 0.1, 0.15, 0.2, 0.3), 0, 0.1),
    "floor_last": ((0, 0.005, 0.01, 0.02), 0, 0.01),
    "epsilon_first": ((0.1, 0.15, 0.2, 0.3, 0.5, 1), 1, 0.15),
    "epsilon_last": ((0.01, 0.02, 0.05, 0.1), 0.05, 0.02),
    "epsilon_fraction": ((0.5, 0.8, 1), 1, 0.8),
    "starts_last": ((0, 0.1, 0.2, 0.3, 0.5, 1), 1, 0.2),
    "starts_fraction": ((0.5, 0.8, 1), 1, 0.5),
    "q_star_init": ((0, 10, 15, 20, 30), 0, 20),
    "q_coord_init": ((0, 100, 200), 200, 200),
    "goal_value": ((0, 200), 200, 200),
    "max_steps": ((50, 100, 200, 1000), 1000, 100),
}
"""What Algorithm 1 leaves open: the values tried, the textbook's (step sizes that decay with the
visits, epsilon from 1, exploring starts throughout), and the best that earlier searches of this
kind, with fewer runs and other seeds, came to."""

SPACE: Mapping[str, tuple[float, ...]] = {name: row[0] for name, row in PROTOCOLS.items()}
TEXTBOOK: Choices = {name: row[1] for name, row in PROTOCOLS.items()}
EARLIER: Choices = {name: row[2] for name, row in PROTOCOLS.items()}
STARTS: Mapping[str, Choices] = {
    "the textbook protocol": TEXTBOOK,
    "the best of earlier searches": EARLIER,
}
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


@dataclass
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
    loss: float = 0.0
    whole: bool = False
    closed: dict[str, float] = field(default_factory=dict)
    difference: dict[str, float] = field(default_factory=dict)
    asks: dict[str, float] = field(default_factory=dict)
    failed_teams: int = 0
    teams: int = 0

    def with_teams(self, result: ConditionResult) -> ConditionResult:
        """Count the teams of a condition that was judged, and return its result."""
        self.failed_teams += result.failed_teams
        self.teams += result.runs
        self.loss += 100.0 * result.failed_teams / result.runs
        return result


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
        row: returns what a table says of a protocol, by column.
    """

    learner: str
    space: Mapping[str, tuple[float, ...]]
    starts: Mapping[str, Choices]
    judge: Callable[[Choices, Compute, float], Judgement]
    row: Callable[[Judgement], Row]


def judge(choices: Choices, compute: Compute, limit: float) -> Judgement:
    """Return what a protocol brings; stop early once its loss exceeds a limit.

    Args:
        choices: the protocol.
        compute: returns the result of a condition.
        limit: loss beyond which the protocol is of no interest.
    """
    found = Judgement(choices)

    def reward(name: str, learner: str, settings: Mapping[str, object]) -> ConditionResult:
        return compute(make_condition(name, learner, {**settings_of(choices), **settings}))

    for name in CLOSE:
        result = found.with_teams(reward(name, "coop", LONG))
        low = reward(name, "noncoop", LONG).measure("reward").mean
        found.closed[name] = (result.measure("reward").mean - low) / (result.optimum - low)
        found.loss += 40.0 * max(0.0, CLOSED[name] + MARGIN - found.closed[name])
        if found.loss > limit:
            return found
    for name in SMALL + LARGE:
        result = found.with_teams(reward(name, "coop", {"penalty": -20}))
        baseline = result.reference["reward"]
        if name in SMALL:  # in the large ones Non-coop. is worth the shortest paths
            other = reward(name, "noncoop", {"penalty": -20})
            baseline = max(baseline, other.measure("reward").mean)
        found.difference[name] = result.measure("reward").mean - baseline
        found.loss += 2.0 * max(0.0, -0.3 - found.difference[name])
        if name in SPARSE:
            found.asks[name] = result.measure("asks").mean
            found.loss += 20.0 * max(0.0, found.asks[name] - 0.03)
        if found.loss > limit:
            return found
    found.whole = True
    return found


def loss_of(one: Judgement) -> str:
    """Return the loss as a text; of a protocol that was not judged to the end, what it is over."""
    return f"{one.loss:.2f}" if one.whole else f"> {one.loss:.0f}"


def coop_row(one: Judgement) -> Row:
    """Return what a table says of a protocol of Coop."""
    worst = min(one.difference, key=lambda name: one.difference[name]) if one.whole else ""
    return {
        "loss": loss_of(one),
        **{f"{name} closed": f"{one.closed[name]:.0%}" for name in CLOSE if name in one.closed},
        "worst difference": f"{one.difference[worst]:+.2f} ({worst})" if one.whole else None,
        "most asks": f"{max(one.asks.values()):.3f}" if one.whole else None,
        "failed teams": of(one.failed_teams, one.teams),
    }


COOP = Task("coop", SPACE, STARTS, judge, coop_row)


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
