# Copyright 2026 The sparse_coord_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Targets of a call: whole experiments, conditions, single learning runs."""

import re
from collections.abc import Sequence
from dataclasses import dataclass

from sparse_coord_ros.base.errors import SettingError, did_you_mean
from sparse_coord_ros.core.game.plugins import allow_named
from sparse_coord_ros.studies.catalogue import NAMES, Experiment, experiment
from sparse_coord_ros.studies.conditions import Condition, parse_id
from sparse_coord_ros.studies.store import Plan, computation_digest


@dataclass(frozen=True)
class Targets:
    """The targets of a call, each once.

    Attributes:
        experiments: whole experiments, in the order of `NAMES`.
        conditions: those of the experiments, and those named.
        runs: single runs: their condition and their number.
    """

    experiments: tuple[Experiment, ...]
    conditions: tuple[Condition, ...]
    runs: tuple[tuple[Condition, int], ...]


def parse_targets(asked: Sequence[str | Condition], plan: Plan) -> Targets:
    """Return the targets from names of experiments and ids of conditions and single runs.

    Args:
        asked: names, ids and conditions.
        plan: first seed, learning runs and trials.

    Raises:
        SettingError: neither an experiment nor an id; a single run that the plan does not have;
            two scenario files of one name.
        ScenarioError: an id with an unknown scenario.
    """
    chosen = tuple(experiment(name) for name in NAMES if name in asked)
    conditions = {one.id: one for each in chosen for one in each.conditions}
    runs: dict[str, tuple[Condition, int]] = {}
    digests: dict[str, str] = {}
    for target in asked:
        if target in NAMES:
            continue
        condition, number = _condition_and_run(target)
        digest = computation_digest(condition)
        if digests.setdefault(condition.id, digest) != digest:
            raise SettingError(
                f"id {condition.id!r}: another scenario file of the name "
                f"{condition.scenario.name!r} is asked for too; give one of them another with "
                "the field 'name'"
            )
        if number is None:
            conditions[condition.id] = condition
        elif number < plan.runs:
            runs[f"{condition.id}/{number}"] = condition, number
        else:
            raise SettingError(
                f"id {condition.id}/{number}: run {number} is not one of {plan.runs}; choose a "
                f"number below {plan.runs} or more --runs"
            )
    return Targets(chosen, tuple(conditions.values()), tuple(runs.values()))


def _condition_and_run(target: str | Condition) -> tuple[Condition, int | None]:
    """Return a condition that is asked for; and the number of a run, None for all of them."""
    if isinstance(target, Condition):
        return target, None
    if "/" not in target:
        raise SettingError(
            f"unknown experiment {target!r}{did_you_mean(target, NAMES)}; allowed: "
            f"{', '.join(NAMES)}, or an id such as env1/coop/penalty=-20"
        )
    # The user names these modules, and so allows them to be imported.
    for word in re.split("[/,=]", target):
        allow_named(word)
    return parse_id(target)
