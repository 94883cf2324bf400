# Copyright 2026 The sparse_coord_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The experiments as data: the paper's Section 4, and the questions of its Section 5."""

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from functools import cache
from itertools import product
from types import MappingProxyType

from sparse_coord_ros.base.errors import SettingError
from sparse_coord_ros.core.game.scenario import PEERS
from sparse_coord_ros.core.game.unseen import SPLITS, TEAMS, split_of, team_of
from sparse_coord_ros.core.solve.shipped import known_best, unseen_buildings
from sparse_coord_ros.studies.conditions import Condition, make_condition

SMALL = ("env1", "env2-2r", "env2-4r")
"""Scenarios of the paper's Tables 1 and 2."""

LARGE = ("cit", "cmu", "isr", "mit", "pentagon", "suny")
"""Scenarios of the paper's Table 3."""

REPORTED_LEARNERS = ("indiv", "noncoop", "coop", "factored")
"""In the order of the paper's tables; the last one is not the paper's."""

PENALTIES = (0, -0.1, -1, -10, -20, -100)
"""Figure 4's, and that of the tables."""

PAYING_PAIRS = ("env1", "env2-2r", "pentagon")
"""Two-robot scenarios in which coordination pays at a penalty of -100."""

CLOSED: Mapping[str, float] = {"env1": 0.8, "env2-2r": 0.5, "pentagon": 0.5}
"""Share of the gap between Non-coop. and the optimum that Coop. is to close there."""

REACHED: Mapping[str, float] = {"env1": 0.97, "env2-2r": 0.9, "pentagon": 0.98}
"""Share of the gain over Non-coop. of the best asking team found that Factored is to close."""

FALLS: Mapping[str, float] = {"env1": 1.1, "env2-2r": 1.35}
"""From a penalty of 0 to -100 Factored may lose as many times what the best asking team does.

Scenarios without a limit here are not judged.
"""

LONG: Mapping[str, object] = {"penalty": -100, "steps": 100_000}
"""Where the penalty is large and there is time to learn."""

ASK_COSTS = (0, 0.5, 1, 2, 3, 5, 7, 10)
PROBABILITIES = (0, 0.25, 0.5, 0.75, 0.9, 1)
RANGES = (1, 2, 3, 4, 6)
SHARES = ("same", "each:1:0.5", "each:1:0", "each:2:0")
CROWDS = (2, 3, 4, 6, 8)

WHEN: Mapping[str, object] = {"prior": "map", "steps": 30_000}
"""Settings of the experiment on when to coordinate: robots know their map."""

WHEN_PENALTIES = (-5, -20, -100, -500)
WHEN_COSTS = (0.2, 1, 5)
WHEN_CHANCES = (0.5, 0.2)
"""Probabilities of an answer, beside 1."""

WHEN_PAIRS = (
    *("env1", "isr", "env2-2r", "mit", "pentagon", "suny", "cit", "cmu"),
    *("unseen1-door-2r-1", "unseen1-door-2r-3"),
    *("unseen1-doors-2r-1", "unseen1-doors-2r-101"),
    *("unseen1-corridor-2r-1", "unseen1-corridor-2r-3"),
    *("unseen1-rooms-2r-1", "unseen1-rooms-2r-3"),
    *("unseen1-loop-2r-1", "unseen1-loop-2r-105"),
    *("unseen1-crossing-2r-5", "unseen1-crossing-2r-105"),
    *("unseen1-crossing-2r-103", "unseen1-door-2r-101"),
    *("unseen1-rooms-2r-105", "building-2x2x3-2r-1"),
    *("building-2x1x4-2r-0", "building-2x1x4-2r-3"),
    *("building-4x1x3-2r-1", "building-4x1x3-2r-3"),
    *("building-2x2x3-2r-3", "building-3x2x3-2r-0"),
)
"""Maps of two robots that meet, on shortest paths, in 0 to 75 of 100 episodes."""

