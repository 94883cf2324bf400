# Copyright 2026 The sparse_coord_ros authors
# SPDX-License-Identifier: Apache-2.0
"""What the results say: agreement with exact values and the paper, gaps closed, places of asks."""

import math

import numpy as np

from sparse_coord_ros.core.evaluation import Measure
from sparse_coord_ros.core.grid import UNREACHABLE, GridMap
from sparse_coord_ros.core.optimum import independent_bound
from sparse_coord_ros.engine.report.entries import Entry

AGREE = 3.0
"""Two values agree within as many standard errors of their difference."""

SURE = 5.0
"""A number of the paper is called impossible from as many of its standard errors on."""

NEAR = 2
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
    """Whether two means differ by no more than `AGREE` standard errors of their difference."""
    error = math.hypot(ours.standard_error, other.standard_error)
    return abs(ours.mean - other.mean) <= AGREE * error


def above_optimum(entry: Entry) -> bool:
    """Whether the paper's reward exceeds what any joint policy can reach."""
    paper = entry.paper("reward")
    return paper is not None and errors_from(paper, entry.result.optimum) > SURE


def implied_reward(entry: Entry) -> Measure | None:
    """Return the reward that the paper's own number of miscoordinations implies.

    What one miscoordination costs is taken from the exact values of shortest-path policies, which
    miscoordinate at the same doorways: (value without penalties - value) / miscoordinations.
    None where there is nothing to compare, or the row is one of a learner that pays for asking.
    """
    counted = entry.paper("miscoordinations")
    exact = entry.result.reference
    if counted is None or entry.cell.learner == "coop" or not exact["miscoordinations"]:
        return None
    alone = independent_bound(entry.scenario)
    cost = (alone - exact["reward"]) / exact["miscoordinations"]
    return Measure(
        alone - cost * counted.mean, cost * counted.spread, cost * counted.standard_error
    )


def contradicts_itself(entry: Entry) -> bool:
    """Whether the paper's reward does not follow from its own number of miscoordinations."""
    implied, paper = implied_reward(entry), entry.paper("reward")
    if implied is None or paper is None:
        return False
    error = math.hypot(implied.standard_error, paper.standard_error)
    return abs(paper.mean - implied.mean) > SURE * error


def gap_closed(coop: Measure, baseline: Measure, optimum: float) -> Measure | None:
    """Return (coop - baseline) / (optimum - baseline) with its standard error.

    The error follows from those of the two means, which are independent; the optimum has none.
    None where the baseline leaves no gap.
    """
    gap = optimum - baseline.mean
    if gap <= 0:
        return None
    share = (coop.mean - baseline.mean) / gap
    error = math.hypot(coop.standard_error, (1 - share) * baseline.standard_error) / gap
    return Measure(share, error, error)


def near_doorways(grid: GridMap, moves: int = NEAR) -> np.ndarray:
    """Shape (cells,): whether a doorway is at most `moves` moves away."""
    near = np.zeros(len(grid.cells), dtype=bool)
    for doorway in grid.doorways:
        distance = grid.distances_to(doorway)
        near |= (distance != UNREACHABLE) & (distance <= moves)
    return near


def asked_near(entry: Entry, moves: int = NEAR) -> float:
    """Return the share of COORDINATE chosen near doorways; NaN where it is never chosen."""
    asked = np.array(entry.result.asked)
    near = near_doorways(entry.scenario.map, moves)
    total = asked.sum()
    return float(asked[:, near].sum() / total) if total else math.nan
