# Copyright 2026 The sparse_coord_ros authors
# SPDX-License-Identifier: Apache-2.0
"""What teams earn: the measures of the paper's Section 4, by trials or exact.

One record for one team and for many: the trials of a team, its exact evaluation, or the means of
many learned teams.
"""

import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING, Any

import numpy as np

from sparse_coord_ros.base.dataframes import data_frame
from sparse_coord_ros.base.errors import check_argument, check_choice
from sparse_coord_ros.base.percents import percent

if TYPE_CHECKING:
    import pandas as pd

MEASURES = ("returns", "time_to_goal", "miscoordinations", "asks", "arrived")
"""The names of the measures."""

BY_ROBOT = ("returns", "time_to_goal", "asks")
"""Those that each robot has."""

BY_CELL = ("asked", "stays")
"""What is counted in each cell."""

TRIALS = "trials"
EXACT = "exact"
"""The sources of measures."""

TRIAL = "trial"
RUN = "run"
"""The units of measures: what one row is."""

ARRIVE = 0.999
"""Share of its trials in which all robots of a team must arrive; in a failed team fewer do."""

ROUNDING = 1e-9
"""A return that exceeds the optimum by less does so by rounding."""


def fails(arrived: float) -> bool:
    """Return whether a team fails: some robot is missing in more than one of 1,000 trials.

    Args:
        arrived: share of its trials in which all robots arrive.
    """
    return arrived < ARRIVE


@dataclass(frozen=True, eq=False)
class Measures:
    """The measures of a team, or of many learned teams; a row for each trial or each team.

    Attributes:
        source: "trials": greedy trials were played from the scenario's starts; "exact": expected
            values were computed.
        unit: what a row is. "trial": a trial of one team; its exact evaluation has one row, the
            expected trial. "run": the mean of a trial of the team of one learning run.
        trials: trials of each team; 0: exact.
        returns: total discounted reward: the goal paid from arrival on for ever, penalties, costs
            of asking; shape (rows, robots).
        time_to_goal: steps until arrival; the horizon for a robot that does not arrive; same
            shape.
        miscoordinations: steps of a trial that end in a miscoordination, shape (rows,).
        asks: how often the robot chose COORDINATE, shape (rows, robots).
        arrived: whether all robots arrived within the horizon; share of the trials, or
            probability; shape (rows,).
        asked: how often COORDINATE was chosen in each cell, mean of a trial; shape (robots,
            cells).
        stays: steps that the robot acted in each cell, mean of a trial, same shape: the steps
            until it arrived.
        variances: of each measure over the robots and trials behind a row, shape (rows,). Rows
            that are single trials have none; it is empty where they are not known.
    """

    source: str
    unit: str
    trials: int
    returns: np.ndarray
    time_to_goal: np.ndarray
    miscoordinations: np.ndarray
    asks: np.ndarray
    arrived: np.ndarray
    asked: np.ndarray
    stays: np.ndarray
    variances: Mapping[str, np.ndarray] = field(default_factory=dict)

    def __eq__(self, other: object) -> bool:
        """Return whether all numbers are the same."""
        return isinstance(other, Measures) and _same(vars(self), vars(other))

    def __len__(self) -> int:
        """Return the number of rows."""
        return len(self.returns)

    def __repr__(self) -> str:
        """Return the means ± their standard errors on one line."""
        means = [f"{HEADINGS[name]} {self.in_words(name)}" for name in MEASURES]
        return f"<Measures: {self.how}; {', '.join(means)}>"

    def each(self, name: str) -> np.ndarray:
        """Return a measure of each row, averaged over the robots, shape (rows,).

        Run i of two experiments with one seed draws the same numbers: differences are taken row
        by row.
        """
        values = self._values(name)
        if values.ndim == 2:
            values = values.mean(axis=1)
        return values.astype(float, copy=False)

    def mean(self, name: str) -> float:
        """Return the mean of a measure over rows and robots."""
        return float(self._values(name).mean())

    def error(self, name: str) -> float:
        """Return the standard error of the mean; NaN of a single sample.

        The rows are the independent samples: the robots of one trial, and the trials of one team,
        depend on each other. An exact evaluation of one team has none.
        """
        if self.source == EXACT and self.unit == TRIAL:
            return 0.0
        return standard_error(self.each(name))

    def spread(self, name: str) -> float:
        """Return the standard deviation over robots, trials and runs: the paper's ±.

        NaN where it is not known.
        """
        if self.source == TRIALS and self.unit == TRIAL:
            return float(self._values(name).std())
        if not self.variances:
            return math.nan
        return math.sqrt(self.variances[name].mean() + self.each(name).var())

    def _values(self, name: str) -> np.ndarray:
        """Return a measure's array; SettingError: there is no such measure."""
        check_choice("measure", name, MEASURES)
        values: np.ndarray = getattr(self, name)
        return values

    @property
    def failed(self) -> int:
        """Number of failed teams: see `fails`."""
        shares = self.arrived if self.unit == RUN else [self.mean("arrived")]
        return sum(1 for share in shares if fails(share))

    @property
    def how(self) -> str:
        """The source and the numbers of samples, in words."""
        played = f"{self.trials} trials" if self.source == TRIALS else EXACT
        if self.unit == TRIAL:
            return played
        return f"{len(self)} runs, {played}"

    def errors_above(self, optimum: float) -> float:
        """Return by how many standard errors the mean return of trials exceeds an optimum.

        0: it does not. NaN: of a single sample.
        """
        excess = self.mean("returns") - optimum
        if self.source == EXACT or excess <= ROUNDING:
            return 0.0
        error = self.error("returns")
        return excess / error if error else math.inf

    def in_words(self, name: str) -> str:
        """Return a mean ± its standard error, as one cell of a table.

        An exact value stands alone. "-" stands for the unknown error of a single sample.
        """
        if name == "arrived" and self.source == TRIALS and self.unit == TRIAL:
            return f"{int(self.arrived.sum())} of {self.trials}"

        def written(value: float) -> str:
            return percent(value) if name == "arrived" else f"{value:.2f}"

        mean = written(self.mean(name))
        if self.source == EXACT and self.unit == TRIAL:
            return mean
        error = self.error(name)
        return f"{mean} ± {'-' if math.isnan(error) else written(error)}"

    def cells(self, *, optimum: float = math.inf) -> dict[str, str]:
        """Return the cells of a table's row, by the headings of their columns.

        Args:
            optimum: the joint optimum or its bound. Where the return of trials exceeds it, its
                cell says by how many standard errors.
        """
        cells = {HEADINGS[name]: self.in_words(name) for name in MEASURES}
        above = self.errors_above(optimum)
        if above != 0.0:
            many = "" if math.isnan(above) else f"{above:.1f} s.e. "
            cells[HEADINGS["returns"]] += f", {many}above the optimum"
        return {**cells, "source": self.how}

    def spreads(self) -> list[str]:
        """Return the spreads of the first four measures, as cells of a table; "-": not known."""
        values = [self.spread(name) for name in SPREAD]
        return ["-" if math.isnan(value) else f"{value:.2f}" for value in values]

    def to_dict(self) -> dict[str, Any]:
        """Return plain data of all rows together.

        `source`, `runs` (where rows are runs) and `trials`; of each measure its mean under its
        name, `<measure>_spread` where it is known, and `<measure>_error`.
        """
        data: dict[str, Any] = {"source": self.source}
        if self.unit == RUN:
            data["runs"] = len(self)
        data["trials"] = self.trials
        for name in MEASURES:
            data[name] = self.mean(name)
            spread = self.spread(name)
            if not math.isnan(spread):
                data[f"{name}_spread"] = spread
            data[f"{name}_error"] = self.error(name)
        return data

    def by_robot(self) -> dict[str, list[float]]:
        """Return the mean of each robot, by the names of the measures that robots have."""
        return {name: getattr(self, name).mean(axis=0).tolist() for name in BY_ROBOT}

    def columns(self) -> dict[str, Sequence[object] | np.ndarray]:
        """Return the columns of `to_pandas`."""
        columns: dict[str, Sequence[object] | np.ndarray] = {}
        for name in MEASURES:
            columns[name] = self.each(name)
            if self.source == EXACT:
                columns[f"{name}_error"] = np.zeros(len(self))
            elif self.unit == RUN:
                columns[f"{name}_error"] = np.sqrt(self.variances[name] / self.trials)
        return {**columns, "source": [self.source] * len(self)}

    def to_pandas(self) -> "pd.DataFrame":
        """Return a data frame with a row for each trial or run.

        Its columns: each measure, averaged over the robots; `<measure>_error`, its standard error
        (none of a single trial; the robots of a trial are taken as wholly dependent); `source`.

        Raises:
            RunError: pandas is not installed.
        """
        return data_frame(self.columns())


