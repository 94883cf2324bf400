# Copyright 2026 The sparse_coord_ros authors
# SPDX-License-Identifier: Apache-2.0
"""A section of the report, its claims, and the counts that several sections tell."""

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import pandas as pd

from sparse_coord_ros.core.runs.evaluation import Measure
from sparse_coord_ros.studies.condition_result import ConditionResult
from sparse_coord_ros.studies.report.analysis import surely_above
from sparse_coord_ros.studies.report.text import of

Results = Sequence[ConditionResult]

TARGET = "our target"
CENTRAL_CLAIM = "central claim"
OPEN_QUESTION = "open question (Section 5)"
"""Sources of claims; the others are a table, a figure or a footnote of the paper."""


@dataclass(frozen=True)
class Claim:
    """A line of the findings.

    Attributes:
        text: the claim.
        source: its source.
        measured: our measurement.
        holds: number of cases in which the claim holds.
        cases: number of cases.
    """

    text: str
    source: str
    measured: str
    holds: int
    cases: int


@dataclass(frozen=True)
class Section:
    """One experiment in the report.

    Attributes:
        template: the file of its words in `templates`, with the blocks `intro` and `notes`.
        table: its table of texts; cells may be missing.
        claims: the claims that it bears on.
        values: the variables of its template.
    """

    template: str
    table: pd.DataFrame
    claims: Sequence[Claim] = ()
    values: Mapping[str, Any] = field(default_factory=dict)


def failed(results: Iterable[ConditionResult]) -> str:
    """Return the number of failed teams, and of all teams."""
    results = list(results)
    failing = sum(one.failed_teams for one in results)
    return of(failing, sum(one.runs for one in results))


def surely_positive(measures: Iterable[Measure]) -> tuple[int, int]:
    """Return the number of measures that surely exceed 0, and of all measures."""
    found = [surely_above(one) for one in measures]
    return sum(found), len(found)
