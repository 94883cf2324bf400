# Copyright 2026 The sparse_coord_ros authors
# SPDX-License-Identifier: Apache-2.0
"""What a part of the report consists of, and what several parts share."""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field

from matplotlib.figure import Figure

from sparse_coord_ros.experiments.report.entries import Entry
from sparse_coord_ros.experiments.report.text import (
    Row,
    class_bound,
    optimum,
    percent,
    size,
    with_error,
)


@dataclass(frozen=True)
class Section:
    """One experiment in the report; its words are in `texts.yaml`.

    Attributes:
        values: what the texts leave open.
        tables: the rows of each table.
        figures: one a caption.
        agrees: for each claim, in how many cases it holds, and of how many.
        misses: rows of the paper that do not fit.
    """

    values: dict[str, str]
    tables: Sequence[Sequence[Row]]
    figures: Sequence[Figure]
    agrees: Sequence[tuple[int, int]]
    misses: Sequence[Row] = field(default=())


def common(entry: Entry) -> Row:
    """Return the columns that most tables share: what a condition brings."""
    return {
        "reward (s.e.)": with_error(entry.measure("reward")),
        "class bound": class_bound(entry) if entry.can_ask else None,
        "joint optimum": optimum(entry),
        "miscoordinations (s.e.)": with_error(entry.measure("miscoordinations"), 3),
        "COORDINATE (s.e.)": with_error(entry.measure("asks"), 3) if entry.can_ask else None,
        "all arrive": percent(entry.result.arrived, 2),
    }


def memory(entry: Entry) -> Row:
    """Return the columns on the memory of one robot's Q^C."""
    return {
        "bytes visited": size(entry.result.visited_bytes) if entry.can_ask else None,
        "bytes dense": size(entry.dense_bytes) if entry.can_ask else None,
    }


def failed(entries: Iterable[Entry]) -> str:
    """Return how many teams fail, of how many."""
    results = [entry.result for entry in entries]
    return f"{sum(r.failed_teams for r in results)} of {sum(r.runs for r in results)}"
