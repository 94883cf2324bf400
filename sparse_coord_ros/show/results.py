# Copyright 2026 The sparse_coord_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Pictures of results: the report's figures, and a figure of any conditions."""

from collections.abc import Mapping, Sequence
from pathlib import Path

from matplotlib.figure import Figure

from sparse_coord_ros.base.errors import ResultsError, SettingError, did_you_mean
from sparse_coord_ros.studies.catalogue import NAMES, Experiment, experiment
from sparse_coord_ros.studies.condition_result import ConditionResult
from sparse_coord_ros.studies.report.data import by_scenario
from sparse_coord_ros.studies.report.figures import DRAWN, Draw
from sparse_coord_ros.studies.report.map_pictures import asked_maps
from sparse_coord_ros.studies.store import Plan, Say, read_results


def results_figure(
    directory: Path, what: str | None = None, say: Say = lambda _: None
) -> tuple[str, Figure]:
    """Draw a figure of a results directory.

    Args:
        directory: the results directory.
        what: `conditions`: all of them; `asks`: a map for each scenario in which robots may ask,
            of the condition of `most_asking`; a complete experiment, or one of its figures; None:
            the first of these.
        say: receives notes on omissions, and on the condition that a map shows.

    Returns:
        The figure's name, and the figure.

    Raises:
        ResultsError: the directory has no results, or a damaged one.
        SettingError: unknown figure.
    """
    _, results = some_results(directory, say)
    known = drawn(results)
    what = what or "conditions"
    if what not in known:
        why = f"these results have {', '.join(known)}{did_you_mean(what, known)}"
        raise SettingError(f"--what {what!r}: {why}")
    if what == "asks":
        for one in known[what]:
            say(
                f"asks: {one.id}, where robots ask most at the hardest penalty there is"
            )
    return what, figure_of(what, known[what])


def some_results(directory: Path, say: Say) -> tuple[Plan, list[ConditionResult]]:
    """Return the results in a directory; errors as in `results_figure`."""
    plan, results = read_results(directory, say)
    if not results:
        remedy = "'sparse_coord reproduce' writes results"
        raise ResultsError(f"{directory}: holds no result yet; {remedy}")
    return plan, results


def complete_experiments(results: Sequence[ConditionResult]) -> list[Experiment]:
    """Return the experiments with results of all their conditions."""
    ids = {one.id for one in results}
    known = [experiment(name) for name in NAMES]
    return [one for one in known if ids.issuperset(each.id for each in one.conditions)]


def drawn(results: Sequence[ConditionResult]) -> Mapping[str, list[ConditionResult]]:
    """Return the possible figures by name, each with its results."""
    by_id = {one.id: one for one in results}
    found = {"conditions": list(results)}
    for one in complete_experiments(results):
        own = [by_id[each.id] for each in one.conditions]
        found |= dict.fromkeys(DRAWN[one.name], own)
    asking = by_scenario(one for one in results if one.learner.asks)
    if asking:
        found["asks"] = [most_asking(own) for own in asking]
    return found


def most_asking(results: Sequence[ConditionResult]) -> ConditionResult:
    """Return one scenario's condition with the hardest penalty in which robots ask most.

    It has most to show. Of equal ones the first by its id.
    """
    hardest = min(one.scenario.penalty for one in results)
    there = sorted(
        (one for one in results if one.scenario.penalty == hardest), key=lambda e: e.id
    )
    return max(there, key=lambda one: one.best("asks").mean)


def figure_of(what: str, results: Sequence[ConditionResult]) -> Figure:
    """Return a figure by its name in `drawn`."""
    draws: dict[str, Draw] = {"asks": asked_maps}
    for files in DRAWN.values():
        draws |= files
    return draws[what](results)
