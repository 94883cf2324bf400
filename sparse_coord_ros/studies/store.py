# Copyright 2026 The sparse_coord_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Results on disk: one JSON file a condition, in a directory that never mixes seeds or versions.

`results.json` says what the directory holds; `conditions/<id>.json` is written whole when its
condition is done, so an interrupted experiment goes on where it stopped. Every file carries a
digest of its content (`studies.checked_json`), and a condition's file also says of which
condition, scenario and plan it is: a file that was damaged, edited or moved is never shown.
"""

import hashlib
import json
import math
import os
from collections.abc import Callable, Iterable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import asdict, dataclass, fields, replace
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from sparse_coord_ros.base.errors import (
    ResultsError,
    SettingError,
    SparseCoordError,
    in_short,
)
from sparse_coord_ros.base.files import PARTIAL, free_name, take_lock, write_whole
from sparse_coord_ros.base.version import __version__
from sparse_coord_ros.core.engine.trained import Training
from sparse_coord_ros.core.game.actions import PRIMITIVES
from sparse_coord_ros.core.game.interactions import interactions_of, only_together
from sparse_coord_ros.core.game.plugins import leaving_out
from sparse_coord_ros.core.game.scenario import (
    SETTINGS,
    Scenario,
    dense_nbytes,
    scenario_from_dict,
)
from sparse_coord_ros.core.game.settings import Setting
from sparse_coord_ros.core.learners.factored import Factored
from sparse_coord_ros.core.learners.learner import Learner
from sparse_coord_ros.core.learners.registry import learner_of
from sparse_coord_ros.core.runs.evaluation import Measure, fails
from sparse_coord_ros.core.runs.run_config import RUN_SETTINGS
from sparse_coord_ros.core.solve.reference import Reference, shortest_path_reference
from sparse_coord_ros.core.solve.shipped import known_optimum
from sparse_coord_ros.studies.checked_json import (
    DamagedError,
    Form,
    Numbers,
    OrNull,
    check_form,
    read_checked,
    to_text,
)
from sparse_coord_ros.studies.conditions import Condition, parse_id

CONFIDENCE = 0.95
"""The level of confidence intervals."""

MANIFEST = "results.json"
CONDITIONS = "conditions"
"""The folder of the conditions' files."""

RUNS = Setting("runs", int, 100, "learning runs of a condition", low=1, high=1_000_000)
RUN_TRIALS = Setting(
    "trials", int, 1000, "Monte-Carlo trials of a run", low=1, high=1_000_000
)
TRIALS_OR_NONE = replace(RUN_TRIALS, low=0, least=1)

SUMS = ("returns", "time_to_goal", "asks", "miscoordinations")
BY_ROBOT = ("returns", "asks")

Say = Callable[[str], None]
"""Is told in one line about a file that is left out, or put aside."""


