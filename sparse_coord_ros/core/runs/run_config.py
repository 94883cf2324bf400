# Copyright 2026 The sparse_coord_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The configuration of a run: scenario, seed, learner and timing, also as `run.yaml`.

The world simulator publishes this text once, latched, on the topic `run`; robots and recorder
need nothing else, and the log holds it too.
"""

import hashlib
import json
import platform
import re
from collections.abc import Mapping
from contextlib import suppress
from dataclasses import dataclass, fields, replace
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path
from typing import Any, ClassVar

from sparse_coord_ros.base.errors import (
    RunError,
    SettingError,
    check_format,
    did_you_mean,
)
from sparse_coord_ros.base.files import read_text
from sparse_coord_ros.base.version import FORMAT, __version__
from sparse_coord_ros.base.yaml_text import parse_yaml, to_yaml
from sparse_coord_ros.core.game.grid import GridMap
from sparse_coord_ros.core.game.perception import (
    MODELS,
    check_found_elsewhere,
)
from sparse_coord_ros.core.game.scenario import (
    WHILE_LEARNING,
    Scenario,
    scenario_from_dict,
    scenario_names,
)
from sparse_coord_ros.core.game.settings import setting, settings_of
from sparse_coord_ros.core.game.specs import Form, SpecFamily
from sparse_coord_ros.core.learners.learner import Learner
from sparse_coord_ros.core.learners.registry import (
    LEARNERS,
    learner_of,
)

RUN_FILE = "run.yaml"
SUMMARY_FILE = "summary.yaml"
CELLS = 250_000
"""Most free cells of a map to learn on."""

OWN_CLOCK = "own"
NO_CLOCK = "none"
"""Whether the world publishes /clock."""

RUN_RECORD = "sparse_coord_ros"
"""Name of the bag's metadata record about the run."""


class LearnerName(SpecFamily):
    """The setting that names a learner, as its name or as `module:Class`."""

    @property
    def usage(self) -> str:
        """The allowed names, for help and error texts."""
        return LEARNERS.usage

    @property
    def forms(self) -> tuple[Form, ...]:
        """The learners that are registered."""
        return tuple(
            Form(name, learner.summary) for name, learner in self._registered()
        )

    def _registered(self) -> list[tuple[str, Learner]]:
        return list(LEARNERS.registered.items())

    def parse(self, value: object) -> Any:
        """Return the learner's name in files.

        Raises:
            SettingError: unknown learner.
        """
        named = value if isinstance(value, Learner) else str(value)
        if isinstance(named, str) and LEARNERS.barred(named):
            return named  # looking it up says so, where it is used
        return learner_of(named).label


class LiveLearnerName(LearnerName):
    """The same for a live run; others are refused with a reason where the run is made."""

    @property
    def usage(self) -> str:
        """The allowed names, for help and error texts."""
        shipped = ", ".join(form.text for form in self.forms)
        return f"{shipped}, or one of your own as module:name"

    def _registered(self) -> list[tuple[str, Learner]]:
        return [
            (name, learner)
            for name, learner in super()._registered()
            if learner.runs_live
        ]


BODIES_SUCCEED = 0.95
"""`prior_success` with prior=map and slips=false, unless a user chose one."""

LEARNER = LearnerName("learner")
LIVE_LEARNER = LiveLearnerName("learner")


