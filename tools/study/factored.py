# Copyright 2026 The sparse_coord_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The same search for the learner `factored`: what may be chosen, and how it is judged.

Its loss is plain: the reward that is missing to the class bound, the best team of this form, added
up over the conditions of `JUDGED`; of env2-4r, to robots that never meet.
"""

from collections.abc import Mapping

from sparse_coord_ros.experiments.catalogue import LONG
from sparse_coord_ros.experiments.conditions import Condition, make_condition
from sparse_coord_ros.experiments.report.text import Row, of
from sparse_coord_ros.experiments.store import ConditionResult
from sparse_coord_ros.solve.shipped import shipped_class_bound
from tools.study.search import Choices, Compute, Judgement, Task, loss_of, settings_of

PROTOCOLS: Mapping[str, tuple[tuple[float, ...], float]] = {
    "exponent": ((0.4, 0.5, 0.6, 0.8), 0.5),
    "floor_first": ((0.05, 0.1, 0.2), 0.1),
    "floor_last": ((0, 0.005, 0.01, 0.02), 0.01),
    "epsilon_first": ((0.15, 0.2, 0.3, 0.5), 0.3),
    "epsilon_last": ((0, 0.01, 0.02, 0.05), 0.02),
    "epsilon_fraction": ((0.5, 0.8, 1), 0.8),
    "starts_last": ((0, 0.1, 0.2), 0),
    "starts_fraction": ((0.25, 0.5, 0.8), 0.5),
    "q_coord_init": ((0, 100, 200), 200),
    "max_steps": ((50, 100, 200), 100),
}
"""What the learner leaves open: the values tried, and its default. U begins at `q_coord_init`."""

SPACE: Mapping[str, tuple[float, ...]] = {name: row[0] for name, row in PROTOCOLS.items()}
SHIPPED: Choices = {name: row[1] for name, row in PROTOCOLS.items()}
COOPS: Choices = {**SHIPPED, "epsilon_first": 0.15, "starts_last": 0.2}
"""Coop.'s protocol."""

STARTS: Mapping[str, Choices] = {"the learner's defaults": SHIPPED, "Coop.'s protocol": COOPS}

LITTLE: Mapping[str, object] = {"penalty": -20}
JUDGED: Mapping[str, tuple[str, Mapping[str, object]]] = {
    **{f"{name} -100": (name, LONG) for name in ("env1", "env2-2r", "pentagon")},
    **{f"{name} -20": (name, LITTLE) for name in ("env1", "env2-2r", "cmu")},
    **{f"{name} -100": (name, LONG) for name in ("isr", "cit", "cmu", "env2-4r")},
}
"""Where a protocol is judged: at -100 with 10^5 steps, at -20 with the paper's budgets."""


def judge(choices: Choices, compute: Compute, limit: float) -> Judgement:
    """Return what a protocol brings, as of `search.judge`."""
    found = Judgement(choices)
    for text, (name, settings) in JUDGED.items():
        condition = make_condition(name, "factored", {**settings_of(choices), **settings})
        result = found.with_teams(compute(condition))
        found.difference[text] = result.best("reward").mean - best_known(condition, result)
        found.loss -= found.difference[text]
        if found.loss > limit:
            return found
    found.whole = True
    return found


def best_known(condition: Condition, result: ConditionResult) -> float:
    """Return the class bound or, for more than two robots, what robots alone are worth."""
    bound = shipped_class_bound(condition.scenario)
    return result.optimum if bound is None else bound.value


def row(one: Judgement) -> Row:
    """Return what a table says of a protocol: how much reward is missing where."""
    missing = {text: f"{-value:.2f}" for text, value in one.difference.items()}
    failed = of(one.failed_teams, one.teams)
    return {"loss": loss_of(one), **missing, "failed teams": failed}


FACTORED = Task("factored", SPACE, STARTS, judge, row)
