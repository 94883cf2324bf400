# Copyright 2026 The sparse_coord_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Text forms of numbers, tables and enumerations."""

import math
from collections.abc import Mapping, Sequence

import pandas as pd

from sparse_coord_ros.base.percents import percent
from sparse_coord_ros.core.game.scenario import Scenario
from sparse_coord_ros.core.runs.evaluation import Measure
from sparse_coord_ros.studies.condition_result import ConditionResult
from sparse_coord_ros.studies.report.data import best_asking_team, best_team

UNITS = ("B", "kB", "MB", "GB", "TB", "PB", "EB", "ZB", "YB")
LEFT_COLUMNS = {
    "scenario",
    "learner",
    "steps",
    "cost",
    "percept",
    "factors",
    "claim",
    "from",
}
LEFT_COLUMNS |= {"measured here", "why", "measure"}
"""Columns that are aligned to the left, and the first one of every table."""

Row = Mapping[str, str | None]
"""A line of a table: the text of each column; None where it is missing."""


def to_markdown(table: pd.DataFrame) -> str:
    """Return a table of texts as Markdown."""
    columns = list(table.columns)
    rule = ["--:"] * len(columns)
    for number, column in enumerate(columns):
        if column in LEFT_COLUMNS or number == 0:
            rule[number] = ":--"
    lines = [columns, rule, *cells(table)]
    return "".join("| " + " | ".join(line) + " |\n" for line in lines)


def cells(table: pd.DataFrame) -> list[list[str]]:
    """Return the lines of a table of texts; where a text is missing there is a dash."""
    found: list[list[str]] = (
        table.astype(object).where(table.notna(), "-").values.tolist()
    )
    return found


def fixed(value: float, digits: int = 2) -> str:
    """Return a number; a dash for NaN, such as the standard error of a single run."""
    return "-" if math.isnan(value) else f"{value:.{digits}f}"


def with_error(measure: Measure, digits: int = 2, sign: str = "") -> str:
    """Return `mean (standard error)`, with its sign where `sign` is "+"."""
    return f"{measure.mean:{sign}.{digits}f} ({fixed(measure.standard_error, digits)})"


def signed(measure: Measure) -> str:
    """Return `+difference (standard error)`."""
    return with_error(measure, sign="+")


def share(measure: Measure | None) -> str:
    """Return the share of a gap that is closed, with its standard error."""
    if measure is None:
        return "no gap to close"
    return f"{percent(measure.mean)} ± {percent(measure.standard_error)}"


def size(count: float) -> str:
    """Return a number of bytes in decimal units, e.g. 14.1 kB."""
    power = 0
    while count >= 1000 and power < len(UNITS) - 1:
        count /= 1000
        power += 1
    return f"{count:.{1 if power else 0}f} {UNITS[power]}"


def listed(texts: Sequence[str]) -> str:
    """Return texts as an enumeration; "none" for an empty one."""
    if len(texts) < 2:
        return texts[0] if texts else "none"
    return f"{', '.join(texts[:-1])} and {texts[-1]}"


def named(texts: Mapping[str, str]) -> str:
    """Return names with their values, such as `env1 1.61, pentagon 1.77`; or "none"."""
    return ", ".join(f"{name} {text}" for name, text in texts.items()) or "none"


def of(holds: int, cases: int) -> str:
    """Return a text for the number of cases in which something holds."""
    return f"{holds} of {cases}"


def steps(scenario: Scenario) -> str:
    """Return the step budget, as a power of ten where it is one."""
    digits = str(scenario.steps)
    return (
        f"10^{len(digits) - 1}"
        if digits.rstrip("0") == "1" and digits != "1"
        else digits
    )


def factors(result: ConditionResult) -> str:
    """Return the factors of r^C, robot by robot."""
    spec = result.scenario.common_reward
    return " : ".join(f"{factor:g}" for factor in spec.numbers) or spec.kind


def shortest_paths_of(result: ConditionResult, measure: str = "returns") -> str:
    """Return a measure of shortest paths, with its standard error where it is of trials."""
    value = f"{result.reference[measure]:.2f}"
    if not result.reference.get("trials"):
        return value
    return f"{value} ({result.reference[f'{measure}_error']:.2f})"


def optimum_of(result: ConditionResult) -> str:
    """Return the joint optimum, marked where it is an upper bound only."""
    return f"{'' if result.optimum_exact else '<= '}{result.optimum:.2f}"


def bound_of(result: ConditionResult) -> str | None:
    """Return the value of the best asking team found; None if it is not known.

    Marked where no search found it: the best of many learned teams, of more than two robots.
    """
    team = best_team(result)
    bound = best_asking_team(result)
    if team is not None:
        return f">= {team:.2f}"
    return None if bound is None else f"{bound:.2f}"
