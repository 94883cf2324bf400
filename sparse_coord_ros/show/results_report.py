# Copyright 2026 The sparse_coord_ros authors
# SPDX-License-Identifier: Apache-2.0
"""A page that tells all of a results directory: findings, tables, figures, every condition."""

import shlex
from collections.abc import Iterable, Iterator, Sequence
from pathlib import Path

from sparse_coord_ros.base.version import __version__
from sparse_coord_ros.show.html import Part, code, page, picture, table, text
from sparse_coord_ros.show.results import (
    complete_experiments,
    drawn,
    figure_of,
    some_results,
)
from sparse_coord_ros.studies.report.analysis import AGREE
from sparse_coord_ros.studies.report.document import Findings, findings, how_to_read
from sparse_coord_ros.studies.report.document import Part as ExperimentPart
from sparse_coord_ros.studies.report.rows import names
from sparse_coord_ros.studies.report.text import (
    Row,
    as_table,
    bound_of,
    listed,
    of,
    optimum_of,
    percent,
    with_error,
)
from sparse_coord_ros.studies.store import ConditionResult, Plan, Say

CAPTIONS = {
    "conditions": "Learners against the first setting in which the conditions differ, beside what "
    "they are to be compared with. Bars are standard errors of the mean over the learning runs.",
    "asks": "Where robots ask: the darker a cell, the more often COORDINATE is chosen there. Of "
    "each scenario that condition of the hardest penalty in which they ask most. S: starts, G: "
    "goals.",
}


def results_report(directory: Path, say: Say = lambda _: None) -> str:
    """Return the page of a results directory.

    Args:
        directory: where it is.
        say: hears what is left out, and what takes a while.

    Raises:
        ResultsError: it is no results directory, or holds no result yet, or a damaged one.
    """
    left_out: list[str] = []
    plan, results = some_results(directory, left_out.append)
    for line in left_out:
        say(line)
    chosen = complete_experiments(results)
    said = findings(plan, chosen, {one.id: one for one in results})
    shown = {one.id for part in said.parts for one in part.results}
    others = [one for one in results if one.id not in shown]
    sections: dict[str, Iterable[Part]] = {
        "": _begin(directory, plan, results, left_out)
    }
    if said.claims:
        sections["Findings"] = _findings(said)
    for part in said.parts:
        sections[part.title] = _experiment(part, say)
    if others:
        sections["Other conditions" if said.parts else "Conditions"] = _conditions(
            others, say
        )
    if said.parts:
        sections["Every condition"] = [_table([_row(one) for one in results])]
    if said.missed:
        sections["Rows of the paper that are not reproduced, or are inconsistent"] = (
            _missed(said)
        )
    sections["How to read the tables"] = [text(point) for point in how_to_read()]
    sections["How to reproduce it"] = _again(plan, said.parts, others)
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


def _findings(said: Findings) -> Iterator[Part]:
    yield text(
        'What is claimed, what was measured, and in how many cases the two agree. "Surely": by '
        f"more than {AGREE:g} standard errors."
    )
    if said.plan.runs == 1:
        yield text("A single run has no standard error: nothing is judged.", warn=True)
    yield _table(said.claims, words=True)


def _experiment(part: ExperimentPart, say: Say) -> Iterator[Part]:
    say(f"drawing {part.name}")
    yield from map(text, part.paragraphs("shown"))
    yield _table(part.rows)
    for name, figure in part.figures().items():
        yield picture(figure, f"{part.title} ({name}).")
    yield from map(text, part.paragraphs("notes"))


def _conditions(results: Sequence[ConditionResult], say: Say) -> Iterator[Part]:
    """Yield the table of conditions, and their pictures."""
    yield _table([_row(one) for one in results])
    for what, own in drawn(results).items():
        if what in CAPTIONS:
            say(f"drawing {what}")
            yield picture(figure_of(what, own), CAPTIONS[what])


def _row(result: ConditionResult) -> Row:
    return {
        "condition": result.id,
        "reward (s.e.)": with_error(result.best("reward")),
        "time to goal": f"{result.best('time_to_goal').mean:.2f}",
        "miscoordinations": f"{result.best('miscoordinations').mean:.3f}",
        "asks": f"{result.best('asks').mean:.2f}",
        "all arrive": percent(result.arrived, 2),
        "failed teams": of(result.failed_teams, result.runs),
        "shortest paths": f"{result.reference['reward']:.2f}",
        "best asking team found": bound_of(result),
        "joint optimum": optimum_of(result),
    }


def _missed(said: Findings) -> Iterator[Part]:
    yield _table(said.missed, words=True)
    yield from map(text, said.maps)


def _again(
    plan: Plan, parts: Sequence[ExperimentPart], others: Sequence[ConditionResult]
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


def _table(rows: Sequence[Row], *, words: bool = False) -> Part:
    return table(*as_table(rows), words=words)