@dataclass(frozen=True)
class Plan:
    """The plan that all conditions of a results directory share.

    Attributes:
        seed: seed of run 0; run i has seed + i.
        runs: independent learning runs of a condition, >= 2.
        trials: Monte-Carlo trials of each run, >= 2.
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


@dataclass(frozen=True)
class ConditionResult:
    """The results of the runs of one condition; lists have one entry for each run.

    Attributes:
        condition: the condition.
        trials: trials of each run.
        optimum: exact joint optimum of the scenario, or an upper bound.
        optimum_exact: whether it is exact.
        reference: value of fixed shortest-path policies: returns, time_to_goal and
            miscoordinations. Where robots swap, block or help also the other attributes
            of `Reference`.
        means: mean of each measure of `SUMS` over trials (and robots).
        variances: variance of each measure over trials (and robots).
        robot_means: mean of each measure of `BY_ROBOT` over runs and trials, one a robot.
        not_arrived: trials in which some robot did not arrive.
        visited: joint states that a robot has updated in Q^C, mean over the robots.
        asked: how often COORDINATE was chosen in each cell, mean of a trial, shape
            (robots, cells).
        stays: steps in which the robot acted in each cell, likewise.
        exact: exact mean of each measure of `SUMS` over trials (and robots), and the probability
            `arrived` that all robots arrive; None where a team has no exact evaluation.
    """

    condition: Condition
    trials: int
    optimum: float
    optimum_exact: bool
    reference: dict[str, float]
    means: dict[str, list[float]]
    variances: dict[str, list[float]]
    robot_means: dict[str, list[float]]
    not_arrived: list[int]
    visited: list[float]
    asked: list[list[float]]
    stays: list[list[float]]
    exact: dict[str, list[float]] | None = None

    def __repr__(self) -> str:
        """Return a one-line description."""
        returns = self.measure("returns")
        worth = f"return {returns.mean:.2f} ({returns.standard_error:.2f})"
        return f"<ConditionResult {self.id}; {self.runs} runs, {self.trials} trials each; {worth}>"

    @property
    def id(self) -> str:
        """The condition's id."""
        return self.condition.id

    @property
    def scenario(self) -> Scenario:
        """The scenario with the condition's settings."""
        return self.condition.scenario

    @property
    def learner(self) -> Learner:
        """The condition's learner."""
        return learner_of(self.condition.learner)

    @property
    def runs(self) -> int:
        """Number of learning runs."""
        return len(self.not_arrived)

    def measure(self, name: str) -> Measure:
        """Return mean, spread over single robots, trials and runs, and standard error.

        The runs are the independent samples: the standard error is that of their means.
        """
        means = np.array(self.means[name])
        variances = np.array(self.variances[name])
        spread = math.sqrt(variances.mean() + means.var())
        return Measure(float(means.mean()), spread, standard_error(means))

    def best(self, name: str) -> Measure:
        """Return a measure with its exact mean where there is one, else that of the trials.

        The spread is that of the trials; the standard error says how much the runs differ.
        """
        means = self.run_means(name)
        spread = self.measure(name).spread
        return Measure(float(means.mean()), spread, standard_error(means))

    def run_means(self, name: str) -> np.ndarray:
        """Return a measure's mean in each run, shape (runs,); exact where it is known.

        Run i has the same seed in every condition: quantities from several conditions are computed
        run by run, and their error is that of the results.
        """
        return np.array((self.means if self.exact is None else self.exact)[name])

    @property
    def arrived(self) -> float:
        """Share of trials in which every robot arrived."""
        return 1.0 - sum(self.not_arrived) / (self.runs * self.trials)

    @property
    def arrived_in_trials(self) -> list[float]:
        """Share of its trials in which every robot of a run's team arrived, for each run."""
        return [(self.trials - missed) / self.trials for missed in self.not_arrived]

    @property
    def failed_teams(self) -> int:
        """Runs whose team fails in its trials."""
        return sum(fails(share) for share in self.arrived_in_trials)

    @property
    def joint_states(self) -> int:
        """Rows that Q^C of one robot could have: joint states, or pairs of cells in factors."""
        return self.learner.rows_of_a_cell(self.scenario) * len(self.scenario.map.cells)

    @property
    def row_bytes(self) -> int:
        """Bytes of one such row: four float64, and its key where it has one."""
        if isinstance(self.learner, Factored):
            return CORRECTION_BYTES
        perceived = self.scenario.perceived
        return dense_nbytes(1, perceived) + self.scenario.sparse * KEY_BYTES

    @property
    def dense_bytes(self) -> int:
        """Bytes of one robot's Q^C with a row for every joint state."""
        return dense_nbytes(len(self.scenario.map.cells), self.scenario.perceived)

    @property
    def visited_share(self) -> float:
        """Share of the joint states that a robot's Q^C has updated."""
        return float(np.mean(self.visited)) / self.joint_states

    @property
    def visited_bytes(self) -> float:
        """Bytes of the visited rows of one robot's Q^C, with their keys where it is sparse."""
        return float(np.mean(self.visited)) * self.row_bytes

    def to_dict(self) -> dict[str, Any]:
        """Return plain data, as `reproduce --json` prints it."""
        measures = {name: asdict(self.measure(name)) for name in SUMS}
        if self.exact is not None:
            measures["exact"] = {
                name: float(np.mean(self.exact[name])) for name in self.exact
            }
        return {
            "id": self.id,
            "runs": self.runs,
            "trials": self.trials,
            **measures,
            "robot_means": self.robot_means,
            "arrived": self.arrived,
            "failed_teams": self.failed_teams,
            "visited_share": self.visited_share,
            "visited_bytes": self.visited_bytes,
            "optimum": self.optimum,
            "optimum_exact": self.optimum_exact,
            "reference": self.reference,
        }


