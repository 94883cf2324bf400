# Copyright 2026 The sparse_coord_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The study of the learning protocol: what Algorithm 1 leaves open, for all nine scenarios.

A protocol is one choice from each list of `SPACE`. Its loss adds up, in units of reward, by how
much Coop. misses what one protocol for all nine scenarios should reach. The search tries a
textbook protocol, then protocols drawn at random and changes of the best so far; from the winner
it descends, one choice at a time, until no change of one choice is better.
"""

import math
import random
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from typing import NamedTuple

from sparse_coord_ros.engine.cells import Cell, make_cell
from sparse_coord_ros.engine.experiments import CLOSE, LARGE, LONG, SMALL, SPARSE
from sparse_coord_ros.engine.results import CellResult

Choices = Mapping[str, float]
"""One value for each name of `SPACE`."""

SPACE: Mapping[str, tuple[float, ...]] = {
    "exponent": (0.5, 0.6, 0.7, 0.8, 1),
    "floor_first": (0, 0.05, 0.1, 0.15, 0.2, 0.3),
    "floor_last": (0, 0.005, 0.01, 0.02),
    "epsilon_first": (0.1, 0.2, 0.3, 0.5, 1),
    "epsilon_last": (0.01, 0.02, 0.05, 0.1),
    "starts_last": (0, 0.1, 0.2, 0.3, 0.5, 1),
    "starts_fraction": (0.5, 0.8, 1),
    "q_star_init": (0, 5, 10, 20, 30),
    "q_coord_init": (0, 100, 200, 250),
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
    "starts_last": 1,
    "starts_fraction": 1,
    "q_star_init": 0,
    "q_coord_init": 200,
    "goal_value": 200,
    "max_steps": 1000,
}
"""Where the search starts: decaying step sizes, epsilon from 1, exploring starts throughout."""

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

CLOSED = {"env1": 0.8, "env2-2r": 0.5, "pentagon": 0.5}
"""Share of the gap between Non-coop. and the optimum that Coop. should close at penalty -100."""

MARGIN = 0.03
"""How much more of the gap the search asks for, as its runs are few."""

KEPT = 6
"""Protocols whose choices the search goes on from."""

FRESH = 0.3
"""Share of protocols drawn at random."""

CHANGED = 0.25
"""Probability that a choice of a good protocol is drawn again."""


def settings_of(choices: Choices) -> dict[str, str]:
    """Return the scenario settings of a protocol."""
    c = {name: f"{value:g}" for name, value in choices.items()}
    return {
        "step_size": f"floored:{c['exponent']}:{c['floor_first']}:{c['floor_last']}",
        "epsilon": f"linear:{c['epsilon_first']}:{c['epsilon_last']}:1",
        "starts": f"exploring:1:{c['starts_last']}:{c['starts_fraction']}",
        "q_star_init": c["q_star_init"],
        "q_coord_init": c["q_coord_init"],
        "goal_value": c["goal_value"],
        "max_steps": c["max_steps"],
    }


@dataclass(frozen=True)
class Outcome:
    """What a protocol brought.

    Attributes:
        choices: the protocol.
        loss: summed shortfalls, in units of reward; 0: nothing is missed.
        whole: False where the search stopped early, as the loss was too large already.
        closed: share of the gap closed at penalty -100 and 10^5 steps, by scenario.
        difference: reward of Coop. less the exact value of shortest paths at penalty -20.
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


def judge(choices: Choices, compute: Callable[[Cell], CellResult], limit: float) -> Outcome:
    """Return what a protocol brings; stop early once its loss exceeds a limit.

    Args:
        choices: the protocol.
        compute: returns the result of a cell.
        limit: loss beyond which the protocol is of no interest.
    """
    protocol = settings_of(choices)
    loss, failed, teams = 0.0, 0, 0
    closed: dict[str, float] = {}
    difference: dict[str, float] = {}
    asks: dict[str, float] = {}

    def coop(name: str, settings: Mapping[str, object]) -> CellResult:
        nonlocal loss, failed, teams
        result = compute(make_cell(name, "coop", {**protocol, **settings}))
        failed += result.failed_teams
        teams += result.runs
        loss += 50.0 * result.failed_teams / result.runs
        return result

    for name in CLOSE:
        result = coop(name, LONG)
        low = compute(make_cell(name, "noncoop", {**protocol, **LONG})).measure("reward").mean
        closed[name] = (result.measure("reward").mean - low) / (result.optimum - low)
        loss += 40.0 * max(0.0, CLOSED[name] + MARGIN - closed[name])
        if loss > limit:
            return Outcome(choices, loss, False, closed, difference, asks, failed, teams)
    for name in SMALL + LARGE:
        result = coop(name, {"penalty": -20})
        difference[name] = result.measure("reward").mean - result.reference["reward"]
        loss += 2.0 * max(0.0, -0.3 - difference[name])
        if name in SPARSE:
            asks[name] = result.measure("asks").mean
            loss += 20.0 * max(0.0, asks[name] - 0.03)
        if loss > limit:
            return Outcome(choices, loss, False, closed, difference, asks, failed, teams)
    return Outcome(choices, loss, True, closed, difference, asks, failed, teams)


def search(
    compute: Callable[[Cell], CellResult], candidates: int, seed: int = 0
) -> Iterator[Outcome]:
    """Yield the outcome of each protocol tried, the textbook's first.

    Protocols are drawn at random until `KEPT` of them were judged whole; from then on most are
    changes of the best ones.

    Args:
        compute: returns the result of a cell.
        candidates: how many protocols to try.
        seed: of the choice of candidates.
    """
    draw = random.Random(seed)
    best: list[Outcome] = []
    choices = dict(TEXTBOOK)
    seen: set[tuple[float, ...]] = set()
    for _ in range(min(candidates, math.prod(map(len, SPACE.values())))):
        while tuple(choices.values()) in seen:
            fresh = len(best) < KEPT or draw.random() < FRESH
            kept = {} if fresh else draw.choice(best).choices
            choices = {
                name: draw.choice(values) if fresh or draw.random() < CHANGED else kept[name]
                for name, values in SPACE.items()
            }
        seen.add(tuple(choices.values()))
        limit = 1.3 * best[KEPT - 1].loss + 1.0 if len(best) >= KEPT else float("inf")
        outcome = judge(choices, compute, limit)
        yield outcome
        if outcome.whole:
            best = sorted([*best, outcome], key=lambda one: one.loss)[:KEPT]


class Round(NamedTuple):
    """One round of `descend`: a protocol, and the outcome of each change of one choice.

    Attributes:
        best: the protocol.
        variations: name, new value and outcome of every change.
    """

    best: Outcome
    variations: list[tuple[str, float, Outcome]]


def descend(
    best: Outcome,
    compute: Callable[[Cell], CellResult],
    progress: Callable[[], None] = lambda: None,
) -> Iterator[Round]:
    """Change one choice at a time, take the best change, until no change is better.

    Args:
        best: the protocol to begin with.
        compute: returns the result of a cell.
        progress: called after each protocol.

    Yields:
        Every round; no variation of the last one's protocol is better than it.
    """
    while True:
        variations = []
        for name, values in SPACE.items():
            for value in values:
                if value != best.choices[name]:
                    outcome = judge({**best.choices, name: value}, compute, float("inf"))
                    variations.append((name, value, outcome))
                    progress()
        yield Round(best, variations)
        better = min((one for _, _, one in variations), key=lambda one: one.loss)
        if better.loss >= best.loss:
            return
        best = better
