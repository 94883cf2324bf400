# Copyright 2026 The sparse_coord_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Statistics of results: agreement with exact values and the paper, gaps closed, asks by place."""

import math
from collections.abc import Sequence

import numpy as np

from sparse_coord_ros.core.game.grid import UNREACHABLE, GridMap
from sparse_coord_ros.core.game.scenario import Scenario
from sparse_coord_ros.core.runs.evaluation import Measure
from sparse_coord_ros.core.solve.optimum import independent_bound
from sparse_coord_ros.studies.condition_result import ConditionResult, standard_error
from sparse_coord_ros.studies.report.data import paper

AGREE = 3.0
"""Two values agree if they differ by at most this many standard errors of their difference."""

CONTRADICTION_ERRORS = 5.0
"""A number of the paper contradicts a bound that it exceeds by more standard errors than this."""

SAME = 0.01
"""Returns that differ by less count as equal: far above rounding noise, below printed digits."""

NEAR_MOVES = 2
"""Moves from a doorway that still count as near it."""


def errors_from(measure: Measure, exact: float) -> float:
    """Return how many standard errors a mean lies from an exact value, with its sign."""
    difference = measure.mean - exact
    if abs(difference) < 1e-9:
        return 0.0
    if measure.standard_error == 0:
        return math.copysign(math.inf, difference)
    return difference / measure.standard_error


def agrees(ours: Measure, other: Measure) -> bool:
    """True if two means differ by no more than `AGREE` standard errors of their difference."""
    error = math.hypot(ours.standard_error, other.standard_error)
    return abs(ours.mean - other.mean) <= AGREE * error


def loss_alone(result: ConditionResult) -> Measure:
    """Return the loss of return against robots that are each alone on the map.

    Such robots take shortest paths and never miscoordinate, wait or ask. Unlike the return, the
    loss does not depend on the lengths of the paths.
    """
    returns = result.best("returns")
    loss = independent_bound(result.scenario) - returns.mean
    return Measure(loss, returns.spread, returns.standard_error)


def above_optimum(result: ConditionResult) -> bool:
    """True if the paper's return exceeds that of every joint policy."""
    printed = paper(result, "returns")
    return (
        printed is not None
        and errors_from(printed, result.optimum) > CONTRADICTION_ERRORS
    )


def implied_return(result: ConditionResult) -> Measure | None:
    """Return the return that the paper's own number of miscoordinations implies.

    The cost of one miscoordination follows from the exact values of shortest-path policies, which
    miscoordinate at the same doorways: (value without penalties - value) / miscoordinations.
    None if there is nothing to compare, or if the learner pays for asking.
    """
    counted = paper(result, "miscoordinations")
    exact = result.reference
    if counted is None or result.learner.asks or not exact["miscoordinations"]:
        return None
    alone = independent_bound(result.scenario)
    cost = (alone - exact["returns"]) / exact["miscoordinations"]
    return Measure(
        alone - cost * counted.mean,
        cost * counted.spread,
        cost * counted.standard_error,
    )


def contradicts_itself(result: ConditionResult) -> bool:
    """True if the paper's return does not fit its own number of miscoordinations."""
    implied = implied_return(result)
    printed = paper(result, "returns")
    if implied is None or printed is None:
        return False
    error = math.hypot(implied.standard_error, printed.standard_error)
    return abs(printed.mean - implied.mean) > CONTRADICTION_ERRORS * error


def is_shortest(result: ConditionResult) -> bool:
    """Return whether the return agrees with the exact value of shortest-path policies.

    If all runs learned the same route the standard error is 0; then values may differ by less
    than `SAME`.
    """
    returns = result.best("returns")
    exact = result.reference["returns"]
    return abs(returns.mean - exact) < SAME or abs(errors_from(returns, exact)) <= AGREE


def paired(values: np.ndarray) -> Measure:
    """Return mean, spread and standard error of a number that each run has one of."""
    spread = float(values.std(ddof=1)) if len(values) > 1 else math.nan
    return Measure(float(values.mean()), spread, standard_error(values))


def difference(
    result: ConditionResult, other: ConditionResult, measure: str = "returns"
) -> Measure:
    """Return the difference of a measure from another condition, run by run."""
    return paired(result.run_means(measure) - other.run_means(measure))


def surely_better(result: ConditionResult, baseline: ConditionResult) -> bool:
    """True if the return surely exceeds shortest paths' and a learned baseline's, run by run."""
    above_paths = surely_above(result.best("returns"), result.reference["returns"])
    return above_paths and surely_above(difference(result, baseline))


def surely_above(measure: Measure, exact: float = 0.0) -> bool:
    """True if a mean lies more than `AGREE` standard errors above a value."""
    return errors_from(measure, exact) > AGREE


def surely_below(measure: Measure, exact: float = 0.0) -> bool:
    """True if a mean lies more than `AGREE` standard errors below a value."""
    return errors_from(measure, exact) < -AGREE


def gap_closed(
    coop: np.ndarray, baseline: np.ndarray | float, optimum: float
) -> Measure | None:
    """Return (coop - baseline) / (optimum - baseline) of the means with its standard error.

    The error is to first order that of coop_i - (1 - closed) baseline_i over the runs i, divided
    by the gap; the optimum is exact. None if the baseline leaves no gap.

    Args:
        coop: mean return of each run.
        baseline: mean return of each run, paired with those of `coop`; or an exact value.
        optimum: the joint optimum.
    """
    base = np.broadcast_to(baseline, coop.shape)
    gap = optimum - float(base.mean())
    if gap <= 0:
        return None
    closed = float(coop.mean() - base.mean()) / gap
    error = paired(coop - (1 - closed) * base).standard_error / gap
    return Measure(closed, error, error)


def near_doorways(grid: GridMap, moves: int = NEAR_MOVES) -> np.ndarray:
    """Shape (cells,): whether a doorway is at most `moves` moves away."""
    near = np.zeros(len(grid.cells), dtype=bool)
    for doorway in grid.doorways:
        distance = grid.distances_to(doorway)
        near |= (distance != UNREACHABLE) & (distance <= moves)
    return near


def share_near(scenario: Scenario, counts: Sequence[Sequence[float]]) -> float:
    """Return the share of counts by robot and cell that is near doorways; NaN if all are 0."""
    values = np.array(counts)
    total = values.sum()
    return (
        float(values[:, near_doorways(scenario.map)].sum() / total)
        if total
        else math.nan
    )
