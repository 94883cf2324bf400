# Copyright 2026 The sparse_coord_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The report on experiments: `reproduction.md` with its tables and figures."""

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import Any

import jinja2
import pandas as pd
from matplotlib.figure import Figure

from sparse_coord_ros.base.version import __version__
from sparse_coord_ros.core.solve.verdict import RARE
from sparse_coord_ros.studies.catalogue import NAMES, Experiment
from sparse_coord_ros.studies.condition_result import ConditionResult
from sparse_coord_ros.studies.report.analysis import AGREE, NEAR_MOVES
from sparse_coord_ros.studies.report.charts import save
from sparse_coord_ros.studies.report.claims import Claim
from sparse_coord_ros.studies.report.data import to_csv
from sparse_coord_ros.studies.report.figures import DRAWN, figures_of
from sparse_coord_ros.studies.report.paper_sections import return_claims
from sparse_coord_ros.studies.report.reasons import misses, provenances
from sparse_coord_ros.studies.report.sections import SECTIONS
from sparse_coord_ros.studies.report.text import named, of, steps, to_markdown
from sparse_coord_ros.studies.store import Plan, write_result

RETURNS = {"table1": "Table 1", "table3": "Table 3"}
"""The experiments that reproduce a table of returns, and the table's name in the paper."""


@dataclass(frozen=True)
class ReportedExperiment:
    """One experiment of the report.

    Attributes:
        name: its name for `reproduce`.
        title: its title.
        results: the result of each of its conditions.
        table: its table, as of `Section`.
        intro: Markdown before the table.
        notes: Markdown after the figures; may be empty.
    """

    name: str
    title: str
    results: Sequence[ConditionResult]
    table: pd.DataFrame
    intro: str
    notes: str

    def figures(self) -> dict[str, Figure]:
        """Draw its figures; return them by the names of their files."""
        return figures_of(self.name, self.results)


@dataclass(frozen=True)
class Findings:
    """The content of the report.

    Attributes:
        plan: seed, runs and trials of every condition.
        parts: the experiments.
        claims: the table of findings.
        missed: the paper's rows that are not reproduced or impossible, each with the reason.
        maps: the sources of the maps of those rows.
    """

    plan: Plan
    parts: Sequence[ReportedExperiment]
    claims: pd.DataFrame
    missed: pd.DataFrame
    maps: Sequence[str]


def write_report(
    directory: Path,
    plan: Plan,
    chosen: Sequence[Experiment],
    found: Mapping[str, ConditionResult],
) -> None:
    """Write tables, figures and `reproduction.md`; the same results give the same bytes.

    Args:
        directory: gets `reproduction.md` and the folders `tables` (NAME.csv of each experiment)
            and `figures` (PNG and SVG).
        plan: seed, runs and trials of every condition.
        chosen: the experiments, in the order in which they are to appear.
        found: result of every condition of these experiments, by its id.
    """
    (directory / "figures").mkdir(parents=True, exist_ok=True)
    report = findings(plan, chosen, found)
    for part in report.parts:
        write_result(directory / f"tables/{part.name}.csv", to_csv(part.results))
        for name, figure in part.figures().items():
            save(figure, directory / f"figures/{name}")
    write_result(directory / "reproduction.md", reproduction_page(report))


def reproduction_page(report: Findings) -> str:
    """Return `reproduction.md`."""
    names = tuple(part.name for part in report.parts)
    return (
        _templates()
        .get_template("reproduction.md.j2")
        .render(
            version=__version__,
            whole=names == NAMES,
            report=report,
            figures={name: list(DRAWN[name]) for name in names},
            AGREE=AGREE,
            linked=True,
        )
    )


def findings(
    plan: Plan, chosen: Sequence[Experiment], found: Mapping[str, ConditionResult]
) -> Findings:
    """Return the content of the report; arguments as of `write_report`."""
    results = {one.name: [found[each.id] for each in one.conditions] for one in chosen}
    claims = _claims_on_returns(results)
    parts = []
    for one in chosen:
        own = results[one.name]
        section = SECTIONS[one.name](own)
        claims += section.claims
        template = _templates().get_template(section.template)
        values = {
            "game": _game(own[0]),
            "NEAR_MOVES": NEAR_MOVES,
            "RARE": RARE,
            **section.values,
        }
        intro = _block(template, "intro", values)
        notes = _block(template, "notes", values)
        parts.append(
            ReportedExperiment(one.name, one.title, own, section.table, intro, notes)
        )
    shown = [one for name in RETURNS for one in results.get(name, ())]
    missed = misses(shown)
    return Findings(
        plan,
        parts,
        _claims_table(claims, judged=plan.runs > 1),
        missed,
        provenances(shown, missed),
    )


def how_to_read() -> list[str]:
    """Return how to read the tables, as plain text: a list of points."""
    points = "\n" + _templates().get_template("reading.md.j2").render(linked=False)
    return [
        " ".join(point.replace("`", "").split()) for point in points.split("\n- ")[1:]
    ]


@cache
def _templates() -> jinja2.Environment:
    found = jinja2.Environment(
        loader=jinja2.FileSystemLoader(Path(__file__).with_name("templates")),
        undefined=jinja2.StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
        keep_trailing_newline=True,
        autoescape=False,  # noqa: S701 - the pages are Markdown
    )
    found.filters |= {"table": to_markdown, "named": named}
    return found


def _block(template: jinja2.Template, name: str, values: Mapping[str, Any]) -> str:
    """Return a rendered block of a template; empty if the template has no such block."""
    if name not in template.blocks:
        return ""
    context = template.new_context(dict(values))
    return "".join(template.blocks[name](context)).strip()


def _game(result: ConditionResult) -> str:
    scenario = result.scenario
    return f"penalty {scenario.penalty:g}, {steps(scenario)} learning steps"


def _claims_on_returns(
    results: Mapping[str, Sequence[ConditionResult]],
) -> list[Claim]:
    """Return the claims on all tables of returns together; empty without such a table."""
    tables = [name for name in RETURNS if name in results]
    if not tables:
        return []
    numbers = [RETURNS[name].removeprefix("Table ") for name in tables]
    source = f"Table{'s' * (len(tables) - 1)} {' and '.join(numbers)}"
    shown = [one for name in tables for one in results[name]]
    # Table 2 has the conditions of Table 1.
    elsewhere = {
        name: own for name, own in results.items() if name not in (*RETURNS, "table2")
    }
    return return_claims(source, shown, elsewhere)


def _claims_table(claims: Iterable[Claim], *, judged: bool) -> pd.DataFrame:
    """Return the table of findings.

    Args:
        claims: its lines.
        judged: whether it says which claims hold; a single run has no error to judge by.
    """
    rows = []
    for one in claims:
        if not judged or one.cases == 0:
            verdict = None
        elif one.holds == one.cases:
            verdict = "yes"
        elif one.holds == 0:
            verdict = "no"
        else:
            verdict = f"in {of(one.holds, one.cases)}"
        rows.append(
            {
                "claim": one.text,
                "from": one.source,
                "measured here": one.measured,
                "agrees": verdict,
            }
        )
    return pd.DataFrame(rows)
