# Copyright 2026 The sparse_coord_ros authors
# SPDX-License-Identifier: Apache-2.0
"""How numbers, tables and enumerations are written; the words of the report."""

import math
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import pandas as pd
import yaml

from sparse_coord_ros.experiments.report.entries import Entry, names
from sparse_coord_ros.learn.evaluation import Measure

TEXTS: Mapping[str, Any] = yaml.safe_load(
    Path(__file__).with_name("texts.yaml").read_text(encoding="utf-8")
)
UNITS = ("B", "kB", "MB", "GB", "TB", "PB", "EB", "ZB", "YB")
LEFT = {"scenario", "learner", "learner, peers", "steps", "cost", "percept", "factors"}
LEFT |= {"claim", "from", "measured here", "why"}
"""Columns that are aligned to the left, and the first one of every table."""

Row = Mapping[str, str | None]
"""Column -> text; None and missing columns are shown as a dash."""


def to_markdown(rows: Sequence[Row]) -> str:
    """Return a table."""
    data = pd.DataFrame(rows, dtype=object)
    data = data.where(data.notna(), "-")
    head = [str(column) for column in data.columns]
    rule = [":--" if column in LEFT or not i else "--:" for i, column in enumerate(head)]
    lines = [head, rule, *data.to_numpy().tolist()]
    return "".join("| " + " | ".join(line) + " |\n" for line in lines)


def fixed(value: float, digits: int = 2, sign: str = "") -> str:
    """Return a number; a dash where there is none, such as the standard error of a single run."""
    return "-" if math.isnan(value) else f"{value:{sign}.{digits}f}"


def pair(measure: Measure | None) -> str | None:
    """Return `mean ± spread`."""
    return f"{measure.mean:.2f} ± {measure.spread:.2f}" if measure else None


def with_error(measure: Measure, digits: int = 2, sign: str = "") -> str:
    """Return `mean (standard error)`, with its sign where `sign` is "+"."""
    return f"{measure.mean:{sign}.{digits}f} ({fixed(measure.standard_error, digits)})"


def signed(measure: Measure) -> str:
    """Return `+difference (standard error)`."""
    return with_error(measure, sign="+")


def optimum(entry: Entry) -> str:
    """Return the joint optimum, marked where it is an upper bound only."""
    return f"{'' if entry.result.optimum_exact else '<= '}{entry.result.optimum:.2f}"


def class_bound(entry: Entry) -> str | None:
    """Return what the best known team of Algorithm 1's form is worth; None where it is unknown.

    Marked where no search found it: the best of many learned teams, of more than two robots.
    """
    if entry.best_team is not None:
        return f">= {entry.best_team:.2f}"
    bound = entry.class_bound
    return None if bound is None else f"{bound:.2f}"


def percent(share: float, digits: int = 1) -> str:
    """Return a share in percent."""
    return "-" if math.isnan(share) else f"{100 * share:.{digits}f} %"


def size(count: float) -> str:
    """Return a number of bytes in decimal units, e.g. 14.1 kB."""
    power = 0
    while count >= 1000 and power < len(UNITS) - 1:
        count /= 1000
        power += 1
    return f"{count:.{1 if power else 0}f} {UNITS[power]}"


def listed(texts: Sequence[str]) -> str:
    """Return texts as an enumeration; "none" where there are none."""
    if len(texts) < 2:
        return texts[0] if texts else "none"
    return f"{', '.join(texts[:-1])} and {texts[-1]}"


def exceptions(texts: Sequence[str]) -> str:
    """Return the end of a sentence that counts cases: the others, where there are any."""
    return f"; not in: {listed(texts)}." if texts else "."


def steps(entry: Entry) -> str:
    """Return the step budget, as a power of ten where it is one."""
    digits = str(entry.scenario.steps)
    return f"10^{len(digits) - 1}" if digits.rstrip("0") == "1" and digits != "1" else digits


def shared(entries: Sequence[Entry]) -> dict[str, str]:
    """Return what the conditions of an experiment have in common, for its texts."""
    game = f"penalty {entries[0].scenario.penalty:g}, {steps(entries[0])} learning steps"
    return {"game": game, "names_and_game": f"{', '.join(names(entries))}; {game}"}
