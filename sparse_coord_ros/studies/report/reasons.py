# Copyright 2026 The sparse_coord_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The paper's rows that are not reproduced, or cannot be, and why."""

from collections.abc import Iterable, Sequence

from sparse_coord_ros.core.runs.evaluation import Measure
from sparse_coord_ros.core.solve.optimum import independent_bound
from sparse_coord_ros.core.solve.reference import shortest_path_reference
from sparse_coord_ros.studies.report import analysis
from sparse_coord_ros.studies.report.analysis import AGREE, errors_from
from sparse_coord_ros.studies.report.rows import paper, pick
from sparse_coord_ros.studies.report.text import Row, listed, percent
from sparse_coord_ros.studies.store import ConditionResult


def misses(results: Iterable[ConditionResult]) -> list[Row]:
    """Return the rows whose reward is not the paper's, or cannot be, each with the reason."""
    return [
        {
            "scenario": one.scenario.name,
            "learner": one.learner.title,
            "ours": f"{one.best('reward').mean:.2f}",
            "paper": f"{printed.mean:.2f}",
            "why": _reason(one, printed),
        }
        for one in results
        if (printed := paper(one, "reward"))
        and (
            analysis.above_optimum(one)
            or analysis.contradicts_itself(one)
            or not analysis.agrees(one.best("reward"), printed)
        )
    ]


def _reason(result: ConditionResult, printed: Measure) -> str:
    """Return why the paper's reward of a row is not reproduced."""
    best = result.optimum
    alone = independent_bound(result.scenario)
    bound = (
        "exact joint optimum" if result.optimum_exact else "upper bound of the optimum"
    )
    ideal = abs(errors_from(printed, alone)) <= AGREE
    untouched = f"the {alone:.2f} of robots that never miscoordinate, wait or ask"
    if analysis.above_optimum(result):
        text = f"The paper's row lies above the {bound} {best:.2f}: no policy can reach it."
        return text + f" It equals, within its sampling error, {untouched}." * ideal
    implied = analysis.implied_reward(result)
    turning = _turning(result)
    counted = paper(result, "miscoordinations")
    if counted and implied and analysis.contradicts_itself(result):
        return (
            f"The paper's row contradicts its own Table 2, whose {counted.mean:.2f} "
            f"miscoordinations imply a reward of about {implied.mean:.1f}.{turning}"
        )
    if result.condition.learner == "indiv" and analysis.is_shortest(result):
        return (
            f"Ours agrees with the exact {result.reference['reward']:.2f} of shortest-path "
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
    ours = percent(result.best("reward").mean / best)
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
        f" Robots that all keep right where routes are equally short are worth exactly "
        f"{same.reward:.2f} with {same.miscoordinations:.2f} miscoordinations: the paper's "
        f"{counted.mean:.2f} says that its learners turned alike."
    )


def provenances(results: Sequence[ConditionResult], rows: Iterable[Row]) -> list[str]:
    """Return where the maps come from on which rows do not fit, each text once."""
    maps: dict[str, list[str]] = {}
    for name in dict.fromkeys(str(row["scenario"]) for row in rows):
        maps.setdefault(pick(results, name=name)[0].scenario.map.provenance, []).append(
            name
        )
    return [f"{listed(own)}: {text}." for text, own in maps.items() if text]
