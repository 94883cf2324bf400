# Copyright 2026 The sparse_coord_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The studies of docs/interactions.md: what learners reach, and `factored` without each part."""

from collections.abc import Mapping
from functools import cache
from itertools import product

from sparse_coord_ros.base.percents import percent
from sparse_coord_ros.core.game.scenario import Scenario, load_scenario
from sparse_coord_ros.core.game.unseen import KINDS, VERSIONS
from sparse_coord_ros.core.solve.reference import shortest_path_reference
from sparse_coord_ros.core.solve.shipped import known_optimum
from sparse_coord_ros.studies.catalogue import LONG
from sparse_coord_ros.studies.conditions import make_condition
from sparse_coord_ros.studies.standings import standing
from tools.study.coordination import RULES, Found, Rows, Study

SEED = 5_200_000
"""Seed of the first team."""

SEEDS = (1, 3, 5)
"""Of the buildings of each kind: for validation."""

REACHED_SEED = 77_000
"""Seed of the first team of the study of all learners."""

REACHED_SEEDS = tuple(range(1, 17, 2))
"""Of its buildings."""

CONFLICT = 3.0
"""By how much the joint optimum of a building that counts exceeds shortest paths."""

BLOCKS = ("block:anywhere",)
INTERACTIONS = ("together", "together:anywhere", "swap", *BLOCKS)

PARTS: Mapping[str, tuple[str, Mapping[str, object], tuple[str, ...]]] = {
    "all of it": ("factored", {}, INTERACTIONS),
    "no looking back": (RULES + "NoLookingBack", {}, INTERACTIONS),
    "r^C counts once (`credit: own`)": ("factored", {"credit": "own"}, INTERACTIONS),
    "no percept update of r_bar": (RULES + "NoPerceptUpdate", {}, INTERACTIONS),
    "no replay": (RULES + "NoReplay", {}, INTERACTIONS),
    "exchanges not told from cells": (RULES + "NoExchanges", {}, ("swap",)),
    "stops are slips": (RULES + "NoStops", {}, BLOCKS),
    "a stop counts one step": (RULES + "OneStep", {}, BLOCKS),
}
"""Learner, changed settings, and for which kinds of interaction; in others it changes nothing."""

LEARNERS: Mapping[str, str] = {
    "factored": "factored",
    "factored, only r^C at a cell": RULES + "NoExchanges",
    "factored, stops are slips": RULES + "NoStops",
    "coop": "coop",
    "cq": "cq",
    "joint": "joint",
}
"""Learners of the study of all learners."""

REACHED: Mapping[str, tuple[str, ...]] = {
    "swap": tuple(one for one in LEARNERS if not one.endswith("slips")),
    "block": tuple(one for one in LEARNERS if not one.endswith("cell")),
    "block:anywhere": tuple(one for one in LEARNERS if not one.endswith("cell")),
}
"""Which of them learn each kind of interaction."""


def _reached(found: Found) -> Rows:
    """Yield how the teams of each learner stand, by kind of interaction."""
    for interactions, learners in REACHED.items():
        settings = {**LONG, "interactions": interactions}
        names = _buildings(interactions, REACHED_SEEDS)
        for what in learners:
            results = [
                found(make_condition(name, LEARNERS[what], settings)) for name in names
            ]
            stood = standing(results, _optimum)
            share = stood.share
            yield {
                "interactions": f"`{interactions}`",
                "learner": what,
                "buildings": str(stood.buildings),
                "shortest paths": f"{stood.paths:.2f}",
                "joint optimum": f"{stood.best_known:.2f}",
                "learned": f"{stood.returns.mean:.2f}",
                "share of the gap": f"{percent(share.mean)} ({100 * share.standard_error:.1f})",
                "worst building": percent(stood.worst),
                "failed teams": stood.of_teams(stood.failed),
                "asks": f"{stood.asks:.2f}",
            }


def _table(found: Found) -> Rows:
    """Yield a row for each part; its cells have the share of the gap and the failed teams."""
    for what, (rule, more, kinds) in PARTS.items():
        row = {"what": what}
        for interactions in INTERACTIONS:
            row[f"`{interactions}`"] = "-"
            if interactions in kinds:
                settings = {**LONG, "interactions": interactions, **more}
                results = [
                    found(make_condition(name, rule, settings))
                    for name in _buildings(interactions, SEEDS)
                ]
                stood = standing(results, _optimum)
                row[f"`{interactions}`"] = stood.share_and_failed()
        yield row


@cache
def _buildings(interactions: str, seeds: tuple[int, ...]) -> tuple[str, ...]:
    """Return the buildings with a gap."""
    names = []
    for kind, seed in product(KINDS, seeds):
        name = f"{VERSIONS[0]}-{kind}-2r-{seed}"
        scenario = load_scenario(name).with_settings({"interactions": interactions})
        paths = shortest_path_reference(scenario).returns
        if _optimum(scenario) > paths + CONFLICT:
            names.append(name)
    return tuple(names)


def _optimum(scenario: Scenario) -> float:
    return known_optimum(scenario).value


PAGE = "interactions.md"

STUDIES = (
    Study("reached", (4, 4), 2, _reached, seed=REACHED_SEED, page=PAGE),
    Study("kinds", (8, 8), 2, _table, seed=SEED, page=PAGE),
)