HEADINGS = {
    "returns": "return",
    "time_to_goal": "time to goal",
    "miscoordinations": "miscoordinations",
    "asks": "asks",
    "arrived": "all arrive",
}
"""Column headings of tables."""

ERRORS = "±: standard error (s.e.)"
"""What is said below a table of trials or runs."""

SPREAD = ("returns", "time_to_goal", "miscoordinations", "asks")
"""The measures whose spread a table can show."""


def _same(first: Any, second: Any) -> bool:
    """Return whether values, or mappings of values, are the same."""
    if isinstance(first, Mapping):
        return first.keys() == second.keys() and all(
            _same(value, second[name]) for name, value in first.items()
        )
    return np.array_equal(first, second)


def standard_error(values: np.ndarray) -> float:
    """Return the standard error of the mean of independent values; NaN of a single one."""
    if len(values) < 2:
        return math.nan
    return float(values.std(ddof=1) / math.sqrt(len(values)))


def by_run(teams: Iterable[Measures]) -> Measures:
    """Return the measures of many learned teams, a row for each.

    Args:
        teams: the measures of each team (or of several, by run already), all of one scenario and
            one source; at least one.

    Raises:
        SettingError: they are something else.
    """
    teams = list(teams)
    kinds = {_kind(team) for team in teams}
    check_argument("teams", teams, len(kinds) == 1 and None not in kinds, TEAMS)
    rows = [_as_run(team) for team in teams]
    many = [len(row) for row in rows]
    means: dict[str, Any] = {
        name: np.concatenate([getattr(row, name) for row in rows]) for name in MEASURES
    }
    variances = {
        name: np.concatenate([row.variances[name] for row in rows])
        for name in rows[0].variances
    }
    return replace(
        rows[0],
        **means,
        asked=np.average([row.asked for row in rows], axis=0, weights=many),
        stays=np.average([row.stays for row in rows], axis=0, weights=many),
        variances=variances,
    )


TEAMS = (
    "the measures of teams of one scenario, all exact or all of trials; train_many with trials=0 "
    "finds none"
)


def _kind(team: object) -> tuple[str, int] | None:
    """Return what all teams of `by_run` share; None: these are no measures."""
    if not isinstance(team, Measures):
        return None
    return team.source, team.returns.shape[1]


def _as_run(team: Measures) -> Measures:
    """Return a team's measures as one row, that of a run."""
    if team.unit == RUN:
        return team
    variances = team.variances
    if team.source == TRIALS:
        variances = {name: np.array([getattr(team, name).var()]) for name in MEASURES}
    means = {name: getattr(team, name).mean(axis=0, keepdims=True) for name in MEASURES}
    return replace(team, unit=RUN, **means, variances=variances)
