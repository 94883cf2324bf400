# Copyright 2026 The sparse_coord_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Conditions of experiments: a scenario, a learner, some settings.

A condition is named by an id such as `env1/coop/penalty=-20`. An id with a number after it,
`env1/coop/penalty=-20/3`, is one learning run of it: the run with seed S + 3 in a batch with seed
S. The scenario may be given as the path of a file; the condition's own id then has the scenario's
name, which no shipped scenario may have. A learner of one's own is given as `module:Class`:
`env1/my_team:Team/penalty=-20`.
"""

import os
import re
from collections.abc import Mapping
from dataclasses import dataclass
from functools import cache, cached_property, lru_cache

from sparse_coord_ros.errors import ScenarioError, SettingError
from sparse_coord_ros.game.scenario import Scenario, load_scenario, scenario_names
from sparse_coord_ros.game.settings import parse_assignments
from sparse_coord_ros.learn.learners import learner_of
from sparse_coord_ros.share import share_file


@dataclass(frozen=True)
class Condition:
    """One condition of an experiment.

    Attributes:
        name: name of a shipped scenario or unseen building, or path of a scenario file.
        learner: name of a learner.
        settings: the penalty, and what else differs from the scenario, as texts.
    """

    name: str
    learner: str
    settings: tuple[tuple[str, str], ...]

    @property
    def id(self) -> str:
        """`scenario/learner/key=value,key=value`, penalty first: of plain names, never a path."""
        changes = ",".join(f"{key}={value}" for key, value in self.settings)
        return f"{_load(self.name).name}/{self.learner}/{changes}"

    @cached_property
    def scenario(self) -> Scenario:
        """The scenario with the condition's settings, and its learner's defaults."""
        scenario = _load(self.name).changed(dict(self.settings))
        return learner_of(self.learner).with_defaults(scenario)


def _load(name: str) -> Scenario:
    if name in _shipped_names():
        return _read(str(share_file("config", f"{name}.yaml")), shipped=True)
    if os.path.isfile(name):
        return _read(os.path.abspath(name), shipped=False)
    return _read(name, shipped=True)  # an unseen building; else it says that there is none


@cache
def _shipped_names() -> frozenset[str]:
    return frozenset(scenario_names())


@lru_cache(maxsize=256)
def _read(path: str, *, shipped: bool) -> Scenario:
    scenario = load_scenario(path)
    if not shipped and scenario.name in _shipped_names():
        raise ScenarioError(
            f"{path}: its name {scenario.name!r} is that of a shipped scenario, and results are "
            "filed by name; give it another with the field 'name', or rename the file"
        )
    return scenario


def make_condition(name: str, learner: str, settings: Mapping[str, object]) -> Condition:
    """Return a condition in its one canonical form.

    Args:
        name: name of a shipped scenario or unseen building, or path of a scenario file.
        learner: name of a learner.
        settings: changed settings of the scenario.

    Raises:
        ScenarioError: no such scenario, or a malformed one.
        SettingError: an unknown learner or setting, or a bad value.
    """
    rule = learner_of(learner)
    scenario = rule.with_defaults(_load(name))
    changed = rule.with_defaults(_load(name).changed(settings))
    rule.check(changed)
    kept = [
        (key, _text(getattr(changed, key)))
        for key in sorted(settings)
        if key != "penalty" and getattr(changed, key) != getattr(scenario, key)
    ]
    return Condition(name, rule.label, (("penalty", _text(changed.penalty)), *kept))


def parse_id(text: str) -> tuple[Condition, int | None]:
    """Read an id; the number is that of a run, None for the whole condition.

    Raises:
        ScenarioError: no such scenario.
        SettingError: not an id; an unknown learner or setting; a bad value.
    """
    *path, last = text.split("/")
    number = None
    if last.isdecimal():
        if not re.fullmatch("[0-9]{1,9}", last):
            raise SettingError(
                f"id {_short(text)!r}: the number of a run has 1 to 9 digits 0 to 9; "
                "e.g. env2-4r/coop/penalty=-20/3"
            )
        number = int(last)
        *path, last = path
    if len(path) < 2:
        raise SettingError(
            f"id {_short(text)!r}: must be scenario/learner/settings, or the same with /run; "
            "e.g. env2-4r/coop/penalty=-20 or env2-4r/coop/penalty=-20/3"
        )
    *name, learner = path
    try:
        assignments = last.split(",")
        settings = parse_assignments(assignments)
        if len(settings) < len(assignments):
            raise SettingError("a setting is there twice; give each once")
        condition = make_condition("/".join(name), learner, settings)
    except SettingError as error:
        raise type(error)(f"id {_short(text)!r}: {error}") from None
    return condition, number


def _short(text: str) -> str:
    return text if len(text) <= 200 else f"{text[:97]}...{text[-97:]}"


def _text(value: object) -> str:
    """Return a setting's value as it is read back: 20.0 as 20, and -0.0 as 0."""
    return repr(value + 0.0).removesuffix(".0") if isinstance(value, float) else str(value)