WHEN_TEAMS = (
    *("unseen1-doors-4r-1", "unseen1-rooms-4r-1", "unseen1-crossing-4r-1"),
    *("unseen1-door-4r-1", "unseen1-loop-4r-1", "building-3x2x3-4r-1"),
    *("unseen1-doors-8r-1", "unseen1-rooms-8r-1", "unseen1-crossing-8r-1"),
    *("unseen1-door-8r-1", "unseen1-loop-8r-1", "building-4x2x3-8r-1"),
)
"""Maps of four and of eight robots."""

WHEN_TEAM_PENALTIES = (-1, -5, -20, -100)
"""Less than those of pairs: larger teams meet more often."""

WHEN_KINDS = ("together:anywhere", "swap", "block", "block:anywhere")
"""Kinds of interaction beside `together`, each by itself."""

WHEN_KIND_COSTS: Mapping[str, Sequence[float]] = {
    "together:anywhere": (1, 5),
    "swap": (1, 5),
    "block": (0.2, 1, 5, 20),
    "block:anywhere": (0.2, 1, 5, 20),
}
"""Costs of a question. A stop costs time and no penalty, so `block` has more of them."""


@dataclass(frozen=True)
class Experiment:
    """One experiment.

    Attributes:
        name: its name for `reproduce`.
        title: its title.
        conditions: its conditions.
    """

    name: str
    title: str
    conditions: tuple[Condition, ...]


def _every(
    names: Iterable[str],
    over: Mapping[str, Iterable[object]],
    same: Mapping[str, object] = MappingProxyType({}),
) -> list[Condition]:
    """Return a condition for each scenario and combination of values.

    Args:
        names: of the scenarios.
        over: the values of each setting; under `learner`, learners.
        same: settings of all of them.
    """
    found = []
    for name in names:
        for values in product(*over.values()):
            given = {**same, **dict(zip(over, values, strict=True))}
            found.append(make_condition(name, str(given.pop("learner")), given))
    return found


def _tables(names: Iterable[str]) -> list[Condition]:
    return _every(names, {"learner": REPORTED_LEARNERS}, {"penalty": -20})


def _figure4() -> list[Condition]:
    over = {"learner": REPORTED_LEARNERS, "penalty": PENALTIES}
    return _every(SMALL + LARGE, over) + _every(SMALL, over, LONG)


def _sweep(setting: str, values: Iterable[object]) -> list[Condition]:
    return _every(PAYING_PAIRS, {"learner": ["coop"], setting: values}, LONG)


def _ask_cost() -> list[Condition]:
    """Return Coop. at each cost, and once Non-coop., which cannot ask, in the same problem."""
    return _sweep("ask_cost", ASK_COSTS) + _every(
        PAYING_PAIRS, {"learner": ["noncoop"]}, LONG
    )


def _perception() -> list[Condition]:
    values = [f"probability:{p}" for p in PROBABILITIES]
    values += ["line_of_sight", *(f"range:{cells}" for cells in RANGES)]
    return _sweep("perception", values)


def _crowd() -> list[Condition]:
    found = []
    for name in (f"crowd-{robots}r" for robots in CROWDS):
        found.append(make_condition(name, "noncoop", LONG))
        found += _every([name], {"learner": ["coop"], "peers": PEERS}, LONG)
        found.append(make_condition(name, "factored", LONG))
    return found