KEY_BYTES = 8
"""Bytes of the key of a row."""

CORRECTION_BYTES = KEY_BYTES + PRIMITIVES * 8
"""Bytes of a row of rho: its key, and four float64."""


def standard_error(values: np.ndarray) -> float:
    """Return the standard error of the mean of independent values; NaN of a single one."""
    return (
        float(values.std(ddof=1) / math.sqrt(len(values)))
        if len(values) > 1
        else math.nan
    )


class Sample(NamedTuple):
    """The part of one run that a condition's result keeps; its size does not depend on the tables.

    Attributes:
        means, variances: of each measure of `SUMS`.
        by_robot: mean of each measure of `BY_ROBOT`, shape (robots,).
        not_arrived: trials in which some robot did not arrive.
        visited: as of `ConditionResult`.
        exact: mean of each exact measure; empty without an exact evaluation.
        asked, stays: how often, over all trials, shape (robots, cells).
    """

    means: dict[str, float]
    variances: dict[str, float]
    by_robot: dict[str, np.ndarray]
    not_arrived: int
    visited: float
    exact: dict[str, float]
    asked: np.ndarray
    stays: np.ndarray


def sample(run: Training) -> Sample:
    """Return the sample of a run with trials."""
    trials = run.trials
    assert trials is not None  # conditions are computed with trials
    exact = {} if run.exact is None else run.exact._asdict()
    return Sample(
        means={name: float(getattr(trials, name).mean()) for name in SUMS},
        variances={name: float(getattr(trials, name).var()) for name in SUMS},
        by_robot={name: getattr(trials, name).mean(axis=0) for name in BY_ROBOT},
        not_arrived=int((~trials.arrived.all(axis=1)).sum()),
        visited=float(run.visited.mean()),
        exact={name: float(np.mean(value)) for name, value in exact.items()},
        asked=trials.asked,
        stays=trials.stays,
    )


def collect(
    condition: Condition, trials: int, samples: Iterable[Sample]
) -> ConditionResult:
    """Summarise a condition's runs (>= 1), in the order of their seeds."""
    found = list(samples)
    optimum = known_optimum(condition.scenario)
    episodes = len(found) * trials

    def of_runs(field: str) -> dict[str, list[float]]:
        each = [getattr(one, field) for one in found]
        return {name: [own[name] for own in each] for name in each[0]}

    return ConditionResult(
        condition=condition,
        trials=trials,
        optimum=optimum.value,
        optimum_exact=optimum.exact,
        reference=_reference_of(condition.scenario),
        means=of_runs("means"),
        variances=of_runs("variances"),
        robot_means={
            name: np.mean([one.by_robot[name] for one in found], axis=0).tolist()
            for name in BY_ROBOT
        },
        not_arrived=[one.not_arrived for one in found],
        visited=[one.visited for one in found],
        asked=(np.sum([one.asked for one in found], axis=0) / episodes).tolist(),
        stays=(np.sum([one.stays for one in found], axis=0) / episodes).tolist(),
        exact=of_runs("exact") or None,
    )


