# Copyright 2026 The sparse_coord_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Results on disk: one JSON file a condition, in a directory that never mixes seeds or versions.

`results.json` says what the directory holds; `conditions/<id>.json` is written whole when its
condition is done, so an interrupted experiment goes on where it stopped. A condition's file says
of which scenario and plan it is: results of different settings are never merged.
"""

import hashlib
import json
import os
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from sparse_coord_ros.base.errors import ResultsError, SettingError, in_short
from sparse_coord_ros.base.files import PARTIAL, take_lock, write_whole
from sparse_coord_ros.base.version import __version__
from sparse_coord_ros.core.game.plugins import leaving_out
from sparse_coord_ros.core.game.scenario import (
    SETTINGS,
    Scenario,
    scenario_from_dict,
)
from sparse_coord_ros.core.game.settings import Setting
from sparse_coord_ros.core.runs.measures import (
    BY_CELL,
    BY_ROBOT,
    EXACT,
    MEASURES,
    RUN,
    TRIALS,
    Measures,
)
from sparse_coord_ros.studies.checked_json import (
    Form,
    OrNull,
    check_form,
    read_checked,
    to_text,
)
from sparse_coord_ros.studies.condition_result import ConditionResult
from sparse_coord_ros.studies.conditions import Condition, parse_id

MANIFEST = "results.json"
CONDITIONS = "conditions"
"""The folder of the conditions' files."""

RUNS = Setting("runs", int, 100, "learning runs of a condition", low=1, high=1_000_000)
RUN_TRIALS = Setting(
    "trials",
    int,
    1000,
    "trials of a team of more than two robots",
    low=1,
    high=1_000_000,
)
TRIALS_OR_NONE = replace(RUN_TRIALS, low=0)

Say = Callable[[str], None]
"""Is told in one line about results that are left out."""


@dataclass(frozen=True)
class Plan:
    """The plan that all conditions of a results directory share.

    Attributes:
        seed: seed of run 0; run i has seed + i.
        runs: independent learning runs of a condition, >= 2.
        trials: trials of each team that is not evaluated exactly.
    """

    seed: int
    runs: int
    trials: int

    def __post_init__(self) -> None:
        """Raise `SettingError` where the last run's seed is too large."""
        if self.seed + self.runs > 2**63:
            raise SettingError(
                f"setting seed: value is {self.seed}, allowed with {self.runs} runs: at most "
                f"{2**63 - self.runs}, as run i has seed + i, below 2^63"
            )

    @property
    def seeds(self) -> range:
        """The seeds of the runs."""
        return range(self.seed, self.seed + self.runs)


def computation_digest(condition: Condition) -> str:
    """Return a digest of everything that a result depends on besides seed and counts."""
    content = [condition.learner, condition.scenario.computation()]
    return hashlib.sha256(json.dumps(content, sort_keys=True).encode()).hexdigest()[:16]


class Results:
    """A results directory; use `open_results`, which locks it.

    Args:
        directory: where it is.
        plan: seed, runs and trials of every condition in it.
    """

    def __init__(self, directory: Path, plan: Plan) -> None:
        self.directory = directory
        self.plan = plan

    def path(self, condition: Condition) -> Path:
        """Return the path of a condition's result."""
        return self.directory / CONDITIONS / f"{condition.id}.json"

    def load(self, condition: Condition) -> ConditionResult | None:
        """Return a condition's result, None where it is not there yet.

        Raises:
            ResultsError: the file is damaged, of another scenario, protocol or plan, or in another
                format.
        """
        path = self.path(condition)
        if not path.exists():
            return None
        data = read_checked(path, CONDITION_FORM, REMEDY)
        return _result(path, condition, self.plan, data)

    def save(self, condition: Condition, result: ConditionResult) -> None:
        """Write a condition's result, whole or not at all."""
        own_scenario = condition.own_scenario
        data = {
            "computation": computation_digest(condition),
            "plan": asdict(self.plan),
            "scenario": None if own_scenario is None else _scenario_data(own_scenario),
            "result": result_data(result),
        }
        write_result(self.path(condition), to_text(data))