@dataclass(frozen=True, kw_only=True)
class RunConfig:
    """A run: a scenario, and settings that belong to no scenario.

    `versions` names what computed it. `id` tells one live run from every other: the world makes it
    when it announces the run; what never was live has none.
    """

    scenario: Scenario
    seed: int = setting(0, "seed of every random draw", low=0, high=2**63 - 1)
    learner: str = setting("coop", "learner; coop is Algorithm 1 of the paper", LEARNER)
    greedy: bool = setting(
        False, "act on learned tables, without exploring or learning"
    )
    clock: str = setting(
        NO_CLOCK,
        "own: the world publishes /clock, step t at t * 0.1 s; none: it does not",
        choices=(OWN_CLOCK, NO_CLOCK),
    )
    step_timeout: float = setting(
        5.0, "seconds until a silent robot is left out", low=0.1
    )
    bodies: bool = setting(
        False, "the robots have bodies: each step waits for their drivers"
    )
    slips: bool = setting(
        True,
        "moves also fail at random, as often as in the grid; false: only if a body fails",
    )
    tables: str = setting(
        "", "directory of a run; learning starts from its tables; empty: none"
    )
    recorded: bool = setting(False, "wait for a recorder before the run starts")
    checkpoint: int = setting(
        10_000,
        "record the learned tables every so many time steps; 0: only at the end",
        low=0,
        high=2**31 - 1,
    )
    versions: Mapping[str, str]
    id: str = ""

    step_period: ClassVar[float] = 0.1
    """Simulated seconds a time step."""

    @property
    def resolution(self) -> float:
        """Metres a cell: those of the map, or 1."""
        return self.scenario.map.resolution or 1.0

    @property
    def percept_timeout(self) -> float:
        """Seconds until an unanswered question fails: 2 of the default's 5 for a silent robot."""
        return 0.4 * self.step_timeout

    @property
    def sees_all(self) -> bool:
        """True if its robots learn from the cells of all their peers in every step."""
        return not self.greedy and self.scenario.peers_seen == WHILE_LEARNING

    @property
    def rule(self) -> Learner:
        """The learner that the run names.

        Raises:
            NotAllowedError: its code may not be imported.
        """
        return learner_of(self.learner)

    @property
    def known_rule(self) -> Learner | None:
        """The learner that the run names; None where its code may not be imported."""
        return None if LEARNERS.barred(self.learner) else self.rule

    @property
    def title(self) -> str:
        """What its learner is called in print.

        It names the information that the robots learned from if it is not that of Algorithm 1.
        """
        title = self.learner
        if self.scenario.peers_seen == WHILE_LEARNING:
            title += ", peers seen while learning"
        return title

    def check_code(self) -> None:
        """Raise `NotAllowedError` where the code that it names may not be imported."""
        learner_of(self.learner)
        MODELS.find(self.scenario.perception.kind)

    @property
    def digest(self) -> str:
        """A digest of everything that affects learning: equal digests mean equal bits."""
        content = [
            self.learner,
            self.seed,
            self.greedy,
            self.tables,
            self.scenario.computation(),
        ]
        if self.bodies:
            content.append({"slips": self.slips})
        return hashlib.sha256(json.dumps(content, sort_keys=True).encode()).hexdigest()[
            :16
        ]

    def to_yaml(self) -> str:
        """Return the text of `run.yaml`; `run_from_yaml` reads it back.

        Raises:
            SettingError: other processes cannot find its perception model, a function.
        """
        check_found_elsewhere(self.scenario.perception)
        data: dict[str, Any] = {"id": self.id, "format": FORMAT}
        data |= {f.name: getattr(self, f.name) for f in fields(self)}
        data["scenario"] = self.scenario.to_dict()
        data["versions"] = dict(self.versions)
        if not self.id:
            del data["id"]
        return to_yaml(data)

    @staticmethod
    def identity(text: bytes) -> str:
        """Return the `id` that the text of a live run begins with, without reading it."""
        match = re.match(rb"id: '?(\w{1,99})'?\n", text)
        return match[1].decode() if match else ""

    def record(self) -> dict[str, str]:
        """Return the texts of the bag's metadata record."""
        named = {
            "scenario": self.scenario.name,
            "seed": str(self.seed),
            "learner": self.learner,
        }
        if self.scenario.peers_seen == WHILE_LEARNING:
            named["peers_seen"] = WHILE_LEARNING
        if self.id:
            named["id"] = self.id
        return named | {
            f"version_{name}": str(value) for name, value in self.versions.items()
        }


RUN_SETTINGS = settings_of(RunConfig)
"""Parameters of a run that belong to no scenario."""


def make_run(scenario: Scenario, values: Mapping[str, object]) -> RunConfig:
    """Build a run of this software's versions.

    Args:
        scenario: the problem.
        values: some of `RUN_SETTINGS`; the others take their defaults.

    Raises:
        SettingError: an unknown name or a bad value.
    """
    settings = RUN_SETTINGS.parse(values)
    learner = learner_of(settings.get("learner", RunConfig.learner))
    scenario = learner.with_defaults(scenario)
    if not settings.get("slips", True):
        scenario = _known_to_bodies(scenario)
    learner.check(scenario)
    _check_size(scenario.map)
    run = RunConfig(scenario=scenario, versions=versions(), **settings)
    run.check_code()
    return run


def _known_to_bodies(scenario: Scenario) -> Scenario:
    """Return a scenario in which robots that know their map know how seldom bodies fail.

    The moves of the world do not fail at random then, so `move_success` says nothing of them.
    """
    if scenario.prior != "map" or "prior_success" in scenario.given:
        return scenario
    known = scenario.with_settings({"prior_success": BODIES_SUCCEED})
    return replace(known, given=scenario.given)