def computation_digest(condition: Condition) -> str:
    """Return a digest of everything that a result depends on besides seed and counts."""
    said = [condition.learner, condition.scenario.computation()]
    return hashlib.sha256(json.dumps(said, sort_keys=True).encode()).hexdigest()[:16]


class Results:
    """A results directory; use `open_results`, which locks it.

    Args:
        directory: where it is.
        plan: seed, runs and trials of every condition in it.
        say: hears which file is put aside.
    """

    def __init__(self, directory: Path, plan: Plan, say: Say = lambda _: None) -> None:
        self.directory = directory
        self.plan = plan
        self._say = say

    def path(self, condition: Condition) -> Path:
        """Return the path of a condition's result."""
        return self.directory / CONDITIONS / f"{condition.id}.json"

    def load(self, condition: Condition) -> ConditionResult | None:
        """Return a condition's result, None where it is not there yet.

        A file that is damaged, or belongs elsewhere, is put aside as `<file>.broken`, and its
        condition is open again.

        Raises:
            ResultsError: the result is of another scenario or protocol, or in another format.
        """
        path = self.path(condition)
        if not path.exists():
            return None
        try:
            data = _read(path)
            _condition_at(path, self.directory / CONDITIONS, data["scenario"])
            return _result(path, condition, self.plan, data)
        except DamagedError as damage:
            aside = free_name(path.with_name(f"{path.name}.broken"))
            os.replace(path, aside)
            self._say(
                f"{path}: {damage}; it is now {aside.name}, and is computed again"
            )
            return None

    def save(self, condition: Condition, result: ConditionResult) -> None:
        """Write a condition's result, whole or not at all."""
        own = condition.own_scenario
        data = {
            "condition": condition.id,
            "computation": computation_digest(condition),
            "plan": asdict(self.plan),
            "scenario": None if own is None else _scenario_data(own),
            "result": {name: getattr(result, name) for name in MEASURED},
        }
        write_result(self.path(condition), to_text(data))


MEASURED = tuple(
    field.name
    for field in fields(ConditionResult)
    if field.name not in ("condition", "trials")
)
"""What a file says of a condition's runs, as named in `ConditionResult`."""

PLAN_FORM: Mapping[str, Form] = {
    setting.name: Numbers(low=setting.low, high=setting.high, whole=True)
    for setting in (RUN_SETTINGS["seed"], RUNS, RUN_TRIALS)
}
MANIFEST_FORM: Mapping[str, Form] = {"version": str, **PLAN_FORM}
CONDITION_FORM: Mapping[str, Form] = {
    "condition": str,
    "computation": str,
    "plan": PLAN_FORM,
    "scenario": OrNull(dict),
    "result": dict,
}
"""The form of a condition's file; that of `result` depends on the scenario and the plan."""

MOST_ARRIVED = 1.0 + 1e-9
"""A probability that is a sum of floats may exceed 1 by a rounding error."""


def _result_form(scenario: Scenario, plan: Plan) -> Mapping[str, Form]:
    """Return the form of a file's data on a condition's runs, by the names of `MEASURED`."""
    of_run = (plan.runs,)
    of_robot = (len(scenario.robots),)
    of_cell = (*of_robot, len(scenario.map.cells))
    means: dict[str, Form] = {name: Numbers(of_run, low=0.0) for name in SUMS}
    means["returns"] = Numbers(of_run)
    return {
        "optimum": Numbers(),
        "optimum_exact": bool,
        "reference": {name: Numbers() for name in _reference_names(scenario)},
        "means": means,
        "variances": {name: Numbers(of_run, low=0.0) for name in SUMS},
        "robot_means": {name: Numbers(of_robot) for name in BY_ROBOT},
        "not_arrived": Numbers(of_run, low=0, high=plan.trials, whole=True),
        "visited": Numbers(of_run, low=0.0),
        "asked": Numbers(of_cell, low=0.0),
        "stays": Numbers(of_cell, low=0.0),
        "exact": OrNull(
            {**means, "arrived": Numbers(of_run, low=0.0, high=MOST_ARRIVED)}
        ),
    }


