# Copyright 2026 The sparse_coord_ros authors
# SPDX-License-Identifier: Apache-2.0
"""What a part of the report consists of."""

from collections.abc import Sequence
from dataclasses import dataclass, field

from matplotlib.figure import Figure

from sparse_coord_ros.engine.report.entries import Entries, Entry
from sparse_coord_ros.engine.report.tables import Table


@dataclass(frozen=True)
class Picture:
    """A figure of the report.

    Attributes:
        name: stem of its files.
        caption: what it shows.
        figure: the drawing.
    """

    name: str
    caption: str
    figure: Figure


@dataclass(frozen=True)
class Section:
    """One experiment in the report.

    Attributes:
        shown: what is shown, a paragraph.
        tables: for reading.
        pictures: figures.
        text: paragraphs that explain.
        findings: what it comes to, sentences for the summary.
        misses: what was not reproduced, and why.
    """

    shown: str
    tables: Sequence[Table]
    pictures: Sequence[Picture]
    text: Sequence[str] = ()
    findings: Sequence[str] = ()
    misses: Sequence[str] = field(default=())


def game(entry: Entry) -> str:
    """Return penalty and step budget of a cell, for captions."""
    return f"penalty {entry.scenario.penalty:g}, {steps(entry)} learning steps"


def steps(entry: Entry) -> str:
    """Return the step budget, as a power of ten where it is one."""
    count = entry.scenario.steps
    digits = str(count)
    power = digits.rstrip("0") == "1" and count > 1
    return f"10^{len(digits) - 1}" if power else digits


def names_and_settings(entries: Entries) -> str:
    """Return what the scenarios of a sweep have in common."""
    return f"{', '.join(entries.names)}; {game(entries[0])}"