SAVED = ("visited", "optimum", "optimum_exact")
"""What a file says of a condition's runs besides measures, as named in `ConditionResult`."""

PLAN_FORM: Mapping[str, Form] = {"seed": int, "runs": int, "trials": int}
MANIFEST_FORM: Mapping[str, Form] = {"version": str, **PLAN_FORM}
CONDITION_FORM: Mapping[str, Form] = {
    "computation": str,
    "plan": PLAN_FORM,
    "scenario": OrNull(dict),
    "result": dict,
}
"""The form of a condition's file; that of `result` depends on the scenario and the plan."""

REMEDY = "remove it, and the command that made this directory computes it again"
"""What helps where a condition's file is damaged."""


def _result_form(scenario: Scenario, plan: Plan) -> Mapping[str, Form]:
    """Return the form of `result_data`."""
    robots = len(scenario.robots)
    measures: dict[str, Form] = {"source": str}
    measures |= dict.fromkeys(MEASURES, (plan.runs,))
    measures |= dict.fromkeys(BY_ROBOT, (plan.runs, robots))
    measures |= dict.fromkeys(BY_CELL, (robots, len(scenario.map.cells)))
    measures["variances"] = dict.fromkeys(MEASURES, (plan.runs,))
    return {
        "measures": measures,
        "visited": (plan.runs,),
        "optimum": (),
        "optimum_exact": bool,
    }


def result_data(result: ConditionResult) -> dict[str, Any]:
    """Return what a file says of a condition's runs."""
    measured = result.measures
    measures: dict[str, Any] = {"source": measured.source}
    for name in (*MEASURES, *BY_CELL):
        measures[name] = getattr(measured, name).tolist()
    measures["variances"] = {
        name: values.tolist() for name, values in measured.variances.items()
    }
    return {"measures": measures, **{name: getattr(result, name) for name in SAVED}}


def _measures(plan: Plan, data: dict[str, Any]) -> Measures:
    """Return measures by run, from the data of a file; ValueError: unknown source."""
    source = data["source"]
    if source not in (TRIALS, EXACT):
        allowed = f"allowed: {TRIALS}, {EXACT}"
        raise ValueError(
            f"field result.measures.source is {in_short(source)}, {allowed}"
        )
    return Measures(
        source=source,
        unit=RUN,
        trials=plan.trials if source == TRIALS else 0,
        **{name: np.array(data[name]) for name in (*MEASURES, *BY_CELL)},
        variances={
            name: np.array(values) for name, values in data["variances"].items()
        },
    )


def _scenario_data(scenario: Scenario) -> dict[str, Any]:
    """Return plain data of a scenario; settings that were not given are left to the learner."""
    data = scenario.to_dict()
    return {k: v for k, v in data.items() if k not in SETTINGS or k in scenario.given}


def _result(
    path: Path, condition: Condition, plan: Plan, data: dict[str, Any]
) -> ConditionResult:
    """Return the result in a condition's file.

    Args:
        path: the file, for messages.
        condition: the condition that the file's place says.
        plan: the plan of its directory.
        data: the file's content.

    Raises:
        ResultsError: it is of another scenario, protocol or plan, or has not the form of a
            result.
    """
    for name, wanted in asdict(plan).items():
        given = data["plan"][name]
        if given != wanted:
            what = (
                f"was computed with {name} {given}, this directory has {name} {wanted}"
            )
            raise ResultsError(f"{path}: {what}; {REMEDY}")
    if data["computation"] != computation_digest(condition):
        raise ResultsError(
            f"{path}: was computed for another scenario or learning protocol than {condition.id} "
            "has now; results of different settings are not merged: choose another --out, or "
            "remove this file"
        )
    try:
        check_form(data["result"], _result_form(condition.scenario, plan), "result")
        measures = _measures(plan, data["result"]["measures"])
    except ValueError as error:
        raise ResultsError(f"{path}: {error}; {REMEDY}") from None
    return ConditionResult(
        condition=condition,
        seed=plan.seed,
        measures=measures,
        **{name: data["result"][name] for name in SAVED},
    )


