# Copyright 2026 The sparse_coord_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The leaderboard: what teams of learners earn in lists of scenarios, as rows and as a file."""

from collections.abc import Mapping
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from sparse_coord_ros.base.dataframes import data_frame, shown_as
from sparse_coord_ros.base.errors import (
    ResultsError,
)
from sparse_coord_ros.base.files import path_argument, write_whole
from sparse_coord_ros.base.percents import percent
from sparse_coord_ros.base.version import __version__
from sparse_coord_ros.studies.checked_json import (
    DamagedError,
    Form,
    Numbers,
    OrNull,
    check_form,
    read_checked,
    to_text,
)
from sparse_coord_ros.studies.condition_result import standard_error
from sparse_coord_ros.studies.lists import (
    SAMPLED,
)
from sparse_coord_ros.studies.standings import pooled_share

if TYPE_CHECKING:
    import pandas as pd

BUDGETS = (2_000, 5_000, 10_000, 30_000)
"""Steps of learning that are tried before the whole budget: which is the least that closes
`NEARLY_ALL` of the gap."""

NEARLY_ALL = 0.9

FIGURES = ("share of the gap", "failed teams", "steps to 90 %", "seconds a run")
"""The columns of a place in the leaderboard, after its list and entry."""


@dataclass(frozen=True)
class BenchmarkResult:
    """What the teams of an entry are worth in one scenario.

    Attributes:
        scenario: its name, and the settings that the list changes.
        paths: what fixed shortest paths are worth.
        top: where the gap ends.
        returns: of each team, averaged over its robots.
        failed: teams in which some robot fails to arrive in more than one trial of a thousand.
    """

    scenario: str
    paths: float
    top: float
    returns: tuple[float, ...]
    failed: int


@dataclass(frozen=True)
class Place:
    """How an entry stands in a list.

    Attributes:
        title: the entry's.
        learner: its learner; empty: of several, or unknown.
        settings: its changed settings, as texts.
        list: the list's name.
        judged: its scenarios; empty: it cannot learn them all.
        steps: steps of learning.
        steps_to_90: least budget that was tried and closes 90 % of the gap; None: none does.
        seconds: processor time of one learning run in the first scenario; None: not measured.
    """

    title: str
    learner: str
    settings: Mapping[str, str]
    list: str
    judged: tuple[BenchmarkResult, ...]
    steps: int
    steps_to_90: int | None
    seconds: float | None

    @property
    def share(self) -> tuple[float, float]:
        """Share of the pooled gap, and its standard error.

        Of buildings that stand for others it is a bootstrap over buildings, and teams in each; of
        other scenarios it is that of the teams.
        """
        learned = [np.array(one.returns) for one in self.judged]
        low = np.array([one.paths for one in self.judged])
        high = np.array([one.top for one in self.judged])
        found = pooled_share(learned, low, high)
        if self.list in SAMPLED:
            return found.mean, found.standard_error
        errors = [standard_error(returns) for returns in learned]
        return found.mean, float(np.linalg.norm(errors) / (high - low).sum())

    @property
    def failed(self) -> int:
        """Teams that fail."""
        return sum(one.failed for one in self.judged)

    @property
    def teams(self) -> int:
        """Teams that learned."""
        return sum(len(one.returns) for one in self.judged)

    def row(self) -> dict[str, str]:
        """Return the place as a row of the leaderboard."""
        named = {"list": self.list, "entry": self.title}
        if not self.judged:
            return named | dict.fromkeys(FIGURES, "-")
        share, error = self.share
        seconds = "-" if self.seconds is None else f"{self.seconds:.2f}"
        figures = (
            f"{percent(share)} ({100 * error:.1f})",
            f"{self.failed} of {self.teams}",
            self._steps_in_words(),
            seconds,
        )
        return named | dict(zip(FIGURES, figures, strict=True))

    def _steps_in_words(self) -> str:
        """Return the least budget that closes 90 % of the gap; if none does, the whole budget."""
        if self.steps_to_90 is not None:
            return f"{self.steps_to_90:,}"
        return f"> {self.steps:,}"


