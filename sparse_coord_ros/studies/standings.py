# Copyright 2026 The sparse_coord_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Standings of learned teams: their share of the gap, with its error, and failures."""

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from sparse_coord_ros.base.percents import percent
from sparse_coord_ros.core.game.scenario import Scenario
from sparse_coord_ros.core.runs.evaluation import Measure, fails
from sparse_coord_ros.core.solve.shipped import known_best
from sparse_coord_ros.studies.condition_result import CONFIDENCE, ConditionResult

RESAMPLES = 2000
"""Of a bootstrap."""


@dataclass(frozen=True)
class Standing:
    """The standing of teams in some buildings; all buildings count the same.

    Attributes:
        buildings: number of buildings.
        teams: teams that learned there.
        paths: value of fixed shortest paths.
        best_known: value of the best asking team found, or of the route planner.
        returns: total discounted reward; its standard error is that of the teams in just these
            buildings.
        share: closed share of the pooled gap: (return - paths) / (best_known - paths). Its
            standard error is a bootstrap over buildings, and over the teams in each: the effect of
            other buildings of these kinds. For a single building it is that of its teams.
        worst: share of the gap in the building where it is least.
        asks, miscoordinations: of a robot, and of a team, in a trial.
        below: teams with a lower value than shortest paths.
        failed: teams in which some robot fails to arrive in more than one trial of a thousand.
    """

    buildings: int
    teams: int
    paths: float
    best_known: float
    returns: Measure
    share: Measure
    worst: float
    asks: float
    miscoordinations: float
    below: int
    failed: int

    def share_and_failed(self) -> str:
        """Return the share of the gap with its error in percent, and the count of failed teams."""
        share = self.share
        closed = f"{percent(share.mean)} ({100 * share.standard_error:.1f})"
        return f"{closed}; {self.of_teams(self.failed)} fail"

    def of_teams(self, count: int) -> str:
        """Return a number of teams; for 0 also the upper 95 % confidence limit of their share."""
        most = 1.0 - (1.0 - CONFIDENCE) ** (1.0 / self.teams)
        surely = f" (< {percent(most)})" if count == 0 else ""
        return f"{count} of {self.teams}{surely}"

    def to_dict(self) -> dict[str, Any]:
        """Return plain data."""
        said = dict(vars(self))
        for name in ("returns", "share"):
            measure = said[name]
            said[name] = measure.mean
            said[f"{name}_standard_error"] = measure.standard_error
        return said


def standings(
    results: Iterable[ConditionResult], *, by_kind: bool = False
) -> dict[str, Standing]:
    """Return the standings of teams, by their number of robots, such as `2r`.

    Args:
        results: of unseen buildings.
        by_kind: by the kind of their building too, such as `2r door`.
    """
    groups: dict[str, list[ConditionResult]] = {}
    for one in results:
        _, kind, team, _ = one.scenario.name.split("-")
        groups.setdefault(f"{team} {kind}" if by_kind else team, []).append(one)
    return {name: standing(own) for name, own in groups.items()}


def standing(
    results: Sequence[ConditionResult],
    best_of: Callable[[Scenario], float | None] = known_best,
) -> Standing:
    """Return the standing of one learner's teams in these buildings.

    Args:
        results: of the buildings.
        best_of: returns the value of the best known team of a building.
    """
    returns = [one.best("returns") for one in results]
    error = float(np.sqrt(sum(one.standard_error**2 for one in returns))) / len(returns)
    values = [best_of(one.scenario) for one in results]
    known = np.array([np.nan if value is None else value for value in values])
    paths = [one.reference["returns"] for one in results]
    learned = [one.run_means("returns") for one in results]
    gained = np.array([own.mean() for own in learned]) - paths

    def mean(values: Iterable[float]) -> float:
        return float(np.mean(list(values)))

    return Standing(
        buildings=len(results),
        teams=sum(one.runs for one in results),
        paths=mean(paths),
        best_known=mean(known),
        returns=Measure(mean(one.mean for one in returns), float("nan"), error),
        share=pooled_share(learned, np.array(paths), known),
        worst=float((gained / (known - paths)).min()),
        asks=mean(one.best("asks").mean for one in results),
        miscoordinations=mean(one.best("miscoordinations").mean for one in results),
        below=sum(
            int((own < low - 1e-9).sum())
            for own, low in zip(learned, paths, strict=True)
        ),
        failed=sum(map(failed_teams, results)),
    )


def pooled_share(
    learned: Sequence[np.ndarray], low: np.ndarray, high: np.ndarray
) -> Measure:
    """Return the share of the pooled gap that teams close, with a bootstrap standard error.

    A resample draws as many buildings with replacement, and in each as many teams. Its draws are
    the same in every call.

    Args:
        learned: the teams' returns in each building, shape (teams,) each.
        low: where the gap begins in each building, shape (buildings,).
        high: where it ends, shape (buildings,).

    Returns:
        A measure without a spread (NaN).
    """
    rng = np.random.default_rng(0)
    count = len(learned)
    chosen = rng.integers(count, size=(RESAMPLES, count))
    gained = np.zeros((RESAMPLES, count))
    for building, returns in enumerate(learned):
        places = chosen == building
        teams = rng.integers(len(returns), size=(int(places.sum()), len(returns)))
        gained[places] = returns[teams].mean(axis=1) - low[building]
    shares = gained.sum(axis=1) / (high - low)[chosen].sum(axis=1)
    means = np.array([returns.mean() for returns in learned])
    share = float((means - low).sum() / (high - low).sum())
    return Measure(share, float("nan"), float(shares.std(ddof=1)))


def failed_teams(result: ConditionResult) -> int:
    """Return the number of failed teams."""
    return int(teams_that_fail(result).sum())


def teams_that_fail(result: ConditionResult) -> np.ndarray:
    """Return whether each team fails, exactly where that is known; (runs,), bool."""
    arrived = result.arrived_in_trials
    if result.exact is not None:
        arrived = result.exact["arrived"]
    return np.array([fails(share) for share in arrived])