def read_results(
    directory: Path, say: Say = lambda _: None
) -> tuple[Plan, list[ConditionResult]]:
    """Read all results of a directory, without writing there.

    Args:
        directory: where it is.
        say: hears which result is left out, as its learner's code may not be imported.

    Raises:
        ResultsError: it is no results directory, or one of its files is damaged, of another
            scenario or plan, or in another format.
    """
    plan = _manifest(directory / MANIFEST)
    results = []
    folder = directory / CONDITIONS
    for file in sorted(folder.rglob("*.json")):
        data = read_checked(file, CONDITION_FORM, REMEDY)
        with leaving_out(f"results of {file.parent.name}", say):
            condition = _condition_at(file, folder, data["scenario"])
            results.append(_result(file, condition, plan, data))
    return plan, results


def _condition_at(file: Path, folder: Path, given: dict[str, Any] | None) -> Condition:
    """Return the condition that belongs to the path of a file.

    Args:
        file: the file.
        folder: the folder of the conditions.
        given: plain data of the scenario, where it is the user's own.

    Raises:
        SparseCoordError: the path is no condition's, or its scenario or learner is unknown; the
            data are no scenario, or belong to another path.
    """
    inside = str(file.relative_to(folder))
    scenario = None
    if given is not None:
        scenario = scenario_from_dict(given, where=str(file), name="unnamed")
    condition = parse_id(inside.removesuffix(".json"), scenario)
    if inside != f"{condition.id}.json":
        raise ResultsError(f"{file}: its place is {condition.id}.json; move it there")
    return condition


def _manifest(path: Path) -> Plan:
    """Return the plan that a results.json says.

    Raises:
        ResultsError: it is missing or damaged, or in another format.
    """
    remedy = "give the directory that 'sparse_coord reproduce' wrote, or another --out"
    manifest = read_checked(path, MANIFEST_FORM, remedy)
    return Plan(manifest["seed"], manifest["runs"], manifest["trials"])


@contextmanager
def open_results(directory: Path, plan: Plan) -> Iterator[Results]:
    """Create or continue a results directory, for this process alone.

    Args:
        directory: where it is.
        plan: seed, runs and trials of every condition in it.

    Raises:
        ResultsError: the directory holds no results, has another format or plan, or another
            process is writing it.
    """
    directory.mkdir(parents=True, exist_ok=True)
    lock = os.open(directory, os.O_RDONLY | os.O_DIRECTORY)
    try:
        if not take_lock(lock):
            what = f"results directory {directory}: another process is writing it"
            raise ResultsError(f"{what}; wait for it, or choose another --out")
        _check_manifest(directory, plan)
        yield Results(directory, plan)
    finally:
        os.close(lock)


def _check_manifest(directory: Path, plan: Plan) -> None:
    """Make sure that the directory is of this plan; write its manifest where it is new."""
    path = directory / MANIFEST
    wanted = asdict(plan)
    if not path.exists():
        # An interruption right at the beginning leaves our own half-written manifest.
        if any(file.name != path.name + PARTIAL for file in directory.iterdir()):
            what = f"results directory {directory}: holds other files and no {MANIFEST}"
            raise ResultsError(f"{what}; choose an empty or new directory for --out")
        write_result(path, to_text({"version": __version__, **wanted}))
    for name, given in asdict(_manifest(path)).items():
        if given != wanted[name]:
            raise ResultsError(
                f"results directory {directory}: was made with {name} {given}, this is {name} "
                f"{wanted[name]}; results of different plans are not merged: use the same, or "
                "another --out"
            )


def write_result(path: Path, text: str) -> None:
    """Write a text file, whole or not at all; its folder is made where it is missing."""
    path.parent.mkdir(parents=True, exist_ok=True)
    write_whole(path, text)