def _check_size(grid: GridMap) -> None:
    """Raise `SettingError` where a map is too large to learn on."""
    cells = len(grid.cells)
    if cells > CELLS:
        raise SettingError(
            f"map {grid.name} has {cells:,} cells, allowed in learning: at most {CELLS:,}; take "
            "larger cells (import-map --cell) or a part of the map"
        )


def versions() -> dict[str, str]:
    """Return the versions of software on which a run's numbers depend."""
    installed = {
        "sparse_coord_ros": __version__,
        "python": platform.python_version(),
    }
    for name in (
        "numpy",
        "PyYAML",
        "mcap",
        "rclpy",
        "rmw_fastrtps_cpp",
        "ros-rmw-fastrtps-cpp",
    ):
        with suppress(PackageNotFoundError):
            installed[name] = version(name)
    return installed


def run_from_yaml(text: str, *, where: str) -> RunConfig:
    """Read a run back; settings that the text lacks have their defaults.

    Raises:
        RunError: the text is no run, has an unknown field, or has another format.
        ScenarioError: not YAML, or the scenario in it is malformed.
        SettingError: a bad value.
    """
    data = parse_yaml(text, where=where)
    check_format(data.pop("format", None), where, RunError)
    known = [f.name for f in fields(RunConfig)]
    wrong = [
        f"unknown field {n!r}{did_you_mean(str(n), known)}"
        for n in data
        if n not in known
    ]
    for name in ("scenario", "versions"):
        if not isinstance(data.get(name), dict):
            wrong.append(f"field {name!r} is missing or no mapping")
    if wrong:
        remedy = "use the file that run or train wrote"
        raise RunError(
            f"{where}: is not a run.yaml of this software: {wrong[0]}; {remedy}"
        )
    scenario = scenario_from_dict(
        data["scenario"], where=f"{where} (scenario)", name="scenario"
    )
    settings = RUN_SETTINGS.parse({n: data[n] for n in RUN_SETTINGS if n in data})
    return RunConfig(
        scenario=scenario,
        versions=data["versions"],
        id=str(data.get("id", "")),
        **settings,
    )


MOST_NAMED = 8
"""Runs of a folder that a message names."""


def load_run(directory: Path) -> RunConfig:
    """Read `run.yaml` of a run's output directory.

    Raises:
        RunError: the file is missing, or of another version.
    """
    refuse_scenario(directory)
    path = directory / RUN_FILE
    inside = sorted(str(file.parent) for file in directory.glob(f"*/{RUN_FILE}"))
    if inside and not path.exists():
        more = (
            f" and {len(inside) - MOST_NAMED} more" if len(inside) > MOST_NAMED else ""
        )
        runs = f"{', '.join(inside[:MOST_NAMED])}{more}"
        raise RunError(
            f"{directory}: is no run; it holds these runs, give one of them: {runs}"
        )
    if directory.exists() and not path.exists():
        run = next(
            (parent for parent in directory.parents if (parent / RUN_FILE).exists()),
            None,
        )
        if run is not None:
            raise RunError(f"{directory}: is no run, but in one; give {run}")
    remedy = "give the output directory of 'sparse_coord run' or 'sparse_coord train'"
    text = read_text(path, RunError, remedy)
    return run_from_yaml(text, where=str(path))


def later_result(directory: Path) -> str:
    """Return what `summary.yaml` says in place of a result that is not computed yet."""
    return f"not computed yet; sparse_coord evaluate {directory} adds it"


def refuse_scenario(path: Path) -> None:
    """Refuse the name of a scenario where a run is expected.

    Raises:
        RunError: it is one, and no path.
    """
    if not path.exists() and str(path) in scenario_names():
        raise RunError(
            f"{path} is a scenario, not a run; make one: sparse_coord train {path} --out "
            f"runs/{path}, or sparse_coord run {path} --watch"
        )


def create_output(directory: Path) -> Path:
    """Create a run's output directory and return it.

    Raises:
        RunError: it exists already; nothing is overwritten.
        OSError: it cannot be created.
    """
    try:
        directory.mkdir(parents=True)
    except FileExistsError:
        what = f"output directory {directory}: exists already, nothing is overwritten"
        raise RunError(f"{what}; choose another one or remove it") from None
    return directory