def unseen_conditions(
    learner: str,
    split: str,
    settings: Mapping[str, object],
    robots: Sequence[int] = TEAMS,
) -> tuple[Condition, ...]:
    """Return a condition for each building of a split.

    Args:
        learner: name of the learner.
        split: one of `SPLITS`.
        settings: changed settings; the penalty stays, the bounds are those of this game.
        robots: which sizes of teams.

    Raises:
        SettingError: an unknown learner, split, size or setting, or one that changes the game.
    """
    if split not in SPLITS:
        raise SettingError(f"split: value is {split!r}, allowed: {', '.join(SPLITS)}")
    unknown = [team for team in robots if team not in TEAMS]
    if unknown or not robots:
        more = f"allowed: {', '.join(map(str, TEAMS))}"
        raise SettingError(
            f"robots: value is {', '.join(map(str, unknown)) or 'none'}, {more}"
        )
    made = tuple(
        make_condition(name, learner, settings)
        for name in unseen_buildings()
        if split_of(name) == split and team_of(name) in robots
    )
    if known_best(made[0].scenario) is None:
        raise SettingError(
            f"benchmark: with {', '.join(sorted(settings.keys() - {'steps'}))} another game "
            "would be played, and its bounds are unknown; change settings of learning only"
        )
    return made


def _unseen() -> list[Condition]:
    return [
        one
        for learner in REPORTED_LEARNERS
        for one in unseen_conditions(learner, "validation", {})
    ]


def _when() -> list[Condition]:
    """Return pairs at each penalty and cost; other learners, chances and teams at cost 1.

    And pairs that interact in other ways.
    """
    penalties = {"penalty": WHEN_PENALTIES}
    over = {"learner": ["factored"], **penalties, "ask_cost": WHEN_COSTS}
    found = _every(WHEN_PAIRS, over, WHEN)
    over = {"learner": ["coop", "cq", "noncoop"], **penalties}
    found += _every(WHEN_PAIRS, over, WHEN)
    chances = [f"probability:{chance}" for chance in WHEN_CHANCES]
    over = {"learner": ["factored"], **penalties, "perception": chances}
    found += _every(WHEN_PAIRS, over, WHEN)
    over = {"learner": ["factored"], "penalty": WHEN_TEAM_PENALTIES}
    found += _every(WHEN_TEAMS, over, WHEN)
    for kind in WHEN_KINDS:
        fixed = kind.startswith("block")
        over = {
            "learner": ["factored"],
            "penalty": [-100] if fixed else WHEN_PENALTIES,
            "ask_cost": WHEN_KIND_COSTS[kind],
        }
        found += _every(WHEN_PAIRS, over, {**WHEN, "interactions": kind})
    return found


_EXPERIMENTS: Mapping[str, tuple[str, Callable[[], list[Condition]]]] = {
    "table1": ("Table 1: total discounted reward", lambda: _tables(SMALL)),
    "table2": ("Table 2: time to goal and miscoordinations", lambda: _tables(SMALL)),
    "table3": ("Table 3: the large scenarios", lambda: _tables(LARGE)),
    "figure4": ("Figure 4: return against the penalty", _figure4),
    "penalty100": (
        "Penalty -100, 10^5 steps: share of the gain over Non-coop.",
        lambda: _every(PAYING_PAIRS, {"learner": REPORTED_LEARNERS}, LONG),
    ),
    "ask_cost": ("Cost of a question", _ask_cost),
    "perception": ("How often questions are answered", _perception),
    "uneven": (
        "r^C that differs between the robots",
        lambda: _every(
            PAYING_PAIRS,
            {"common_reward": SHARES, "learner": ("noncoop", "coop")},
            LONG,
        ),
    ),
    "crowd": ("More robots: asking one random peer, or all peers (footnote 3)", _crowd),
    "where": (
        "Where on the map robots ask",
        lambda: _every(SMALL + LARGE, {"learner": ["coop"]}, LONG),
    ),
    "unseen": ("Generated buildings", _unseen),
    "when": ("When robots should coordinate", _when),
}

NAMES = tuple(_EXPERIMENTS)
"""Every experiment, in the order in which they are reported."""


def experiment_names() -> list[str]:
    """Return the name of every experiment, in the order in which they are reported."""
    return list(NAMES)


@cache
def experiment(name: str) -> Experiment:
    """Return the experiment of one of `NAMES`."""
    title, conditions = _EXPERIMENTS[name]
    return Experiment(name, title, tuple(conditions()))
