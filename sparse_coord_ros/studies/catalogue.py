# Copyright 2026 The sparse_coord_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The experiments as data: the paper's Section 4, and the questions of its Section 5."""

from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass
from functools import cache
from itertools import product
from types import MappingProxyType

from sparse_coord_ros.core.game.scenario import PEERS
from sparse_coord_ros.studies.conditions import Condition, make_condition
from sparse_coord_ros.studies.paper import PENALTY

SMALL = ("env1", "env2-2r", "env2-4r")
"""Scenarios of the paper's Tables 1 and 2."""

LARGE = ("cit", "cmu", "isr", "mit", "pentagon", "suny")
"""Scenarios of the paper's Table 3."""

REPORTED_LEARNERS = ("indiv", "noncoop", "coop", "voi")
"""In the order of the paper's tables; the last one is not the paper's."""

PENALTIES = (0, -0.1, -1, -10, -20, -100)
"""Figure 4's, and that of the tables."""

PAYING_PAIRS = ("env1", "env2-2r", "pentagon")
"""Two-robot scenarios in which coordination pays at a penalty of -100."""

LONG: Mapping[str, object] = {"penalty": -100, "steps": 100_000}
"""Where the penalty is large and there is time to learn."""

ASK_COSTS = (0, 0.5, 1, 2, 3, 5, 7, 10)
PROBABILITIES = (0, 0.25, 0.5, 0.75, 0.9, 1)
RANGES = (1, 2, 3, 4, 6)
SHARES = ("same", "each:1:0.5", "each:1:0", "each:2:0")
CROWDS = (2, 3, 4, 6, 8)


@dataclass(frozen=True)
class Experiment:
    """One experiment.

    Attributes:
        name: its name for `reproduce`.
        conditions: its conditions.
    """

    name: str
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
    conditions = []
    for name in names:
        for values in product(*over.values()):
            given = {**same, **dict(zip(over, values, strict=True))}
            conditions.append(make_condition(name, str(given.pop("learner")), given))
    return conditions


def _tables(names: Iterable[str]) -> list[Condition]:
    return _every(names, {"learner": REPORTED_LEARNERS}, {"penalty": PENALTY})


def _figure4() -> list[Condition]:
    over = {"learner": REPORTED_LEARNERS, "penalty": PENALTIES}
    return _every(SMALL + LARGE, over) + _every(SMALL, over, LONG)


def _sweep(setting: str, values: Iterable[object]) -> list[Condition]:
    return _every(PAYING_PAIRS, {"learner": ["coop", "voi"], setting: values}, LONG)


def _ask_cost() -> list[Condition]:
    """Return `coop` and `voi` at each cost, and once `noncoop`, which cannot ask."""
    return _sweep("ask_cost", ASK_COSTS) + _every(
        PAYING_PAIRS, {"learner": ["noncoop"]}, LONG
    )


def _perception() -> list[Condition]:
    values = [f"probability:{p}" for p in PROBABILITIES]
    values += ["line_of_sight", *(f"range:{cells}" for cells in RANGES)]
    return _sweep("perception", values)


def _crowd() -> list[Condition]:
    conditions = []
    for name in (f"crowd-{robots}r" for robots in CROWDS):
        conditions.append(make_condition(name, "noncoop", LONG))
        conditions += _every([name], {"learner": ["coop"], "peers": PEERS}, LONG)
        conditions.append(make_condition(name, "voi", LONG))
    return conditions


def _uneven() -> list[Condition]:
    over = {"common_reward": SHARES, "learner": ("noncoop", "coop")}
    return _every(PAYING_PAIRS, over, LONG)


_EXPERIMENTS: Mapping[str, Callable[[], list[Condition]]] = {
    # The paper's: Tables 1 to 3, and Figure 4.
    "table1": lambda: _tables(SMALL),
    "table2": lambda: _tables(SMALL),
    "table3": lambda: _tables(LARGE),
    "figure4": _figure4,
    # Where the penalty is large, with time to learn.
    "penalty100": lambda: _every(PAYING_PAIRS, {"learner": REPORTED_LEARNERS}, LONG),
    # The paper's open questions: cost of a question, how often questions are answered, r^C that
    # differs between the robots, and more robots (footnote 3).
    "ask_cost": _ask_cost,
    "perception": _perception,
    "uneven": _uneven,
    "crowd": _crowd,
}

NAMES = tuple(_EXPERIMENTS)
"""Every experiment, in the order of the paper."""


def experiment_names() -> list[str]:
    """Return the name of every experiment, in the order of the paper."""
    return list(NAMES)


@cache
def experiment(name: str) -> Experiment:
    """Return the experiment of one of `NAMES`."""
    return Experiment(name, tuple(_EXPERIMENTS[name]()))
