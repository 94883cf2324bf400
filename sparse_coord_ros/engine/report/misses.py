# Copyright 2026 The sparse_coord_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Rows of the paper that are not reproduced or are inconsistent, and why."""

import math

from sparse_coord_ros.core.evaluation import Measure
from sparse_coord_ros.core.optimum import independent_bound
from sparse_coord_ros.core.reference import shortest_path_reference
from sparse_coord_ros.engine.report.analysis import (
    AGREE,
    above_optimum,
    agrees,
    contradicts_itself,
    errors_from,
    implied_reward,
)
from sparse_coord_ros.engine.report.entries import Entries, Entry
from sparse_coord_ros.engine.report.tables import percent


def versus(entry: Entry, measure: str) -> str:
    """Return a row's name with ours and the paper's mean."""
    ours, paper = entry.measure(measure), entry.paper(measure)
    return f"{entry.label} (ours {ours.mean:.2f}, paper {paper.mean:.2f})"


def misses(entries: Entries) -> list[str]:
    """Return the rows whose reward is not the paper's, or cannot be, each with the reason."""
    found = []
    for entry in entries:
        paper = entry.paper("reward")
        if paper and (
            above_optimum(entry)
            or contradicts_itself(entry)
            or not agrees(entry.measure("reward"), paper)
        ):
            found.append(f"{versus(entry, 'reward')}: {_reason(entry, paper)}")
    return found


def _reason(entry: Entry, paper: Measure) -> str:
    """Return why the paper's reward of a row is not reproduced."""
    ours, result = entry.measure("reward"), entry.result
    if above_optimum(entry):
        alone = independent_bound(entry.scenario)
        bound = "exact joint optimum" if result.optimum_exact else "upper bound of the optimum"
        equal = (
            f" It equals, within its sampling error, the value {alone:.2f} of robots that never "
            "miscoordinate, wait or ask."
            if abs(errors_from(paper, alone)) <= AGREE
            else ""
        )
        return (
            f"the paper's row lies above the {bound} {result.optimum:.2f}, above what any policy "
            f"can reach {_on_map(entry)}.{equal}"
        )
    if contradicts_itself(entry):
        counted = entry.paper("miscoordinations").mean
        return (
            f"the paper's row contradicts its own Table 2, whose {counted:.2f} miscoordinations "
            f"imply a reward of about {implied_reward(entry).mean:.1f} {_on_map(entry)}."
            f"{_turning(entry)}"
        )
    exact = result.reference["reward"]
    if entry.cell.learner == "indiv" and abs(errors_from(ours, exact)) <= AGREE:
        return (
            f"ours agrees with the exact value {exact:.2f} of shortest-path policies that break "
            f"ties at random {_on_map(entry)}; the paper does not say how it breaks ties."
            f"{_turning(entry)}"
        )
    behind = (
        f" The paper's is {percent(paper.mean / result.optimum)} of the "
        f"{'optimum' if result.optimum_exact else 'upper bound of the optimum'}, ours "
        f"{percent(ours.mean / result.optimum)}."
    )
    if entry.cell.learner == "coop" and math.isclose(
        paper.mean, independent_bound(entry.scenario), abs_tol=AGREE * paper.standard_error
    ):
        return (
            "the paper's row equals, within its sampling error, the value "
            f"{independent_bound(entry.scenario):.2f} of robots that never miscoordinate, wait or "
            f"ask {_on_map(entry)}; our learners pay for at least one of these.{behind}"
        )
    turning = _turning(entry).strip() if entry.cell.learner == "noncoop" else ""
    return (turning or f"not explained by the paper's numbers {_on_map(entry)}.") + behind


def _on_map(entry: Entry) -> str:
    """Return the words that a statement about exact values holds for the map as we have it."""
    provenance = entry.scenario.map.provenance
    return f"on this map (provenance: {provenance})" if provenance else "on this map"


def _turning(entry: Entry) -> str:
    """Return a sentence where the paper's miscoordinations are those of robots that keep right."""
    paper = entry.paper("miscoordinations")
    same = shortest_path_reference(entry.scenario, turning="same")
    chance = entry.result.reference["miscoordinations"]
    if paper is None or abs(errors_from(paper, same.miscoordinations)) > AGREE:
        return ""
    if abs(errors_from(paper, chance)) <= AGREE:
        return ""
    return (
        " Robots that all keep right where routes are equally short are worth "
        f"{same.reward:.2f} with {same.miscoordinations:.2f} miscoordinations (exact): the "
        f"paper's {paper.mean:.2f} says that its learners turned alike."
    )
