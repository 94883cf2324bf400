# Copyright 2026 The sparse_coord_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Conditions of experiments: a scenario, a learner, some settings.

A condition is named by an id such as `env1/coop/penalty=-20`. The scenario may be given as the
path of a file; the condition's own id then has the scenario's name, which must not be a shipped
scenario's. The user's own learner is given as `module:Class`: `env1/my_team:Team/penalty=-20`.
"""

import os
from collections.abc import Mapping
from dataclasses import dataclass, field
from functools import cache, cached_property, lru_cache

from sparse_coord_ros.base.errors import ScenarioError, SettingError, in_short
from sparse_coord_ros.base.share import share_file
from sparse_coord_ros.core.game.buildings import building
from sparse_coord_ros.core.game.scenario import Scenario, load_scenario, scenario_names
from sparse_coord_ros.core.game.settings import as_text, parse_assignments
from sparse_coord_ros.core.learners.registry import learner_of


@dataclass(frozen=True)
class Condition:
    """One condition of an experiment.

    Attributes:
        name: name of a shipped scenario or unseen building, or path of a scenario file.
        learner: name of a learner.
        settings: the penalty, and the settings that differ from the scenario, as texts.
        given: the scenario, where it is neither shipped nor read from a file.
    """

    name: str
    learner: str
    settings: tuple[tuple[str, str], ...]
    given: Scenario | None = field(default=None, compare=False, repr=False)

    @property
    def id(self) -> str:
        """`scenario/learner/key=value,key=value`, penalty first: of plain names, never a path."""
        changes = ",".join(f"{key}={value}" for key, value in self.settings)
        return f"{self._base.name}/{self.learner}/{changes}"

    @cached_property
    def scenario(self) -> Scenario:
        """The scenario with the condition's settings, and its learner's defaults."""
        scenario = self._base.changed(dict(self.settings))
        return learner_of(self.learner).with_defaults(scenario)

    @property
    def own_scenario(self) -> Scenario | None:
        """The user's own scenario without the condition's settings; None for a shipped one."""
        base = self._base
        return None if _is_known(base.name) else base

    @property
    def _base(self) -> Scenario:
        return self.given or _load(self.name)


def _load(name: str) -> Scenario:
    if name in _shipped_names():
        return _read(str(share_file("config", f"{name}.yaml")), shipped=True)
    if os.path.isfile(name):
        return _read(os.path.abspath(name), shipped=False)
    # an unseen building; else it raises an error
    return _read(name, shipped=True)


@cache
def _shipped_names() -> frozenset[str]:
    return frozenset(scenario_names())


@lru_cache(maxsize=256)
def _read(path: str, *, shipped: bool) -> Scenario:
    scenario = load_scenario(path)
    if not shipped and scenario.name in _shipped_names():
        raise _misnamed(path, scenario)
    return scenario


def _is_known(name: str) -> bool:
    """True if a name is that of a shipped scenario or a generated building."""
    return name in _shipped_names() or building(name) is not None


def _misnamed(source: str, scenario: Scenario) -> ScenarioError:
    return ScenarioError(
        f"{source}: its name {scenario.name!r} is that of a shipped scenario, and results are "
        "filed by name; give it another with the field 'name', or rename the file"
    )


def _changed(scenario: Scenario) -> dict[str, object] | None:
    """Return the changed settings of a shipped scenario or building; None for any other one."""
    if not _is_known(scenario.name):
        return None
    shipped = _load(scenario.name)
    plain = scenario.plain_settings
    if (shipped.map, shipped.robots) != (scenario.map, scenario.robots):
        raise _misnamed("scenario", scenario)
    new = scenario.given - shipped.given
    changed = {n for n in plain if plain[n] != shipped.plain_settings[n]}
    return {name: plain[name] for name in new | changed}


def make_condition(
    name: str | Scenario, learner: str, settings: Mapping[str, object]
) -> Condition:
    """Return a condition in its one canonical form.

    Args:
        name: name of a shipped scenario or unseen building, or path of a scenario file; or a
            scenario.
        learner: name of a learner.
        settings: changed settings of the scenario.

    Raises:
        ScenarioError: no such scenario, or a malformed one.
        SettingError: an unknown learner or setting, or a bad value.
    """
    rule = learner_of(learner)
    given = None
    if isinstance(name, Scenario):
        changed_already = _changed(name)
        given = name if changed_already is None else None
        name = name.name
        settings = {**(changed_already or {}), **settings}
    base = given or _load(name)
    changed = rule.with_defaults(base.changed(settings))
    rule.check(changed)
    kept = []
    for key in sorted(settings):
        if key == "penalty":
            continue
        # A learner's default may depend on the other settings.
        others = {name: value for name, value in settings.items() if name != key}
        usual = rule.with_defaults(base.changed(others))
        if getattr(changed, key) != getattr(usual, key):
            kept.append((key, as_text(getattr(changed, key))))
    return Condition(
        name, rule.label, (("penalty", as_text(changed.penalty)), *kept), given
    )


def parse_id(text: str, given: Scenario | None = None) -> Condition:
    """Return the condition of an id.

    Args:
        text: the id.
        given: the scenario that it names; None: it is looked up.

    Raises:
        ScenarioError: no such scenario.
        SettingError: not an id; an unknown learner or setting; a bad value.
    """
    *path, last = text.split("/")
    if len(path) < 2:
        what = f"id {in_short(text)}: must be scenario/learner/settings"
        raise SettingError(f"{what}; e.g. env2-4r/coop/penalty=-20")
    *name, learner = path
    try:
        assignments = last.split(",")
        settings = parse_assignments(assignments)
        if len(settings) < len(assignments):
            raise SettingError("a setting is there twice; give each once")
        return make_condition(given or "/".join(name), learner, settings)
    except SettingError as error:
        raise type(error)(f"id {in_short(text)}: {error}") from None
