# Copyright 2026 The sparse_coord_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The HTML report of a results directory: findings, tables, figures, every condition."""

import shlex
from collections.abc import Iterable, Iterator, Sequence
from pathlib import Path

import pandas as pd

from sparse_coord_ros.base.percents import percent
from sparse_coord_ros.base.version import __version__
from sparse_coord_ros.show.html import Part, code, page, picture, table, text
from sparse_coord_ros.show.results import (
    complete_experiments,
    drawn,
    figure_of,
    some_results,
)
from sparse_coord_ros.studies.condition_result import ConditionResult
from sparse_coord_ros.studies.report.analysis import AGREE
from sparse_coord_ros.studies.report.data import names
from sparse_coord_ros.studies.report.document import (
    Findings,
    ReportedExperiment,
    findings,
    how_to_read,
)
from sparse_coord_ros.studies.report.text import (
    bound_of,
    cells,
    listed,
    of,
    optimum_of,
    shortest_paths_of,
    with_error,
)
from sparse_coord_ros.studies.store import Plan, Say

RESULT_CAPTIONS = {
    "conditions": "Learners against the first setting in which the conditions differ, beside "
    "reference values. Bars are standard errors of the mean over the learning runs.",
    "asks": "Where robots ask: the darker a cell, the more often COORDINATE is chosen there. "
    "For each scenario: the condition with the most questions at the largest penalty. S: "
    "starts, G: "
    "goals.",
}


def results_report(directory: Path, say: Say = lambda _: None) -> str:
    """Return the page of a results directory.

    Args:
        directory: the results directory.
        say: receives notes on omissions and on slow work.

    Raises:
        ResultsError: the directory has no results, or a damaged one.
    """
    left_out: list[str] = []
    plan, results = some_results(directory, left_out.append)
    for line in left_out:
        say(line)
    chosen = complete_experiments(results)
    found = findings(plan, chosen, {one.id: one for one in results})
    shown = {one.id for part in found.parts for one in part.results}
    others = [one for one in results if one.id not in shown]
    sections: dict[str, Iterable[Part]] = {
        "": _begin(directory, plan, results, left_out)
    }
    if not found.claims.empty:
        sections["Findings"] = _findings(found)
    for part in found.parts:
        sections[part.title] = _experiment(part, say)
    if others:
        heading = "Other conditions" if found.parts else "Conditions"
        sections[heading] = _conditions(others, say)
    if found.parts:
        sections["Every condition"] = [_conditions_table(results)]
    if not found.missed.empty:
        heading = "Rows of the paper that are not reproduced, or are inconsistent"
        sections[heading] = _missed(found)
    sections["How to read the tables"] = [text(point) for point in how_to_read()]
    sections["How to reproduce it"] = _again(plan, found.parts, others)
    return page(f"Results: {directory.resolve().name}", sections)


def _begin(
    directory: Path,
    plan: Plan,
    results: Sequence[ConditionResult],
    left_out: Sequence[str],
) -> Iterator[Part]:
    seeds = (
        f"seeds {plan.seeds[0]} to {plan.seeds[-1]}"
        if plan.runs > 1
        else f"seed {plan.seed}"
    )
    yield text(
        f"{_count(len(results), 'condition')} of {listed(names(results))}; of each "
        f"{_count(plan.runs, 'learning run')} ({seeds}) of {_count(plan.trials, 'trial')}. "
        f"From {directory}; report of sparse_coord_ros {__version__}."
    )
    for line in left_out:
        yield text(line, warn=True)


def _count(number: int, thing: str) -> str:
    return f"{number} {thing}{'s' * (number != 1)}"


def _findings(found: Findings) -> Iterator[Part]:
    yield text(
        'Claims, measurements, and in how many cases both agree. "Surely": by '
        f"more than {AGREE:g} standard errors."
    )
    if found.plan.runs == 1:
        yield text(
            "A single run has no standard error, so claims are not judged.", warn=True
        )
    yield _table(found.claims, words=True)


def _experiment(part: ReportedExperiment, say: Say) -> Iterator[Part]:
    say(f"drawing {part.name}")
    yield from map(text, _paragraphs(part.intro))
    yield _table(part.table)
    for name, figure in part.figures().items():
        yield picture(figure, f"{part.title} ({name}).")
    yield from map(text, _paragraphs(part.notes))


def _paragraphs(markdown: str) -> list[str]:
    plain = markdown.replace("`", "")
    found = [" ".join(paragraph.split()) for paragraph in plain.split("\n\n")]
    return [paragraph for paragraph in found if paragraph]


def _conditions(results: Sequence[ConditionResult], say: Say) -> Iterator[Part]:
    """Yield the table of conditions, and their pictures."""
    yield _conditions_table(results)
    for what, own in drawn(results).items():
        if what in RESULT_CAPTIONS:
            say(f"drawing {what}")
            yield picture(figure_of(what, own), RESULT_CAPTIONS[what])


def _conditions_table(results: Iterable[ConditionResult]) -> Part:
    rows = [
        {
            "condition": one.id,
            "return (s.e.)": with_error(one.best("returns")),
            "time to goal": f"{one.best('time_to_goal').mean:.2f}",
            "miscoordinations": f"{one.best('miscoordinations').mean:.3f}",
            "asks": f"{one.best('asks').mean:.2f}",
            "all arrive": percent(one.arrived),
            "failed teams": of(one.failed_teams, one.runs),
            "shortest paths": shortest_paths_of(one),
            "best asking team found": bound_of(one),
            "joint optimum": optimum_of(one),
        }
        for one in results
    ]
    return _table(pd.DataFrame(rows))


def _missed(found: Findings) -> Iterator[Part]:
    yield _table(found.missed, words=True)
    yield from map(text, found.maps)


def _again(
    plan: Plan, parts: Sequence[ReportedExperiment], others: Sequence[ConditionResult]
) -> Iterator[Part]:
    """Yield the command that computes the results again."""
    asked = [part.name for part in parts] + [one.id for one in others]
    words = ["sparse_coord", "reproduce", *asked, "--runs", str(plan.runs)]
    words += [
        "--trials",
        str(plan.trials),
        "--seed",
        str(plan.seed),
        "--out",
        "results",
    ]
    yield code(shlex.join(words))
    own = names(one for one in others if one.condition.own_scenario is not None)
    if own:
        yield text(f"In place of {listed(own)}: the path of that scenario's file.")


def _table(data: pd.DataFrame, *, words: bool = False) -> Part:
    return table(list(data.columns), cells(data), words=words)
