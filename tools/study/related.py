# Copyright 2026 The sparse_coord_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The study of docs/related.md: all learners on maps old and new, asking priced and free."""

from collections.abc import Mapping
from itertools import product
from pathlib import Path

import sparse_coord_ros
from sparse_coord_ros.base.errors import SettingError
from sparse_coord_ros.core.game.scenario import load_scenario
from sparse_coord_ros.core.learners.registry import learner_of
from sparse_coord_ros.core.solve.shipped import known_best
from sparse_coord_ros.studies.catalogue import LONG
from sparse_coord_ros.studies.condition_result import ConditionResult
from sparse_coord_ros.studies.conditions import make_condition
from tools.study import coordination
from tools.study.coordination import (
    Found,
    Rows,
    Study,
    learning_seconds,
    return_and_failed,
)

SEED = 1_300_000
RUNS = 100
TRIALS = 200
"""Seeds that no search has seen."""

LEARNERS: Mapping[str, tuple[str, ...]] = {
    "indiv": ("baselines",),
    "noncoop": ("baselines",),
    "coop": ("coop",),
    "factored": ("factored",),
    "cq": ("cq", "lone"),
    "joint": ("joint", "lone"),
}
"""Learners, and the modules of each."""

KINDS = ("door", "corridor", "rooms", "loop")
BUILDINGS = tuple(f"unseen1-{kind}-{team}r-0" for team in (2, 4) for kind in KINDS)
"""Of those for tuning."""

SCENARIOS = ("env1", "env2-2r", "env2-4r", "pentagon", "isr", "cit", "cmu", *BUILDINGS)


def _return(
    found: Found, name: str, learner: str, price: int
) -> ConditionResult | None:
    """Return a learner's result; None where it cannot learn the scenario, or price is nothing."""
    try:
        condition = make_condition(name, learner, {**LONG, "ask_cost": price})
    except SettingError:
        return None
    return found(condition) if price or learner_of(learner).asks else None


def _learners(found: Found) -> Rows:
    for name, price in product(SCENARIOS, (1, 0)):
        row: dict[str, str | None] = {"scenario": name, "a question costs": f"{price}"}
        for learner in LEARNERS:
            one = _return(found, name, learner, price)
            row[learner] = None if one is None else return_and_failed(one)
        row["best known"] = _best_known(name) if price else None
        yield row


def _best_known(name: str) -> str | None:
    """Return the best known value of a scenario, with its cost of asking."""
    value = known_best(
        load_scenario(name).with_settings(LONG)
    ) or coordination.ROUTES.get(name)
    return None if value is None else f"{value:.2f}"


def _costs(_found: Found) -> Rows:
    learn = Path(sparse_coord_ros.__file__).parent / "core" / "learners"
    for learner, modules in LEARNERS.items():
        texts = [(learn / f"{module}.py").read_text("utf-8") for module in modules]
        seconds = learning_seconds(
            load_scenario("env2-2r").with_settings(LONG), learner
        )
        yield {
            "learner": learner,
            "seconds a run": f"{seconds:.3f}",
            "lines": str(sum(text.count("\n") for text in texts)),
            "modules": ", ".join(modules),
        }


PAIRS = ("env1", "env2-2r", "pentagon")

SHARED = ("credit", "epsilon", "starts", "step_size")
"""Settings whose defaults are factored's own."""


def _settings(found: Found) -> Rows:
    """Yield what other learners earn with the settings of factored."""
    defaults = learner_of("factored").defaults
    shared = {name: defaults[name] for name in SHARED}
    for learner in ("coop", "cq"):
        for what, more in (("its own", {}), ("those of factored", shared)):
            row: dict[str, str | None] = {"learner": learner, "settings": what}
            for name in PAIRS:
                row[name] = return_and_failed(
                    found(make_condition(name, learner, {**LONG, **more}))
                )
            yield row


STUDIES = (
    Study("learners", (RUNS, RUNS), TRIALS, _learners, SEED, "related.md"),
    Study("settings", (RUNS, RUNS), TRIALS, _settings, SEED, "related.md"),
    Study("costs", (RUNS, RUNS), TRIALS, _costs, SEED, "related.md"),
)
