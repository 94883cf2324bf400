# Copyright 2026 The sparse_coord_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Targets of a call: whole experiments, and conditions."""

import re
from collections.abc import Sequence
from dataclasses import dataclass

from sparse_coord_ros.base.errors import SettingError, did_you_mean
from sparse_coord_ros.core.game.plugins import allow_named
from sparse_coord_ros.studies.catalogue import NAMES, Experiment, experiment
from sparse_coord_ros.studies.conditions import Condition, parse_id
from sparse_coord_ros.studies.store import computation_digest


@dataclass(frozen=True)
class Targets:
    """The targets of a call, each once.

    Attributes:
        experiments: whole experiments, in the order of `NAMES`.
        conditions: those of the experiments, and those named.
    """

    experiments: tuple[Experiment, ...]
    conditions: tuple[Condition, ...]


def parse_targets(asked: Sequence[str | Condition]) -> Targets:
    """Return the targets from names of experiments and ids of conditions.

    Args:
        asked: names, ids and conditions.

    Raises:
        SettingError: neither an experiment nor an id; two scenario files of one name.
        ScenarioError: an id with an unknown scenario.
    """
    chosen = tuple(experiment(name) for name in NAMES if name in asked)
    conditions = {
        condition.id: condition for whole in chosen for condition in whole.conditions
    }
    digests: dict[str, str] = {}
    for target in asked:
        if target in NAMES:
            continue
        condition = _condition(target)
        digest = computation_digest(condition)
        if digests.setdefault(condition.id, digest) != digest:
            raise SettingError(
                f"id {condition.id!r}: another scenario file of the name "
                f"{condition.scenario.name!r} is asked for too; give one of them another with "
                "the field 'name'"
            )
        conditions[condition.id] = condition
    return Targets(chosen, tuple(conditions.values()))


def _condition(target: str | Condition) -> Condition:
    """Return a condition that is asked for."""
    if isinstance(target, Condition):
        return target
    if "/" not in target:
        raise SettingError(
            f"unknown experiment {target!r}{did_you_mean(target, NAMES)}; allowed: "
            f"{', '.join(NAMES)}, or an id such as env1/coop/penalty=-20"
        )
    # The user names these modules, and so allows them to be imported.
    for word in re.split("[/,=]", target):
        allow_named(word)
    return parse_id(target)