@dataclass(frozen=True)
class Leaderboard:
    """How entries stand in lists; `save` and `load_leaderboard` are its file.

    Attributes:
        places: in the order in which they were judged.
        seed: seed of the first team of each scenario.
        trials: of a team of more than two robots.
        version: of this software.
    """

    places: tuple[Place, ...]
    seed: int
    trials: int
    version: str = __version__

    def __repr__(self) -> str:
        """Return what it says, a line a place."""
        rows = self.rows()
        columns = {name: [row[name] for row in rows] for name in rows[0]}
        return shown_as(f"<leaderboard: {len(rows)} places>", columns)

    def rows(self) -> list[dict[str, str]]:
        """Return a row for each place; in each list the greatest share is the first."""
        found = []
        for name in dict.fromkeys(one.list for one in self.places):
            own = [one for one in self.places if one.list == name]
            judged = [one for one in own if one.judged]
            judged.sort(key=lambda one: -one.share[0])
            found += [one.row() for one in judged]
            found += [one.row() for one in own if not one.judged]
        return found

    def to_dict(self) -> dict[str, Any]:
        """Return plain data: what its file says."""
        return {
            "version": self.version,
            "seed": self.seed,
            "trials": self.trials,
            "places": [_plain(one) for one in self.places],
        }

    def to_pandas(self) -> "pd.DataFrame":
        """Return a data frame of `rows`.

        Raises:
            RunError: pandas is not installed.
        """
        rows = self.rows()
        return data_frame({name: [row[name] for row in rows] for name in rows[0]})

    def save(self, file: str | Path) -> None:
        """Write the file of the results: JSON with the number of its format and a digest.

        Raises:
            OSError: it cannot be written.
        """
        write_whole(path_argument("file", file), to_text(self.to_dict()))


def _plain(place: Place) -> dict[str, Any]:
    said = asdict(place)
    said["judged"] = [
        {**one, "returns": list(one["returns"])} for one in said["judged"]
    ]
    return said


def load_leaderboard(file: str | Path) -> Leaderboard:
    """Read a file of `Leaderboard.save`.

    Raises:
        ResultsError: it is no such file, was damaged or edited, or has another format.
    """
    path = path_argument("file", file)
    try:
        data = read_checked(path)
        check_form(data, {"version": str, "seed": int, "trials": int, "places": list})
        places = tuple(
            _place(one, f"places[{i}]") for i, one in enumerate(data["places"])
        )
    except DamagedError as error:
        raise ResultsError(f"{path}: {error}; run the benchmark again") from None
    return Leaderboard(places, data["seed"], data["trials"], data["version"])


NUMBER = Numbers()
COUNT = Numbers(low=0, whole=True)
PLACE_FORM = {
    "title": str,
    "learner": str,
    "settings": dict,
    "list": str,
    "judged": list,
    "steps": COUNT,
    "steps_to_90": OrNull(COUNT),
    "seconds": OrNull(Numbers(low=0)),
}


def _place(said: Any, where: str) -> Place:
    """Return a place of plain data; raise `DamagedError` where it is none."""
    check_form(said, PLACE_FORM, where)
    for value in said["settings"].values():
        check_form(value, str, f"{where}.settings")
    judged = []
    for number, one in enumerate(said["judged"]):
        check_form(one, _result_form(one), f"{where}.judged[{number}]")
        judged.append(BenchmarkResult(**{**one, "returns": tuple(one["returns"])}))
    return Place(**{**said, "judged": tuple(judged)})


def _result_form(said: Any) -> Mapping[str, Form]:
    """Return the form of a `BenchmarkResult`; it has as many teams as the data have returns."""
    teams = 0
    if isinstance(said, dict) and isinstance(said.get("returns"), list):
        teams = len(said["returns"])
    return {
        "scenario": str,
        "paths": NUMBER,
        "top": NUMBER,
        "returns": Numbers((teams,)),
        "failed": Numbers(low=0, high=teams, whole=True),
    }
