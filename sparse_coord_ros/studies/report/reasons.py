# Copyright 2026 The sparse_coord_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The paper's rows that are not reproduced, or cannot be, and why."""

from collections.abc import Iterable, Sequence

import pandas as pd

from sparse_coord_ros.base.percents import percent
from sparse_coord_ros.core.runs.evaluation import Measure
from sparse_coord_ros.core.solve.optimum import independent_bound
from sparse_coord_ros.core.solve.reference import shortest_path_reference
from sparse_coord_ros.studies.condition_result import ConditionResult
from sparse_coord_ros.studies.report.analysis import (
    AGREE,
    above_optimum,
    agrees,
    contradicts_itself,
    errors_from,
    implied_return,
    is_shortest,
)
from sparse_coord_ros.studies.report.data import paper, pick
from sparse_coord_ros.studies.report.text import listed


def misses(results: Iterable[ConditionResult]) -> pd.DataFrame:
    """Return the paper's rows that are not reproduced or impossible, each with the reason."""
    rows = []
    last_reason = ""
    for one in results:
        printed = paper(one, "returns")
        if printed is None or _is_reproduced(one, printed):
            continue
        reason = _reason(one, printed)
        rows.append(
            {
                "scenario": one.scenario.name,
                "learner": one.learner.title,
                "ours": f"{one.best('returns').mean:.2f}",
                "paper": f"{printed.mean:.2f}",
                "why": "As in the row above." if reason == last_reason else reason,
            }
        )
        last_reason = reason
    return pd.DataFrame(rows)


def _is_reproduced(result: ConditionResult, printed: Measure) -> bool:
    """True if our return agrees with the paper's, and the paper's is possible."""
    possible = not (above_optimum(result) or contradicts_itself(result))
    return possible and agrees(result.best("returns"), printed)


def _reason(result: ConditionResult, printed: Measure) -> str:
    """Return why the paper's return of a row is not reproduced."""
    best = result.optimum
    alone = independent_bound(result.scenario)
    bound = (
        "exact joint optimum" if result.optimum_exact else "upper bound of the optimum"
    )
    ideal = abs(errors_from(printed, alone)) <= AGREE
    untouched = f"the {alone:.2f} of robots that never miscoordinate, wait or ask"
    if above_optimum(result):
        text = f"The paper's row lies above the {bound} {best:.2f}: no policy can reach it."
        return text + f" It equals, within its sampling error, {untouched}." * ideal
    implied = implied_return(result)
    turning = _turning(result)
    counted = paper(result, "miscoordinations")
    if counted and implied and contradicts_itself(result):
        return (
            f"The paper's row contradicts its own Table 2: {counted.mean:.2f} "
            f"miscoordinations imply a return of about {implied.mean:.1f}.{turning}"
        )
    if result.condition.learner == "indiv" and is_shortest(result):
        return (
            f"Ours agrees with the exact {result.reference['returns']:.2f} of shortest-path "
            "policies that break ties at random; the paper does not say how it breaks "
            f"ties.{turning}"
        )
    text = "Not explained by the numbers of the paper."
    if result.learner.asks and ideal:
        text = (
            f"The paper's row equals, within its sampling error, {untouched}; our learners pay "
            "for at least one of these."
        )
    elif result.condition.learner == "noncoop" and turning:
        text = turning.strip()
    ours = percent(result.best("returns").mean / best)
    return f"{text} The paper's row is {percent(printed.mean / best)} of the {bound}, ours {ours}."


def _turning(result: ConditionResult) -> str:
    """Return a sentence where the paper's miscoordinations are those of robots that keep right."""
    counted = paper(result, "miscoordinations")
    if counted is None:
        return ""
    same = shortest_path_reference(result.scenario, keep_right=True)
    alike = abs(errors_from(counted, same.miscoordinations)) <= AGREE
    if (
        not alike
        or abs(errors_from(counted, result.reference["miscoordinations"])) <= AGREE
    ):
        return ""
    return (
        f" Robots that all keep right where routes are equally short earn exactly "
        f"{same.returns:.2f}, with {same.miscoordinations:.2f} miscoordinations. The paper's "
        f"{counted.mean:.2f} suggests that its learners turned alike."
    )


def provenances(results: Sequence[ConditionResult], missed: pd.DataFrame) -> list[str]:
    """Return the sources of the maps of rows that are not reproduced, each text once."""
    if missed.empty:
        return []
    maps: dict[str, list[str]] = {}
    for name in missed["scenario"].unique():
        provenance = pick(results, name=name)[0].scenario.map.provenance
        maps.setdefault(provenance, []).append(name)
    return [f"{listed(own)}: {text}." for text, own in maps.items() if text]