def _reference_names(scenario: Scenario) -> tuple[str, ...]:
    """Return the attributes of `Reference` that a result has; where it is always exact, three."""
    if only_together(interactions_of(scenario)):
        return "returns", "time_to_goal", "miscoordinations"
    return tuple(field.name for field in fields(Reference))


def _reference_of(scenario: Scenario) -> dict[str, float]:
    """Return the fields of a result for the value of fixed shortest paths."""
    found = asdict(shortest_path_reference(scenario))
    return {name: float(found[name]) for name in _reference_names(scenario)}


def _scenario_data(scenario: Scenario) -> dict[str, Any]:
    """Return plain data of a scenario; settings that were not given are left to the learner."""
    data = scenario.to_dict()
    return {k: v for k, v in data.items() if k not in SETTINGS or k in scenario.given}


def _read(path: Path) -> dict[str, Any]:
    """Return the content of a condition's file; errors as of `read_checked`."""
    data = read_checked(path)
    check_form(data, CONDITION_FORM)
    return data


def _result(
    path: Path, condition: Condition, plan: Plan, data: dict[str, Any]
) -> ConditionResult:
    """Return the result in a condition's file.

    Args:
        path: the file, for messages.
        condition: the condition that the file's place says.
        plan: the plan of its directory.
        data: the data, from `_read`.

    Raises:
        DamagedError: it is of another condition or plan, or has not the form of a result.
        ResultsError: it is of another scenario or learning protocol.
    """
    if data["condition"] != condition.id:
        raise DamagedError(f"it holds the result of {in_short(data['condition'])}")
    for name, wanted in asdict(plan).items():
        found = data["plan"][name]
        if found != wanted:
            what = f"it was computed with {name} {found}"
            raise DamagedError(f"{what}, this directory has {name} {wanted}")
    if data["computation"] != computation_digest(condition):
        raise ResultsError(
            f"{path}: was computed for another scenario or learning protocol than {condition.id} "
            "has now; results of different settings are not merged: choose another --out, or "
            "remove this file"
        )
    check_form(data["result"], _result_form(condition.scenario, plan), "result")
    if condition.own_scenario is None:
        _check_references(condition.scenario, data["result"])
    return ConditionResult(condition=condition, trials=plan.trials, **data["result"])


ROUNDING = 1e-9
"""Share by which a reference may differ between machines."""


def _check_references(scenario: Scenario, said: Mapping[str, Any]) -> None:
    """Compute optimum and shortest paths again, and compare: milliseconds.

    That is done for scenarios that come with the package; those of the user may be large.

    Args:
        scenario: of the condition.
        said: a file's data on its runs.

    Raises:
        DamagedError: the file says something else.
    """
    optimum = known_optimum(scenario)
    told = {"optimum": said["optimum"], **said["reference"]}
    known = {"optimum": optimum.value, **_reference_of(scenario)}
    for name, value in known.items():
        if not math.isclose(told[name], value, rel_tol=ROUNDING, abs_tol=ROUNDING):
            what = name if name == "optimum" else f"{name} of shortest paths"
            raise DamagedError(
                f"its {what} is {told[name]:g}, computed again {value:g}"
            )
    if said["optimum_exact"] != optimum.exact:
        raise DamagedError(
            f"its optimum_exact is {said['optimum_exact']}, it is {optimum.exact}"
        )


def read_results(
    directory: Path, say: Say = lambda _: None
) -> tuple[Plan, list[ConditionResult]]:
    """Read all results of a directory, without writing there.

    Args:
        directory: where it is.
        say: hears which result is left out, as its learner's code may not be imported.

    Raises:
        ResultsError: it is no results directory, or one of its files is damaged, was edited, is
            of another condition, scenario or plan, or in another format.
    """
    plan = _manifest(directory / MANIFEST)
    results = []
    folder = directory / CONDITIONS
    for file in sorted(folder.rglob("*.json")):
        try:
            data = _read(file)
            with leaving_out(f"results of {file.parent.name}", say):
                condition = _condition_at(file, folder, data["scenario"])
                results.append(_result(file, condition, plan, data))
        except DamagedError as damage:
            remedy = (
                "remove it, and the command that made this directory computes it again"
            )
            raise ResultsError(f"{file}: {damage}; {remedy}") from None
    return plan, results


def _condition_at(file: Path, folder: Path, given: dict[str, Any] | None) -> Condition:
    """Return the condition that belongs to the path of a file.

    Args:
        file: the file.
        folder: the folder of the conditions.
        given: plain data of the scenario, where it is the user's own.

    Raises:
        DamagedError: the data are no scenario, or belong to another path.
        SparseCoordError: the path is no condition's, or its scenario or learner is unknown.
    """
    place = str(file.relative_to(folder))
    scenario = None if given is None else _scenario_of(given)
    condition, _ = parse_id(place.removesuffix(".json"), scenario)
    if place != f"{condition.id}.json":
        raise DamagedError(f"its place is {condition.id}.json")
    return condition


def _scenario_of(data: dict[str, Any]) -> Scenario:
    """Return the scenario of `_scenario_data`; raise `DamagedError` if it is malformed."""
    if not isinstance(data.get("map"), dict):
        raise DamagedError("the scenario in it has no map")
    try:
        return scenario_from_dict(data, where="the scenario in it", name="unnamed")
    except SparseCoordError as error:
        raise DamagedError(str(error)) from None


def _manifest(path: Path) -> Plan:
    """Return the plan that a results.json says.

    Raises:
        ResultsError: it is missing or damaged, was edited, or is in another format.
    """
    try:
        said = read_checked(path)
        check_form(said, MANIFEST_FORM)
    except DamagedError as damage:
        remedy = (
            "give the directory that 'sparse_coord reproduce' wrote, or another --out"
        )
        what = f"is no {MANIFEST} of this software: {damage}"
        raise ResultsError(f"{path}: {what}; {remedy}") from None
    return Plan(said["seed"], said["runs"], said["trials"])


@contextmanager
def open_results(
    directory: Path, plan: Plan, say: Say = lambda _: None
) -> Iterator[Results]:
    """Create or continue a results directory, for this process alone.

    Args:
        directory: where it is.
        plan: seed, runs and trials of every condition in it.
        say: hears which file is put aside, because it is damaged or belongs elsewhere.

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
        yield Results(directory, plan, say)
    finally:
        os.close(lock)


def _check_manifest(directory: Path, plan: Plan) -> None:
    """Make sure that the directory is of this plan; write its manifest where it is new."""
    path = directory / MANIFEST
    wanted = asdict(plan)
    if not path.exists():
        # An interruption right at the beginning leaves our own half-written manifest.
        if any(found.name != path.name + PARTIAL for found in directory.iterdir()):
            what = f"results directory {directory}: holds other files and no {MANIFEST}"
            raise ResultsError(f"{what}; choose an empty or new directory for --out")
        write_result(path, to_text({"version": __version__, **wanted}))
    for name, found in asdict(_manifest(path)).items():
        if found != wanted[name]:
            raise ResultsError(
                f"results directory {directory}: was made with {name} {found}, this is {name} "
                f"{wanted[name]}; results of different plans are not merged: use the same, or "
                "another --out"
            )


def write_result(path: Path, text: str) -> None:
    """Write a text file, whole or not at all; its folder is made where it is missing."""
    path.parent.mkdir(parents=True, exist_ok=True)
    write_whole(path, text)
